#include "learner/worker/bench.h"

#include <algorithm>
#include <cstdio>
#include <nlohmann/json.hpp>
#include <span>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/batch/collate.h"
#include "learner/worker/learner.h"
#include "learner/worker/replay_feed.h"
#include "learner/worker/weights_publisher.h"
#include "policy_workers/device/host_wait_counter.h"
#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/work_counter.h"
#include "policy_workers/device/work_report.h"
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

}  // namespace

Status run_bench(const RunConfig& config, const EnvShape& env, double seconds, bool counts_work) {
  TrajectoryShape shape;
  shape.env = env;
  shape.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.recurrent_state_count =
      static_cast<int32_t>(policy::PolicyNetOptions::from(config, env).recurrent_state_count());
  COMRAD_TRY(validate(shape));
  COMRAD_TRY_ASSIGN(torch::Device device, policy::choose_device(config.collection.device));
  if (device.is_cpu())
    device = torch::Device(torch::kCPU, 0);  // with its number, as HostWaitCounter wants it
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
  WeightsPublisher weights(*algorithm, [](std::span<const std::byte>, PolicyVersion) {});
  UpdateContext context;
  context.after_step = [&] { weights.offer(); };
  auto* on_policy = dynamic_cast<OnPolicyAlgorithm*>(algorithm.get());
  auto* off_policy = dynamic_cast<OffPolicyAlgorithm*>(algorithm.get());
  RolloutBatch batch = make_rollout_batch(shape, slab_count, device);
  std::unique_ptr<ReplayFeed> feed;
  if (off_policy != nullptr) {
    RunConfig eager = config;
    eager.q_learning.learning_starts_decisions = 1;
    COMRAD_TRY_ASSIGN(feed, ReplayFeed::create(eager, shape, algorithm->weights_bytes(), "", device));
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
      send_ahead(batch, device);
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
    const device::HostWaitCounter counter;
    COMRAD_TRY(round());
    const auto steps = static_cast<double>(std::max<int64_t>(1, updates - updates_measured));
    const device::HostWaitCounter::Counts inside = counter.in_steps(), between = counter.between_steps();
    waits = {{"numbers_read", static_cast<double>(inside.numbers_read) / steps},
             {"nonzero", static_cast<double>(inside.nonzero) / steps},
             {"device_copies", static_cast<double>(inside.device_copies) / steps},
             {"readbacks", static_cast<double>(inside.readbacks) / steps},
             {"all", static_cast<double>(inside.all()) / steps},
             {"between_steps", static_cast<double>(between.all()) / steps}};
  }
  nlohmann::ordered_json work;
  if (counts_work) {
    const device::OperatorPath path;
    const device::WorkCounter counter;
    const int64_t decisions_before = decisions, updates_before = updates;
    COMRAD_TRY(round());
    for (const auto& [name, phase] :
         {std::pair{"forward", device::Phase::kForward}, std::pair{"backward", device::Phase::kBackward},
          std::pair{"optimizer", device::Phase::kOptimizer}})
      work[name] = device::work_of(counter.of(phase), decisions - decisions_before, updates - updates_before);
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
  if (counts_work) line["work"] = work;
  line["seconds"] = elapsed_s;
  line["cpu_seconds"] = cpu_s;
  line["cpu_seconds_per_1000_decisions"]["all"] = cpu_s / thousands;
  std::printf("%s\n", line.dump().c_str());
  return {};
}

}  // namespace comrad::learn
