#include "sim_workers/env/game_variables.h"

#include <algorithm>

namespace comrad::sim {

double read_variable(const doom::World& world, int player, const scenarios::GameVariable& variable) {
  using scenarios::VariableKind;
  const doom::Player& state = world.player(player);
  switch (variable.kind) {
    case VariableKind::kHealth:
      return std::max(0, state.health);
    case VariableKind::kArmor:
      return state.armor;
    case VariableKind::kDead:
      return state.alive ? 0.0 : 1.0;
    case VariableKind::kDamageTaken:
      return state.damage_taken;
    case VariableKind::kItemCount:
      return state.pickup_count;
    case VariableKind::kKillCount:
      return 0.0;  // nothing in the engine can be killed by a player yet
    case VariableKind::kPositionX:
      return doom::to_double(world.body(player).x);
    case VariableKind::kPositionY:
      return doom::to_double(world.body(player).y);
    case VariableKind::kPositionZ:
      return doom::to_double(world.body(player).z);
    case VariableKind::kAngle:
      return world.body(player).angle * (360.0 / 4294967296.0);
    case VariableKind::kVelocityX:
      return doom::to_double(world.body(player).velocity_x);
    case VariableKind::kVelocityY:
      return doom::to_double(world.body(player).velocity_y);
    case VariableKind::kVelocityZ:
      return doom::to_double(world.body(player).velocity_z);
    case VariableKind::kUser:
      return world.exported(variable.index);
  }
  return 0.0;
}

}  // namespace comrad::sim
