#include "deploy/launch/launch_plan.h"

#include <algorithm>

#include "deploy/process/child_program.h"

namespace comrad::deploy {

std::string LaunchPlan::program(const std::string& name) const {
  return bin_dir.empty() ? sibling_program(name) : bin_dir + "/" + name;
}

int64_t LaunchPlan::longest_episode() const {
  constexpr int64_t kTicsPerLimit = 4;  // what scenarios count limits in
  if (config.environment.decision_limit > 0) return config.environment.decision_limit;
  if (decision_limit <= 0) return 0;
  const int64_t skip = std::max<int64_t>(1, config.environment.env_frameskip);
  return (std::min<int64_t>(decision_limit, INT32_MAX) * kTicsPerLimit + skip - 1) / skip;
}

Expected<shm::ArenaShape> arena_shape(const LaunchPlan& plan) {
  const RunConfig& config = plan.config;
  shm::ArenaShape shape;
  shape.trajectory.env = plan.env;
  shape.trajectory.rollout_steps = static_cast<int32_t>(config.collection.rollout);
  shape.trajectory.recurrent_state_count = plan.network.recurrent_state_count;
  shape.remote_frame_worker_count = static_cast<int32_t>(plan.remote_frame_workers());
  shape.remote_worker_count = shape.remote_frame_worker_count +
                              (plan.serves() ? static_cast<int32_t>(config.hosts.serve_workers) : 0);
  shape.sim_worker_count = static_cast<int32_t>(plan.own_workers()) + shape.remote_worker_count;
  shape.envs_per_worker = static_cast<int32_t>(config.collection.num_envs_per_worker);
  shape.splits_per_worker = static_cast<int32_t>(config.collection.worker_num_splits);
  shape.policy_worker_count = plan.sends_frames ? 1 : static_cast<int32_t>(config.collection.policy_workers);
  // Evaluation keeps one slab in every environment's hands and needs no more.
  shape.slab_count =
      plan.evaluates() ? shape.env_count() : static_cast<int32_t>(config.collection.trajectory_slabs);
  // Those of hosts without a policy are filled here.
  if (plan.serves())
    shape.slab_count += static_cast<int32_t>(config.hosts.serve_frame_workers) * shape.envs_per_worker;
  if (plan.is_lock_step()) {
    const int64_t longest = plan.longest_episode();
    if (config.collection.deterministic && longest <= 0)
      return Error{ErrorCode::kBadInput, "--deterministic: scenario " + config.run.scenario +
                                             " has no decision limit, so its journal cannot be sized"};
    shape.journal_steps =
        longest <= 0 ? 0 : static_cast<int32_t>(std::min<int64_t>(longest, INT32_MAX - 1)) + 1;
  }
  shape.weights_bytes = plan.network.weights_bytes;
  return shape;
}

}  // namespace comrad::deploy
