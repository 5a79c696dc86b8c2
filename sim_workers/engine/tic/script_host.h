// Rules in C++ where a map has no scripts. Stage: tic.
#pragma once

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// A scenario's rules in C++: called at the places where the engine runs scripts. Maps with a BEHAVIOR lump
/// need none.
class ScriptHost {
 public:
  virtual ~ScriptHost() = default;
  virtual void on_open(World& world) = 0;               ///< map start, after things spawned
  virtual void on_enter(World& world, int player) = 0;  ///< a player entered
  virtual void on_tic(World& world) = 0;                ///< delayed scripts that are due
  virtual void on_death(World& world, int player) { (void)world, (void)player; }
  virtual void on_pickup(World& world, int player, const Actor& item) {
    (void)world, (void)player, (void)item;
  }
};

}  // namespace comrad::doom
