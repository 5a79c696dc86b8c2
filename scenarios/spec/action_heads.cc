#include "scenarios/spec/action_heads.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "rollout_buffer/core/text.h"
#include "scenarios/spec/game_names.h"

namespace comrad::scenarios {
namespace {

constexpr std::size_t kMostChoices = 31;

/// What a delta button may be given: two steps to each side. Moves: the walk and the run key.
constexpr const char* kTurnSteps[] = {"-10", "-3", "3", "10"};
constexpr const char* kMoveSteps[] = {"-50", "-25", "25", "50"};

/// What a button belongs to; of one such thing at a time can be done. Others stand alone: -1.
int axis_of(const Button& button) {
  switch (button.kind) {
    case ButtonKind::kMoveForward:
    case ButtonKind::kMoveBackward:
    case ButtonKind::kMoveForwardBackwardDelta:
      return 0;
    case ButtonKind::kMoveLeft:
    case ButtonKind::kMoveRight:
    case ButtonKind::kMoveLeftRightDelta:
      return 1;
    case ButtonKind::kTurnLeft:
    case ButtonKind::kTurnRight:
    case ButtonKind::kTurn180:
    case ButtonKind::kTurnLeftRightDelta:
      return 2;
    case ButtonKind::kLookUp:
    case ButtonKind::kLookDown:
    case ButtonKind::kLookUpDownDelta:
      return 3;
    case ButtonKind::kJump:
    case ButtonKind::kCrouch:
    case ButtonKind::kMoveUp:
    case ButtonKind::kMoveDown:
    case ButtonKind::kLand:
    case ButtonKind::kMoveUpDownDelta:
      return 4;
    case ButtonKind::kSelectWeapon:
    case ButtonKind::kSelectNextWeapon:
    case ButtonKind::kSelectPreviousWeapon:
    case ButtonKind::kDropWeapon:
      return 5;
    case ButtonKind::kUseItem:
    case ButtonKind::kSelectNextItem:
    case ButtonKind::kSelectPreviousItem:
    case ButtonKind::kDropItem:
      return 6;
    case ButtonKind::kSpeed:
    case ButtonKind::kStrafe:
      return 7;
    case ButtonKind::kUse:
    case ButtonKind::kReload:
    case ButtonKind::kZoom:
      return 8;
    case ButtonKind::kAttack:
    case ButtonKind::kAltAttack:
      return -1;
  }
  return -1;
}

/// The names of buttons that the heads press, without numbers.
std::vector<std::string> buttons_of(const std::vector<ActionHead>& heads) {
  std::vector<std::string> names;
  for (const ActionHead& head : heads)
    for (const std::string& choice : head.buttons) {
      const std::string name = choice.substr(0, choice.find('='));
      if (std::ranges::count(names, name) == 0) names.push_back(name);
    }
  return names;
}

std::vector<std::string> parts_of(std::string_view text, char separator) {
  std::vector<std::string> parts;
  while (true) {
    const std::size_t end = text.find(separator);
    parts.emplace_back(trimmed(text.substr(0, end)));
    if (end == std::string_view::npos) return parts;
    text.remove_prefix(end + 1);
  }
}

}  // namespace

std::vector<ActionHead> heads_of_buttons(const std::vector<std::string>& button_names) {
  std::vector<ActionHead> heads;
  std::vector<int> axes;  // parallel to heads
  for (const std::string& name : button_names) {
    const Button button = find_button(name).value();
    const int axis = axis_of(button);
    const auto same = axis < 0 ? axes.end() : std::ranges::find(axes, axis);
    const auto head = static_cast<std::size_t>(same - axes.begin());
    if (same == axes.end()) heads.emplace_back(), axes.push_back(axis);
    std::vector<std::string>& choices = heads[head].buttons;
    if (!button.is_delta()) {
      choices.push_back(name);
      continue;
    }
    const bool turns = axis == 2 || axis == 3;
    for (const char* const step : turns ? kTurnSteps : kMoveSteps) choices.push_back(name + "=" + step);
  }
  return heads;
}

Status change_heads(ScenarioSpec& spec, const std::string& text) {
  const auto too_many = [](const std::string& whose, std::size_t count) {
    return Error{ErrorCode::kUnsupported,
                 fmt::format("{} make {} action heads, and an agent has {} at most; name those that it may "
                             "use, as in --heads \"MOVE_LEFT,MOVE_RIGHT;ATTACK\"",
                             whose, count, kMaxHeads)};
  };
  if (text.empty())
    return spec.heads.size() > kMaxHeads ? Status(too_many("the buttons of " + spec.name, spec.heads.size()))
                                         : Status();
  const auto refuse = [&](const std::string& what) {
    return Error{ErrorCode::kBadInput, "--heads " + text + ": " + what};
  };
  if (!spec.masks.empty())
    return Error{ErrorCode::kUnsupported,
                 "--heads " + text + ": scenario " + spec.name +
                     " has [[masks]] for its own heads; write the heads into a scenario "
                     "of your own with 'base'"};
  const std::vector<std::string> known = buttons_of(spec.heads);
  std::vector<ActionHead> heads;
  for (const std::string& part : parts_of(text, ';')) {
    ActionHead& head = heads.emplace_back();
    for (const std::string& choice : parts_of(part, ',')) {
      if (choice.empty())
        return refuse(
            "a name is missing; write buttons with ',' between them and heads with ';', as in "
            "MOVE_LEFT,MOVE_RIGHT;ATTACK");
      const Expected<ButtonPress> press = parse_press(choice);
      if (!press) return refuse(press.error().message);
      const std::string name = choice.substr(0, choice.find('='));
      if (std::ranges::count(known, name) == 0)
        return refuse("scenario " + spec.name + " does not give the agent " + name + "; it has " +
                      joined(known));
      if (std::ranges::count(head.buttons, choice) > 0) return refuse(choice + " is in one head twice");
      head.buttons.push_back(choice);
    }
    if (head.buttons.size() > kMostChoices)
      return refuse(fmt::format("a head has {} buttons at most", kMostChoices));
  }
  if (heads.size() > kMaxHeads) return too_many("these", heads.size());
  spec.heads = std::move(heads);
  return {};
}

}  // namespace comrad::scenarios
