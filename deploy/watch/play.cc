// `comrad play`: people play seats of a scenario in browsers; policies, the scripted team or chance play the others.

#include <algorithm>
#include <cstdio>
#include <utility>

#include "deploy/evaluation/player.h"
#include "deploy/process/child_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/output_check.h"
#include "deploy/settings/scenario_description.h"
#include "deploy/watch/live_page.h"
#include "deploy/watch/watch_flags.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

struct PlayRequest {
  std::string scenario, policy = "oracle", save;
  double people = 1;
  std::vector<std::string> seats;
  PageFlags page;
};

/// The agents that people play: the first ones, or those of --seat AGENT=person.
std::vector<int> people_of(const PlayRequest& request, bool counts) {
  std::vector<int> agents;
  for (const std::string& seat : request.seats) {
    const std::size_t equals = seat.find('=');
    if (equals == std::string::npos || seat.substr(equals + 1) != kPerson) continue;
    const std::optional<double> agent = read_real(seat.substr(0, equals));
    if (agent && *agent >= 0 && *agent < 8) agents.push_back(static_cast<int>(*agent));
  }
  if (agents.empty() || counts)
    for (int agent = 0; agent < static_cast<int>(request.people); ++agent)
      if (std::ranges::find(agents, agent) == agents.end()) agents.push_back(agent);
  std::ranges::sort(agents);
  return agents;
}

Expected<int> play(PlayRequest& request, const CommandLine& line) {
  LivePageOptions options{.command = "play"};
  COMRAD_TRY(request.page.check(options));
  if (!(request.people >= 1 && request.people <= 8))
    return bad_value("people", real_text(request.people), "write how many people play, from 1 to 8");
  options.seats = people_of(request, line.was_typed("people"));
  if (!request.save.empty()) {
    COMRAD_TRY_ASSIGN(options.saved, check_new_folder("save", request.save, "; name a new one"));
  }
  options.policies = {request.policy};
  const std::vector<std::string> settings = settings_arguments(line);
  options.program = [&](const PageChoice&) -> PageProgram {
    std::vector<std::string> arguments = {"eval", "--policy", request.policy, "--page_rate", "35"};
    const auto add = [&](const std::vector<std::string>& more) {
      arguments.insert(arguments.end(), more.begin(), more.end());
    };
    // The scenario's own game, unless a partner's run has one.
    if (!line.was_typed("scenario")) add({"--scenario=" + request.scenario});
    for (const int agent : options.seats) add({"--seat", std::to_string(agent) + "=" + kPerson});
    for (const std::string& seat : request.seats)
      if (!seat.ends_with(std::string("=") + kPerson)) add({"--seat", seat});
    add(settings);
    if (!options.saved.empty()) add({"--episodes_dir", options.saved});
    add({"--page_size", request.page.size});
    return {sibling_program("comrad"), std::move(arguments)};
  };
  COMRAD_TRY(serve_live_page(options));
  return kExitDone;
}

}  // namespace

int play_command(Arguments arguments) {
  PlayRequest request;
  CommandLine line("play SCENARIO [--policy PLAYER] [--people N] [--save DIR] [settings]",
                   "Opens a page on which you play one agent with keyboard and mouse, 35 tics a second or "
                   "step by step. With\n"
                   "--people N a page for each of the first N agents is printed, each for one browser. "
                   "PLAYER plays the others:\n"
                   "oracle (the scenario's scripted team, the default), random, noop, or a run. --save keeps "
                   "every episode that\n"
                   "ends: comrad.load_episode and comrad watch play it again, comrad eval --recorded DIR "
                   "scores it. Ctrl-C ends "
                   "it.");
  line.add_positional("SCENARIO", request.scenario, "what to play: comrad scenarios lists them");
  line.add_option("policy", request.policy, "PLAYER",
                  "player of the agents that people do not play (default oracle)");
  line.add_option("seat", request.seats, "AGENT=PLAYER",
                  "player of one agent, counted from 0: person, oracle, random, noop or a run");
  line.add_option("people", request.people, "N", "how many people play, a browser each (default 1)");
  line.add_option("save", request.save, "DIR", "keep the episodes in this new folder");
  request.page.add_to(line);
  line.add_settings(SettingsListed::kUsedByEval);
  return run_command("play", line, arguments, [&] { return play(request, line); });
}

}  // namespace comrad::deploy
