// `comrad bench`: throughput of one stage alone (engine, render, sim, inference, learner: the worker program's own --bench;
// transport, replay: programs with their own flags), of the whole pipeline (train), or of many of these (scaling).

#include <algorithm>
#include <cstdio>
#include <fstream>
#include <iterator>
#include <nlohmann/json.hpp>

#include "deploy/bench/bench_check.h"
#include "deploy/bench/bench_parts.h"
#include "deploy/bench/bench_report.h"
#include "deploy/bench/bench_scaling.h"
#include "deploy/bench/bench_table.h"
#include "deploy/bench/scaling_model.h"
#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

/// With settings of a run.
const std::vector<std::string> kBenches = {"engine", "render",  "sim",   "inference", "learner",
                                           "train",  "scaling", "check", "report",    "model"};
/// Programs with their own flags.
const std::vector<std::string> kProgramBenches = {"transport", "replay"};

std::vector<std::string> all_benches() {
  std::vector<std::string> all = kBenches;
  all.insert(all.end(), kProgramBenches.begin(), kProgramBenches.end());
  return all;
}

struct BenchFlags {
  std::string what;
  double seconds = 20;
  bool json = false;
  ScalingGrid grid;
  double rounds = 5;          ///< check: at most
  std::string write, charts;  ///< report
  std::string from;           ///< model
  std::vector<std::string> cores;
};

/// Flags of one bench alone.
constexpr std::pair<const char*, const char*> kFlagsOf[] = {
    {"parts", "scaling"}, {"scenarios", "scaling"}, {"agents", "scaling"}, {"workers", "scaling"},
    {"envs", "scaling"},  {"rounds", "check"},      {"write", "report"},   {"charts", "report"},
    {"from", "model"},    {"cores", "model"}};
constexpr int kRoundsMin = 3;
constexpr double kCheckSeconds = 6;

Status check(const BenchFlags& flags, const CommandLine& line) {
  if (std::ranges::find(kBenches, flags.what) == kBenches.end()) {
    if (std::ranges::find(kProgramBenches, flags.what) != kProgramBenches.end())
      return Error{ErrorCode::kBadInput, "write `comrad bench " + flags.what + " [flags]`: the " +
                                             flags.what + "'s bench has its own flags"};
    return Error{ErrorCode::kBadInput, "unknown bench '" + flags.what + "'" +
                                           did_you_mean(flags.what, all_benches()) + " (" +
                                           joined(all_benches()) + ")"};
  }
  if (!(flags.seconds > 0) || flags.seconds > 86400)
    return Error{ErrorCode::kBadInput, "--seconds must be above 0, at most 86400"};
  if (!(flags.rounds >= 1 && flags.rounds <= 100))
    return Error{ErrorCode::kBadInput, "--rounds must be 1 to 100"};
  for (const auto& [flag, bench] : kFlagsOf)
    if (flags.what != bench && line.was_typed(flag))
      return Error{ErrorCode::kBadInput,
                   "--" + std::string(flag) + " is for `comrad bench " + std::string(bench) + "`"};
  if (flags.what == "model" && flags.from.empty())
    return Error{ErrorCode::kBadInput, "model needs --from FILE, what `comrad bench train --json` printed"};
  return {};
}

Expected<std::string> text_of(const std::string& path) {
  std::ifstream file(path);
  if (!file) return Error{ErrorCode::kNotFound, path + " cannot be read"};
  return std::string(std::istreambuf_iterator<char>(file), {});
}

Expected<ordered_json> report(const BenchFlags& flags, const BenchRequest& request) {
  std::string before;
  if (!flags.write.empty()) {
    // Before minutes of measuring.
    COMRAD_TRY_ASSIGN(before, text_of(flags.write));
    if (const auto fits = with_tables(before, ""); !fits)
      return Error{fits.error().code, "--write " + flags.write + ": " + fits.error().message};
  }
  COMRAD_TRY_ASSIGN(const std::vector<ordered_json> benches, measure_everything(request));
  const std::string tables = report_tables(benches, bench_origin());
  if (!flags.write.empty()) {
    COMRAD_TRY_ASSIGN(const std::string after, with_tables(before, tables));
    COMRAD_TRY(write_file_atomically(flags.write, after, /*durable=*/false));
  }
  ordered_json summary = benches.back();
  summary["bench"] = "report";
  summary["benches"] = benches;
  summary["markdown"] = tables;
  return summary;
}

/// Becomes the program that draws the charts of BENCHMARKS.md from the rates kept in deploy/bench/rates.toml.
Error draw_charts(const std::string& folder) {
  const Expected<std::string> python = python_that_imports(kReportModules);
  if (!python) return python.error();
  return replace_process(python_command(*python, "deploy/report/rates.py", {folder}));
}

/// Of the settings that were typed, on other machines.
Expected<ordered_json> model(const BenchFlags& flags, const BenchRequest& request) {
  COMRAD_TRY_ASSIGN(const std::string text, text_of(flags.from));
  const ordered_json measured = ordered_json::parse(text, nullptr, /*allow_exceptions=*/false);
  const Expected<DecisionCosts> costs = DecisionCosts::from(measured);
  if (!costs) return Error{costs.error().code, "--from " + flags.from + ": " + costs.error().message};
  std::vector<int64_t> cores;
  for (const std::string& word : flags.cores) {
    const ordered_json number = ordered_json::parse(word, nullptr, false);
    if (!number.is_number_integer() || number < 1 || number > 4096)
      return Error{ErrorCode::kBadInput, "--cores " + word + " must be whole numbers from 1 to 4096"};
    cores.push_back(number.get<int64_t>());
  }
  if (cores.empty()) cores = {1, 2, 4, 8, 16, 32};
  const auto settings_on = [&](int count) -> Expected<RunConfig> {
    COMRAD_TRY_ASSIGN(const MergedSettings merged, merge_new(request.user, describe_scenario, count));
    return merged.config;
  };
  ordered_json summary;
  for (const char* key :
       {"bench", "scenario", "algo", "num_agents", "cores", "seconds", "decisions_per_s", "env_frames_per_s"})
    summary[key] = measured.value(key, ordered_json());
  summary["bench"] = "model";
  COMRAD_TRY_ASSIGN(summary["on"], model_table(*costs, cores, settings_on));
  return summary;
}

Expected<ordered_json> measure(const BenchFlags& flags, const CommandLine& line) {
  BenchRequest request{.what = flags.what,
                       .user = {line.config_file(), line.typed()},
                       .seconds = flags.seconds,
                       .is_quiet = false};
  if (flags.what == "scaling") return measure_scaling(flags.grid, request);
  if (flags.what == "report") return report(flags, request);
  if (flags.what == "model") return model(flags, request);
  if (flags.what == "check") {
    if (!line.was_typed("seconds")) request.seconds = kCheckSeconds;
    const int rounds = static_cast<int>(flags.rounds);
    return measure_checks(request, std::min(kRoundsMin, rounds), rounds);
  }
  const auto algorithm =
      std::ranges::find(request.user.typed.values, "algo", &std::pair<std::string, std::string>::first);
  if (flags.what == "learner" && algorithm != request.user.typed.values.end() && algorithm->second == "all") {
    request.user.typed.values.erase(algorithm);
    return measure_all_algorithms(request);
  }
  return measure_bench(request);
}

}  // namespace

int bench_command(Arguments arguments) {
  if (!arguments.empty() && std::ranges::find(kProgramBenches, arguments[0]) != kProgramBenches.end()) {
    std::vector<std::string> command = {sibling_program("comrad-bench-" + arguments[0])};
    command.insert(command.end(), arguments.begin() + 1, arguments.end());
    return report_error("bench", replace_process(command));
  }
  BenchFlags flags;
  flags.grid.benches.clear();
  CommandLine line(
      "bench WHAT [--seconds S] [--json] [settings]",
      "Measures agent decisions and env frames per second, in several windows, in a temporary directory:\n"
      "  engine     tics without pictures\n"
      "  render     the views alone\n"
      "  sim        one simulator process with random actions\n"
      "  inference  one policy worker, over batch sizes\n"
      "  learner    optimizer steps on made-up data; --algo all: every algorithm\n"
      "  train      the whole pipeline after the first update and a warm-up: processor seconds by stage, "
      "what\n"
      "             limits it, which setting to change\n"
      "  scaling    a table over scenarios, agents, workers and environments\n"
      "  check      whether ratios hold that do not depend on the machine; exit code 1 where one does not\n"
      "  report     all of these as Markdown tables, with commit, machine and date\n"
      "  model      what the costs that train measured would give on more cores\n"
      "transport measures hand-overs through the shared memory, replay what the replay alone hands out; "
      "their\n"
      "flags: comrad bench transport --help.");
  line.add_positional("WHAT", flags.what, joined(all_benches()));
  line.add_option("seconds", flags.seconds, "S",
                  "how long to measure (default 20; check 6); scaling, report: every part");
  line.add_switch("json", flags.json, "print one JSON object on stdout and nothing else");
  line.add_option(
      "parts", flags.grid.benches, "BENCHES",
      "scaling: what measures a point, engine, render, sim, inference, learner or train (default sim)");
  line.add_option("scenarios", flags.grid.scenarios, "NAMES", "scaling: instead of --scenario");
  line.add_option("agents", flags.grid.agents, "NUMBERS", "scaling: instead of --num_agents");
  line.add_option("workers", flags.grid.workers, "NUMBERS", "scaling: instead of --num_workers, for train");
  line.add_option("envs", flags.grid.envs, "NUMBERS", "scaling: instead of --num_envs_per_worker");
  line.add_option("rounds", flags.rounds, "N", "check: give up after so many rounds (default 5)");
  line.add_option("write", flags.write, "FILE.md", "report: put the tables between the marks of this file");
  line.add_option("charts", flags.charts, "DIR",
                  "report: measure nothing, draw the charts of deploy/bench/rates.toml into this folder");
  line.add_option("from", flags.from, "FILE", "model: what `comrad bench train --json` printed");
  line.add_option("cores", flags.cores, "NUMBERS", "model: on how many cores (default 1,2,4,8,16,32)");
  line.add_settings();
  return run_command("bench", line, arguments, [&]() -> Expected<int> {
    COMRAD_TRY(check(flags, line));
    if (!flags.charts.empty()) return draw_charts(flags.charts);
    if (flags.grid.benches.empty()) flags.grid.benches = {"sim"};
    COMRAD_TRY_ASSIGN(const ordered_json summary, measure(flags, line));
    if (flags.what == "report" && !flags.json) {
      std::fputs(summary.at("markdown").get<std::string>().c_str(), stdout);
      return kExitDone;
    }
    std::fputs(flags.json ? (summary.dump() + "\n").c_str() : bench_table(summary).c_str(), stdout);
    return flags.what == "check" && !summary.at("holds").get<bool>() ? kExitFailed : kExitDone;
  });
}

}  // namespace comrad::deploy
