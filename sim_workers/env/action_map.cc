#include "sim_workers/env/action_map.h"

namespace comrad::sim {

Expected<ActionMap> ActionMap::create(const std::vector<scenarios::ActionHead>& heads) {
  ActionMap map;
  for (const scenarios::ActionHead& head : heads) {
    std::vector<scenarios::Button>& buttons = map.heads_.emplace_back();
    for (const std::string& name : head.buttons) {
      const auto button = scenarios::find_button(name);
      if (!button) return Error{ErrorCode::kBadInput, "'" + name + "' is no button"};
      buttons.push_back(*button);
    }
  }
  return map;
}

doom::Buttons ActionMap::buttons(std::span<const int32_t> choice) const {
  using scenarios::ButtonKind;
  doom::Buttons pressed;
  for (std::size_t head = 0; head < heads_.size() && head < choice.size(); ++head) {
    const int32_t index = choice[head];
    if (index <= 0 || index > static_cast<int32_t>(heads_[head].size())) continue;
    const scenarios::Button& button = heads_[head][index - 1];
    switch (button.kind) {
      case ButtonKind::kMoveForward:
        pressed.forward = true;
        break;
      case ButtonKind::kMoveBackward:
        pressed.backward = true;
        break;
      case ButtonKind::kMoveLeft:
        pressed.left = true;
        break;
      case ButtonKind::kMoveRight:
        pressed.right = true;
        break;
      case ButtonKind::kTurnLeft:
        pressed.turn_left = true;
        break;
      case ButtonKind::kTurnRight:
        pressed.turn_right = true;
        break;
      case ButtonKind::kAttack:
        pressed.attack = true;
        break;
      case ButtonKind::kUse:
        pressed.use = true;
        break;
      case ButtonKind::kJump:
        pressed.jump = true;
        break;
      case ButtonKind::kSpeed:
        pressed.speed = true;
        break;
      case ButtonKind::kSelectWeapon:
        pressed.select_weapon = static_cast<int8_t>(button.slot);
        break;
    }
  }
  return pressed;
}

}  // namespace comrad::sim
