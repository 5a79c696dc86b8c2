// comrad-policy-worker: one inference process of a run, or its benchmark.
#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <vector>

#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/libtorch_facts.h"
#include "policy_workers/network/actor_critic.h"
#include "policy_workers/worker/policy_worker.h"
#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/worker_shell.h"

namespace {

using namespace comrad;

constexpr int64_t kBenchedWorldsMax = 64;

nlohmann::json facts_of_libtorch() {
  const device::LibtorchFacts facts = device::libtorch_facts();
  nlohmann::json devices = nlohmann::json::array();
  for (const device::CudaDevice& device : facts.devices)
    devices.push_back(
        {{"name", device.name}, {"memory_bytes", device.memory_bytes}, {"capability", device.capability}});
  return {{"version", facts.version}, {"library", facts.library},   {"cuda", facts.cuda},
          {"cudnn", facts.cudnn},     {"has_nccl", facts.has_nccl}, {"devices", std::move(devices)},
          {"error", facts.error}};
}

Status bench(const RunConfig& config, const shm::BenchShape& shape, double seconds) {
  COMRAD_TRY_ASSIGN(const EnvShape env, shape.env());
  device::tune_math(static_cast<int>(config.collection.policy_threads));
  COMRAD_TRY_ASSIGN(const torch::Device device, policy::choose_device(policy_device(config, 0)));
  COMRAD_TRY(policy::check_encoder(config.network.encoder, env));
  const policy::ActorCritic net = policy::ActorCritic::create(policy::NetworkOptions::from(config, env),
                                                              static_cast<uint64_t>(config.run.seed), device);
  const int64_t envs =
      config.collection.max_batch > 0 ? config.collection.max_batch : config.collection.num_envs_per_worker;
  const int64_t own_rows = envs * env.num_agents;
  // Beside the settings' own batch: 1, 2, 4, ... worlds. The sizes take turns, so that a slow moment of the host meets all.
  std::vector<int64_t> sizes = {own_rows};
  for (int64_t worlds = 1; worlds <= kBenchedWorldsMax; worlds *= 2) sizes.push_back(worlds * env.num_agents);
  std::ranges::sort(sizes);
  sizes.erase(std::ranges::unique(sizes).begin(), sizes.end());
  std::vector<std::vector<double>> rates(sizes.size());
  double measured_s = 0, own_cpu_s = 0, own_decisions = 0;
  const double slice_s =
      seconds / static_cast<double>(BenchWindows::kCount) / static_cast<double>(sizes.size());
  for (int window = 0; window < BenchWindows::kCount; ++window)
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const policy::InferenceBench result = policy::bench_inference(net, sizes[i], slice_s);
      rates[i].push_back(result.rows_per_s);
      measured_s += result.seconds;
      if (sizes[i] != own_rows) continue;
      own_cpu_s += result.cpu_seconds;
      own_decisions += result.rows_per_s * result.seconds;
    }
  nlohmann::json batches = nlohmann::json::array();
  for (std::size_t i = 0; i < sizes.size(); ++i)
    batches.push_back({{"batch_rows", sizes[i]},
                       {"rows_per_s", median_of(rates[i])},
                       {"spread", spread_of(rates[i])},
                       {"ms_per_batch", 1000 * static_cast<double>(sizes[i]) / median_of(rates[i])}});
  const auto own = static_cast<std::size_t>(std::ranges::find(sizes, own_rows) - sizes.begin());
  nlohmann::json report = {{"bench", "inference"},
                           {"rows_per_s", median_of(rates[own])},
                           {"decisions_per_s", median_of(rates[own])},
                           {"windows", rates[own]},
                           {"spread", spread_of(rates[own])},
                           {"batch_rows", own_rows},
                           {"seconds", measured_s},
                           {"device", device.str()},
                           {"cpu_seconds_per_1000_decisions", {{"all", 1000 * own_cpu_s / own_decisions}}},
                           {"batches", batches}};
  std::printf("%s\n", report.dump().c_str());
  return {};
}

/// Prints what the arena must know of the network of these settings; with_libtorch: also which libtorch this is.
Status describe(const RunConfig& config, const shm::BenchShape& shape, bool with_libtorch) {
  COMRAD_TRY_ASSIGN(const EnvShape env, shape.env());
  COMRAD_TRY(policy::check_encoder(config.network.encoder, env));
  const auto options = policy::NetworkOptions::from(config, env);
  const policy::ActorCritic net = policy::ActorCritic::create_for_loading(options, torch::kCPU);
  nlohmann::json report = {{"weights_bytes", net.weights_bytes()},
                           {"parameter_bytes", net.parameter_count() * int64_t{sizeof(float)}},
                           {"recurrent_state_count", options.recurrent_state_count()}};
  if (with_libtorch) report["libtorch"] = facts_of_libtorch();
  std::printf("%s\n", report.dump().c_str());
  return {};
}

Status work(const shm::WorkerShell& shell, const RunConfig& config, policy::PolicyWorkerOptions options,
            bool plays_seats) {
  options.worker_index = shell.worker_index();
  if (plays_seats) options.seats_of = shell.run_dir();
  COMRAD_TRY_ASSIGN(const shm::Arena arena, shell.join());
  device::tune_math(static_cast<int>(config.collection.policy_threads));
  COMRAD_TRY_ASSIGN(policy::PolicyWorker worker, policy::PolicyWorker::create(config, arena, options));
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
  device::tune_allocator();
  policy::PolicyWorkerOptions options;
  bool plays_seats = false;
  bool with_libtorch = false;
  shm::BenchShape shape;
  shell.flags().add("--greedy", options.is_greedy, "most probable actions instead of drawn ones");
  shell.flags().add("--random", options.is_random, "uniform over allowed actions, no network");
  shell.flags().add("--seats", plays_seats, "every agent has the player that seats.toml in --run_dir names");
  shell.flags().add("--evaluate", options.is_evaluation,
                    "the run is an evaluation: batches and draws are the same on every start");
  shell.flags().add("--libtorch", with_libtorch,
                    "describe: also which libtorch this is, and the GPUs it sees");
  shape.add_flags(shell.flags());
  return shell.run(
      argc, argv,
      {.work = [&](const RunConfig& config) { return work(shell, config, options, plays_seats); },
       .bench = [&](const RunConfig& config, double seconds) { return bench(config, shape, seconds); },
       .describe = [&](const RunConfig& config) { return describe(config, shape, with_libtorch); }});
}
