// The names that DECORATE lumps and scripts give to flags, damage types, render styles and numbers. Stage:
// loading and tic.
#pragma once

#include <cstdint>
#include <optional>
#include <string_view>

#include "sim_workers/engine/actors/actor_type.h"

namespace comrad::doom {

/// The flag called `name` (SOLID, WEAPON.NOAUTOFIRE, NoAutoFire), in any case.
std::optional<ActorFlag> find_flag(std::string_view name);
/// False for flags that are kept for scripts to ask about and do nothing: nothing bounces, nothing is pushed.
bool has_effect(ActorFlag flag);
/// True for flags that mean nothing here (sounds, decals, other games) and may be set in silence.
bool is_idle_flag(std::string_view name);
/// The damage type called `name`; nothing for names that a lump defines (see
/// ActorCatalog::find_damage_type).
std::optional<DamageType> find_damage_type(std::string_view name);
std::string_view damage_type_name(DamageType type);  ///< lower case; "normal" for plain damage
std::optional<RenderStyle> find_render_style(std::string_view name);
/// "Invulnerable" or "PowerInvulnerable".
std::optional<PowerKind> find_power(std::string_view name);
/// The number that an action function's argument has as a word: CHF_RESURRECT, true, SXF_SETMASTER ...
std::optional<int32_t> find_constant(std::string_view name);

}  // namespace comrad::doom
