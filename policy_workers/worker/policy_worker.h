// A policy worker's life: refresh the weights, gather a batch, forward it, scatter the answers. One network, one thread, of a
// separate process or of the learner's.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "policy_workers/batching/batcher.h"
#include "policy_workers/batching/staged_forward.h"
#include "policy_workers/network/actor_critic.h"
#include "policy_workers/weights/weights_receiver.h"
#include "policy_workers/worker/seat_networks.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::policy {

/// What the command line adds to the settings.
struct PolicyWorkerOptions {
  int worker_index = 0;
  bool is_greedy = false;  ///< most probable actions
  bool is_random = false;  ///< uniform over allowed choices, no network
  /// The agents of a world have different players: those of seats.toml in this run directory; empty: all alike.
  std::string seats_of = {};
  /// The same episodes on every start: batches are whole splits, and draws are keyed by the episode alone.
  bool is_evaluation = false;
  /// Of the learner in whose process this is a thread: the process's time and the arena's weights are not its own. Null: a process.
  const LocalWeights* learners_weights = nullptr;
  /// And where the frames that it acts on are kept for the learner; null: nowhere.
  SlabFrames* learners_frames = nullptr;
};

/// Joined to one run.
class PolicyWorker {
 public:
  /// Errors: kBadInput for a worker index, device or network that does not fit the run.
  static Expected<PolicyWorker> create(const RunConfig& config, const shm::Arena& arena,
                                       const PolicyWorkerOptions& options);

  /// Works until `stop`, or RunState::kStopping. Errors: kBadFormat when the learner's weights never fit.
  Status run(const std::atomic<bool>& stop);

  const ActorCritic& policy() const { return policy_; }
  Batcher& batcher() { return batcher_; }

 private:
  PolicyWorker(const shm::Arena& arena, const PolicyWorkerOptions& options, ActorCritic policy,
               std::optional<SeatNetworks> seats, Batcher batcher);
  bool needs_weights() const { return seats_ ? seats_->needs_weights() : !options_.is_random; }
  bool is_thread() const { return options_.learners_weights != nullptr; }
  Status refresh();
  Expected<PolicyOutput> answer(const Batch& batch);
  void count_batch(const Batch& batch, int64_t busy_ns);

  const shm::Arena* arena_;
  PolicyWorkerOptions options_;
  ActorCritic policy_;  // empty when is_random, and where seats play
  std::optional<SeatNetworks> seats_;
  std::unique_ptr<StagedForward> staged_;  // null where a CPU has its own kernels
  Batcher batcher_;
  WeightsReceiver weights_;
  StageClock stage_;
};

/// Throughput of the network alone on random frames.
struct InferenceBench {
  double rows_per_s;  ///< agent rows; one row is one agent's decision
  int64_t batch_rows;
  double seconds;
  double cpu_seconds;  ///< processor time of the process meanwhile
};
InferenceBench bench_inference(const ActorCritic& policy, int64_t batch_rows, double seconds);

}  // namespace comrad::policy
