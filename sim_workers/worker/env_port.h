// One environment's end of the pipeline: it hands observations to the policy worker through the step slot,
// takes the actions back, appends what happened to a trajectory slab and seals it. Stage: commit, step,
// append, seal.
#pragma once

#include <cstdint>
#include <span>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/shm/accounts.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/journal.h"
#include "rollout_buffer/shm/layout_mailbox.h"
#include "rollout_buffer/shm/step_slots.h"
#include "sim_workers/env/environment.h"
#include "sim_workers/worker/reward_rules.h"

namespace comrad::sim {

/// What all ports of a worker obey.
struct PortRules {
  uint64_t seed = 0;      ///< of the run
  bool evaluate = false;  ///< play a fixed quota of episodes and never seal
  uint64_t episodes = 0;  ///< evaluation: episodes of the whole run
  RewardRules rewards{};
  uint32_t layout_count = 0;       ///< of the run's pool; 0: one map and no pool
  uint32_t layout_swap_every = 1;  ///< episodes between two draws; evaluation plays all layouts in turn
};

/// Drives one environment. SimWorker calls, in every round of the port's split and in this order:
///
///   try_begin_slab   while kParked: take a free slab if the gate is open
///   advance          once the answer is there: step the world, or seal, or begin the next episode
///   wants_final      an episode is over: its last observation goes to final_target(), then close_episode()
///   wants_row        row t needs an observation: it goes to row_target(), then mark_observed()
///   wants_commit     commit() hands the slot over
///
///   kParked -> kRow -> kObserved -commit-> kOutstanding -advance-> kRow | kFinal | kObserved | kParked
///                                kFinal -close_episode-> kRow (terminated) | kObserved (truncated)
///
/// Between calls the port is in one of these stages, and everything that a successor process needs to count
/// on (ids, seeds, actions since reset) is in the environment's journal. The step path neither allocates,
/// throws nor logs.
class EnvPort {
 public:
  EnvPort(const shm::Arena& arena, Environment& environment, const PortRules& rules, int sim_worker,
          int local_index);

  /// Replays the journal, continues a dead predecessor's counts, or begins the first episode.
  /// Errors: kBadFormat when the journal does not replay in this environment.
  Status start();

  bool is_outstanding() const { return stage_ == Stage::kOutstanding; }
  /// Evaluation: this environment's share of the episodes is played; or status() is an error.
  bool is_done() const { return stage_ == Stage::kDone; }
  /// What ended this environment early: a layout of the pool that cannot be loaded.
  const Status& status() const { return status_; }
  /// The policy worker has answered.
  bool has_answer() const { return slot_->state.load(std::memory_order_acquire) == shm::SlotState::kActed; }

  /// Takes a free slab if this environment's next rollout is below `rollouts_allowed`; else stays parked.
  void try_begin_slab(uint64_t rollouts_allowed);
  /// Takes the answer and does what was waiting for it. Returns whether the world was stepped.
  bool advance(uint64_t rollouts_allowed);

  bool wants_final() const { return stage_ == Stage::kFinal; }
  ObservationTarget final_target() const;
  /// The episode's record goes out; a terminated one resets at once, a truncated one first requests its
  /// final value.
  void close_episode();

  bool wants_row() const { return stage_ == Stage::kRow; }
  ObservationTarget row_target() const { return target_of_row(slab_, step_); }
  void mark_observed();

  bool wants_commit() const { return stage_ == Stage::kObserved; }
  void commit();

 private:
  enum class Stage { kParked, kRow, kFinal, kObserved, kOutstanding, kDone };

  ObservationTarget target_of_row(const SlabView& slab, int step) const;
  Status begin_episode(uint64_t episode_id);
  Status choose_layout(uint64_t episode_id);
  void next_episode();
  void act();
  void append_to_journal(std::span<const int32_t> action);
  void record_episode();
  uint32_t played_layout() const;
  bool begin_slab(uint64_t rollouts_allowed);
  void finish_slab(uint64_t rollouts_allowed);
  void copy_observation(const ObservationTarget& from, const ObservationTarget& to) const;

  const shm::Arena& arena_;
  Environment& environment_;
  const PortRules& rules_;
  const int sim_worker_;
  const int env_index_;
  shm::StepSlot* const slot_;
  shm::JournalHeader* const journal_;
  shm::LayoutMailbox* const mailbox_;
  shm::EnvAccount* const account_;

  Stage stage_ = Stage::kParked;
  shm::RequestKind request_ = shm::RequestKind::kAct;
  uint32_t slab_index_ = 0;
  SlabView slab_;
  int step_ = 0;          // row t that comes next
  int final_count_ = 0;   // finals of this slab that are in use
  uint64_t step_id_ = 0;  // of the next kAct
  uint64_t rollout_index_ = 0;
  uint64_t episode_id_ = 0;
  uint64_t episode_seed_ = 0;
  uint32_t episode_step_ = 0;
  Status status_;
};

}  // namespace comrad::sim
