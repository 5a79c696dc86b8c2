#include "sim_workers/env/action_map.h"

#include "sim_workers/env/button_press.h"

namespace comrad::sim {

Expected<ActionMap> ActionMap::create(const std::vector<scenarios::ActionHead>& heads) {
  ActionMap map;
  for (const scenarios::ActionHead& head : heads) {
    std::vector<scenarios::Button>& buttons = map.heads_.emplace_back();
    for (const std::string& name : head.buttons) {
      const auto button = scenarios::find_button(name);
      if (!button) return Error{ErrorCode::kBadInput, "'" + name + "' is no button"};
      if (button->is_delta())
        return Error{ErrorCode::kBadInput,
                     "'" + name + "' takes a number, and a head of choices cannot give it one"};
      buttons.push_back(*button);
    }
  }
  return map;
}

doom::Buttons ActionMap::buttons(std::span<const int32_t> choice) const {
  doom::Buttons pressed;
  for (std::size_t head = 0; head < heads_.size() && head < choice.size(); ++head) {
    const int32_t index = choice[head];
    if (index <= 0 || index > static_cast<int32_t>(heads_[head].size())) continue;
    press(pressed, heads_[head][static_cast<std::size_t>(index) - 1]);
  }
  return pressed;
}

void ActionMap::choose(const doom::Buttons& pressed, std::span<int32_t> choice) const {
  for (std::size_t head = 0; head < heads_.size() && head < choice.size(); ++head) {
    choice[head] = 0;
    for (std::size_t i = 0; i < heads_[head].size() && choice[head] == 0; ++i) {
      doom::Buttons with = pressed;
      press(with, heads_[head][i]);
      if (with == pressed) choice[head] = static_cast<int32_t>(i) + 1;  // it was held already
    }
  }
}

}  // namespace comrad::sim
