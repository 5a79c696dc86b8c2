#include "scenarios/spec/exported_variables.h"

#include <algorithm>
#include <map>
#include <regex>

#include "scenarios/spec/game_names.h"
#include "scenarios/spec/scenario_files.h"

namespace comrad::scenarios {
namespace {

constexpr int kUserVariables = 60;  // globals that ViZDoom hands out

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

std::vector<ExportedVariable> declared_globals(std::string_view script) {
  static const std::regex declaration(
      R"(^\s*global\s+(?:int|bool|str)\s+(\d{1,2})\s*:\s*(\w+)\s*(?:\[\s*\]\s*)?;\s*(?://\s*(.*?)\s*)?$)",
      std::regex::icase);
  std::map<int, ExportedVariable> found;
  while (!script.empty()) {
    const std::size_t end = std::min(script.find('\n'), script.size());
    const std::string line(script.substr(0, end));
    script.remove_prefix(std::min(end + 1, script.size()));
    std::smatch part;
    if (line.size() > 1000 || !std::regex_match(line, part, declaration)) continue;
    const int user = std::stoi(part[1]);
    if (user >= 1 && user <= kUserVariables) found[user] = {user, part[2], part[3]};
  }
  std::vector<ExportedVariable> result;
  for (auto& [user, one] : found) result.push_back(std::move(one));
  return result;
}

Expected<std::vector<ExportedVariable>> exported_variables(const ScenarioSpec& spec, int num_agents) {
  std::map<int, ExportedVariable> exported;
  if (const std::string path = spec.folder + "/script.acs"; scenario_file_exists(path)) {
    COMRAD_TRY_ASSIGN(const std::string script, read_scenario_file(path));
    for (ExportedVariable& one : declared_globals(script)) exported[one.user] = std::move(one);
  }
  note(exported, spec.score, spec.score_agent_stride, num_agents, "score");
  note(exported, spec.score_divisor, 0, num_agents, "score_divisor");
  for (std::size_t i = 0; i < spec.measurements.size(); ++i)
    note(exported, spec.measurements[i].variable, spec.measurements[i].agent_stride, num_agents,
         "measurement " + std::to_string(i));
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
