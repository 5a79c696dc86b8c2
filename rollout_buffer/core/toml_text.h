// A TOML value as text. toml++ stays out of the headers that are included everywhere.
#pragma once

#include <toml++/toml.h>
#include <optional>
#include <string>
#include <string_view>

#include "rollout_buffer/core/expected.h"

namespace comrad {

/// A text as it is, a number as the shortest that reads back the same, "true" or "false"; nothing for a list, a table or
/// a date.
std::optional<std::string> toml_scalar_text(const toml::node& node);

/// To be asked before toml++ parses `text`, for what its 3.3 does not survive: a table's header without a key
/// ("[=]" is undefined behaviour in release builds), and a key of more than 64 parts, whose tables lie in one
/// another. Errors: kBadFormat as "label:line:column: what".
Status check_toml_text(std::string_view text, const std::string& label);

}  // namespace comrad
