// Reads the true state of a world (scenarios/spec/global_state.h lists its parts) for critics that see more than
// pictures: trajectory slabs and Python's `state()` are filled from here. Stage: step.
#pragma once

#include <cstdint>
#include <vector>

#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::sim {

class GlobalState {
 public:
  GlobalState(const scenarios::ScenarioSpec& spec, int num_agents);

  /// S: numbers of the state, as global_state_names() has names.
  int32_t count() const { return count_; }
  /// Writes the state of `world`, f32 [S]. Positions in map units, speeds in map units a tic, the rest as the game counts.
  void write(const doom::World& world, float* state) const;

 private:
  int num_agents_;
  int32_t count_;
  std::vector<int> exports_;  // numbers of USER variables
};

}  // namespace comrad::sim
