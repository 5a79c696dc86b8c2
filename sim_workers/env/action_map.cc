#include "sim_workers/env/action_map.h"

#include "sim_workers/env/button_press.h"

namespace comrad::sim {

Expected<ActionMap> ActionMap::create(const std::vector<scenarios::ActionHead>& heads) {
  ActionMap map;
  for (const scenarios::ActionHead& head : heads) {
    std::vector<scenarios::ButtonPress>& presses = map.heads_.emplace_back();
    for (const std::string& text : head.buttons) {
      COMRAD_TRY_ASSIGN(presses.emplace_back(), scenarios::parse_press(text));
    }
  }
  return map;
}

doom::Buttons ActionMap::buttons(std::span<const int32_t> choice) const {
  doom::Buttons pressed;
  for (std::size_t head = 0; head < heads_.size() && head < choice.size(); ++head) {
    const int32_t index = choice[head];
    if (index <= 0 || index > static_cast<int32_t>(heads_[head].size())) continue;
    const scenarios::ButtonPress& chosen = heads_[head][static_cast<std::size_t>(index) - 1];
    press(pressed, chosen.button, chosen.value);
  }
  return pressed;
}

void ActionMap::choose(const doom::Buttons& pressed, std::span<int32_t> choice) const {
  for (std::size_t head = 0; head < heads_.size() && head < choice.size(); ++head) {
    choice[head] = 0;
    for (std::size_t i = 0; i < heads_[head].size() && choice[head] == 0; ++i) {
      doom::Buttons with = pressed;
      press(with, heads_[head][i].button, heads_[head][i].value);
      if (with == pressed) choice[head] = static_cast<int32_t>(i) + 1;  // it was held already
    }
  }
}

}  // namespace comrad::sim
