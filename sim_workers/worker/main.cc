// comrad-sim-worker: one simulator process of a run, or its benchmark.
#include <sched.h>
#include <sys/prctl.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>

#include "rollout_buffer/core/config.h"
#include "rollout_buffer/core/layout_list.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/env/environment.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/worker/bench.h"
#include "sim_workers/worker/sim_worker.h"

namespace {

using namespace comrad;

constexpr int kJoinTimeoutMs = 20'000;

std::atomic<bool> g_stop{false};  // a signal handler has no other way to speak

struct Arguments {
  std::string run_dir;
  std::string arena;
  int worker_index = 0;
  bool evaluate = false;
  bool oracle = false;
  double bench_seconds = 0;
};

int fail(const Error& error) {
  spdlog::error("{}", error.message);
  switch (error.code) {
    case ErrorCode::kBadInput:
    case ErrorCode::kNotFound:
    case ErrorCode::kBadFormat:    // a map that cannot be read
    case ErrorCode::kUnsupported:  // or played
      return kExitBadInput;        // starting again cannot help
    default:
      return 1;
  }
}

void pin_to_core(int core) {
  cpu_set_t cores;
  CPU_ZERO(&cores);
  CPU_SET(static_cast<std::size_t>(core), &cores);
  if (sched_setaffinity(0, sizeof cores, &cores) != 0)
    spdlog::warn("cannot pin to core {}: {}", core, std::strerror(errno));
}

/// The settings of the run, with the scenario's share of the team reward where none was chosen.
Expected<RunConfig> load_settings(const std::string& run_dir) {
  COMRAD_TRY_ASSIGN(RunConfig config, load_run_config(run_dir + "/config.toml"));
  if (config.shared_reward_alpha < 0) {
    COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec scenario, scenarios::load_scenario(config.scenario));
    config.shared_reward_alpha = scenario.shared_reward_alpha;
  }
  if (config.wad.empty() && config.layout_pool.empty())
    return Error{
        ErrorCode::kBadInput,
        run_dir + "/config.toml: wad is empty; it must name the map to play (comrad-doomgen makes one)"};
  return config;
}

/// Paths of the run's layout pool, in its order; empty where it plays one map.
Expected<std::vector<std::string>> pool_paths(const RunConfig& config, const std::string& run_dir) {
  std::vector<std::string> paths;
  if (config.layout_pool.empty()) return paths;
  COMRAD_TRY_ASSIGN(const LayoutList list, read_layout_list(run_dir));
  for (const LayoutEntry& layout : list.layouts) paths.push_back(layout.path);
  return paths;
}

sim::EnvironmentOptions environment_options(const RunConfig& config, const std::vector<std::string>& layouts,
                                            int num_agents, int count) {
  return {.scenario = config.scenario,
          .wad_path = config.wad,
          .layouts = layouts,
          .num_agents = num_agents,
          .count = count,
          .frame_skip = static_cast<int>(config.env_frameskip),
          .use_measurements = config.use_additional_input,
          .render_size = config.render_size,
          .resize = config.resize};
}

Status bench(const Arguments& arguments) {
  COMRAD_TRY_ASSIGN(const RunConfig config, load_settings(arguments.run_dir));
  COMRAD_TRY_ASSIGN(const std::vector<std::string> layouts, pool_paths(config, arguments.run_dir));
  // One core, so that the number is a core's: threads that the renderer may start share it.
  pin_to_core(sched_getcpu());
  COMRAD_TRY_ASSIGN(const auto environments, sim::make_doom_environments(environment_options(
                                                 config, layouts, static_cast<int>(config.num_agents),
                                                 static_cast<int>(config.num_envs_per_worker))));
  const sim::BenchResult result =
      sim::run_bench(*environments, {.seconds = arguments.bench_seconds,
                                     .splits = static_cast<int>(config.worker_num_splits),
                                     .rollout_steps = static_cast<int>(config.rollout),
                                     .seed = static_cast<uint64_t>(config.seed),
                                     .layout_count = static_cast<int>(layouts.size()),
                                     .rewards = sim::RewardRules::from(config)});
  const double decisions_per_s = static_cast<double>(result.decisions) / result.seconds;
  const nlohmann::json report = {
      {"decisions_per_s", decisions_per_s},
      {"env_frames_per_s", decisions_per_s * static_cast<double>(config.env_frameskip)},
      {"num_agents", config.num_agents},
      {"num_envs", config.num_envs_per_worker},
      {"episodes", result.episodes},
      {"seconds", result.seconds},
      {"cpu_seconds", result.cpu_seconds}};
  std::printf("%s\n", report.dump().c_str());
  return {};
}

Expected<std::unique_ptr<sim::EnvironmentSet>> make_environments(const sim::EnvironmentOptions& options,
                                                                 bool oracle) {
  if (!oracle) return sim::make_doom_environments(options);
  COMRAD_TRY_ASSIGN(auto guided, sim::make_doom_environment_set(options));
  return sim::OracleEnvironmentSet::create(std::move(guided));
}

Status work(const Arguments& arguments) {
  COMRAD_TRY_ASSIGN(const RunConfig config, load_settings(arguments.run_dir));
  shm::JoinRequest request;
  std::strncpy(request.role, "sim", sizeof request.role - 1);
  request.worker_index = static_cast<uint32_t>(arguments.worker_index);
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shm::join_arena(arguments.arena, request, kJoinTimeoutMs));
  if (config.set_workers_cpu_affinity)
    pin_to_core(arguments.worker_index % static_cast<int>(std::max(1u, std::thread::hardware_concurrency())));
  COMRAD_TRY_ASSIGN(const std::vector<std::string> layouts, pool_paths(config, arguments.run_dir));
  COMRAD_TRY_ASSIGN(
      const auto environments,
      make_environments(environment_options(config, layouts, arena.shape().trajectory.env.num_agents,
                                            arena.shape().envs_per_worker),
                        arguments.oracle));
  COMRAD_TRY_ASSIGN(const auto worker,
                    sim::SimWorker::create(
                        *environments, arena,
                        {.worker_index = arguments.worker_index,
                         .rules = {.seed = static_cast<uint64_t>(config.seed),
                                   .evaluate = arguments.evaluate,
                                   .rewards = sim::RewardRules::from(config),
                                   .layout_count = static_cast<uint32_t>(layouts.size()),
                                   .layout_swap_every = static_cast<uint32_t>(config.layout_swap_every)}}));
  spdlog::info("{} environments of {} on {}", arena.shape().envs_per_worker, config.scenario,
               layouts.empty() ? config.wad : std::to_string(layouts.size()) + " layouts");
  COMRAD_TRY(worker->run(g_stop));
  spdlog::info("stopped");
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  comrad::prepare_process();
  Arguments arguments;
  CLI::App app{
      "One simulator process of a run: renders observations into the arena and plays the actions that come "
      "back."};
  app.add_option("--run_dir", arguments.run_dir, "the run's folder, with config.toml")->required();
  const auto* arena = app.add_option("--arena", arguments.arena, "name of the run's socket");
  app.add_option("--worker_index", arguments.worker_index, "which simulator this is, from 0")
      ->check(CLI::NonNegativeNumber);
  app.add_flag("--evaluate", arguments.evaluate, "play a fixed number of episodes, record no trajectories");
  app.add_flag("--oracle", arguments.oracle,
               "the scenario's scripted team plays, whatever the policy workers answer");
  const auto* bench_option =
      app.add_option("--bench", arguments.bench_seconds,
                     "no run: random actions for so many seconds, prints one JSON object")
          ->check(CLI::Range(0.01, 86400.0));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& failure) {
    return app.exit(failure) == 0 ? 0 : kExitBadInput;
  }
  const bool is_bench = bench_option->count() > 0;
  if (!is_bench && arena->count() == 0) {
    std::fprintf(stderr, "comrad-sim-worker: give --arena NAME to join a run, or --bench SECONDS\n");
    return kExitBadInput;
  }

  if (!is_bench) {
    struct sigaction on_term {};
    on_term.sa_handler = [](int) { g_stop.store(true); };
    sigaction(SIGTERM, &on_term, nullptr);  // without SA_RESTART: a waiting worker wakes at once
    std::signal(SIGINT, SIG_IGN);           // Ctrl-C reaches the whole process group; the supervisor decides
    prctl(PR_SET_PDEATHSIG, SIGTERM);
  }
  const std::string role = "sim-" + std::to_string(arguments.worker_index);
  try {
    if (Status log = init_log(role, is_bench ? "" : arguments.run_dir + "/logs/" + role + ".log"); !log)
      return fail(log.error());
    const Status done = is_bench ? bench(arguments) : work(arguments);
    return done ? 0 : fail(done.error());
  } catch (const std::exception& failure) {  // from libraries; ours do not throw
    std::fprintf(stderr, "comrad-sim-worker: %s\n", failure.what());
    return 1;
  }
}
