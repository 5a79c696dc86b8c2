// Properties of DECORATE actors: "Health 100", "Weapon.AmmoType Clip". Stage: loading.
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sim_workers/engine/actors/actor_catalog.h"
#include "sim_workers/engine/actors/decorate_expression.h"

namespace comrad::doom {

/// What a property's handler works on.
struct PropertyTarget {
  ActorCatalog* catalog = nullptr;
  ActorType* type = nullptr;
  std::function<void(const std::string& what)> warn;
  bool own_drops = false, own_start_items = false;  ///< lists begin anew in the type that names one
};

enum class PropertyShape : uint8_t { kUnknown, kValues, kNoValues };

/// How `name` (lower case) is written; kUnknown for names that this engine does not know.
PropertyShape property_shape(std::string_view name);

/// Applies a known property. Something: what is wrong with its values.
std::optional<std::string> apply_property(PropertyTarget* target, std::string_view name,
                                          std::span<const DecorateValue> values);

}  // namespace comrad::doom
