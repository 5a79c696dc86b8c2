// The true state of a world, which central critics may see and agents may not: of each agent its place, direction, speed
// and health, of the world what its script exports. The names stand here, the values are read in
// sim_workers/env/global_state.h; the C++ critics (--critic_state global) and Python's `state()` have this one.
#pragma once

#include <string>
#include <vector>

#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

/// The state of each agent, in this order: map units, map units a tic, points of health; `alive` is 0 or 1.
constexpr const char* kAgentStateNames[] = {
    "x", "y", "z", "cos_angle", "sin_angle", "velocity_x", "velocity_y", "velocity_z", "health", "alive"};

/// Names of the state's numbers [S]: "agent_0/x" and so on for each agent, then the exported variables by their names in
/// [exports] or as "USER7".
std::vector<std::string> global_state_names(const ScenarioSpec& spec, int num_agents);

}  // namespace comrad::scenarios
