// scenario_play: one scenario on one WAD, for comparing it with another engine.
//
//   scenario_play play SCENARIO WAD AGENTS IDLE_TICS ACTIONS VARIABLES SEED...   rows of our engine
//   scenario_play rewards SCENARIO AGENTS TABLE                                  what rows of any engine pay
//
// ACTIONS has a line per decision: of each agent the choice of each head, agents one after the other.
// VARIABLES are names with commas between. An episode begins with IDLE_TICS in which nobody presses anything;
// a row is noted then and after each decision: seed,decision,agent,tics,finished,VARIABLES. `rewards` reads
// such rows (a TABLE's finished means that the map ended) and prints seed,agent,return.
#include <charconv>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <string_view>
#include <vector>

#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/rewards.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/env/game_variables.h"

using namespace comrad;

namespace {

int fail(const std::string& message) {
  return std::fprintf(stderr, "scenario_play: %s\n", message.c_str()), 1;
}

std::vector<std::string> split(const std::string& text) {
  std::vector<std::string> cells;
  std::istringstream stream(text);
  for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
  return cells;
}

int play(const std::vector<std::string>& args) {
  const std::string& scenario = args[0];
  const int agents = std::stoi(args[2]), idle_tics = std::stoi(args[3]);
  auto wad = wad::WadFile::open(args[1]);
  if (!wad) return fail(wad.error().message);
  sim::EnvironmentOptions options;
  options.scenario = scenario;
  options.num_agents = agents;
  options.frame_skip = 1;
  const auto game = sim::load_doom_game(options, *wad);
  if (!game) return fail(game.error().message);
  const sim::ActionMap& actions = (*game)->actions;
  const auto heads = static_cast<std::size_t>(actions.head_count());

  std::vector<std::vector<doom::Buttons>> script;  // [decision][agent]
  std::ifstream file(args[4]);
  if (!file) return fail("cannot read " + args[4]);
  for (std::string line; std::getline(file, line);) {
    std::vector<int32_t> choice;
    for (const std::string& cell : split(line)) choice.push_back(std::stoi(cell));
    if (choice.size() != heads * static_cast<std::size_t>(agents))
      return fail(args[4] + ": a line must have one number per agent and head");
    auto& decision = script.emplace_back();
    for (std::size_t agent = 0; agent < static_cast<std::size_t>(agents); ++agent)
      decision.push_back(actions.buttons(std::span(choice).subspan(agent * heads, heads)));
  }
  std::vector<scenarios::GameVariable> variables;
  std::printf("seed,decision,agent,tics,finished,%s\n", args[5].c_str());
  for (const std::string& name : split(args[5])) {
    const auto variable = scenarios::find_variable(name);
    if (!variable) return fail("no variable " + name);
    variables.push_back(*variable);
  }

  sim::DoomEnvironment environment(*game);
  const std::vector<doom::Buttons> nothing(static_cast<std::size_t>(agents));
  for (std::size_t i = 6; i < args.size(); ++i) {
    environment.reset(std::stoull(args[i]));
    const auto over = [&] { return environment.last_step().episode_over(); };
    const auto note = [&](std::size_t decision) {
      for (int agent = 0; agent < agents; ++agent) {
        std::printf("%s,%zu,%d,%lld,%d", args[i].c_str(), decision, agent,
                    static_cast<long long>(environment.world().tic_count()), static_cast<int>(over()));
        for (const scenarios::GameVariable& variable : variables)
          std::printf(",%.10g", sim::read_variable(environment.world(), agent, variable));
        std::printf("\n");
      }
    };
    for (int tic = 0; tic < idle_tics && !over(); ++tic) environment.press(nothing);
    note(0);
    for (std::size_t decision = 0; decision < script.size() && !over(); ++decision) {
      for (int tic = 0; tic < 4 && !over(); ++tic) environment.press(script[decision]);
      note(decision + 1);
    }
    if (!environment.world().state().scripts.last_error.empty())
      return fail("a script stopped: " + environment.world().state().scripts.last_error);
  }
  return 0;
}

/// One decision's variables by name, of every agent.
struct Row {
  std::vector<std::map<std::string, double>> agents;
  bool finished = false;
};

/// As DoomEnvironment reads a term's variable.
double read_term(const Row& row, int agent, const std::string& name, int stride) {
  if (name == "ONE") return 1;
  if (name == "TERMINATED") return row.finished;
  if (name == "TRUNCATED") return 0;
  const auto& values = row.agents[static_cast<std::size_t>(agent)];
  const auto found =
      values.find(stride == 0 ? name : "USER" + std::to_string(std::stoi(name.substr(4)) + agent * stride));
  if (found == values.end()) std::fprintf(stderr, "no column %s\n", name.c_str()), std::exit(1);
  return found->second;
}

int rewards(const std::vector<std::string>& args) {
  const auto spec = scenarios::load_scenario(args[0]);
  if (!spec) return fail(spec.error().message);
  const int agents = std::stoi(args[1]);
  std::ifstream file(args[2]);
  if (!file) return fail("cannot read " + args[2]);
  std::string line;
  std::getline(file, line);
  const std::vector<std::string> columns = split(line);
  std::map<std::string, std::map<int, Row>> episodes;
  while (std::getline(file, line)) {
    const std::vector<std::string> cells = split(line);
    if (cells.size() != columns.size()) return fail(args[2] + ": a short row: " + line);
    Row& row = episodes[cells[0]][std::stoi(cells[1])];
    row.agents.resize(static_cast<std::size_t>(agents));
    row.finished = cells[4] == "1";
    for (std::size_t i = 5; i < cells.size(); ++i)
      row.agents[static_cast<std::size_t>(std::stoi(cells[2]))][columns[i]] =
          std::strtod(cells[i].c_str(), nullptr);
  }
  for (const auto& [seed, rows] : episodes) {
    scenarios::RewardTracker tracker(spec->rewards, agents);
    std::vector<double> total(static_cast<std::size_t>(agents), 0.0);
    bool first = true;
    for (const auto& [decision, row] : rows) {
      std::vector<double> value;
      std::vector<uint8_t> pays;
      for (const scenarios::RewardTerm& term : spec->rewards) {
        const auto variable = scenarios::find_term_variable(term.variable);
        const bool is_sum = term.scope == "team" && (!variable->is_team_variable() || term.agent_stride != 0);
        double sum = 0;
        for (int agent = 0; agent < agents; ++agent)
          sum += read_term(row, agent, term.variable, term.agent_stride);
        for (int agent = 0; agent < agents; ++agent) {
          value.push_back(is_sum ? sum : read_term(row, agent, term.variable, term.agent_stride));
          pays.push_back((term.when.empty() || read_term(row, agent, term.when, 0) != 0) &&
                         (term.unless.empty() || read_term(row, agent, term.unless, 0) == 0));
        }
      }
      std::vector<double> reward(static_cast<std::size_t>(agents));
      if (first) {
        tracker.reset(value);
        first = false;
        continue;
      }
      tracker.step(value, reward, pays);
      for (std::size_t agent = 0; agent < reward.size(); ++agent) total[agent] += reward[agent];
    }
    for (std::size_t agent = 0; agent < total.size(); ++agent)
      std::printf("%s,%zu,%.6f\n", seed.c_str(), agent, total[agent]);
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  const std::vector<std::string> args(argv + 1, argv + argc);
  if (args.size() >= 8 && args[0] == "play") return play({args.begin() + 1, args.end()});
  if (args.size() == 4 && args[0] == "rewards") return rewards({args.begin() + 1, args.end()});
  std::fprintf(stderr,
               "usage: scenario_play play SCENARIO WAD AGENTS IDLE_TICS ACTIONS VARIABLES SEED...\n"
               "       scenario_play rewards SCENARIO AGENTS TABLE\n");
  return 2;
}
