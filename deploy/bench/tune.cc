// `comrad tune`: which workers, environments, threads and precision make the whole pipeline fastest on this machine.

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <utility>

#include "deploy/bench/pipeline_bench.h"
#include "deploy/bench/tune_search.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/output_check.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

struct TuneRequest {
  double seconds = 120;
  std::string write;
  bool json = false;
};

constexpr double kTrySeconds = 4, kTryWarmupSeconds = 1.5;

/// "--precision bf16 --num_workers 3"; "the settings as they are" for none.
std::string flags_of(const TunedSettings& settings) {
  if (settings.empty()) return "the settings as they are";
  std::vector<std::string> flags;
  for (const auto& [setting, value] : settings) flags.push_back("--" + setting + " " + value);
  return joined(flags, " ");
}

ordered_json json_of(const TunedSettings& settings) {
  ordered_json object = ordered_json::object();
  for (const auto& [setting, value] : settings) object[setting] = value;
  return object;
}

Status write_toml(const std::string& path, const TuneResult& result, const MergedSettings& merged) {
  const std::string found_for =
      fmt::format("# comrad tune: {}, {}, {} cores; use: comrad train --config FILE\n",
                  merged.config.run.scenario, merged.config.run.algo.name(), usable_cores());
  return write_file_atomically(path, found_for + toml_of(result.best), /*durable=*/false);
}

Expected<int> tune_here(const TuneRequest& request, const CommandLine& line) {
  if (!(request.seconds > 0) || request.seconds > 86400)
    return Error{ErrorCode::kBadInput, "--seconds must be above 0, at most 86400"};
  std::string file;
  if (!request.write.empty()) {
    COMRAD_TRY_ASSIGN(file, check_output_file("write", request.write, {".toml"}));
  }
  const int cores = usable_cores();
  const auto merged_with = [&](const TunedSettings& tuned) {
    UserSettings user{line.config_file(), line.typed()};
    for (const auto& [setting, value] : tuned) user.typed.values.emplace_back(setting, value);
    return merge_new(user, describe_scenario, cores, endless_settings());
  };
  COMRAD_TRY_ASSIGN(const MergedSettings merged, merged_with({}));
  print_warnings(merged.scenario);
  std::vector<TuneAxis> axes = tune_axes(merged.config, cores);
  // What the user fixed stays.
  const auto is_fixed = [&](const auto& value) { return line.was_typed(value.first); };
  for (TuneAxis& axis : axes)
    std::erase_if(axis, [&](const TunedSettings& one) { return std::ranges::any_of(one, is_fixed); });
  std::erase_if(axes, [](const TuneAxis& axis) { return axis.empty(); });

  const double began = monotonic_s();
  bool is_interrupted = false;
  const auto measure = [&](const TunedSettings& tuned) -> Expected<double> {
    std::fprintf(stderr, "comrad tune: %3.0f s: %s ", monotonic_s() - began, flags_of(tuned).c_str());
    const auto measured = [&]() -> Expected<RunOutcome> {
      COMRAD_TRY_ASSIGN(const MergedSettings settings, merged_with(tuned));
      return bench_pipeline(settings, {.seconds = kTrySeconds,
                                       .warmup_seconds = kTryWarmupSeconds,
                                       .notes = {},
                                       .shows_progress = false});
    };
    const Expected<RunOutcome> outcome = measured();
    is_interrupted |= !outcome && outcome.error().message == "interrupted";
    if (!outcome) {
      std::fprintf(stderr, "failed: %s\n", outcome.error().message.c_str());
      return outcome.error();
    }
    const double rate = static_cast<double>(outcome->measured.decisions) / outcome->measured.seconds;
    std::fprintf(stderr, "%.0f decisions/s\n", rate);
    return rate;
  };
  const auto has_time = [&] { return !is_interrupted && monotonic_s() - began < request.seconds; };
  COMRAD_TRY_ASSIGN(const TuneResult result, tune(axes, measure, has_time));
  if (is_interrupted) return Error{ErrorCode::kSystem, "interrupted"};

  if (!file.empty()) COMRAD_TRY(write_toml(file, result, merged));
  if (request.json) {
    ordered_json tries = ordered_json::array();
    for (const TuneTry& one : result.tries)
      tries.push_back({{"settings", json_of(one.settings)},
                       {"decisions_per_s", one.failure.empty() ? ordered_json(one.rate) : ordered_json()},
                       {"failure", one.failure}});
    const ordered_json all = {{"scenario", merged.config.run.scenario},
                              {"algo", merged.config.run.algo.name()},
                              {"cores", cores},
                              {"best", json_of(result.best)},
                              {"ratio", result.ratio},
                              {"whole", result.is_whole},
                              {"tries", tries}};
    std::printf("%s\n", all.dump().c_str());
    return kExitDone;
  }
  if (result.best.empty())
    std::printf("nothing that was tried is faster by %.0f %%: the settings are right as they are\n",
                100 * kLeastGain);
  else
    std::printf("%s\n%.2f times as fast as without them\n", flags_of(result.best).c_str(), result.ratio);
  if (!result.is_whole) std::printf("time ran out before all settings were tried; --seconds gives more\n");
  if (!file.empty()) std::printf("written to %s\n", file.c_str());
  return kExitDone;
}

}  // namespace

int tune_command(Arguments arguments) {
  TuneRequest request;
  CommandLine line(
      "tune [--seconds S] [--write FILE.toml] [settings]",
      "Trains for some seconds with one setting changed after the other (precision, workers, environments,\n"
      "threads, batches and splits) and keeps what is faster twice, by 3 %. Nothing of what is learned is\n"
      "changed but the rounding of bf16 and the policy lag. What you set yourself stays. Prints the flags\n"
      "that were found; give nothing else to do to the machine meanwhile.");
  line.add_option("seconds", request.seconds, "S", "begin no further setting after so long (default 120)");
  line.add_option("write", request.write, "FILE.toml", "write what was found, for comrad train --config");
  line.add_switch("json", request.json, "print one JSON object with every measurement on stdout");
  line.add_settings();
  return run_command("tune", line, arguments, [&] { return tune_here(request, line); });
}

}  // namespace comrad::deploy
