#include "rollout_buffer/replay/replay_plan.h"

#include <spdlog/fmt/fmt.h>
#include <sys/statvfs.h>

#include <algorithm>
#include <filesystem>

#include "rollout_buffer/core/text.h"
#include "rollout_buffer/replay/trajectory_store.h"
#include "rollout_buffer/settings/drawn_batch.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/segment.h"

namespace comrad::replay {
namespace {

constexpr double kBytesPerGigabyte = 1e9;
/// Short trajectories and masks take more than whole ones without; what is not touched costs no memory.
constexpr double kSlack = 1.1;
constexpr int64_t kShareOfMemory = 3;                // one part in so many
constexpr int64_t kLeastTrajectories = 10;           // of each learner
constexpr int64_t kTorchProgramBytes = 600'000'000;  // learner and policy workers, each
constexpr int64_t kSimulatorBytes = 100'000'000;
constexpr int64_t kWeightCopies = 8;  // both networks, gradients of several threads, two moments

/// Of a whole trajectory with so many cuts, uncompressed.
int64_t trajectory_bytes(const RunConfig& config, TrajectoryShape shape, int cuts) {
  if (!config.network.use_rnn) shape.recurrent_state_count = 0;  // single decisions keep none
  return TrajectoryStore::item_bytes(shape, std::min(cuts, shape.final_capacity), false);
}

}  // namespace

HostSpace probe_space(const std::string& folder) {
  HostSpace space{.memory_bytes = shm::free_memory_bytes()};
  std::error_code error;
  std::filesystem::path place = std::filesystem::absolute(folder.empty() ? "." : folder, error);
  while (!std::filesystem::exists(place, error) && place.has_relative_path()) place = place.parent_path();
  struct statvfs facts {};
  if (statvfs(place.c_str(), &facts) == 0)
    space.disk_bytes = static_cast<int64_t>(facts.f_bavail) * static_cast<int64_t>(facts.f_frsize);
  return space;
}

int64_t reserved_bytes(const RunConfig& config, const TrajectoryShape& shape, int64_t weights_bytes) {
  const EnvShape& env = shape.env;
  shm::ArenaShape arena;
  arena.trajectory = shape;
  arena.sim_worker_count = static_cast<int32_t>(std::max<int64_t>(1, config.collection.num_workers));
  arena.envs_per_worker = static_cast<int32_t>(config.collection.num_envs_per_worker);
  arena.splits_per_worker = static_cast<int32_t>(config.collection.worker_num_splits);
  arena.policy_worker_count = static_cast<int32_t>(std::max<int64_t>(1, config.collection.policy_workers));
  arena.slab_count = static_cast<int32_t>(std::max<int64_t>(1, config.collection.trajectory_slabs));
  arena.weights_bytes = weights_bytes;
  // One batch in training, one that waits, and what a micro-batch leaves for its gradient.
  const DrawnBatch drawn = drawn_batch(config, env.num_agents);
  const int64_t unit_rows = drawn.unit == DrawnBatch::Unit::kSequence
                                ? (config.collection.rollout + 1) * env.num_agents
                            : drawn.unit == DrawnBatch::Unit::kJointDecision ? 2 * env.num_agents
                                                                             : 2;
  const int64_t batch_rows = drawn.units * unit_rows;
  const int64_t learners = config.collection.learners;
  return shm::Arena::size_bytes(arena) + learners * kWeightCopies * arena.weights_bytes +
         3 * batch_rows * env.frame_bytes() +
         (learners + config.collection.policy_workers) * kTorchProgramBytes +
         config.collection.num_workers * kSimulatorBytes;
}

Expected<ReplayPlan> replay_plan(const RunConfig& config, const TrajectoryShape& shape,
                                 const HostSpace& space, int64_t reserved_bytes, const std::string& run_dir) {
  const int64_t per_trajectory = trajectory_bytes(config, shape, 1);
  const int64_t decisions = int64_t{shape.rollout_steps} * shape.env.num_agents;
  const int64_t trajectories = (config.replay.replay_capacity_decisions + decisions - 1) / decisions;
  const auto wanted = static_cast<int64_t>(
      std::min(kSlack * static_cast<double>(trajectories + 1) * static_cast<double>(per_trajectory), 4e18));
  const int64_t left = std::max<int64_t>(0, space.memory_bytes - reserved_bytes);
  ReplayPlan plan{.capacity_transitions = config.replay.replay_capacity_decisions,
                  .file = config.replay.replay_file};
  int64_t allowed = 0;
  if (config.replay.replay_gb > 0) {
    allowed = static_cast<int64_t>(std::min(config.replay.replay_gb * kBytesPerGigabyte, 4e18));
    plan.reason = "replay_gb is " + bytes_text(allowed);
    // The estimate of what the rest takes must not drive a small replay out of memory.
    const int64_t memory_allows = std::max(left, space.memory_bytes / kShareOfMemory);
    plan.capacity_bytes = std::min(allowed, wanted);
    if (plan.file.empty() && plan.capacity_bytes > memory_allows) {
      if (plan.capacity_bytes > space.disk_bytes)
        return Error{ErrorCode::kNoSpace,
                     "a replay of " + bytes_text(plan.capacity_bytes) +
                         " fits neither into memory, which allows " + bytes_text(memory_allows) +
                         ", nor on the disk of " + run_dir + ", which has " + bytes_text(space.disk_bytes) +
                         " free; lower --replay_gb or --replay_capacity_decisions, or name "
                         "another disk with --replay_file"};
      plan.file = (run_dir.empty() ? "." : run_dir) + "/replay.ring";
      plan.reason += ", more than the " + bytes_text(memory_allows) + " that memory allows: in " + plan.file +
                     ", which goes with the run";
    }
  } else {
    const bool on_disk = !plan.file.empty();
    allowed = on_disk ? space.disk_bytes / kShareOfMemory : left / kShareOfMemory;
    allowed = std::max(allowed, config.collection.learners * kLeastTrajectories * per_trajectory);
    plan.capacity_bytes = std::min(allowed, wanted);
    plan.reason =
        bytes_text(allowed) + " is a third of what is free " + (on_disk ? "on the disk" : "in memory");
  }
  const bool fits = wanted <= allowed;
  plan.compress = config.replay.replay_compress == Compress::kTrue ||
                  (config.replay.replay_compress == Compress::kAuto && !fits);
  plan.reason += fmt::format("; replay_capacity_decisions {} takes {} uncompressed{}{}",
                             config.replay.replay_capacity_decisions, bytes_text(wanted),
                             (fits ? ", and decides" : ""), (plan.compress ? "; LZ4 on" : ""));
  plan.fitting_decisions = std::min(plan.capacity_bytes / trajectory_bytes(config, shape, 0) * decisions,
                                    plan.capacity_transitions);
  const int64_t starts = config.q_learning.learning_starts_decisions;
  plan.decisions_before_training =
      std::max<int64_t>(1, starts < plan.fitting_decisions ? starts : plan.fitting_decisions / 2);
  return plan;
}

ReplayPlan ReplayPlan::share_of(int rank, int learners) const {
  ReplayPlan share = *this;
  share.capacity_bytes /= learners;
  share.capacity_transitions = std::max<int64_t>(1, capacity_transitions / learners);  // 0 would be no limit
  share.fitting_decisions /= learners;
  if (rank > 0 && !share.file.empty()) share.file += fmt::format(".{}", rank);
  return share;
}

std::string ReplayPlan::words() const {
  return fmt::format("replay: room for {}{} agent decisions in {} ({}); learning begins with {}",
                     compress ? "at least " : "", fitting_decisions, bytes_text(capacity_bytes), reason,
                     decisions_before_training);
}

}  // namespace comrad::replay
