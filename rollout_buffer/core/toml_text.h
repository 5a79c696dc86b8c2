// A TOML value as text. toml++ stays out of the headers that everybody includes.
#pragma once

#include <toml++/toml.h>
#include <optional>
#include <string>

namespace comrad {

/// A text as it is, a number as the shortest that reads back the same, "true" or "false"; nothing for a list, a table or
/// a date.
std::optional<std::string> toml_scalar_text(const toml::node& node);

}  // namespace comrad
