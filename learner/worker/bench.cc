#include "learner/worker/bench.h"

#include <ATen/record_function.h>

#include <algorithm>
#include <atomic>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <string_view>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/batch/collate.h"
#include "learner/worker/learner.h"
#include "learner/worker/replay_feed.h"
#include "policy_workers/policy/policy_net.h"
#include "rollout_buffer/core/bench_windows.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/schema/trajectory.h"

namespace comrad::learn {
namespace {

/// A slab that looks like a sealed one: noise for frames, actions in range, a team reward, one episode end.
void fill_slab(const SlabView& slab, uint64_t seed) {
  Rng rng(RngKey(seed).split("bench"));
  const TrajectoryShape& shape = slab.shape();
  for (int t = 0; t <= shape.rollout_steps; ++t) {
    for (int agent = 0; agent < shape.env.num_agents; ++agent) {
      const auto frame = slab.frame(t, agent);
      for (std::size_t i = 0; i < frame.size(); ++i) frame[i] = static_cast<uint8_t>(rng.next() >> 56);
      std::ranges::fill(slab.action_mask(t, agent), uint8_t{1});
      slab.agent_active(t, agent) = 1;
      if (t == shape.rollout_steps) continue;
      for (int head = 0; head < shape.env.head_count; ++head)
        slab.action(t, agent)[static_cast<std::size_t>(head)] = static_cast<int32_t>(
            rng.below(static_cast<uint32_t>(shape.env.head_sizes[static_cast<std::size_t>(head)])));
      slab.reward(t, agent) = agent == 0 ? static_cast<float>(rng.uniform()) : slab.reward(t, 0);
      slab.log_prob(t, agent) = -3.0f;
    }
    if (t == shape.rollout_steps) continue;
    slab.final_index(t) = -1;
    slab.valid(t) = 1;
  }
  slab.terminated(shape.rollout_steps / 2) = 1;
}

/// Counts, in all threads, what makes the host wait for a device: a number read out of a tensor, the positions of what is not
/// zero, a copy from one device to another. On a CPU they cost little; on a GPU each stops the queue. One at a time.
class HostWaits {
 public:
  HostWaits()
      : handle_(at::addGlobalCallback(at::RecordFunctionCallback(&HostWaits::begin)
                                          .needsInputs(true)
                                          .scopes({at::RecordScope::FUNCTION}))) {
    numbers_read = nonzero = device_copies = 0;
  }
  HostWaits(const HostWaits&) = delete;
  HostWaits& operator=(const HostWaits&) = delete;
  ~HostWaits() { at::removeCallback(handle_); }

  static nlohmann::ordered_json per(double steps) {
    const auto share = [&](const std::atomic<int64_t>& count) { return static_cast<double>(count) / steps; };
    return {{"numbers_read", share(numbers_read)},
            {"nonzero", share(nonzero)},
            {"device_copies", share(device_copies)},
            {"all", share(numbers_read) + share(nonzero) + share(device_copies)}};
  }

 private:
  static std::unique_ptr<at::ObserverContext> begin(const at::RecordFunction& function) {
    const std::string_view name = function.name();
    numbers_read += name == "aten::_local_scalar_dense";
    nonzero += name == "aten::nonzero";
    if (name != "aten::copy_") return nullptr;
    const auto inputs = function.inputs();
    device_copies += inputs.size() > 1 && inputs[0].isTensor() && inputs[1].isTensor() &&
                     inputs[0].toTensor().device() != inputs[1].toTensor().device();
    return nullptr;
  }

  static inline std::atomic<int64_t> numbers_read{0}, nonzero{0}, device_copies{0};
  const at::CallbackHandle handle_;
};

}  // namespace

Status run_bench(const RunConfig& config, const EnvShape& env, double seconds) {
  TrajectoryShape shape;
  shape.env = env;
  shape.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.recurrent_state_count =
      static_cast<int32_t>(policy::PolicyNetOptions::from(config, env).recurrent_state_count());
  COMRAD_TRY(validate(shape));
  COMRAD_TRY_ASSIGN(const torch::Device device, policy::choose_device(config.collection.device));
  COMRAD_TRY_ASSIGN(const std::unique_ptr<Algorithm> algorithm, make_algorithm(config, env, device));

  const int64_t slab_count =
      std::max<int64_t>(1, config.optimisation.batch_size * config.optimisation.num_batches_per_epoch /
                               (config.collection.rollout * env.num_agents));
  const SlabOffsets offsets(shape);
  std::vector<std::byte> bytes(static_cast<std::size_t>(offsets.slab_bytes * slab_count));
  const auto slab = [&](int64_t index) {
    return SlabView(offsets, bytes.data() + offsets.slab_bytes * index);
  };
  for (int64_t i = 0; i < slab_count; ++i) fill_slab(slab(i), static_cast<uint64_t>(i));
  std::vector<std::byte> weights(static_cast<std::size_t>(algorithm->weights_bytes()));
  UpdateContext context;
  context.after_step = [&] { algorithm->write_weights(weights); };
  auto* on_policy = dynamic_cast<OnPolicyAlgorithm*>(algorithm.get());
  auto* off_policy = dynamic_cast<OffPolicyAlgorithm*>(algorithm.get());
  RolloutBatch batch = make_rollout_batch(shape, slab_count);
  std::unique_ptr<ReplayFeed> feed;
  if (off_policy != nullptr) {
    RunConfig eager = config;
    eager.q_learning.learning_starts_decisions = 1;
    COMRAD_TRY_ASSIGN(feed, ReplayFeed::create(eager, shape, algorithm->weights_bytes()));
  }

  int64_t rows = 0, decisions = 0, updates = 0;
  // One batch of new slabs and the updates that it allows.
  const auto round = [&]() -> Status {
    context.env_frames = static_cast<double>(decisions * config.environment.env_frameskip);
    const auto trained = [&](const UpdateStats& stats) {
      rows += stats.rows_trained;
      updates += stats.optimizer_steps;
    };
    if (on_policy != nullptr) clear(batch);
    for (int64_t i = 0; i < slab_count; ++i) {
      for (int t = 0; t < shape.rollout_steps; ++t)
        for (int agent = 0; agent < env.num_agents; ++agent)
          slab(i).policy_version(t, agent) = algorithm->version();
      const auto length = static_cast<uint32_t>(shape.rollout_steps);
      if (on_policy != nullptr)
        collate_slab(batch, i, slab(i), length);
      else
        feed->insert(slab(i), length, algorithm->version());
    }
    decisions += slab_count * shape.rollout_steps * env.num_agents;
    if (on_policy != nullptr) {
      COMRAD_TRY_ASSIGN(const UpdateStats stats, on_policy->update(batch, context));
      trained(stats);
      return {};
    }
    const Inserted inserted = feed->take_inserted();
    if (inserted.transitions > 0)
      off_policy->observe(inserted.frame, inserted.measurement, inserted.global_state);
    while (feed->is_update_due()) {
      std::unique_ptr<ReplayBatch> drawn = feed->sample();
      COMRAD_TRY_ASSIGN(const UpdateStats stats, off_policy->update(*drawn, context));
      trained(stats);
      feed->finish(std::move(drawn));
    }
    return {};
  };
  COMRAD_TRY(round());  // warms up
  rows = decisions = updates = 0;
  BenchWindows windows(seconds);
  const Stopwatch clock(CLOCK_PROCESS_CPUTIME_ID);
  double elapsed_s = 0;
  do {
    COMRAD_TRY(round());
    elapsed_s = clock.elapsed();
  } while (!windows.see(static_cast<double>(decisions), elapsed_s));
  const double cpu_s = clock.cpu_elapsed(), thousands = static_cast<double>(decisions) / 1000;
  const int64_t rows_measured = rows, updates_measured = updates;
  nlohmann::ordered_json waits;
  {
    const HostWaits counted;
    COMRAD_TRY(round());
    waits = HostWaits::per(static_cast<double>(std::max<int64_t>(1, updates - updates_measured)));
  }
  nlohmann::ordered_json line;
  line["bench"] = "learner";
  line["algo"] = config.run.algo.name();
  line["rows_per_s"] = static_cast<double>(rows_measured) / elapsed_s;
  line["decisions_per_s"] = windows.median();
  line["env_frames_per_s"] = windows.median() * static_cast<double>(config.environment.env_frameskip);
  line["windows"] = windows.rates();
  line["spread"] = windows.spread();
  line["updates_per_s"] = static_cast<double>(updates_measured) / elapsed_s;
  line["host_waits_per_step"] = waits;
  line["seconds"] = elapsed_s;
  line["cpu_seconds"] = cpu_s;
  line["cpu_seconds_per_1000_decisions"]["all"] = cpu_s / thousands;
  std::printf("%s\n", line.dump().c_str());
  return {};
}

}  // namespace comrad::learn
