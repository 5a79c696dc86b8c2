#include "sim_workers/env/button_press.h"

#include <algorithm>
#include <cmath>

namespace comrad::sim {
namespace {

/// Beyond these nothing changes: moves are clamped to 50, and a turn repeats.
constexpr double kMoveMax = 1000.0, kDegreesMax = 3600.0;

int32_t move_units(double value) {
  return std::isnan(value) ? 0 : static_cast<int32_t>(std::floor(std::clamp(value, -kMoveMax, kMoveMax)));
}

int32_t angle_units(double degrees) {
  if (!std::isfinite(degrees)) return 0;
  return static_cast<int32_t>(std::floor(std::clamp(degrees, -kDegreesMax, kDegreesMax) * 32768.0 / 180.0));
}

}  // namespace

void press(doom::Buttons& buttons, const scenarios::Button& button, double value) {
  using scenarios::ButtonKind;
  const bool held = value != 0.0 && !std::isnan(value);
  if (!button.is_delta() && !held) return;
  switch (button.kind) {
    case ButtonKind::kAttack:
      buttons.attack = true;
      break;
    case ButtonKind::kUse:
      buttons.use = true;
      break;
    case ButtonKind::kJump:
      buttons.jump = true;
      break;
    case ButtonKind::kCrouch:
      buttons.crouch = true;
      break;
    case ButtonKind::kTurn180:
      buttons.turn_180 = true;
      break;
    case ButtonKind::kAltAttack:
      buttons.alt_attack = true;
      break;
    case ButtonKind::kReload:
      buttons.reload = true;
      break;
    case ButtonKind::kZoom:
      buttons.zoom = true;
      break;
    case ButtonKind::kSpeed:
      buttons.speed = true;
      break;
    case ButtonKind::kStrafe:
      buttons.strafe = true;
      break;
    case ButtonKind::kMoveRight:
      buttons.right = true;
      break;
    case ButtonKind::kMoveLeft:
      buttons.left = true;
      break;
    case ButtonKind::kMoveBackward:
      buttons.backward = true;
      break;
    case ButtonKind::kMoveForward:
      buttons.forward = true;
      break;
    case ButtonKind::kTurnRight:
      buttons.turn_right = true;
      break;
    case ButtonKind::kTurnLeft:
      buttons.turn_left = true;
      break;
    case ButtonKind::kLookUp:
      buttons.look_up = true;
      break;
    case ButtonKind::kLookDown:
      buttons.look_down = true;
      break;
    case ButtonKind::kMoveUp:
      buttons.move_up = true;
      break;
    case ButtonKind::kMoveDown:
      buttons.move_down = true;
      break;
    case ButtonKind::kLand:
      buttons.land = true;
      break;
    case ButtonKind::kSelectWeapon:
      buttons.select_weapon = static_cast<int8_t>(button.slot);
      break;
    case ButtonKind::kSelectNextWeapon:
      buttons.select_next_weapon = true;
      break;
    case ButtonKind::kSelectPreviousWeapon:
      buttons.select_previous_weapon = true;
      break;
    case ButtonKind::kDropWeapon:
      buttons.drop_weapon = true;
      break;
    case ButtonKind::kUseItem:
      buttons.use_item = true;
      break;
    case ButtonKind::kSelectNextItem:
      buttons.select_next_item = true;
      break;
    case ButtonKind::kSelectPreviousItem:
      buttons.select_previous_item = true;
      break;
    case ButtonKind::kDropItem:
      break;  // nothing is thrown away (sim_workers/NOTES.md, Known differences)
    case ButtonKind::kLookUpDownDelta:
      buttons.pitch_delta += angle_units(value);
      break;
    case ButtonKind::kTurnLeftRightDelta:
      buttons.yaw_delta += angle_units(value);
      break;
    case ButtonKind::kMoveForwardBackwardDelta:
      buttons.forward_delta += move_units(value);
      break;
    case ButtonKind::kMoveLeftRightDelta:
      buttons.side_delta += move_units(value);
      break;
    case ButtonKind::kMoveUpDownDelta:
      buttons.up_delta += move_units(value);
      break;
  }
}

}  // namespace comrad::sim
