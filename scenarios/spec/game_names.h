// The names that a scenario may use for what players press and what the game counts: ViZDoom's own. Checked
// when a scenario is read, so that a slip of the pen never becomes a variable that is always zero.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::scenarios {

/// What a button does. Binary ones are held or not; delta ones (last) take a number a tic: degrees for
/// angles, engine units (25 = the walk key) for moves. SELECT_WEAPON0..9 are one kind with a slot.
enum class ButtonKind : uint8_t {
  kAttack,
  kUse,
  kJump,
  kCrouch,
  kTurn180,
  kAltAttack,
  kReload,
  kZoom,
  kSpeed,
  kStrafe,
  kMoveRight,
  kMoveLeft,
  kMoveBackward,
  kMoveForward,
  kTurnRight,
  kTurnLeft,
  kLookUp,
  kLookDown,
  kMoveUp,
  kMoveDown,
  kLand,
  kSelectWeapon,
  kSelectNextWeapon,
  kSelectPreviousWeapon,
  kDropWeapon,
  kUseItem,
  kSelectNextItem,
  kSelectPreviousItem,
  kDropItem,
  kLookUpDownDelta,
  kTurnLeftRightDelta,
  kMoveForwardBackwardDelta,
  kMoveLeftRightDelta,
  kMoveUpDownDelta
};
struct Button {
  ButtonKind kind = ButtonKind::kMoveForward;
  int slot = 0;  ///< of kSelectWeapon
  bool is_delta() const { return kind >= ButtonKind::kLookUpDownDelta; }
};

constexpr int kUserVariables =
    60;  ///< USER1..USER60: the global variables of a script that ViZDoom hands out

/// What the game can tell about a player, or (kUser, kPlayerCount, kPlayerFragCount) about the whole world.
enum class VariableKind : uint8_t {
  kKillCount,
  kItemCount,
  kSecretCount,
  kFragCount,
  kDeathCount,
  kHitCount,
  kHitsTaken,
  kDamageCount,
  kDamageTaken,
  kHealth,
  kArmor,
  kDead,
  kOnGround,
  kAttackReady,
  kAltAttackReady,
  kSelectedWeapon,
  kSelectedWeaponAmmo,
  kAmmo,
  kWeapon,
  kPositionX,
  kPositionY,
  kPositionZ,
  kAngle,
  kPitch,
  kRoll,
  kViewHeight,
  kVelocityX,
  kVelocityY,
  kVelocityZ,
  kCameraPositionX,
  kCameraPositionY,
  kCameraPositionZ,
  kCameraAngle,
  kCameraPitch,
  kCameraRoll,
  kCameraFov,
  kPlayerNumber,
  kPlayerCount,
  kPlayerFragCount,
  kUser,
  // What the environment adds: the script's global variable 0 as a 16.16 number (ViZDoom's map reward), tics since the
  // map began, 1 once the map has ended; 1 always; 1 in the decision that ends the episode (by the game, by the limit) and in its first.
  kMapReward,
  kMapTics,
  kMapExit,
  kOne,
  kTerminated,
  kTruncated,
  kFirst
};
struct GameVariable {
  VariableKind kind = VariableKind::kHealth;
  int index = 0;  ///< of kAmmo, kWeapon: slot 0..9; of kPlayerFragCount: 1..16; of kUser: 1..60
  bool is_team_variable() const { return kind >= VariableKind::kPlayerCount; }
};

/// One choice of a head: a button that is held, or a delta button with its number a tic.
struct ButtonPress {
  Button button;
  double value = 1.0;
};

std::optional<Button> find_button(std::string_view name);
/// "ATTACK", or "TURN_LEFT_RIGHT_DELTA=-10". Errors: kBadInput naming the nearest button; for a delta button without a
/// number and a number behind another button.
Expected<ButtonPress> parse_press(std::string_view text);
std::optional<GameVariable> find_variable(std::string_view name);
/// A game variable, or one of ONE, TERMINATED, TRUNCATED, FIRST, MAP_REWARD, MAP_TICS, MAP_EXIT: what reward and measurement terms may read.
std::optional<GameVariable> find_term_variable(std::string_view name);
std::vector<std::string> button_names();
std::vector<std::string> variable_names();
std::vector<std::string> term_variable_names();

}  // namespace comrad::scenarios
