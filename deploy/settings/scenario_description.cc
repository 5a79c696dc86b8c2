#include "deploy/settings/scenario_description.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "deploy/process/child_program.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using nlohmann::json;

Error wrong(const char* key, const char* must_be) {
  return Error{ErrorCode::kBadFormat, std::string("comrad-scenarios describe: '") + key + "' must be " +
                                          must_be + "; rebuild with ./comrad"};
}

Status read(const json& from, const char* key, std::string& into) {
  const auto found = from.find(key);
  if (found == from.end() || !found->is_string()) return wrong(key, "a text");
  into = found->get<std::string>();
  return {};
}

template <typename Number>
Status read(const json& from, const char* key, Number& into) {
  const auto found = from.find(key);
  if (found == from.end() || !found->is_number()) return wrong(key, "a number");
  into = found->get<Number>();
  return {};
}

Status read(const json& from, const char* key, std::vector<std::string>& into) {
  const auto found = from.find(key);
  if (found == from.end() || !found->is_array()) return wrong(key, "a list of texts");
  for (const json& element : *found) {
    if (!element.is_string()) return wrong(key, "a list of texts");
    into.push_back(element.get<std::string>());
  }
  return {};
}

Status read(const json& from, const char* key, std::vector<int>& into) {
  const auto found = from.find(key);
  if (found == from.end() || !found->is_array()) return wrong(key, "a list of numbers");
  for (const json& element : *found) {
    if (!element.is_number_integer()) return wrong(key, "a list of numbers");
    into.push_back(element.get<int>());
  }
  return {};
}

}  // namespace

Expected<ScenarioDescription> parse_description(std::string_view text) {
  const json described = json::parse(text, nullptr, /*allow_exceptions=*/false);
  if (!described.is_object()) return wrong("the output", "one JSON object");
  ScenarioDescription scenario;
  std::vector<int> heads;
  COMRAD_TRY(read(described, "name", scenario.name));
  COMRAD_TRY(read(described, "title", scenario.title));
  COMRAD_TRY(read(described, "num_agents", scenario.env.num_agents));
  COMRAD_TRY(read(described, "supported_agents", scenario.supported_agents));
  COMRAD_TRY(read(described, "heads", heads));
  COMRAD_TRY(read(described, "measurements", scenario.env.measurement_count));
  COMRAD_TRY(read(described, "global_state", scenario.env.global_state_count));
  COMRAD_TRY(read(described, "decision_limit", scenario.decision_limit));
  COMRAD_TRY(read(described, "ceiling", scenario.ceiling));
  COMRAD_TRY(read(described, "shared_reward_alpha", scenario.shared_reward_alpha));
  COMRAD_TRY(read(described, "score", scenario.score));
  COMRAD_TRY(read(described, "score_unit", scenario.score_unit));
  COMRAD_TRY(read(described, "version", scenario.version));
  const auto rewards = described.find("rewards");
  if (rewards == described.end() || !rewards->is_array()) return wrong("rewards", "a list");
  for (const json& term : *rewards) COMRAD_TRY(read(term, "name", scenario.rewards.emplace_back()));
  if (described.contains("folder")) COMRAD_TRY(read(described, "folder", scenario.folder));
  if (described.contains("warnings")) COMRAD_TRY(read(described, "warnings", scenario.warnings));
  if (heads.empty() || heads.size() > static_cast<size_t>(kMaxHeads)) return wrong("heads", "1 to 8 numbers");
  scenario.env.head_count = static_cast<int32_t>(heads.size());
  std::copy(heads.begin(), heads.end(), scenario.env.head_sizes.begin());

  scenario.training.origin = "scenario " + scenario.name;
  if (const auto training = described.find("training"); training != described.end()) {
    if (!training->is_object()) return wrong("training", "an object of settings");
    for (const auto& [key, value] : training->items())
      scenario.training.values.emplace_back(key, value.is_string() ? value.get<std::string>() : value.dump());
  }
  return scenario;
}

void print_warnings(const ScenarioDescription& scenario) {
  for (const std::string& warning : scenario.warnings) std::fprintf(stderr, "warning: %s\n", warning.c_str());
}

Expected<ScenarioDescription> describe_scenario(const RunConfig& config) {
  const std::string& name = config.run.scenario;
  const int64_t num_agents = config.environment.num_agents;
  const auto ask = [&](int64_t agents) -> Expected<ScenarioDescription> {
    std::vector<std::string> command = {sibling_program("comrad-scenarios"), "describe", name, "--json"};
    if (!config.environment.heads.empty())
      command.insert(command.end(), {"--heads", config.environment.heads});
    if (agents > 0) command.insert(command.end(), {"--num_agents", std::to_string(agents)});
    COMRAD_TRY_ASSIGN(const ProgramResult described, run_program(command));
    if (described.exit_code != 0) {
      const std::string reason = last_words(described);
      return Error{ErrorCode::kBadInput,
                   reason.empty() ? "--scenario=" + name + ": comrad-scenarios failed" : reason};
    }
    COMRAD_TRY_ASSIGN(ScenarioDescription scenario, parse_description(described.output));
    if (!config.environment.use_additional_input) scenario.env.measurement_count = 0;
    return scenario;
  };
  COMRAD_TRY_ASSIGN(ScenarioDescription scenario, ask(0));
  if (num_agents == 0 || num_agents == scenario.env.num_agents) return scenario;

  const std::vector<int>& supported = scenario.supported_agents;
  if (std::find(supported.begin(), supported.end(), num_agents) == supported.end())
    return Error{ErrorCode::kBadInput,
                 fmt::format("--num_agents={}: {} supports {} agents", num_agents, name, joined(supported))};
  return ask(num_agents);
}

}  // namespace comrad::deploy
