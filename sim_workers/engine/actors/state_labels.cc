#include "sim_workers/engine/actors/state_labels.h"

#include <array>
#include <cstddef>

#include "rollout_buffer/core/text.h"

namespace comrad::doom {
namespace {

constexpr std::array<std::string_view, static_cast<std::size_t>(StateLabel::kCount)> kLabelNames = {
    "spawn", "see",   "melee",   "missile",  "pain",  "death", "xdeath", "crash",    "raise",
    "heal",  "idle",  "active",  "inactive", "wound", "ready", "select", "deselect", "fire",
    "hold",  "flash", "altfire", "pickup",   "use",   "drop",  "crush"};

}  // namespace

std::optional<StateLabel> find_state_label(std::string_view name) {
  for (std::size_t label = 0; label < kLabelNames.size(); ++label)
    if (same_ignoring_case(kLabelNames[label], name)) return static_cast<StateLabel>(label);
  return std::nullopt;
}

void set_label(ActorType* type, std::string_view name, uint32_t state) {
  if (const std::optional<StateLabel> label = find_state_label(name))
    type->states[static_cast<std::size_t>(*label)] = state;
  for (ActorType::Label& label : type->labels)
    if (same_ignoring_case(label.name, name)) {
      label.state = state;
      return;
    }
  type->labels.push_back({lower_case(name), state});
}

}  // namespace comrad::doom
