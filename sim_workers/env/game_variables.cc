#include "sim_workers/env/game_variables.h"

#include <algorithm>

#include "sim_workers/engine/play/weapons.h"

namespace comrad::sim {
namespace {

double degrees(doom::Angle angle) { return angle * (360.0 / 4294967296.0); }
double signed_degrees(doom::Angle angle) { return static_cast<int32_t>(angle) * (360.0 / 4294967296.0); }

const doom::Actor& camera_of(const doom::World& world, int player) {
  const doom::Actor* const camera = world.find_actor(world.player(player).camera_id);
  return camera != nullptr ? *camera : world.body(player);
}

}  // namespace

double read_variable(const doom::World& world, int player, const scenarios::GameVariable& variable) {
  using scenarios::VariableKind;
  const doom::Player& state = world.player(player);
  const doom::Actor& body = world.body(player);
  switch (variable.kind) {
    case VariableKind::kKillCount:
      return world.state().kill_total;
    case VariableKind::kItemCount:
      return state.item_count;
    case VariableKind::kSecretCount:
      return state.secret_count;
    case VariableKind::kFragCount:
      return state.frag_count;
    case VariableKind::kDeathCount:
      return state.death_count;
    case VariableKind::kHitCount:
      return state.hits_dealt;
    case VariableKind::kHitsTaken:
      return state.hits_taken;
    case VariableKind::kDamageCount:
      return state.damage_dealt;
    case VariableKind::kDamageTaken:
      return state.damage_taken;
    case VariableKind::kHealth:
      return std::max(0, state.health);
    case VariableKind::kArmor:
      return state.armor;
    case VariableKind::kDead:
      return state.alive ? 0.0 : 1.0;
    case VariableKind::kOnGround:
      return state.on_ground;
    case VariableKind::kAttackReady:
    case VariableKind::kAltAttackReady:
      return state.weapon_ready;
    case VariableKind::kSelectedWeapon:
      return doom::selected_slot(world, player);
    case VariableKind::kSelectedWeaponAmmo:
      return doom::selected_ammo(world, player);
    case VariableKind::kAmmo:
      return doom::ammo_of_slot(world, player, variable.index);
    case VariableKind::kWeapon:
      return doom::weapons_of_slot(world, player, variable.index);
    case VariableKind::kPositionX:
      return doom::to_double(body.x);
    case VariableKind::kPositionY:
      return doom::to_double(body.y);
    case VariableKind::kPositionZ:
      return doom::to_double(body.z);
    case VariableKind::kAngle:
      return degrees(body.angle);
    case VariableKind::kPitch:
      return signed_degrees(body.pitch);
    case VariableKind::kRoll:
    case VariableKind::kCameraRoll:
      return 0.0;
    case VariableKind::kViewHeight:
      return doom::to_double(state.view_z - body.z);  // with the bob
    case VariableKind::kVelocityX:
      return doom::to_double(body.velocity_x);
    case VariableKind::kVelocityY:
      return doom::to_double(body.velocity_y);
    case VariableKind::kVelocityZ:
      return doom::to_double(body.velocity_z);
    case VariableKind::kCameraPositionX:
      return doom::to_double(camera_of(world, player).x);
    case VariableKind::kCameraPositionY:
      return doom::to_double(camera_of(world, player).y);
    case VariableKind::kCameraPositionZ: {
      const doom::Actor& camera = camera_of(world, player);
      return doom::to_double(camera.id == body.id ? state.view_z : camera.z);
    }
    case VariableKind::kCameraAngle:
      return degrees(camera_of(world, player).angle);
    case VariableKind::kCameraPitch:
      return signed_degrees(camera_of(world, player).pitch);
    case VariableKind::kCameraFov:
      return camera_of(world, player).id == body.id ? state.field_of_view : doom::kFieldOfView;
    case VariableKind::kPlayerNumber:
      return player;
    case VariableKind::kPlayerCount:
      return world.player_count();
    case VariableKind::kPlayerFragCount:
      return world.is_multiplayer() && variable.index <= world.player_count()  // as ViZDoom: 0 for one alone
                 ? world.player(variable.index - 1).frag_count
                 : 0;
    case VariableKind::kUser:
      return world.exported(variable.index);
    case VariableKind::kMapReward:
      return world.state().globals[0] / 65536.0;
    case VariableKind::kMapTics:
      return static_cast<double>(world.tic_count());
    case VariableKind::kMapExit:
      return world.level_exited();
    case VariableKind::kOne:
      return 1.0;
    case VariableKind::kTerminated:  // set by the environment (doom_env.cc)
    case VariableKind::kTruncated:
    case VariableKind::kFirst:
      return 0.0;
  }
  return 0.0;
}

}  // namespace comrad::sim
