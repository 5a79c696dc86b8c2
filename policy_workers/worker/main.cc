// comrad-policy-worker: one inference process of a run, or its benchmark.
#include <sys/prctl.h>

#include <CLI/CLI.hpp>
#include <atomic>
#include <csignal>
#include <cstdio>
#include <cstring>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "policy_workers/policy/policy_net.h"
#include "policy_workers/worker/policy_worker.h"
#include "rollout_buffer/core/config.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace {

using namespace comrad;

constexpr int kJoinTimeoutMs = 20'000;

std::atomic<bool> g_stop{false};  // a signal handler has no other way to speak

struct Arguments {
  std::string run_dir;
  std::string arena;
  policy::PolicyWorkerOptions worker;
  bool evaluate = false;
  double bench_seconds = 0;
  int num_agents = 2;
  std::vector<int> heads = {3, 3, 3};
  int measurements = 0;
};

int fail(const Error& error) {
  spdlog::error("{}", error.message);
  return error.code == ErrorCode::kBadInput || error.code == ErrorCode::kNotFound ? kExitBadInput : 1;
}

Status bench(const Arguments& arguments) {
  COMRAD_TRY_ASSIGN(const RunConfig config, load_run_config(arguments.run_dir + "/config.toml"));
  TrajectoryShape shape;
  shape.env.num_agents = arguments.num_agents;
  shape.env.measurement_count = arguments.measurements;
  shape.env.head_count = static_cast<int32_t>(arguments.heads.size());
  if (shape.env.head_count > kMaxHeads)
    return Error{ErrorCode::kBadInput, "--heads has " + std::to_string(shape.env.head_count) +
                                           " entries; at most " + std::to_string(kMaxHeads) +
                                           " are possible"};
  for (size_t head = 0; head < arguments.heads.size(); ++head)
    shape.env.head_sizes[head] = arguments.heads[head];
  COMRAD_TRY(validate(shape));
  policy::tune_math(static_cast<int>(config.policy_threads));
  COMRAD_TRY_ASSIGN(const torch::Device device, policy::choose_device(config.device));
  const policy::PolicyNet net = policy::PolicyNet::create(policy::PolicyNetOptions::from(config, shape.env),
                                                          static_cast<uint64_t>(config.seed), device);
  const int64_t envs = config.max_batch > 0 ? config.max_batch : config.num_envs_per_worker;
  const policy::InferenceBench result =
      policy::bench_inference(net, envs * arguments.num_agents, arguments.bench_seconds);
  const nlohmann::json report = {{"bench", "inference"},
                                 {"rows_per_s", result.rows_per_s},
                                 {"decisions_per_s", result.rows_per_s},
                                 {"batch_rows", result.batch_rows},
                                 {"seconds", result.seconds}};
  std::printf("%s\n", report.dump().c_str());
  return {};
}

Status work(const Arguments& arguments) {
  COMRAD_TRY_ASSIGN(const RunConfig config, load_run_config(arguments.run_dir + "/config.toml"));
  shm::JoinRequest request;
  std::strncpy(request.role, "policy", sizeof request.role - 1);
  request.worker_index = static_cast<uint32_t>(arguments.worker.worker_index);
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shm::join_arena(arguments.arena, request, kJoinTimeoutMs));
  Expected<dds::Bus> bus = dds::Bus::open(dds::bus_config_for_run(arena.run_id()));
  if (!bus) spdlog::warn("no status will be heard of this worker: {}", bus.error().message);
  policy::tune_math(static_cast<int>(config.policy_threads));
  COMRAD_TRY_ASSIGN(policy::PolicyWorker worker, policy::PolicyWorker::create(config, arena, arguments.worker,
                                                                              bus ? &bus.value() : nullptr));
  spdlog::info("serves {} environments, batches of {} to {}{}", worker.batcher().env_count(),
               worker.batcher().min_batch(), worker.batcher().max_batch(),
               arguments.worker.is_random ? ", random actions" : "");
  COMRAD_TRY(worker.run(g_stop));
  spdlog::info("stopped");
  return {};
}

}  // namespace

int main(int argc, char** argv) {
  comrad::prepare_process();
  policy::tune_allocator();
  Arguments arguments;
  CLI::App app{
      "One inference process of a run: reads observations from the arena and writes the chosen actions."};
  app.add_option("--run_dir", arguments.run_dir, "the run's folder, with config.toml")->required();
  const auto* arena = app.add_option("--arena", arguments.arena, "name of the run's socket");
  app.add_option("--worker_index", arguments.worker.worker_index, "which policy worker this is, from 0")
      ->check(CLI::NonNegativeNumber);
  app.add_flag("--greedy", arguments.worker.is_greedy, "most probable actions instead of drawn ones");
  app.add_flag("--random", arguments.worker.is_random, "uniform over allowed actions, no network");
  app.add_flag("--evaluate", arguments.evaluate, "the run is an evaluation (inference is the same)");
  const auto* bench_option =
      app.add_option("--bench", arguments.bench_seconds,
                     "no run: random frames for so many seconds, prints one JSON object")
          ->check(CLI::Range(0.01, 86400.0));
  app.add_option("--num_agents", arguments.num_agents, "bench: agents per environment")
      ->check(CLI::Range(1, kMaxAgents));
  app.add_option("--heads", arguments.heads, "bench: sizes of the action heads, 3,3,3")->delimiter(',');
  app.add_option("--measurements", arguments.measurements, "bench: length of the measurement vector")
      ->check(CLI::Range(0, 1024));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& failure) {
    return app.exit(failure) == 0 ? 0 : kExitBadInput;
  }
  const bool is_bench = bench_option->count() > 0;
  if (!is_bench && arena->count() == 0) {
    std::fprintf(stderr, "comrad-policy-worker: give --arena NAME to join a run, or --bench SECONDS\n");
    return kExitBadInput;
  }

  if (!is_bench) {
    struct sigaction on_term {};
    on_term.sa_handler = [](int) { g_stop.store(true); };
    sigaction(SIGTERM, &on_term, nullptr);  // without SA_RESTART: a waiting worker wakes at once
    std::signal(SIGINT, SIG_IGN);           // Ctrl-C reaches the whole process group; the supervisor decides
    prctl(PR_SET_PDEATHSIG, SIGTERM);
  }
  const std::string role = "policy-" + std::to_string(arguments.worker.worker_index);
  try {
    if (Status log = init_log(role, is_bench ? "" : arguments.run_dir + "/logs/" + role + ".log"); !log)
      return fail(log.error());
    const Status done = is_bench ? bench(arguments) : work(arguments);
    return done ? 0 : fail(done.error());
  } catch (const std::exception& failure) {  // from libraries; ours do not throw
    std::fprintf(stderr, "comrad-policy-worker: %s\n", failure.what());
    return 1;
  }
}
