// What every process of a host looks at beside its data: the desired state with its limits, and each worker's counters.
//
//   ControlBlock | WorkerCounters of simulators | of policy workers | of the learner
//
// Each word names its writer. It is a state, not a command: a late or restarted reader does the right thing.
#pragma once

#include <atomic>
#include <cstdint>

#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/futex.h"

namespace comrad::shm {

enum class RunState : uint32_t { kStarting, kRunning, kPaused, kStopping };

enum class WorkerState : uint32_t { kAbsent, kStarting, kRunning, kStopped };

/// Per-worker rates and totals, one writer each.
struct alignas(kCacheLineBytes) WorkerCounters {
  std::atomic<uint64_t>
      decisions;  ///< sim: agent decisions taken; policy: rows answered; learner: rows trained
  std::atomic<uint64_t> batches;  ///< policy: forward passes; learner: optimizer steps
  std::atomic<uint64_t> wait_ns;  ///< time spent waiting for another process
  std::atomic<uint64_t> busy_ns;
  std::atomic<uint32_t> pid;
  std::atomic<uint32_t> epoch;  ///< starts of this worker
  std::atomic<WorkerState> state;

  /// A worker's first words in a new life: kStarting, with this process's pid.
  void begin_life();
};
static_assert(std::atomic<WorkerState>::is_always_lock_free);
static_assert(sizeof(WorkerCounters) == kCacheLineBytes, "changing this bumps kArenaVersion");

/// The desired state, limits that the supervisor or the learner sets, and what they tell each other in a word.
struct alignas(kCacheLineBytes) ControlBlock {
  std::atomic<RunState> run_state;       ///< (supervisor)
  std::atomic<uint32_t> policy_version;  ///< newest version that the learner offers
  std::atomic<uint64_t>
      rollouts_allowed;  ///< deterministic mode: rollouts with index < this may start (learner)
  std::atomic<uint64_t>
      episodes_per_run;  ///< evaluation: episodes in all; UINT64_MAX while training (supervisor)
  std::atomic<uint64_t> slabs_sealed;              ///< next seal ticket (simulators)
  std::atomic<uint64_t> learner_env_frames;        ///< counted by the learner
  std::atomic<uint64_t> learner_decisions_before;  ///< of the run when this learner began (learner)
  std::atomic<uint64_t>
      schedule_env_frames;  ///< of the run, where schedules stand: the learner's count, on other hosts from the link
  std::atomic<uint32_t> checkpoint_seq;  ///< grows: the learner is to save a checkpoint (supervisor)
  std::atomic<uint32_t>
      goal_reached;  ///< 1: the run has ended at one of its limits (learner, trajectory sender)
  std::atomic<uint32_t>
      leave_requested;  ///< 1: the learner's host requests this one to leave; what was played is delivered first (sender)
  std::atomic<uint32_t> checkpoint_done;     ///< the last checkpoint_seq that the learner has dealt with
  std::atomic<uint32_t> checkpoints_failed;  ///< that the learners of this arena could not write
  std::atomic<uint64_t> saved_env_frames;    ///< of the newest checkpoint (learner)
  std::atomic<uint64_t> env_frames_lost;     ///< by learners that went back to a checkpoint (supervisor)
  std::atomic<uint64_t>
      decisions_lost_on_the_way;  ///< to a learner's host that began anew (trajectory sender)
  alignas(kCacheLineBytes) Doorbell run_state_changed;
  Doorbell slab_sealed;    ///< rung by simulators, heard by the learner
  Doorbell slab_released;  ///< rung by the learner (and when rollouts_allowed grows), heard by simulators
  Doorbell weights_published;
};
static_assert(sizeof(ControlBlock) == 6 * kCacheLineBytes, "changing this bumps kArenaVersion");

}  // namespace comrad::shm
