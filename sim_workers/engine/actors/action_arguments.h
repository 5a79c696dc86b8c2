// What the arguments of action functions mean, where they are not plain numbers. Stage: loading.
#pragma once

#include <cstddef>
#include <cstdint>

#include "sim_workers/engine/actors/action_id.h"

namespace comrad::doom {

enum class ArgumentMeaning : uint8_t { kNumber, kClass, kLabel, kText };

/// The meaning of argument `index` of an action function.
ArgumentMeaning argument_meaning(ActionId action, std::size_t index);

}  // namespace comrad::doom
