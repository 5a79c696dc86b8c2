#include "learner/worker/bench.h"

#include <algorithm>
#include <cstdio>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <span>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/batch/collate.h"
#include "learner/sources/batch_source.h"
#include "learner/sources/replay_feed.h"
#include "learner/worker/learner.h"
#include "learner/worker/weights_publisher.h"
#include "policy_workers/device/choose_device.h"
#include "policy_workers/device/host_wait_counter.h"
#include "policy_workers/network/actor_critic.h"
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

/// An algorithm and made-up slabs that it trains on again and again.
class SyntheticTraining {
 public:
  struct Totals {
    int64_t rows = 0, decisions = 0, updates = 0;
  };

  static Expected<std::unique_ptr<SyntheticTraining>> create(const RunConfig& config,
                                                             const TrajectoryShape& shape,
                                                             torch::Device device) {
    std::unique_ptr<SyntheticTraining> training(new SyntheticTraining(config, shape, device));
    COMRAD_TRY_ASSIGN(training->algorithm_, make_algorithm(config, shape.env, device));
    training->weights_.emplace(*training->algorithm_, [](std::span<const std::byte>, PolicyVersion) {});
    training->context_.after_step = [weights = &*training->weights_] { weights->offer(); };
    training->on_policy_ = training->algorithm_->on_policy();
    training->off_policy_ = training->algorithm_->off_policy();
    if (training->off_policy_ != nullptr) {
      RunConfig eager = config;
      eager.q_learning.learning_starts_decisions = 1;
      COMRAD_TRY_ASSIGN(training->feed_,
                        ReplayFeed::create(eager, shape, training->algorithm_->weights_bytes(), "", device));
    }
    COMRAD_TRY(training->round());  // warms up
    training->totals_ = {};
    return training;
  }

  const Totals& totals() const { return totals_; }

  /// One batch of new slabs and the updates that it allows.
  Status round() {
    const int agents = batch_.shape.env.num_agents, steps = batch_.shape.rollout_steps;
    context_.env_frames = static_cast<double>(totals_.decisions * config_.environment.env_frameskip);
    // As in a run, a batch is filled while the device may still read the one before.
    std::swap(batch_, other_batch_);
    if (on_policy_ != nullptr) clear(batch_);
    for (int64_t i = 0; i < batch_.slab_count; ++i) {
      for (int t = 0; t < steps; ++t)
        for (int agent = 0; agent < agents; ++agent) slab(i).policy_version(t, agent) = algorithm_->version();
      const auto length = static_cast<uint32_t>(steps);
      if (on_policy_ != nullptr)
        collate_slab(batch_, i, slab(i), length);
      else
        feed_->insert(slab(i), length, algorithm_->version());
    }
    totals_.decisions += batch_.slab_count * steps * agents;
    context_.reports = monotonic_s() - reported_s_ >= 1;
    if (context_.reports) reported_s_ = monotonic_s();
    if (on_policy_ != nullptr) {
      send_ahead(batch_, device_);
      COMRAD_TRY_ASSIGN(const UpdateStats stats, on_policy_->update(batch_, context_));
      hand_back(batch_, device_);
      count(stats);
      return {};
    }
    const Inserted inserted = feed_->take_inserted();
    if (inserted.transitions > 0)
      off_policy_->observe(inserted.frame, inserted.measurement, inserted.global_state);
    while (feed_->is_update_due()) {
      std::unique_ptr<ReplayBatch> drawn = feed_->sample();
      COMRAD_TRY_ASSIGN(const UpdateStats stats, off_policy_->update(*drawn, context_));
      count(stats);
      feed_->finish(std::move(drawn));
    }
    return {};
  }

 private:
  SyntheticTraining(const RunConfig& config, const TrajectoryShape& shape, torch::Device device)
      : config_(config),
        device_(device),
        offsets_(shape),
        batch_(make_rollout_batch(shape, slabs_per_batch(config, shape.env), device)),
        other_batch_(make_rollout_batch(shape, batch_.slab_count, device)),
        bytes_(static_cast<std::size_t>(offsets_.slab_bytes * batch_.slab_count)) {
    for (int64_t i = 0; i < batch_.slab_count; ++i) fill_slab(slab(i), static_cast<uint64_t>(i));
  }
  SlabView slab(int64_t index) { return {offsets_, bytes_.data() + offsets_.slab_bytes * index}; }
  void count(const UpdateStats& stats) {
    totals_.rows += stats.rows_trained;
    totals_.updates += stats.optimizer_steps;
  }

  const RunConfig config_;
  const torch::Device device_;
  const SlabOffsets offsets_;
  RolloutBatch batch_, other_batch_;
  double reported_s_ = 0;
  std::vector<std::byte> bytes_;  // the slabs
  std::unique_ptr<Algorithm> algorithm_;
  OnPolicyAlgorithm* on_policy_ = nullptr;  // the algorithm, one of the two
  OffPolicyAlgorithm* off_policy_ = nullptr;
  std::optional<WeightsPublisher> weights_;
  std::unique_ptr<ReplayFeed> feed_;  // of an off-policy algorithm
  UpdateContext context_;
  Totals totals_;
};

/// What made the host wait in one more round, for each optimizer step.
Expected<nlohmann::ordered_json> host_waits(SyntheticTraining& training) {
  const int64_t updates_before = training.totals().updates;
  const device::HostWaitCounter counter;
  COMRAD_TRY(training.round());
  const auto steps = static_cast<double>(std::max<int64_t>(1, training.totals().updates - updates_before));
  const device::HostWaitCounter::Counts inside = counter.in_steps(), between = counter.between_steps();
  return nlohmann::ordered_json{{"numbers_read", static_cast<double>(inside.numbers_read) / steps},
                                {"nonzero", static_cast<double>(inside.nonzero) / steps},
                                {"device_copies", static_cast<double>(inside.device_copies) / steps},
                                {"readbacks", static_cast<double>(inside.readbacks) / steps},
                                {"all", static_cast<double>(inside.all()) / steps},
                                {"between_steps", static_cast<double>(between.all()) / steps}};
}

}  // namespace

Status run_bench(const RunConfig& config, const EnvShape& env, double seconds) {
  TrajectoryShape shape;
  shape.env = env;
  shape.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.recurrent_state_count =
      static_cast<int32_t>(policy::NetworkOptions::from(config, env).recurrent_state_count());
  COMRAD_TRY(validate(shape));
  COMRAD_TRY_ASSIGN(const torch::Device device, policy::choose_device(config.collection.device));
  nlohmann::ordered_json line;
  {
    COMRAD_TRY_ASSIGN(const auto training, SyntheticTraining::create(config, shape, device));
    BenchWindows windows(seconds);
    const Stopwatch clock(CLOCK_PROCESS_CPUTIME_ID);
    double elapsed_s = 0;
    do {
      COMRAD_TRY(training->round());
      elapsed_s = clock.elapsed();
    } while (!windows.see(static_cast<double>(training->totals().decisions), elapsed_s));
    const double cpu_s = clock.cpu_elapsed();
    const SyntheticTraining::Totals& totals = training->totals();
    line["bench"] = "learner";
    line["algo"] = config.run.algo.name();
    line["rows_per_s"] = static_cast<double>(totals.rows) / elapsed_s;
    line["decisions_per_s"] = windows.median();
    line["env_frames_per_s"] = windows.median() * static_cast<double>(config.environment.env_frameskip);
    line["windows"] = windows.rates();
    line["spread"] = windows.spread();
    line["updates_per_s"] = static_cast<double>(totals.updates) / elapsed_s;
    line["seconds"] = elapsed_s;
    line["cpu_seconds"] = cpu_s;
    line["cpu_seconds_per_1000_decisions"]["all"] = cpu_s / (static_cast<double>(totals.decisions) / 1000);
  }
  // HostWaitCounter requires the CPU with its number, which costs copies: so not in the measured part.
  COMRAD_TRY_ASSIGN(
      const auto counted,
      SyntheticTraining::create(config, shape, device.is_cpu() ? torch::Device(torch::kCPU, 0) : device));
  COMRAD_TRY_ASSIGN(line["host_waits_per_step"], host_waits(*counted));
  std::printf("%s\n", line.dump().c_str());
  return {};
}

}  // namespace comrad::learn
