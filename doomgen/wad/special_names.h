// Names of line specials, by number: the public numbering of Hexen as ZDoom extended it. The compiler of
// scripts and the engine both read them here. Stage: loading and messages.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string_view>

namespace comrad::wad {

struct SpecialName {
  int16_t number;
  std::string_view name;
};

/// By rising number; not every number has a special.
std::span<const SpecialName> special_names();

/// "Door_Open" -> 11, in any case. Nothing for what is no special's name.
std::optional<int32_t> find_special(std::string_view name);

/// 11 -> "Door_Open"; empty for what is no special's number.
std::string_view special_name(int32_t number);

}  // namespace comrad::wad
