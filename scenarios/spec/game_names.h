// The names that a scenario may use for what players press and what the game counts: ViZDoom's own. Checked
// when a scenario is read, so that a slip of the pen never becomes a variable that is always zero.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace comrad::scenarios {

/// What a button does. SELECT_WEAPON0..9 are one kind with a slot.
enum class ButtonKind : uint8_t {
  kMoveForward,
  kMoveBackward,
  kMoveLeft,
  kMoveRight,
  kTurnLeft,
  kTurnRight,
  kAttack,
  kUse,
  kJump,
  kSpeed,
  kSelectWeapon
};
struct Button {
  ButtonKind kind = ButtonKind::kMoveForward;
  int slot = 0;  ///< of kSelectWeapon
};

/// What the game can tell about a player (the first ones) or the whole world (kUser, from 1: exported by
/// scripts).
enum class VariableKind : uint8_t {
  kHealth,
  kArmor,
  kDead,
  kDamageTaken,
  kItemCount,
  kKillCount,
  kPositionX,
  kPositionY,
  kPositionZ,
  kAngle,
  kVelocityX,
  kVelocityY,
  kVelocityZ,
  kUser
};
struct GameVariable {
  VariableKind kind = VariableKind::kHealth;
  int index = 0;  ///< of kUser: 1..60
  bool is_team_variable() const { return kind == VariableKind::kUser; }
};

std::optional<Button> find_button(std::string_view name);
std::optional<GameVariable> find_variable(std::string_view name);
std::vector<std::string> button_names();
std::vector<std::string> variable_names();

}  // namespace comrad::scenarios
