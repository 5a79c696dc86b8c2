// The networks that play an evaluation's seats, each for its own agents: one forward pass of each over the rows of its
// agents, put together to the output of one batch. Stage: refresh, forward.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "policy_workers/batching/batcher.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/seat_plan.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// Threads: the policy worker's.
class SeatNetworks {
 public:
  /// Makes the networks of `<run_dir>/seats.toml`, whose weights come later. A network with an actor per agent plays
  /// agent i with its actor i. Errors: those of read_seat_plan() and load_run_config(); kBadInput where the arena
  /// has no room for a recurrent state or for the weights.
  static Expected<SeatNetworks> create(const std::string& run_dir, const shm::Arena& arena,
                                       torch::Device device);

  bool needs_weights() const { return !players_.empty(); }

  /// Takes what the learner's serve_seats() published: for each network its epsilon (f32), then its weights.
  /// Errors: kBadFormat where the length is another.
  Status read_weights(std::span<const std::byte> bytes);

  /// The output of the whole batch: logits 0 where no network plays, values 0.
  PolicyOutput step(const Batch& batch) const;

  /// How the agents' actions come out of such rows, [N].
  std::vector<SeatRule> rules() const;

 private:
  struct Player {
    ActorCritic net;
    std::vector<int> agents;  ///< ascending
    SeatRule rule;
  };
  SeatNetworks(SeatPlan plan, const EnvShape& env) : plan_(std::move(plan)), env_(env) {}

  SeatPlan plan_;
  EnvShape env_;
  std::vector<Player> players_;  ///< by network
};

}  // namespace comrad::policy
