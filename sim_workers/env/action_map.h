// From the choices of the action heads to the buttons of one player. Stage: step.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/game_names.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::sim {

class ActionMap {
 public:
  /// Errors: kBadInput for a button that does not exist, or a delta button without its number.
  static Expected<ActionMap> create(const std::vector<scenarios::ActionHead>& heads);

  int head_count() const { return static_cast<int>(heads_.size()); }

  /// The buttons that `choice` [heads] holds down: index 0 presses nothing, index k the k-th button of its
  /// head; anything out of range counts as 0.
  doom::Buttons buttons(std::span<const int32_t> choice) const;

  /// The way back: of each head the first button that `pressed` holds, 0 where it holds none. Buttons that no
  /// head has are lost. `choice` [heads] is written.
  void choose(const doom::Buttons& pressed, std::span<int32_t> choice) const;

 private:
  std::vector<std::vector<scenarios::ButtonPress>> heads_;
};

}  // namespace comrad::sim
