// Post-death reward: rewards of an agent that is out of the game. Where each agent learns alone (IDQN), an agent's
// trajectory ends with its death although the world continues: its last decision leads to
//
//   r_t + gamma r_{t+1} + ... + gamma^k r_{t+k}      and to no value behind it
//
// where rows t+1 to t+k are those in which it is out of the game, up to the end of its episode or until it is
// back. A penalty for dying is usually paid in one of them. The game respawns the agent, not that decision, so the
// value of the next life does not count either: it begins a new trajectory.
//
// Rows t+1 to t+k may lie in later trajectories of the same environment: the ledger records which agents are
// still owed rewards, and by which item. Stage: seal > drain > replay > sample.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <map>
#include <span>
#include <vector>

#include "rollout_buffer/schema/spec.h"

namespace comrad::replay {

class StoredTrajectory;

/// How payments count.
struct PostDeathReward {
  double gamma = 0.99;
  double reward_clip = 0;  ///< each payment is clipped to +- this before it is discounted; 0: off

  double clipped(double reward) const;
};

/// Where a slab comes from. The next slab of an environment has the next rollout index, and continues the
/// episode with which the previous one ended.
struct SlabOrigin {
  int64_t env_index = -1;  ///< -1: unknown, nothing carries over
  uint64_t rollout_index = 0;
  uint64_t first_episode_id = 0;
};

/// Whether `agent` was in the game at `step`, is out of it behind the step, and the episode continues.
bool is_last_decision(const StoredTrajectory& trajectory, int step, int agent);

/// What `agent` is paid for its decision at `step`: the reward and, if it is the last decision, what
/// follows, discounted.
struct PaidDecision {
  double reward = 0;
  int payments = 0;          ///< rewards that were read in this trajectory
  int clipped_payments = 0;  ///< of those, changed by the clip
};
PaidDecision paid_decision(const StoredTrajectory& trajectory, int step, int agent,
                           const PostDeathReward& pay);

/// Records which agents are out of the game at the end of an environment's newest trajectory, and which item holds
/// each one's last decision. Threads: starts none, holds no locks.
class PostDeathLedger {
 public:
  struct Payment {
    int64_t item = 0;
    int agent = 0;
    double amount = 0;  ///< discounted to row L of that item
  };

  /// Takes a trajectory in, which is item `id`. Returns what it pays to agents that went out of the game in
  /// earlier ones.
  std::vector<Payment> enter(const StoredTrajectory& trajectory, int64_t id, const SlabOrigin& origin,
                             const PostDeathReward& pay);
  void clear() { open_rewards_.clear(); }

  /// For snapshots. Errors of restore (false, and an empty ledger): malformed bytes.
  std::vector<std::byte> bytes() const;
  bool restore(std::span<const std::byte> bytes, int num_agents);

 private:
  /// Of one environment. As it lies in snapshots.
  struct OpenReward {
    int64_t env_index = 0;
    uint64_t next_rollout_index = 0;
    uint64_t episode_id = 0;                 ///< in which the next trajectory must begin
    std::array<int64_t, kMaxAgents> item{};  ///< that holds the last decision; -1: nothing is owed
    std::array<double, kMaxAgents>
        discount{};  ///< of the next trajectory's first reward, from that item's end
  };
  static_assert(sizeof(OpenReward) == 24 + kMaxAgents * 16, "no padding reaches the disk");

  std::map<int64_t, OpenReward> open_rewards_;  // only environments in which an agent is owed rewards
};

}  // namespace comrad::replay
