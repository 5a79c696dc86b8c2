#include "scenarios/spec/game_names.h"

#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <cmath>
#include <utility>

#include "rollout_buffer/core/text.h"

namespace comrad::scenarios {
namespace {

constexpr std::pair<std::string_view, ButtonKind> kButtons[] = {
    {"ATTACK", ButtonKind::kAttack},
    {"USE", ButtonKind::kUse},
    {"JUMP", ButtonKind::kJump},
    {"CROUCH", ButtonKind::kCrouch},
    {"TURN180", ButtonKind::kTurn180},
    {"ALTATTACK", ButtonKind::kAltAttack},
    {"RELOAD", ButtonKind::kReload},
    {"ZOOM", ButtonKind::kZoom},
    {"SPEED", ButtonKind::kSpeed},
    {"STRAFE", ButtonKind::kStrafe},
    {"MOVE_RIGHT", ButtonKind::kMoveRight},
    {"MOVE_LEFT", ButtonKind::kMoveLeft},
    {"MOVE_BACKWARD", ButtonKind::kMoveBackward},
    {"MOVE_FORWARD", ButtonKind::kMoveForward},
    {"TURN_RIGHT", ButtonKind::kTurnRight},
    {"TURN_LEFT", ButtonKind::kTurnLeft},
    {"LOOK_UP", ButtonKind::kLookUp},
    {"LOOK_DOWN", ButtonKind::kLookDown},
    {"MOVE_UP", ButtonKind::kMoveUp},
    {"MOVE_DOWN", ButtonKind::kMoveDown},
    {"LAND", ButtonKind::kLand},
    {"SELECT_NEXT_WEAPON", ButtonKind::kSelectNextWeapon},
    {"SELECT_PREV_WEAPON", ButtonKind::kSelectPreviousWeapon},
    {"DROP_SELECTED_WEAPON", ButtonKind::kDropWeapon},
    {"ACTIVATE_SELECTED_ITEM", ButtonKind::kUseItem},
    {"SELECT_NEXT_ITEM", ButtonKind::kSelectNextItem},
    {"SELECT_PREV_ITEM", ButtonKind::kSelectPreviousItem},
    {"DROP_SELECTED_ITEM", ButtonKind::kDropItem},
    {"LOOK_UP_DOWN_DELTA", ButtonKind::kLookUpDownDelta},
    {"TURN_LEFT_RIGHT_DELTA", ButtonKind::kTurnLeftRightDelta},
    {"MOVE_FORWARD_BACKWARD_DELTA", ButtonKind::kMoveForwardBackwardDelta},
    {"MOVE_LEFT_RIGHT_DELTA", ButtonKind::kMoveLeftRightDelta},
    {"MOVE_UP_DOWN_DELTA", ButtonKind::kMoveUpDownDelta},
};
constexpr std::pair<std::string_view, VariableKind> kVariables[] = {
    {"KILLCOUNT", VariableKind::kKillCount},
    {"ITEMCOUNT", VariableKind::kItemCount},
    {"SECRETCOUNT", VariableKind::kSecretCount},
    {"FRAGCOUNT", VariableKind::kFragCount},
    {"DEATHCOUNT", VariableKind::kDeathCount},
    {"HITCOUNT", VariableKind::kHitCount},
    {"HITS_TAKEN", VariableKind::kHitsTaken},
    {"DAMAGECOUNT", VariableKind::kDamageCount},
    {"DAMAGE_TAKEN", VariableKind::kDamageTaken},
    {"HEALTH", VariableKind::kHealth},
    {"ARMOR", VariableKind::kArmor},
    {"DEAD", VariableKind::kDead},
    {"ON_GROUND", VariableKind::kOnGround},
    {"ATTACK_READY", VariableKind::kAttackReady},
    {"ALTATTACK_READY", VariableKind::kAltAttackReady},
    {"SELECTED_WEAPON", VariableKind::kSelectedWeapon},
    {"SELECTED_WEAPON_AMMO", VariableKind::kSelectedWeaponAmmo},
    {"POSITION_X", VariableKind::kPositionX},
    {"POSITION_Y", VariableKind::kPositionY},
    {"POSITION_Z", VariableKind::kPositionZ},
    {"ANGLE", VariableKind::kAngle},
    {"PITCH", VariableKind::kPitch},
    {"ROLL", VariableKind::kRoll},
    {"VIEW_HEIGHT", VariableKind::kViewHeight},
    {"VELOCITY_X", VariableKind::kVelocityX},
    {"VELOCITY_Y", VariableKind::kVelocityY},
    {"VELOCITY_Z", VariableKind::kVelocityZ},
    {"CAMERA_POSITION_X", VariableKind::kCameraPositionX},
    {"CAMERA_POSITION_Y", VariableKind::kCameraPositionY},
    {"CAMERA_POSITION_Z", VariableKind::kCameraPositionZ},
    {"CAMERA_ANGLE", VariableKind::kCameraAngle},
    {"CAMERA_PITCH", VariableKind::kCameraPitch},
    {"CAMERA_ROLL", VariableKind::kCameraRoll},
    {"CAMERA_FOV", VariableKind::kCameraFov},
    {"PLAYER_NUMBER", VariableKind::kPlayerNumber},
    {"PLAYER_COUNT", VariableKind::kPlayerCount},
};
constexpr std::pair<std::string_view, VariableKind> kTermVariables[] = {
    {"MAP_REWARD", VariableKind::kMapReward},  {"MAP_TICS", VariableKind::kMapTics},
    {"MAP_EXIT", VariableKind::kMapExit},      {"ONE", VariableKind::kOne},
    {"TERMINATED", VariableKind::kTerminated}, {"TRUNCATED", VariableKind::kTruncated},
    {"FIRST", VariableKind::kFirst},
};
constexpr std::string_view kSelectWeapon = "SELECT_WEAPON";

/// Names that end in a number.
struct NumberedVariable {
  std::string_view prefix, suffix;
  VariableKind kind;
  int low, high;
};
constexpr NumberedVariable kNumbered[] = {
    {"AMMO", "", VariableKind::kAmmo, 0, 9},
    {"WEAPON", "", VariableKind::kWeapon, 0, 9},
    {"PLAYER", "_FRAGCOUNT", VariableKind::kPlayerFragCount, 1, 16},
    {"USER", "", VariableKind::kUser, 1, kUserVariables},
};

/// The number between `prefix` and `suffix`, when all between is one without leading zero.
std::optional<int> number_in(std::string_view name, std::string_view prefix, std::string_view suffix) {
  if (name.size() <= prefix.size() + suffix.size() || !name.starts_with(prefix) || !name.ends_with(suffix))
    return std::nullopt;
  name.remove_prefix(prefix.size());
  name.remove_suffix(suffix.size());
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
  if (const auto slot = number_in(name, kSelectWeapon, ""); slot && *slot >= 0 && *slot <= 9)
    return Button{ButtonKind::kSelectWeapon, *slot};
  return std::nullopt;
}

Expected<ButtonPress> parse_press(std::string_view text) {
  const std::size_t equals = text.find('=');
  const std::string name(text.substr(0, equals));
  const std::optional<Button> button = find_button(name);
  if (!button) return Error{ErrorCode::kBadInput, unknown_word("button", name, button_names())};
  ButtonPress press{*button};
  if (equals == std::string_view::npos) {
    if (button->is_delta())
      return Error{ErrorCode::kBadInput, "'" + name + "' takes a number: write " + name + "=10"};
    return press;
  }
  const std::string_view number = text.substr(equals + 1);
  const char* const begin = number.data() + (number.starts_with('+') ? 1 : 0);
  const auto [end, error] = std::from_chars(begin, number.data() + number.size(), press.value);
  if (!button->is_delta() || error != std::errc() || end != number.data() + number.size() ||
      !std::isfinite(press.value))
    return Error{ErrorCode::kBadInput,
                 "'" + std::string(text) + "': " +
                     (button->is_delta() ? "behind '=' stands no number"
                                         : name + " is held or not; leave the number out")};
  return press;
}

std::optional<GameVariable> find_variable(std::string_view name) {
  for (const auto& [known, kind] : kVariables)
    if (name == known) return GameVariable{kind, 0};
  for (const NumberedVariable& numbered : kNumbered)
    if (const auto index = number_in(name, numbered.prefix, numbered.suffix);
        index && *index >= numbered.low && *index <= numbered.high)
      return GameVariable{numbered.kind, *index};
  return std::nullopt;
}

std::optional<GameVariable> find_term_variable(std::string_view name) {
  for (const auto& [known, kind] : kTermVariables)
    if (name == known) return GameVariable{kind, 0};
  return find_variable(name);
}

std::vector<std::string> button_names() {
  std::vector<std::string> names;
  for (const auto& [name, kind] : kButtons) names.emplace_back(name);
  for (int slot = 0; slot <= 9; ++slot) names.push_back(fmt::format("{}{}", kSelectWeapon, slot));
  return names;
}

std::vector<std::string> variable_names() {
  std::vector<std::string> names;
  for (const auto& [name, kind] : kVariables) names.emplace_back(name);
  for (const NumberedVariable& numbered : kNumbered)
    for (int index = numbered.low; index <= numbered.high; ++index)
      names.push_back(fmt::format("{}{}{}", numbered.prefix, index, numbered.suffix));
  return names;
}

std::vector<std::string> term_variable_names() {
  std::vector<std::string> names = variable_names();
  for (const auto& [name, kind] : kTermVariables) names.emplace_back(name);
  return names;
}

}  // namespace comrad::scenarios
