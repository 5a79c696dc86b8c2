#include "sim_workers/engine/actors/action_id.h"

#include <array>
#include <cstddef>
#include <string>
#include <unordered_map>

#include "rollout_buffer/core/text.h"

namespace comrad::doom {
namespace {

constexpr std::array<std::string_view, static_cast<std::size_t>(ActionId::kCount)> kNames = {
    "",
#define COMRAD_ACTION(name) #name,
    COMRAD_ACTOR_ACTIONS(COMRAD_ACTION) COMRAD_WEAPON_ACTIONS(COMRAD_ACTION)
#undef COMRAD_ACTION
};

}  // namespace

std::optional<ActionId> find_action(std::string_view name) {
  static const std::unordered_map<std::string, ActionId> by_name = [] {
    std::unordered_map<std::string, ActionId> all;
    for (std::size_t id = 1; id < kNames.size(); ++id)
      all.emplace(lower_case(kNames[id]), static_cast<ActionId>(id));
    return all;
  }();
  std::string lower = lower_case(name);
  if (lower.starts_with("a_")) lower.erase(0, 2);
  const auto found = by_name.find(lower);
  if (found == by_name.end()) return std::nullopt;
  return found->second;
}

std::string_view action_name(ActionId id) {
  const auto index = static_cast<std::size_t>(id);
  return index < kNames.size() ? kNames[index] : std::string_view();
}

}  // namespace comrad::doom
