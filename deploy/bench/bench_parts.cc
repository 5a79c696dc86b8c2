#include "deploy/bench/bench_parts.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <utility>

#include "deploy/bench/bottleneck.h"
#include "deploy/bench/pipeline_bench.h"
#include "deploy/process/child_program.h"
#include "deploy/process/process_start.h"
#include "deploy/settings/network_description.h"
#include "deploy/settings/start_notes.h"
#include "deploy/settings/temporary_run.h"
#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/settings/algorithms.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

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

bool is_of_simulator(const std::string& bench) {
  return bench == "sim" || bench == "engine" || bench == "render";
}

std::vector<std::string> worker_command(const BenchRequest& request, const MergedSettings& merged,
                                        const std::string& run_dir) {
  const std::string& bench = request.what;
  const std::string program = is_of_simulator(bench) ? "comrad-sim-worker"
                              : bench == "inference" ? "comrad-policy-worker"
                                                     : "comrad-learner";
  std::vector<std::string> command = {sibling_program(program), "--run_dir", run_dir, "--bench",
                                      std::to_string(request.seconds)};
  if (is_of_simulator(bench)) {
    command.insert(command.end(), {"--bench_part", bench});
    return command;
  }
  for (std::string& word : shape_flags(merged.scenario.env)) command.push_back(std::move(word));
  return command;
}

Expected<ordered_json> object_of(const std::vector<std::string>& command, double timeout_s) {
  COMRAD_TRY_ASSIGN(
      const ProgramResult result,
      run_program(command, {.timeout_s = timeout_s, .echo_stderr = true, .environment = sleeping_threads()}));
  if (result.interrupted) return Error{ErrorCode::kSystem, "interrupted"};
  if (result.exit_code != 0)
    return Error{ErrorCode::kPeerLost, fmt::format("the worker's bench ended with exit code {}: {}",
                                                   result.exit_code, last_words(result))};
  ordered_json measured = ordered_json::parse(result.output, nullptr, false);
  if (!measured.is_object() || !measured.contains("decisions_per_s") ||
      !measured["decisions_per_s"].is_number())
    return Error{ErrorCode::kBadFormat, "the worker's bench printed no object with decisions_per_s"};
  return measured;
}

/// One stage alone: the worker program measures itself; its object is completed with the common keys.
Expected<ordered_json> bench_worker(const BenchRequest& request, MergedSettings merged) {
  COMRAD_TRY_ASSIGN(const TemporaryRun run, TemporaryRun::create(merged.config));
  COMRAD_TRY_ASSIGN(const ordered_json measured,
                    object_of(worker_command(request, merged, run.path()), 3 * request.seconds + 120));
  const RunConfig& config = merged.config;
  const int64_t cores = is_of_simulator(request.what) ? 1
                        : request.what == "inference" ? config.collection.policy_threads
                                                      : config.collection.learner_threads;
  const auto took = measured.find("seconds");
  ordered_json summary =
      common_keys(request.what, config, cores,
                  took != measured.end() && took->is_number() ? took->get<double>() : request.seconds,
                  measured["decisions_per_s"].get<double>());
  for (const auto& [key, value] : measured.items())
    if (!summary.contains(key)) summary[key] = value;
  if (is_of_simulator(request.what)) {
    summary["num_workers"] = 1;
    summary["num_envs_per_worker"] = config.collection.num_envs_per_worker;
  }
  return summary;
}

/// Share of their time in which the processes of a role did not wait for others.
double busy_share(const RoleUsage& role, double seconds) {
  return std::clamp(1 - role.wait_s / std::max(1, role.processes) / seconds, 0.0, 1.0);
}

/// What the window cost, and what limits the run.
void append_usage(const RunConfig& config, const MeasuredWindow& measured, int core_count,
                  ordered_json& summary) {
  const RunUsage& usage = measured.usage;
  const double thousands = static_cast<double>(measured.decisions) / 1000;
  ordered_json& cost = summary["cpu_seconds_per_1000_decisions"];
  double staged_s = 0;
  for (std::size_t i = 0; i < kStageCount; ++i) {
    cost[name_of(static_cast<Stage>(i))] = usage.stage_cpu_s[i] / thousands;
    staged_s += usage.stage_cpu_s[i];
  }
  cost["other"] = std::max(0.0, usage.cpu_s() - staged_s) / thousands;
  cost["simulators"] = usage.sims.cpu_s / thousands;
  cost["policy_workers"] = usage.policy_workers.cpu_s / thousands;
  cost["learner"] = usage.learner.cpu_s / thousands;
  cost["all"] = usage.cpu_s() / thousands;
  ordered_json& clocks = summary["policy_thread_us_per_decision"];
  for (const Stage stage : kPolicyStages)
    clocks[name_of(stage)] =
        1e6 * usage.stage_wall_s[static_cast<std::size_t>(stage)] / static_cast<double>(measured.decisions);
  if (measured.gpu_busy) summary["gpu_busy"] = *measured.gpu_busy;
  summary["bytes_copied_per_decision"] = usage.copied_bytes / static_cast<double>(measured.decisions);
  ordered_json cores = ordered_json::array();
  double busy_s = 0;
  for (const double core_s : usage.core_busy_s) {
    cores.push_back(std::min(1.0, core_s / measured.seconds));
    busy_s += core_s;
  }
  summary["cores_busy"] = cores;
  const double available_s = measured.seconds * core_count;
  const PipelineNumbers numbers{.cores = core_count,
                                .cores_busy = std::min(1.0, busy_s / available_s),
                                .others_busy = std::max(0.0, busy_s - usage.cpu_s()) / available_s,
                                .sim_busy = busy_share(usage.sims, measured.seconds),
                                .policy_busy = busy_share(usage.policy_workers, measured.seconds),
                                .learner_busy = busy_share(usage.learner, measured.seconds),
                                .stage_cpu_s = usage.stage_cpu_s,
                                .num_workers = config.collection.num_workers,
                                .num_envs_per_worker = config.collection.num_envs_per_worker,
                                .policy_workers = config.collection.policy_workers,
                                .learner_threads = config.collection.learner_threads,
                                .is_fp32 = config.collection.precision != Precision::kBf16,
                                .is_on_gpu = config.collection.device.starts_with("cuda")};
  summary["other_programs_busy"] = numbers.others_busy;
  summary["busy"] = {{"simulators", numbers.sim_busy},
                     {"policy_workers", numbers.policy_busy},
                     {"learner", numbers.learner_busy}};
  summary["bottleneck"] = bottleneck_text(numbers);
}

/// The whole pipeline, measured after the first update and a warm-up.
Expected<ordered_json> bench_train(const BenchRequest& request, const MergedSettings& merged,
                                   int core_count) {
  const RunConfig& config = merged.config;
  std::vector<std::string> notes;
  if (!request.is_quiet) notes = flags_without_effect(config, request.user.typed);
  COMRAD_TRY_ASSIGN(const RunOutcome outcome,
                    bench_pipeline(merged, {.seconds = request.seconds,
                                            .warmup_seconds = std::min(kTrainWarmupSeconds, request.seconds),
                                            .notes = std::move(notes),
                                            .shows_progress = !request.is_quiet}));
  const MeasuredWindow& measured = outcome.measured;
  ordered_json summary =
      common_keys("train", config, core_count, measured.seconds, median_of(measured.windows));
  summary["decisions"] = measured.decisions;
  summary["windows"] = measured.windows;
  summary["spread"] = spread_of(measured.windows);
  summary["updates_per_s"] = static_cast<double>(measured.updates) / measured.seconds;
  summary["policy_lag_mean"] = outcome.lag_mean;
  summary["steps_lost"] = outcome.accounts.lost_with_the_dead();
  summary["restarts"] = outcome.restarts;
  for (const char* setting :
       {"num_workers", "num_envs_per_worker", "policy_workers", "batch_size", "num_epochs", "rollout",
        "rnn_type", "learner_threads", "precision", "device"}) {
    const std::string text = setting_text(config, setting);
    const ordered_json number = ordered_json::parse(text, nullptr, false);
    summary[setting] = number.is_number() ? number : ordered_json(text);
  }
  append_usage(config, measured, core_count, summary);
  return summary;
}

}  // namespace

Expected<ordered_json> measure_bench(const BenchRequest& request) {
  const int core_count = usable_cores();
  COMRAD_TRY_ASSIGN(MergedSettings merged,
                    merge_new(request.user, describe_scenario, core_count, endless_settings()));
  if (!request.is_quiet) print_warnings(merged.scenario);
  return request.what == "train" ? bench_train(request, merged, core_count)
                                 : bench_worker(request, std::move(merged));
}

Expected<ordered_json> measure_all_algorithms(const BenchRequest& request) {
  ordered_json summary, rows = ordered_json::array();
  for (const std::string& algorithm : algorithm_names()) {
    BenchRequest one = request;
    one.user = user_with(request.user, {{"algo", algorithm}});
    COMRAD_TRY_ASSIGN(const ordered_json measured, measure_bench(one));
    if (summary.empty()) summary = measured;
    const double first =
        rows.empty() ? measured["decisions_per_s"].get<double>() : rows[0]["decisions_per_s"].get<double>();
    rows.push_back({{"algo", algorithm},
                    {"decisions_per_s", measured["decisions_per_s"]},
                    {"spread", measured["spread"]},
                    {"updates_per_s", measured["updates_per_s"]},
                    {"cpu_seconds_per_1000_decisions", measured["cpu_seconds_per_1000_decisions"]["all"]},
                    {"host_waits_per_step", measured["host_waits_per_step"]["all"]},
                    {"of_the_first", measured["decisions_per_s"].get<double>() / first}});
  }
  summary["algorithms"] = rows;
  return summary;
}

Expected<ordered_json> measure_with_program(std::vector<std::string> command, double seconds) {
  command[0] = sibling_program(command[0]);
  command.emplace_back("--json");
  return object_of(command, 3 * seconds + 60);
}

UserSettings user_with(UserSettings user, const SettingValues& settings) {
  user.typed.values = with_settings(std::move(user.typed.values), settings);
  return user;
}

}  // namespace comrad::deploy
