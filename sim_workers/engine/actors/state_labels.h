// Labels of states: the names that the engine itself looks for, and how a type's own come on top of those it
// inherits. Stage: loading.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "sim_workers/engine/actors/actor_type.h"

namespace comrad::doom {

/// The engine's own label called `name`, in any case; nothing for others.
std::optional<StateLabel> find_state_label(std::string_view name);

/// Makes `name` lead to `state` (kNoState: to removal), in the list of labels and in ActorType::states.
void set_label(ActorType* type, std::string_view name, uint32_t state);

}  // namespace comrad::doom
