// comrad-policy-worker: one inference process of a run, or its benchmark.
#include <CLI/CLI.hpp>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "policy_workers/policy/policy_net.h"
#include "policy_workers/worker/policy_worker.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace {

using namespace comrad;

Status bench(const RunConfig& config, const shm::BenchShape& shape, double seconds) {
  COMRAD_TRY_ASSIGN(const EnvShape env, shape.env());
  policy::tune_math(static_cast<int>(config.collection.policy_threads));
  COMRAD_TRY_ASSIGN(const torch::Device device, policy::choose_device(config.collection.device));
  const policy::PolicyNet net = policy::PolicyNet::create(policy::PolicyNetOptions::from(config, env),
                                                          static_cast<uint64_t>(config.run.seed), device);
  const int64_t envs =
      config.collection.max_batch > 0 ? config.collection.max_batch : config.collection.num_envs_per_worker;
  const policy::InferenceBench result = policy::bench_inference(net, envs * env.num_agents, seconds);
  const nlohmann::json report = {{"bench", "inference"},
                                 {"rows_per_s", result.rows_per_s},
                                 {"decisions_per_s", result.rows_per_s},
                                 {"batch_rows", result.batch_rows},
                                 {"seconds", result.seconds}};
  std::printf("%s\n", report.dump().c_str());
  return {};
}

/// Prints what the arena must know of the network of these settings.
Status describe(const RunConfig& config, const shm::BenchShape& shape) {
  COMRAD_TRY_ASSIGN(const EnvShape env, shape.env());
  COMRAD_TRY(policy::check_encoder(config.network.encoder_conv_architecture));
  const auto options = policy::PolicyNetOptions::from(config, env);
  const policy::PolicyNet net =
      policy::PolicyNet::create(options, static_cast<uint64_t>(config.run.seed), torch::kCPU);
  const nlohmann::json report = {{"weights_bytes", net.weights_bytes()},
                                 {"recurrent_state_count", options.recurrent_state_count()}};
  std::printf("%s\n", report.dump().c_str());
  return {};
}

Status work(const shm::WorkerShell& shell, const RunConfig& config, policy::PolicyWorkerOptions options,
            bool plays_seats) {
  options.worker_index = shell.worker_index();
  if (plays_seats) options.seats_of = shell.run_dir();
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  Expected<dds::Bus> bus = dds::Bus::open(dds::bus_config_for_run(arena.run_id()));
  if (!bus) spdlog::warn("no status will be heard of this worker: {}", bus.error().message);
  policy::tune_math(static_cast<int>(config.collection.policy_threads));
  COMRAD_TRY_ASSIGN(policy::PolicyWorker worker,
                    policy::PolicyWorker::create(config, arena, options, bus ? &bus.value() : nullptr));
  spdlog::info("serves {} environments, batches of {} to {}{}", worker.batcher().env_count(),
               worker.batcher().min_batch(), worker.batcher().max_batch(),
               options.is_random ? ", random actions" : "");
  return worker.run(shell.stop());
}

}  // namespace

int main(int argc, char** argv) {
  shm::WorkerShell shell({.name = "comrad-policy-worker",
                          .role = "policy",
                          .description = "One inference process of a run: reads observations from the arena "
                                         "and writes the chosen actions.",
                          .describes = true});
  policy::tune_allocator();
  policy::PolicyWorkerOptions options;
  bool plays_seats = false;
  shm::BenchShape shape;
  shell.flags().add_flag("--greedy", options.is_greedy, "most probable actions instead of drawn ones");
  shell.flags().add_flag("--random", options.is_random, "uniform over allowed actions, no network");
  shell.flags().add_flag("--seats", plays_seats,
                         "every agent has the player that seats.toml in --run_dir names");
  shell.flags().add_flag("--evaluate", options.is_evaluation,
                         "the run is an evaluation: batches and draws are the same on every start");
  shape.add_flags(shell.flags());
  return shell.run(
      argc, argv,
      {.work = [&](const RunConfig& config) { return work(shell, config, options, plays_seats); },
       .bench = [&](const RunConfig& config, double seconds) { return bench(config, shape, seconds); },
       .describe = [&](const RunConfig& config) { return describe(config, shape); }});
}
