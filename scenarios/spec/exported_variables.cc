#include "scenarios/spec/exported_variables.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>

#include "scenarios/spec/game_names.h"

namespace comrad::scenarios {
namespace {

/// Notes the USER variables that `variable` stands for: one, or with a stride one for each agent.
void note(std::map<int, ExportedVariable>& exported, const std::string& variable, int stride, int num_agents,
          const std::string& reader) {
  const auto known = find_term_variable(variable);
  if (!known || known->kind != VariableKind::kUser) return;
  for (int agent = 0; agent < (stride == 0 ? 1 : num_agents); ++agent) {
    const int user = known->index + agent * stride;
    ExportedVariable& one = exported[user];
    one.user = user;
    if (std::find(one.read_by.begin(), one.read_by.end(), reader) == one.read_by.end())
      one.read_by.push_back(reader);
  }
}

}  // namespace

std::vector<ExportedVariable> exported_variables(const ScenarioSpec& spec, int num_agents) {
  std::map<int, ExportedVariable> exported;
  for (const ScenarioExport& one : spec.exports) exported[one.user] = {one.user, one.name, one.meaning};
  note(exported, spec.score, spec.score_agent_stride, num_agents, "score");
  note(exported, spec.score_divisor, 0, num_agents, "score_divisor");
  for (std::size_t i = 0; i < spec.measurements.size(); ++i)
    note(exported, spec.measurements[i].variable, spec.measurements[i].agent_stride, num_agents,
         fmt::format("measurement {}", i));
  for (const RewardTerm& term : spec.rewards) {
    note(exported, term.variable, term.agent_stride, num_agents, term.name);
    note(exported, term.when, 0, num_agents, term.name);
    note(exported, term.unless, 0, num_agents, term.name);
  }
  std::vector<ExportedVariable> result;
  for (auto& [user, one] : exported) result.push_back(std::move(one));
  return result;
}

}  // namespace comrad::scenarios
