// `comrad`: the front program. Finds the command and hands it the rest of the words.

#include <cstdio>
#include <exception>
#include <string>
#include <vector>

#include "deploy/run/command.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/metrics/metric_table.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::deploy {

const std::vector<Command>& commands() {
  static const std::vector<Command> all = {
      {"train", "train agents on a scenario", train_command},
      {"serve", "train a run, new or begun, with a join endpoint for other hosts", serve_command},
      {"join", "let this host play for the learner of another host's run", join_command},
      {"eval", "score or record a policy: a run's, random play or a scripted team", eval_command},
      {"watch", "show live on a page how a policy plays, and the run beside it", watch_command},
      {"play",
       "play a seat of a scenario in the browser, with policies or people as partners",
       play_command,
       {kAnyScenario}},
      {"plot", "draw learning curves of runs, or of several seeds with their mean, as PNG or SVG",
       plot_command},
      {"report", "report on a folder of runs: one HTML page, Markdown, LaTeX, CSV", report_command},
      {"export", "hand the reports of runs to other programs: CSV, Weights & Biases", export_command},
      {"pack-policies", "put the best checkpoint of each scenario of finished sweeps into one archive",
       pack_policies_command},
      {"fetch-policies",
       "put kept policies of such an archive into run directories",
       fetch_policies_command,
       {kAnyScenario}},
      {"sweep", "make many runs from one file, here or with Slurm; look at them, stop them", sweep_command},
      {"top", "watch the runs of this host: rates, lag, queues, workers", top_command},
      {"ctl",
       "talk to a run that is alive: status, pause, resume, checkpoint, stop, workers, drain",
       ctl_command,
       {"status", "pause", "resume", "checkpoint", "stop", "workers", "drain"}},
      {"bench",
       "measure throughput: one part, the whole pipeline (train), how it scales",
       bench_command,
       {"engine", "render", "sim", "transport", "inference", "learner", "replay", "train", "scaling", "check",
        "report", "model"}},
      {"tune", "find the settings that make the pipeline fastest on this machine", tune_command},
      {"config", "print the settings that train would use, and the layer that each came from",
       config_command},
      {"scenarios",
       "list the scenarios, describe one, draw what agents see (--gallery DIR) or their pages (--pages DIR)",
       scenarios_command,
       {"list", "describe", kAnyScenario}},
      {"doomgen",
       "draw a scenario's map as a WAD, or a pool of them; check a pool; show a map from above",
       doomgen_command,
       {kAnyScenario}},
      {"acs", "compile an ACS script", acs_command},
      {"trace", "play one player's buttons and write what came of it, tic by tic", trace_command},
      {"docs", "build the documentation as a site, or serve it", docs_command},
      {"doctor", "check this machine and say what to do", doctor_command},
      {"test", "run the test suite", test_command},
      {"keys",
       "make the keys that let hosts share a run over a network",
       keys_command,
       {"make", "add", "show"}},
      {"completion",
       "print a script with which bash completes commands, flags and values",
       completion_command,
       {"bash"}},
  };
  return all;
}

}  // namespace comrad::deploy

namespace {

using comrad::deploy::Arguments;
using comrad::deploy::Command;
using comrad::deploy::commands;

const Command* find(const std::string& name) {
  for (const Command& command : commands())
    if (command.name == name) return &command;
  return nullptr;
}

void print_overview(FILE* to) {
  std::fprintf(to,
               "COMRAD: cooperative first-person Doom scenarios and the system that trains on them.\n\n"
               "usage: comrad <command> [flags]\n\n");
  for (const Command& command : commands())
    std::fprintf(to, "  %-15s %s\n", command.name.c_str(), command.summary.c_str());
  std::fprintf(to, "  %-15s %s\n  %-15s %s\n\n", "help",
               "this overview, one command (comrad help train), or a run's numbers (comrad help metrics)",
               "version", "what was built");
  std::fprintf(to, "First steps: comrad doctor; comrad train --scenario coop_health_gathering --algo ippo\n");
}

/// `comrad help metrics [--markdown]`.
int print_metrics(Arguments flags) {
  const bool as_markdown = flags.size() == 1 && flags[0] == "--markdown";
  if (!flags.empty() && !as_markdown) {
    std::fprintf(stderr, "comrad: error: help metrics: unexpected '%s'; expected nothing or --markdown\n",
                 flags[0].c_str());
    return comrad::kExitBadInput;
  }
  std::fputs((as_markdown ? comrad::metrics_markdown() : comrad::metrics_text()).c_str(), stdout);
  return comrad::kExitDone;
}

int unknown_command(const std::string& name) {
  std::vector<std::string> known = {"help", "version"};
  for (const Command& command : commands()) known.push_back(command.name);
  std::fprintf(stderr, "comrad: error: unknown command '%s'%s (comrad help lists them)\n", name.c_str(),
               comrad::did_you_mean(name, known).c_str());
  return comrad::kExitBadInput;
}

int dispatch(const std::vector<std::string>& words) {
  if (words.empty()) {
    print_overview(stderr);
    return comrad::kExitBadInput;
  }
  const std::string& name = words[0];
  if (name == "help" && words.size() > 1 && words[1] == "metrics")
    return print_metrics(Arguments(words).subspan(2));
  if (name == "help" && words.size() > 1) {
    const Command* command = find(words[1]);
    std::vector<std::string> help(words.begin() + 2, words.end());
    help.emplace_back("--help");
    return command == nullptr ? unknown_command(words[1]) : command->run(help);
  }
  if (name == "help" || name == "--help" || name == "-h") {
    print_overview(stdout);
    return comrad::kExitDone;
  }
  if (name == "version" || name == "--version") {
    std::printf("comrad %s (arena version %u)\n", COMRAD_VERSION, comrad::kArenaVersion);
    return comrad::kExitDone;
  }
  const Command* command = find(name);
  return command == nullptr ? unknown_command(name) : command->run(Arguments(words).subspan(1));
}

}  // namespace

int main(int argc, char** argv) {
  comrad::prepare_process();
  if (!comrad::init_log("comrad", "")) return comrad::kExitFailed;  // stdout is for results alone
  try {
    return dispatch(std::vector<std::string>(argv + 1, argv + argc));
  } catch (const std::exception& exception) {  // from libraries; our own code returns errors
    std::fprintf(stderr, "comrad: error: %s\n", exception.what());
    return comrad::kExitFailed;
  }
}
