#include "doomgen/wad/special_names.h"

#include <algorithm>
#include <string>
#include <unordered_map>

#include "rollout_buffer/core/text.h"

namespace comrad::wad {
namespace {

constexpr SpecialName kSpecials[] = {
#define COMRAD_SPECIAL_ROW(number, name, support) {number, #name, SpecialSupport::support},
    COMRAD_SPECIALS(COMRAD_SPECIAL_ROW)
#undef COMRAD_SPECIAL_ROW
};

}  // namespace

std::span<const SpecialName> special_names() { return kSpecials; }

std::optional<int32_t> find_special(std::string_view name) {
  static const auto by_name = [] {
    std::unordered_map<std::string, int32_t> all;
    for (const SpecialName& special : kSpecials) all.emplace(lower_case(special.name), special.number);
    return all;
  }();
  const auto found = by_name.find(lower_case(name));
  return found != by_name.end() ? std::optional(found->second) : std::nullopt;
}

std::string_view special_name(int32_t number) {
  const auto* const found =
      std::lower_bound(std::begin(kSpecials), std::end(kSpecials), number,
                       [](const SpecialName& special, int32_t wanted) { return special.number < wanted; });
  return found != std::end(kSpecials) && found->number == number ? found->name : std::string_view{};
}

}  // namespace comrad::wad
