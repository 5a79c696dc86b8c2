#include "rollout_buffer/replay/post_death_reward.h"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "rollout_buffer/replay/trajectory_store.h"

namespace comrad::replay {
namespace {

bool is_active(const StoredTrajectory& trajectory, int row, int agent) {
  return trajectory.agent_active(row)[static_cast<std::size_t>(agent)] != 0;
}

bool is_over(const StoredTrajectory& trajectory, int step) {
  return trajectory.terminated(step) || trajectory.truncated(step);
}

/// What the rows from `first` on pay to an agent that is out of the game there.
struct Paid {
  double amount = 0;    ///< discounted to row `first`
  double discount = 1;  ///< of the row behind the last one paid
  bool is_open = true;  ///< the trajectory ended first: the next one may pay more
  int payments = 0, clipped_payments = 0;
};

/// A row that a peer broke ends it, as no return runs across such rows.
Paid paid_from(const StoredTrajectory& trajectory, int first, int agent, const PostDeathReward& pay) {
  Paid paid;
  for (int step = first; step < trajectory.length(); ++step) {
    if (is_active(trajectory, step, agent) || !trajectory.valid(step)) {
      paid.is_open = false;
      return paid;
    }
    const double reward = double{trajectory.reward(step)[static_cast<std::size_t>(agent)]};
    const double clipped = pay.clipped(reward);
    ++paid.payments;
    paid.clipped_payments += clipped != reward;
    paid.amount += paid.discount * clipped;
    paid.discount *= pay.gamma;
    if (is_over(trajectory, step)) {
      paid.is_open = false;
      return paid;
    }
  }
  paid.is_open = !is_active(trajectory, trajectory.length(), agent);
  return paid;
}

/// The step of the last decision of an agent that is out of the game at the end of the trajectory and whose
/// payments are still open there; -1 where there is none.
int open_decision(const StoredTrajectory& trajectory, int agent) {
  if (is_active(trajectory, trajectory.length(), agent)) return -1;
  for (int step = trajectory.length() - 1; step >= 0; --step) {
    if (is_over(trajectory, step)) return -1;
    if (is_active(trajectory, step, agent)) return step;
    if (!trajectory.valid(step)) return -1;
  }
  return -1;
}

}  // namespace

double PostDeathReward::clipped(double reward) const {
  return reward_clip > 0 ? std::clamp(reward, -reward_clip, reward_clip) : reward;
}

bool is_last_decision(const StoredTrajectory& trajectory, int step, int agent) {
  return is_active(trajectory, step, agent) && !is_over(trajectory, step) &&
         !is_active(trajectory, step + 1, agent);
}

PaidDecision paid_decision(const StoredTrajectory& trajectory, int step, int agent,
                           const PostDeathReward& pay) {
  const double reward = double{trajectory.reward(step)[static_cast<std::size_t>(agent)]};
  PaidDecision decision{.reward = pay.clipped(reward), .payments = 1};
  decision.clipped_payments = decision.reward != reward;
  if (!is_last_decision(trajectory, step, agent)) return decision;
  Paid later = paid_from(trajectory, step + 1, agent, pay);
  if (later.is_open) later.amount += later.discount * double{trajectory.post_death_reward(agent)};
  decision.reward += pay.gamma * later.amount;
  decision.payments += later.payments;
  decision.clipped_payments += later.clipped_payments;
  return decision;
}

std::vector<PostDeathLedger::Payment> PostDeathLedger::enter(const StoredTrajectory& trajectory, int64_t id,
                                                             const SlabOrigin& origin,
                                                             const PostDeathReward& pay) {
  std::vector<Payment> payments;
  if (origin.env_index < 0) return payments;
  OpenReward before;
  before.item.fill(-1);
  if (const auto known = open_rewards_.find(origin.env_index); known != open_rewards_.end()) {
    // After a simulator's restart the world is another one: what was owed is lost with the old one.
    if (known->second.next_rollout_index == origin.rollout_index &&
        known->second.episode_id == origin.first_episode_id)
      before = known->second;
    open_rewards_.erase(known);
  }
  OpenReward after{.env_index = origin.env_index,
                   .next_rollout_index = origin.rollout_index + 1,
                   .episode_id = origin.first_episode_id};
  for (int step = 0; step < trajectory.length(); ++step) after.episode_id += is_over(trajectory, step);
  bool is_owed = false;
  const int agents = static_cast<int>(trajectory.agent_active(0).size());
  after.item.fill(-1);
  for (int agent = 0; agent < agents; ++agent) {
    const auto index = static_cast<std::size_t>(agent);
    if (before.item[index] >= 0) {
      const Paid paid = paid_from(trajectory, 0, agent, pay);
      const double discount = before.discount[index];
      if (paid.amount != 0)
        payments.push_back({.item = before.item[index], .agent = agent, .amount = discount * paid.amount});
      if (paid.is_open) {
        after.item[index] = before.item[index];
        after.discount[index] = discount * paid.discount;
      }
    }
    if (open_decision(trajectory, agent) >= 0) {
      after.item[index] = id;
      after.discount[index] = 1;
    }
    is_owed |= after.item[index] >= 0;
  }
  if (is_owed) open_rewards_[origin.env_index] = after;
  return payments;
}

std::vector<std::byte> PostDeathLedger::bytes() const {
  std::vector<std::byte> bytes(open_rewards_.size() * sizeof(OpenReward));
  std::size_t offset = 0;
  for (const auto& [env_index, open_reward] : open_rewards_) {
    std::memcpy(bytes.data() + offset, &open_reward, sizeof open_reward);
    offset += sizeof open_reward;
  }
  return bytes;
}

bool PostDeathLedger::restore(std::span<const std::byte> bytes, int num_agents) {
  clear();
  if (bytes.size() % sizeof(OpenReward) != 0) return false;
  for (std::size_t offset = 0; offset < bytes.size(); offset += sizeof(OpenReward)) {
    OpenReward open_reward;
    std::memcpy(&open_reward, bytes.data() + offset, sizeof open_reward);
    bool sound = open_reward.env_index >= 0 && !open_rewards_.contains(open_reward.env_index);
    for (std::size_t agent = 0; agent < kMaxAgents; ++agent) {
      const bool exists = static_cast<int>(agent) < num_agents;
      sound &= open_reward.item[agent] >= -1 && (exists || open_reward.item[agent] == -1) &&
               open_reward.discount[agent] >= 0 && open_reward.discount[agent] <= 1;
    }
    if (!sound) {
      clear();
      return false;
    }
    open_rewards_[open_reward.env_index] = open_reward;
  }
  return true;
}

}  // namespace comrad::replay
