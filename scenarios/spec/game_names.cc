#include "scenarios/spec/game_names.h"

#include <charconv>
#include <utility>

namespace comrad::scenarios {
namespace {

constexpr std::pair<std::string_view, ButtonKind> kButtons[] = {
    {"MOVE_FORWARD", ButtonKind::kMoveForward},
    {"MOVE_BACKWARD", ButtonKind::kMoveBackward},
    {"MOVE_LEFT", ButtonKind::kMoveLeft},
    {"MOVE_RIGHT", ButtonKind::kMoveRight},
    {"TURN_LEFT", ButtonKind::kTurnLeft},
    {"TURN_RIGHT", ButtonKind::kTurnRight},
    {"ATTACK", ButtonKind::kAttack},
    {"USE", ButtonKind::kUse},
    {"JUMP", ButtonKind::kJump},
    {"SPEED", ButtonKind::kSpeed},
};
constexpr std::pair<std::string_view, VariableKind> kVariables[] = {
    {"HEALTH", VariableKind::kHealth},
    {"ARMOR", VariableKind::kArmor},
    {"DEAD", VariableKind::kDead},
    {"DAMAGE_TAKEN", VariableKind::kDamageTaken},
    {"ITEMCOUNT", VariableKind::kItemCount},
    {"KILLCOUNT", VariableKind::kKillCount},
    {"POSITION_X", VariableKind::kPositionX},
    {"POSITION_Y", VariableKind::kPositionY},
    {"POSITION_Z", VariableKind::kPositionZ},
    {"ANGLE", VariableKind::kAngle},
    {"VELOCITY_X", VariableKind::kVelocityX},
    {"VELOCITY_Y", VariableKind::kVelocityY},
    {"VELOCITY_Z", VariableKind::kVelocityZ},
};
constexpr std::string_view kSelectWeapon = "SELECT_WEAPON", kUser = "USER";
constexpr int kUserCount = 60;

/// The number behind `prefix`, when the rest of `name` is one without leading zero.
std::optional<int> number_after(std::string_view name, std::string_view prefix) {
  if (!name.starts_with(prefix)) return std::nullopt;
  name.remove_prefix(prefix.size());
  int value = 0;
  const auto [end, error] = std::from_chars(name.data(), name.data() + name.size(), value);
  if (error != std::errc() || end != name.data() + name.size() || std::to_string(value) != name)
    return std::nullopt;
  return value;
}

}  // namespace

std::optional<Button> find_button(std::string_view name) {
  for (const auto& [known, kind] : kButtons)
    if (name == known) return Button{kind, 0};
  if (const auto slot = number_after(name, kSelectWeapon); slot && *slot >= 0 && *slot <= 9)
    return Button{ButtonKind::kSelectWeapon, *slot};
  return std::nullopt;
}

std::optional<GameVariable> find_variable(std::string_view name) {
  for (const auto& [known, kind] : kVariables)
    if (name == known) return GameVariable{kind, 0};
  if (const auto index = number_after(name, kUser); index && *index >= 1 && *index <= kUserCount)
    return GameVariable{VariableKind::kUser, *index};
  return std::nullopt;
}

std::vector<std::string> button_names() {
  std::vector<std::string> names;
  for (const auto& [name, kind] : kButtons) names.emplace_back(name);
  for (int slot = 0; slot <= 9; ++slot) names.push_back(std::string(kSelectWeapon) + std::to_string(slot));
  return names;
}

std::vector<std::string> variable_names() {
  std::vector<std::string> names;
  for (const auto& [name, kind] : kVariables) names.emplace_back(name);
  for (int index = 1; index <= kUserCount; ++index)
    names.push_back(std::string(kUser) + std::to_string(index));
  return names;
}

}  // namespace comrad::scenarios
