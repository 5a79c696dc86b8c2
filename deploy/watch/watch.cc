// `comrad watch`: shows live how policies play, a run's newest checkpoint while it trains, or recorded episodes.

#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <utility>

#include "deploy/evaluation/player.h"
#include "deploy/process/child_program.h"
#include "deploy/run/command.h"
#include "deploy/run/run_client.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/existing_run.h"
#include "deploy/watch/live_page.h"
#include "deploy/watch/watch_flags.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {
namespace {

struct WatchRequest {
  std::vector<std::string> runs, policies, seats;
  std::string checkpoint;
  bool stochastic = false;
  PageFlags page;
};

bool is_a_run(const std::string& player) { return !player_without_run(player); }

bool holds_episodes(const std::string& folder) {
  const Expected<std::vector<std::string>> episodes = files_with_extension(folder, ".comrad");
  return episodes && !episodes->empty();
}

/// A run that trains has its first checkpoint after a while. Errors: kNotFound where it does not train either.
Status await_checkpoint(const std::string& run_dir) {
  bool is_told = false;
  for (;;) {
    const Expected<std::string> found = find_checkpoint(run_dir, CheckpointKind::kLatest);
    if (found) return {};
    if (!find_live_run(run_dir, "")) return found.error();
    if (!std::exchange(is_told, true))
      std::fprintf(stderr,
                   "comrad watch: %s trains and has no checkpoint yet; this waits for the first (comrad ctl "
                   "RUN checkpoint writes one now)\n",
                   run_dir.c_str());
    sleep(1);
  }
}

/// What is played beside a run where a policy that is none is chosen: the run's game.
std::vector<std::string> game_of(const std::string& run_dir) {
  const Expected<RunConfig> config = load_run_config(run_dir + "/config.toml");
  if (!config) return {};
  return {"--scenario=" + config->run.scenario,
          "--num_agents=" + std::to_string(config->environment.num_agents),
          "--env_frameskip=" + std::to_string(config->environment.env_frameskip)};
}

Expected<int> watch(WatchRequest& request, const CommandLine& line) {
  LivePageOptions options{.command = "watch"};
  COMRAD_TRY(request.page.check(options));
  const std::string folder = request.runs.empty() ? "" : request.runs.front();
  if (!folder.empty() && holds_episodes(folder)) {
    if (request.runs.size() > 1 || !request.policies.empty() || !request.seats.empty())
      return Error{ErrorCode::kBadInput,
                   folder +
                       " holds recorded episodes, which have no players; leave other runs, "
                       "--policy and --seat out"};
    options.policies = {folder};
    options.program = [&](const PageChoice&) -> PageProgram {
      return {sibling_program("comrad-sim-watch"), {"--recorded", folder, "--view_size", request.page.size}};
    };
    COMRAD_TRY(serve_live_page(options));
    return kExitDone;
  }
  options.policies = request.runs;
  for (const std::string& player : request.policies)
    if (std::ranges::find(options.policies, player) == options.policies.end())
      options.policies.push_back(player);
  std::string train_dir = RunSettings().train_dir;
  for (const auto& [name, value] : line.typed().values)
    if (name == "train_dir") train_dir = value;
  if (options.policies.empty() && request.seats.empty())
    return Error{
        ErrorCode::kBadInput,
        "name what to watch: comrad watch RUN, a folder of recorded episodes, or --scenario NAME --policy "
        "oracle"};
  for (const std::string& player : options.policies) {
    if (!is_a_run(player) || player.ends_with(".pt")) continue;
    COMRAD_TRY_ASSIGN(const std::string run_dir, find_run(player, train_dir));
    COMRAD_TRY(await_checkpoint(run_dir));
    if (options.run_dir.empty()) options.run_dir = run_dir;
  }
  options.reloads = !options.run_dir.empty() && request.checkpoint.empty();
  const std::vector<std::string> settings = settings_arguments(line);
  options.program = [&](const PageChoice& choice) -> PageProgram {
    std::vector<std::string> arguments = {"eval", "--background"};
    const auto add = [&](const std::vector<std::string>& more) {
      arguments.insert(arguments.end(), more.begin(), more.end());
    };
    if (!options.policies.empty()) {
      const std::string& policy = options.policies[static_cast<std::size_t>(choice.policy)];
      add({"--policy", policy});
      if (!is_a_run(policy) && !options.run_dir.empty()) add(game_of(options.run_dir));
      if (is_a_run(policy) && !request.checkpoint.empty()) add({"--checkpoint", request.checkpoint});
    }
    for (const std::string& seat : request.seats) add({"--seat", seat});
    if (request.stochastic) add({"--stochastic"});
    if (!line.was_typed("load_checkpoint_kind")) add({"--load_checkpoint_kind=latest"});
    add(settings);
    if (!choice.seed.empty()) add({"--seed=" + choice.seed});
    if (!choice.layout_seed.empty()) add({"--layout_seed=" + choice.layout_seed});
    add({"--page_size", request.page.size});
    return {sibling_program("comrad"), std::move(arguments)};
  };
  COMRAD_TRY(serve_live_page(options));
  return kExitDone;
}

}  // namespace

int watch_command(Arguments arguments) {
  WatchRequest request;
  CommandLine line(
      "watch RUN|DIR [--policy PLAYERS] [--seat AGENT=PLAYER] [--port N] [settings]",
      "Opens a page that shows live how policies play: every agent's view, the map from above, actions, "
      "values,\n"
      "probabilities and rewards, episode after episode; beside it the run's curves while it trains. RUN is "
      "a run's\n"
      "folder or an experiment below --train_dir, of which the newest checkpoint plays; DIR a folder of\n"
      "comrad eval --episodes_dir. Without RUN, --scenario and --policy say what is played. Processes of the "
      "lowest\n"
      "priority play, while a page is open; nothing is written into the run. Ctrl-C ends it.");
  line.add_words("RUN", request.runs, "what to watch; of several the page offers a choice");
  line.add_option("policy", request.policies, "PLAYERS",
                  "further players to choose from on the page: runs, oracle, random (as in comrad eval)");
  line.add_option("seat", request.seats, "AGENT=PLAYER", "player of one agent, counted from 0");
  line.add_option("checkpoint", request.checkpoint, "FILE",
                  "the checkpoint to play (default: the newest, always)");
  line.add_switch("stochastic", request.stochastic, "draw actions from the policy, as training does");
  request.page.add_to(line);
  line.add_settings(SettingsListed::kUsedByEval);
  return run_command("watch", line, arguments, [&] { return watch(request, line); });
}

}  // namespace comrad::deploy
