// What the functions of scripts work on: the world, the running script and its activator. Stage: tic.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/world/machine_state.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom::acs {

/// Places of Behavior::first_time() besides the p-codes.
enum WarningIndex : std::size_t {
  kWarnFunction = bytecode::kPCodeCount,  ///< + number of a CallFunc function, below 256
  kWarnProperty = kWarnFunction + 256,    ///< + actor property, below 128
  kWarnName = kWarnProperty + 128,        ///< + string number % 256
  kWarnString = kWarnName + 256,
  kWarnElement,
  kWarnThreads,
  kWarnError,
  kWarnMonsterInventory,
};

struct Caller {
  World& world;
  const Behavior& behavior;
  Thread& thread;

  MachineState& machine() const { return world.state().scripts; }
  /// Null: the world, or an actor that is gone.
  Actor* activator() const;
  /// The player that the activator is; -1 none.
  int activator_player() const;
  /// As scripts name actors: 0 the activator, else the one that got this thing id last. May be null.
  Actor* one_actor(int32_t thing_id) const {
    return thing_id == 0 ? activator() : world.find_thing(thing_id);
  }
  /// 0: the activator; else every actor with this thing id that there is now. Returns how many.
  template <typename Visit>
  int32_t each_actor(int32_t thing_id, Visit visit) const {
    return world.each_thing(thing_id, activator(), visit);
  }
  /// Another actor as seen from one: 0 itself, 1 nobody, 2 target, 4 master, 8 tracer, 16 whom a player aims
  /// at, 64 << n player n.
  Actor* pointer_of(Actor* actor, int32_t selector) const;

  std::string_view text(int32_t index) const;
  /// The actor type that a string names; nothing (and one warning) where there is none.
  std::optional<uint32_t> type_named(int32_t string_index) const;
  /// One warning per behavior: `what` does nothing here.
  void unsupported(std::size_t warning_index, std::string_view what) const;
  void warn(std::size_t warning_index, const std::string& message) const;
  std::string script_label() const;
};

}  // namespace comrad::doom::acs
