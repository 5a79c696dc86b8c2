// `comrad bench`: throughput of one stage alone (sim, inference, learner: the worker program's own --bench;
// replay: comrad-bench-replay with its own flags) or of the whole pipeline (train).

#include <algorithm>
#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "deploy/commands/command.h"
#include "deploy/commands/pipeline_bench.h"
#include "deploy/process/child_program.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/network_description.h"
#include "deploy/settings/start_notes.h"
#include "deploy/settings/temporary_run.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

constexpr std::array kBenches = {"sim", "inference", "learner", "train", "replay"};
constexpr double kTrainWarmupSeconds = 5;

/// The keys that every bench has, in their order.
ordered_json common_keys(const std::string& bench, const RunConfig& config, int64_t cores, double seconds,
                         double decisions_per_s) {
  return {{"bench", bench},
          {"scenario", config.run.scenario},
          {"algo", config.run.algo.name()},
          {"num_agents", config.environment.num_agents},
          {"cores", cores},
          {"seconds", seconds},
          {"decisions_per_s", decisions_per_s},
          {"env_frames_per_s", decisions_per_s * static_cast<double>(config.environment.env_frameskip)}};
}

std::vector<std::string> worker_command(const std::string& bench, const MergedSettings& merged,
                                        const std::string& run_dir, double seconds) {
  const std::string program = bench == "sim"         ? "comrad-sim-worker"
                              : bench == "inference" ? "comrad-policy-worker"
                                                     : "comrad-learner";
  std::vector<std::string> command = {sibling_program(program), "--run_dir", run_dir, "--bench",
                                      std::to_string(seconds)};
  if (bench == "sim") return command;
  for (std::string& word : shape_flags(merged.scenario.env)) command.push_back(std::move(word));
  return command;
}

/// One stage alone: the worker program measures itself; its object is completed with the common keys.
Expected<ordered_json> bench_worker(const std::string& bench, const MergedSettings& merged,
                                    const std::string& run_dir, double seconds) {
  COMRAD_TRY_ASSIGN(const ProgramResult result,
                    run_program(worker_command(bench, merged, run_dir, seconds),
                                {.timeout_s = 3 * seconds + 120, .echo_stderr = true}));
  if (result.interrupted) return Error{ErrorCode::kSystem, "interrupted"};
  if (result.exit_code != 0)
    return Error{ErrorCode::kPeerLost, "the worker's bench ended with exit code " +
                                           std::to_string(result.exit_code) + ": " + last_words(result)};
  const ordered_json measured = ordered_json::parse(result.output, nullptr, false);
  if (!measured.is_object() || !measured.contains("decisions_per_s") ||
      !measured["decisions_per_s"].is_number())
    return Error{ErrorCode::kBadFormat, "the worker's bench printed no object with decisions_per_s"};
  const RunConfig& config = merged.config;
  const int64_t cores = bench == "sim"         ? 1
                        : bench == "inference" ? config.collection.policy_threads
                                               : config.collection.learner_threads;
  const auto took = measured.find("seconds");
  ordered_json summary = common_keys(
      bench, config, cores, took != measured.end() && took->is_number() ? took->get<double>() : seconds,
      measured["decisions_per_s"].get<double>());
  for (const auto& [key, value] : measured.items())
    if (!summary.contains(key)) summary[key] = value;
  return summary;
}

/// The whole pipeline, measured after the first update and a warm-up.
Expected<ordered_json> bench_train(const MergedSettings& merged, double seconds, int core_count,
                                   std::vector<std::string> notes) {
  const RunConfig& config = merged.config;
  COMRAD_TRY_ASSIGN(const RunOutcome outcome,
                    bench_pipeline(merged, {.seconds = seconds,
                                            .warmup_seconds = std::min(kTrainWarmupSeconds, seconds),
                                            .notes = std::move(notes)}));
  ordered_json summary =
      common_keys("train", config, core_count, outcome.measured.seconds,
                  static_cast<double>(outcome.measured.decisions) / outcome.measured.seconds);
  summary["updates_per_s"] = static_cast<double>(outcome.measured.updates) / outcome.measured.seconds;
  summary["policy_lag_mean"] = outcome.lag_mean;
  summary["steps_lost"] = outcome.steps_lost;
  summary["restarts"] = outcome.restarts;
  for (const char* setting : {"num_workers", "num_envs_per_worker", "policy_workers", "batch_size",
                              "num_epochs", "rollout", "rnn_type", "learner_threads", "device"}) {
    const std::string text = setting_text(config, setting);
    const ordered_json number = ordered_json::parse(text, nullptr, false);
    summary[setting] = number.is_number() ? number : ordered_json(text);
  }
  return summary;
}

void print_table(const ordered_json& summary) {
  for (const auto& [key, value] : summary.items()) {
    std::string text = value.is_string() ? value.get<std::string>() : value.dump();
    if (value.is_number_float()) {
      char rounded[32];
      std::snprintf(rounded, sizeof(rounded), "%.1f", value.get<double>());
      text = rounded;
    }
    std::printf("%-24s %s\n", key.c_str(), text.c_str());
  }
}

Expected<int> bench(const std::string& what, double seconds, bool json, const CommandLine& line) {
  if (std::find(kBenches.begin(), kBenches.end(), what) == kBenches.end()) {
    return Error{ErrorCode::kBadInput, "unknown bench '" + what + "'" +
                                           did_you_mean(what, {kBenches.begin(), kBenches.end()}) + " (" +
                                           joined(kBenches) + ")"};
  }
  if (what == "replay")
    return Error{ErrorCode::kBadInput,
                 "write `comrad bench replay [flags]`: the replay's bench has flags of its own"};
  if (!(seconds > 0) || seconds > 86400)
    return Error{ErrorCode::kBadInput, "--seconds must be above 0, at most 86400"};

  const int core_count = usable_cores();
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_new({line.config_file(), line.typed()}, describe_scenario,
                                                     core_count, endless_settings()));
  print_warnings(merged.scenario);
  const auto measured = [&]() -> Expected<ordered_json> {
    if (what == "train")
      return bench_train(merged, seconds, core_count, flags_without_effect(merged.config, line.typed()));
    COMRAD_TRY_ASSIGN(const TemporaryRun run, TemporaryRun::create(merged.config));
    return bench_worker(what, merged, run.path(), seconds);
  };
  COMRAD_TRY_ASSIGN(const ordered_json summary, measured());
  if (json)
    std::printf("%s\n", summary.dump().c_str());
  else
    print_table(summary);
  return kExitDone;
}

}  // namespace

int bench_command(Arguments arguments) {
  if (!arguments.empty() && arguments[0] == "replay") {  // no run, no settings: its program does it all
    std::vector<std::string> command = {sibling_program("comrad-bench-replay")};
    command.insert(command.end(), arguments.begin() + 1, arguments.end());
    return report_error("bench", replace_process(command));
  }
  std::string what;
  double seconds = 20;
  bool json = false;
  CommandLine line(
      "bench sim|inference|learner|train|replay [--seconds S] [--json] [settings]",
      "Measures agent decisions and env frames per second: sim (one simulator process with random\n"
      "actions), inference (one policy worker), learner (optimizer steps on made-up data), or train (the\n"
      "whole pipeline, counted after the first update and a warm-up). Runs in a temporary directory.\n"
      "replay measures what the replay alone hands out; its flags: comrad bench replay --help.");
  line.add_positional("WHAT", what, "sim, inference, learner, train or replay");
  line.add_option("seconds", seconds, "S", "how long to measure (default 20)");
  line.add_switch("json", json, "print one JSON object on stdout and nothing else");
  line.add_settings();
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("bench", parsed.error());
  if (line.help_requested()) {
    std::fputs(line.help().c_str(), stdout);
    return kExitDone;
  }
  const Expected<int> done = bench(what, seconds, json, line);
  return done ? *done : report_error("bench", done.error());
}

}  // namespace comrad::deploy
