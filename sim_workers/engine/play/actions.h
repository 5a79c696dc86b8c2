// Action functions: what states do when they begin. One function per name of actors/action_id.h; the table
// that finds them is play/actions.cc. Stage: tic.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "sim_workers/engine/actors/action_id.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// What an action function is called with, and what it answers.
struct ActionCall {
  World& world;
  Actor& self;               ///< of a weapon's state: the player's body
  Player* player = nullptr;  ///< whose weapon it is; null outside weapon states
  int layer = 0;             ///< weapon_sprites[layer]; 0 weapon, 1 flash
  const State& state;
  std::span<const ActionArg> args;
  uint32_t jump = kNoState;  ///< set it to go to another state instead of waiting in this one
  bool has_jump = false;
  bool succeeded = true;  ///< false: nothing was given or done; items whose Pickup states all fail stay

  std::size_t arg_count() const { return args.size(); }
  int32_t integer(std::size_t index, int32_t fallback = 0) const;  ///< a range is drawn anew at each call
  Fixed fixed(std::size_t index, Fixed fallback = 0) const;
  bool boolean(std::size_t index, bool fallback = false) const { return integer(index, fallback) != 0; }
  uint32_t type(std::size_t index, uint32_t fallback = kNoType) const;
  uint32_t label(std::size_t index) const;  ///< state index
  void go_to(uint32_t target) { jump = target, has_jump = true; }
};

using ActionFunction = void (*)(ActionCall& call);

#define COMRAD_ACTION(name) void action_##name(ActionCall& call);
COMRAD_ACTOR_ACTIONS(COMRAD_ACTION)
COMRAD_WEAPON_ACTIONS(COMRAD_ACTION)
#undef COMRAD_ACTION

/// Runs the action of `state`, if it has one.
void run_action(ActionCall& call);

}  // namespace comrad::doom
