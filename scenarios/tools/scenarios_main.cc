// comrad-scenarios list | describe NAME: what scenarios there are and what each one means, for people and
// programs.
#include <CLI/CLI.hpp>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string>

#include "rollout_buffer/core/process.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad {
namespace {

using Json = nlohmann::ordered_json;

int report(const Error& error) {
  std::fprintf(stderr, "comrad-scenarios: %s\n", error.message.c_str());
  return error.code == ErrorCode::kSystem ? 1 : 2;
}

Expected<Json> describe(const std::string& name, int num_agents, bool use_measurements) {
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::load_scenario(name));
  if (num_agents == 0) num_agents = spec.default_agents;
  if (std::count(spec.supported_agents.begin(), spec.supported_agents.end(), num_agents) == 0) {
    std::string known;
    for (const int n : spec.supported_agents) known += (known.empty() ? "" : ", ") + std::to_string(n);
    return Error{ErrorCode::kBadInput, "scenario " + name + " is not for " + std::to_string(num_agents) +
                                           " agents; num_agents may be " + known};
  }
  const EnvShape shape = spec.shape(num_agents, use_measurements);
  Json head_sizes = Json::array(), head_buttons = Json::array(), training = Json::object();
  for (int head = 0; head < shape.head_count; ++head) {
    head_sizes.push_back(shape.head_sizes[head]);
    head_buttons.push_back(spec.heads[head].buttons);
  }
  for (const auto& [key, value] : spec.training.values) training[key] = value;
  const auto recipes = scenarios::layout_recipes();
  COMRAD_TRY_ASSIGN(const auto ceilings, scenarios::default_ceilings(spec));
  const auto ceiling = ceilings.find(num_agents);
  return Json{{"name", spec.name},
              {"title", spec.title},
              {"summary", spec.summary},
              {"difficulty", spec.difficulty},
              {"num_agents", num_agents},
              {"supported_agents", spec.supported_agents},
              {"heads", head_sizes},
              {"head_buttons", head_buttons},
              {"measurements", shape.measurement_count},
              {"decision_limit", spec.decision_limit},
              {"ceiling", ceiling != ceilings.end() ? ceiling->second : 0.0},
              {"shared_reward_alpha", spec.shared_reward_alpha},
              {"score", spec.score},
              {"has_layout_recipe", std::count(recipes.begin(), recipes.end(), name) > 0},
              {"training", training}};
}

int list(bool as_json) {
  Json all = Json::array();
  for (const std::string& name : scenarios::list_scenarios()) {
    const Expected<Json> one = describe(name, 0, false);
    if (!one) return report(one.error());
    all.push_back(*one);
  }
  if (as_json) {
    std::printf("%s\n", Json{{"scenarios", all}}.dump().c_str());
    return 0;
  }
  for (const Json& one : all)
    std::printf("%-24s difficulty %d, %d agents, %s\n", one["name"].get<std::string>().c_str(),
                one["difficulty"].get<int>(), one["num_agents"].get<int>(),
                one["summary"].get<std::string>().c_str());
  return 0;
}

int run(int argc, char** argv) {
  bool as_json = false, use_measurements = false;
  int num_agents = 0;
  std::string name;
  CLI::App app("Lists and describes the scenarios.", "comrad-scenarios");
  app.require_subcommand(1);
  CLI::App* list_command = app.add_subcommand("list", "every scenario, one line each");
  list_command->add_flag("--json", as_json, "one JSON object");
  CLI::App* describe_command =
      app.add_subcommand("describe", "one scenario's shapes, limits and training settings");
  describe_command->add_option("name", name, "scenario")->required();
  describe_command->add_option("--num_agents", num_agents, "agents; 0: the scenario's default")
      ->check(CLI::Range(0, kMaxAgents));
  describe_command->add_flag("--use_measurements", use_measurements, "count the measurement vector");
  describe_command->add_flag("--json", as_json, "one JSON object on one line");
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& error) {
    return app.exit(error) == 0 ? 0 : 2;
  }
  if (*list_command) return list(as_json);
  const Expected<Json> description = describe(name, num_agents, use_measurements);
  if (!description) return report(description.error());
  std::printf("%s\n", description->dump(as_json ? -1 : 2).c_str());
  return 0;
}

}  // namespace
}  // namespace comrad

int main(int argc, char** argv) {
  comrad::prepare_process();
  return comrad::run(argc, argv);
}
