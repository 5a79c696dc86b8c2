// Tables for other programs.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

namespace comrad::deploy {

/// Objects of the same keys as CSV (RFC 4180, lines end in \n): a header, then a line each. A list becomes columns
/// KEY_0, KEY_1, ... of the longest one among the rows; null and numbers that are none become empty fields.
std::string csv_text(const std::vector<nlohmann::ordered_json>& rows);

/// The same as JSON, an object a line.
std::string json_lines(const std::vector<nlohmann::ordered_json>& rows);

}  // namespace comrad::deploy
