#include "sim_workers/env/global_state.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <iterator>
#include <numbers>

#include "scenarios/spec/exported_variables.h"
#include "scenarios/spec/global_state.h"
#include "sim_workers/env/game_variables.h"

namespace comrad::sim {

using scenarios::GameVariable;
using scenarios::VariableKind;

GlobalState::GlobalState(const scenarios::ScenarioSpec& spec, int num_agents)
    : num_agents_(num_agents),
      count_(static_cast<int32_t>(scenarios::global_state_names(spec, num_agents).size())) {
  for (const scenarios::ExportedVariable& variable : scenarios::exported_variables(spec, num_agents))
    exports_.push_back(variable.user);
}

void GlobalState::write(const doom::World& world, float* state) const {
  for (int player = 0; player < num_agents_; ++player) {
    const auto read = [&](VariableKind kind) {
      return static_cast<float>(read_variable(world, player, GameVariable{kind, 0}));
    };
    const float angle = read(VariableKind::kAngle) * std::numbers::pi_v<float> / 180.0f;
    const std::array<float, std::size(scenarios::kAgentStateNames)> of_agent = {
        read(VariableKind::kPositionX),
        read(VariableKind::kPositionY),
        read(VariableKind::kPositionZ),
        std::cos(angle),
        std::sin(angle),
        read(VariableKind::kVelocityX),
        read(VariableKind::kVelocityY),
        read(VariableKind::kVelocityZ),
        read(VariableKind::kHealth),
        world.player(player).alive ? 1.0f : 0.0f};
    state = std::ranges::copy(of_agent, state).out;
  }
  for (const int user : exports_) *state++ = static_cast<float>(world.exported(user));
}

}  // namespace comrad::sim
