#include "sim_workers/worker/sim_program.h"

#include <spdlog/fmt/fmt.h>

#include <sched.h>

#include <cerrno>
#include <cstdio>
#include <cstring>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>

#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/env/environment.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/worker/bench.h"
#include "sim_workers/worker/episode_recorder.h"
#include "sim_workers/worker/position_log.h"
#include "sim_workers/worker/sim_worker.h"

namespace comrad::sim {
namespace {

/// Where actions come from.
struct Roles {
  bool evaluate = false;
  bool oracle = false;
  std::vector<int> oracle_seats;  ///< agents that the scripted team plays beside others; empty: none
  std::string positions;          ///< file for a PositionLog; empty: none
  std::string episodes;           ///< folder for an EpisodeRecorder; empty: none. One of the two at a time
};

void pin_to_core(int core) {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  CPU_SET(static_cast<std::size_t>(core), &cores);
  if (sched_setaffinity(0, sizeof cores, &cores) != 0)
    spdlog::warn("cannot pin to core {}: {}", core, std::strerror(errno));
}

/// The settings of the run, with the scenario's share of the team reward where none was chosen.
Expected<RunConfig> checked_settings(RunConfig config, const std::string& run_dir) {
  if (config.environment.shared_reward_alpha < 0) {
    COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec scenario, scenarios::load_scenario(config.run.scenario));
    config.environment.shared_reward_alpha = scenario.shared_reward_alpha;
  }
  if (config.environment.wad.empty() && config.environment.layout_pool.empty())
    return Error{
        ErrorCode::kBadInput,
        run_dir + "/config.toml: wad is empty; it must name the map to play (comrad-doomgen makes one)"};
  return config;
}

/// Paths of the run's layout pool, in its order; empty where it plays one map.
Expected<std::vector<std::string>> pool_paths(const RunConfig& config, const std::string& run_dir) {
  std::vector<std::string> paths;
  if (config.environment.layout_pool.empty()) return paths;
  COMRAD_TRY_ASSIGN(const LayoutList list, read_layout_list(run_dir));
  for (const LayoutEntry& layout : list.layouts) paths.push_back(layout.path);
  return paths;
}

EnvironmentOptions environment_options(const RunConfig& config, const std::vector<std::string>& layouts,
                                       int num_agents, int count) {
  return {.scenario = config.run.scenario,
          .wad_path = config.environment.wad,
          .layouts = layouts,
          .num_agents = num_agents,
          .count = count,
          .frame_skip = static_cast<int>(config.environment.env_frameskip),
          .use_measurements = config.environment.use_additional_input,
          .render_size = config.environment.render_size,
          .renderer = config.environment.renderer,
          .resize = config.environment.resize,
          .reward = config.environment.reward,
          .heads = config.environment.heads,
          .decision_limit = config.environment.decision_limit};
}

const std::map<std::string, BenchPart> kBenchParts = {
    {"sim", BenchPart::kAll}, {"engine", BenchPart::kEngine}, {"render", BenchPart::kRender}};

nlohmann::json report_of(const BenchResult& result, const std::string& part, const RunConfig& config) {
  const double decisions_per_s = median_of(result.windows),
               env_frames_per_s = decisions_per_s * static_cast<double>(config.environment.env_frameskip);
  const double thousands = static_cast<double>(result.decisions) / 1000;
  nlohmann::json report = {{"decisions_per_s", decisions_per_s},
                           {"env_frames_per_s", env_frames_per_s},
                           {"windows", result.windows},
                           {"spread", spread_of(result.windows)},
                           {"num_agents", config.environment.num_agents},
                           {"num_envs", config.collection.num_envs_per_worker},
                           {"episodes", result.episodes},
                           {"seconds", result.seconds},
                           {"cpu_seconds", result.cpu_seconds}};
  if (part == "engine") {
    report["player_tics_per_s"] = env_frames_per_s;
    report["world_tics_per_s"] = env_frames_per_s / static_cast<double>(config.environment.num_agents);
  }
  if (part == "render") report["views_per_s"] = decisions_per_s;
  if (part != "render") report["cpu_seconds_per_1000_decisions"]["tic"] = result.tic_cpu_seconds / thousands;
  if (part != "engine")
    report["cpu_seconds_per_1000_decisions"]["render"] = result.render_cpu_seconds / thousands;
  report["cpu_seconds_per_1000_decisions"]["all"] = result.cpu_seconds / thousands;
  return report;
}

Status bench(const shm::WorkerShell& shell, const RunConfig& given, const std::string& part, double seconds) {
  COMRAD_TRY_ASSIGN(const RunConfig config, checked_settings(given, shell.run_dir()));
  if (config.collection.worker_num_splits == 0)
    return Error{
        ErrorCode::kBadInput,
        shell.run_dir() + "/config.toml: worker_num_splits is 0 (auto); a bench of one process needs 1 or 2"};
  COMRAD_TRY_ASSIGN(const std::vector<std::string> layouts, pool_paths(config, shell.run_dir()));
  // One core, so that the number is a core's: threads that the renderer may start share it.
  pin_to_core(sched_getcpu());
  COMRAD_TRY_ASSIGN(const auto environments,
                    make_doom_environments(
                        environment_options(config, layouts, static_cast<int>(config.environment.num_agents),
                                            static_cast<int>(config.collection.num_envs_per_worker))));
  const BenchResult result =
      run_bench(*environments, {.part = kBenchParts.at(part),
                                .seconds = seconds,
                                .splits = static_cast<int>(config.collection.worker_num_splits),
                                .rollout_steps = static_cast<int>(config.collection.rollout),
                                .seed = static_cast<uint64_t>(config.run.seed),
                                .layout_count = static_cast<int>(layouts.size()),
                                .rewards = RewardRules::from(config)});
  std::printf("%s\n", report_of(result, part, config).dump().c_str());
  return {};
}

Expected<std::unique_ptr<EnvironmentSet>> make_environments(const EnvironmentOptions& options,
                                                            const Roles& roles, PositionLog* positions,
                                                            EpisodeRecorder* recorder,
                                                            const SimProgram& program) {
  COMRAD_TRY_ASSIGN(auto environments, make_doom_environment_set(options));
  if (positions != nullptr) positions->watch(*environments);
  if (recorder != nullptr) recorder->watch(*environments);
  if (program.prepare) COMRAD_TRY(program.prepare(options, *environments));
  if (roles.oracle || !roles.oracle_seats.empty())
    return OracleEnvironmentSet::create(std::move(environments), roles.oracle_seats);
  return std::unique_ptr<EnvironmentSet>(std::move(environments));
}

Status work(const shm::WorkerShell& shell, const RunConfig& given, const Roles& roles,
            const SimProgram& program) {
  COMRAD_TRY_ASSIGN(const RunConfig config, checked_settings(given, shell.run_dir()));
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  if (config.collection.set_workers_cpu_affinity) {
    // Of those that it was given: the supervisor gives each simulator one already.
    const std::vector<int> cpus = allowed_cpus();
    pin_to_core(cpus[static_cast<std::size_t>(shell.worker_index()) % cpus.size()]);
  }
  COMRAD_TRY_ASSIGN(const std::vector<std::string> layouts, pool_paths(config, shell.run_dir()));
  std::unique_ptr<PositionLog> positions;
  if (!roles.positions.empty()) {
    COMRAD_TRY_ASSIGN(positions, PositionLog::create(roles.positions));
  }
  std::unique_ptr<EpisodeRecorder> recorder;
  if (!roles.episodes.empty()) recorder = std::make_unique<EpisodeRecorder>(roles.episodes);
  const EnvShape& shape = arena.shape().trajectory.env;
  EnvironmentOptions options =
      environment_options(config, layouts, shape.num_agents, arena.shape().envs_per_worker);
  options.use_global_state = shape.global_state_count > 0;
  COMRAD_TRY_ASSIGN(auto environments,
                    make_environments(options, roles, positions.get(), recorder.get(), program));
  if (program.wrap) environments = program.wrap(std::move(environments), arena);
  COMRAD_TRY_ASSIGN(
      const auto worker,
      SimWorker::create(
          *environments, arena,
          {.worker_index = shell.worker_index(),
           .rules = {.seed = static_cast<uint64_t>(config.run.seed),
                     .evaluate = roles.evaluate,
                     .rewards = RewardRules::from(config),
                     .layout_count = static_cast<uint32_t>(layouts.size()),
                     .layout_swap_every = static_cast<uint32_t>(config.environment.layout_swap_every)}}));
  spdlog::info("{} environments of {} on {}", arena.shape().envs_per_worker, config.run.scenario,
               layouts.empty() ? config.environment.wad : fmt::format("{} layouts", layouts.size()));
  COMRAD_TRY(worker->run(shell.stop()));
  if (positions != nullptr) COMRAD_TRY(positions->finish());
  if (recorder != nullptr) COMRAD_TRY(recorder->status());
  return program.finish ? program.finish() : Status();
}

}  // namespace

int run_sim_program(int argc, char** argv, shm::WorkerShell& shell, const SimProgram& program) {
  Roles roles;
  std::string bench_part = "sim";
  shell.flags()
      .add("--bench_part", bench_part,
           "bench: sim (tics and views), engine (no pictures), render (the time of the views alone)")
      .one_of({"sim", "engine", "render"});
  shell.flags().add("--evaluate", roles.evaluate, "play a fixed number of episodes, record no trajectories");
  shell.flags().add("--oracle", roles.oracle,
                    "the scenario's scripted team plays, whatever the policy workers answer");
  shell.flags()
      .add("--oracle_seats", roles.oracle_seats,
           "agents that the scripted team plays; the policy workers' answers move the others")
      .separated_by(',');
  shell.flags().add("--positions", roles.positions, "file to write where the agents of each episode were");
  shell.flags().add("--episodes", roles.episodes,
                    "folder to write each episode into, so that it can be played again");
  return shell.run(argc, argv,
                   {.work = [&](const RunConfig& config) { return work(shell, config, roles, program); },
                    .bench = [&](const RunConfig& config,
                                 double seconds) { return bench(shell, config, bench_part, seconds); }});
}

}  // namespace comrad::sim
