#include "sim_workers/worker/reward_rules.h"

#include <algorithm>
#include <cstddef>

#include "rollout_buffer/core/check.h"

namespace comrad::sim {

RewardRules RewardRules::from(const RunConfig& config) {
  return {.share = static_cast<float>(std::max(0.0, config.environment.shared_reward_alpha)),
          .share_is_mean = config.environment.shared_reward_scalarisation == Scalarisation::kMean,
          .scale = static_cast<float>(config.environment.reward_scale),
          .clip = static_cast<float>(config.environment.reward_clip)};
}

void shape_rewards(std::span<const float> raw, const RewardRules& rules, std::span<float> reward) {
  COMRAD_DCHECK(raw.size() == reward.size() && !raw.empty(), "one reward per agent");
  float team = 0.0f;
  for (const float own : raw) team += own;
  if (rules.share_is_mean) team /= static_cast<float>(raw.size());
  for (std::size_t agent = 0; agent < raw.size(); ++agent) {
    const float shared = (1.0f - rules.share) * raw[agent] + rules.share * team;
    reward[agent] = std::clamp(rules.scale * shared, -rules.clip, rules.clip);
  }
}

}  // namespace comrad::sim
