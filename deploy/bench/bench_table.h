// What a bench's JSON object looks like as text for people.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

namespace comrad::deploy {

/// A line for every number and text; what is an object gets a line for each of its members, named "outer.inner"; an array of
/// objects becomes its own table behind them, with the keys of its first object as heads. Ends in a line break.
std::string bench_table(const nlohmann::ordered_json& summary);

/// One value as the table shows it: whole numbers whole, others with three digits at least, shares of 1 with two.
std::string bench_cell(const nlohmann::ordered_json& value);

}  // namespace comrad::deploy
