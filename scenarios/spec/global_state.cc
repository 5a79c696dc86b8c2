#include "scenarios/spec/global_state.h"

#include <spdlog/fmt/fmt.h>

#include "scenarios/spec/exported_variables.h"

namespace comrad::scenarios {

std::vector<std::string> global_state_names(const ScenarioSpec& spec, int num_agents) {
  std::vector<std::string> names;
  for (int agent = 0; agent < num_agents; ++agent)
    for (const char* name : kAgentStateNames) names.push_back(fmt::format("agent_{}/{}", agent, name));
  for (const ExportedVariable& variable : exported_variables(spec, num_agents))
    names.push_back(variable.name.empty() ? fmt::format("USER{}", variable.user) : variable.name);
  return names;
}

}  // namespace comrad::scenarios
