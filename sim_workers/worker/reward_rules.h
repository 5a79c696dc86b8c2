// What happens to the environment's raw rewards before they enter a trajectory: sharing, scale, clip, in this
// order, because sharing is part of the game and the other two are part of collecting it. Stage: append.
#pragma once

#include <span>

#include "rollout_buffer/settings/run_config.h"

namespace comrad::sim {

/// The settings that change rewards.
struct RewardRules {
  float share = 0.0f;          ///< alpha: 0 keeps own rewards, 1 gives each agent the team's
  bool share_is_mean = false;  ///< team reward S is the mean, not the sum
  float scale = 1.0f;
  float clip = 1000.0f;  ///< rewards are kept within +- this

  static RewardRules from(const RunConfig& config);
};

/// r'_i = clip(scale * ((1 - alpha) r_i + alpha S)), S the sum or the mean of the raw rewards.
///
///   raw     [N] f32  of one step
///   reward  [N] f32  result; may be the same memory
///
/// Threads: pure function.
void shape_rewards(std::span<const float> raw, const RewardRules& rules, std::span<float> reward);

}  // namespace comrad::sim
