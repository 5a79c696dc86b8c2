#include "deploy/launch/launch_plan.h"

#include <algorithm>

namespace comrad::deploy {

Expected<shm::ArenaShape> arena_shape(const LaunchPlan& plan) {
  const RunConfig& config = plan.config;
  shm::ArenaShape shape;
  shape.trajectory.env = plan.env;
  shape.trajectory.rollout_steps = static_cast<int32_t>(config.rollout);
  shape.trajectory.recurrent_state_count = static_cast<int32_t>(recurrent_state_count(config));
  shape.sim_worker_count = static_cast<int32_t>(config.num_workers);
  shape.envs_per_worker = static_cast<int32_t>(config.num_envs_per_worker);
  shape.splits_per_worker = static_cast<int32_t>(config.worker_num_splits);
  shape.policy_worker_count = static_cast<int32_t>(config.policy_workers);
  // Evaluation keeps one slab in every environment's hands and needs no more.
  shape.slab_count = plan.evaluates() ? shape.env_count() : static_cast<int32_t>(config.trajectory_slabs);
  if (plan.is_lock_step()) {
    if (config.deterministic && plan.decision_limit <= 0)
      return Error{ErrorCode::kBadInput, "--deterministic: scenario " + config.scenario +
                                             " has no decision limit, so its journal cannot be sized"};
    shape.journal_steps =
        plan.decision_limit <= 0
            ? 0
            : static_cast<int32_t>(std::min<int64_t>(plan.decision_limit, INT32_MAX - 1)) + 1;
  }
  shape.weights_bytes =
      weights_bytes_limit(config, plan.env.num_agents, plan.env.frame_bytes(), plan.env.logit_count());
  return shape;
}

}  // namespace comrad::deploy
