// The arena: one sealed memfd per host and run, through which simulators, policy workers and the learner meet. It is made
// of rooms, each with its own header that draws its layout and names its writers:
//
//   header | control_block | step_slots | episode_stream | learner_report | weight_buffers | journal | layout_mailbox |
//   accounts | remote_worker_slot | slab_pool
//
// Every hand-over is a state word with one writer per state and a doorbell beside it. There are no linked
// lists or index rings that a peer killed half way could leave broken: ownership can always be read off
// the state words, and the supervisor gives a dead owner's slabs and slots back with reclaim_*().
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena_shape.h"
#include "rollout_buffer/shm/control_block.h"
#include "rollout_buffer/shm/segment.h"

namespace comrad::shm {

class Accounts;
class EpisodeStream;
class Journals;
class LayoutMailboxes;
class LearnerReports;
class RemoteWorkerSlots;
class SlabPool;
class StepSlots;
class WeightBuffers;

/// A mapped arena. Move-only; all methods are safe to call from every process that has it mapped. Include the headers of the
/// rooms that you enter.
class Arena {
 public:
  /// Bytes that an arena of this shape needs.
  static int64_t size_bytes(const ArenaShape& shape);

  /// Makes a fresh arena; all slots kIdle, all slabs kFree.
  /// Errors: kBadInput for a bad shape; kNoSpace saying how much is needed, how much there is, and which
  /// flags (--trajectory_slabs, --num_workers, --num_envs_per_worker, --rollout) lower it.
  static Expected<Arena> create(const ArenaShape& shape, uint64_t run_id);

  /// Maps a peer's arena. Errors: kBadFormat when magic, version or sizes do not fit this build.
  static Expected<Arena> adopt(int descriptor);

  Arena(Arena&&) noexcept;
  Arena& operator=(Arena&&) noexcept;
  ~Arena();

  const ArenaShape& shape() const;
  uint64_t run_id() const;
  int descriptor() const { return segment_.descriptor(); }
  /// The whole segment, page-aligned.
  std::span<std::byte> bytes() const {
    return {segment_.data(), static_cast<std::size_t>(segment_.size_bytes())};
  }
  ControlBlock& control() const;
  WorkerCounters& sim_counters(int sim_worker) const;
  WorkerCounters& policy_counters(int policy_worker) const;
  WorkerCounters& learner_counters() const;

  const StepSlots& step_slots() const;
  const EpisodeStream& episodes() const;
  const LearnerReports& learner_reports() const;
  const WeightBuffers& weights() const;
  const Journals& journals() const;
  const LayoutMailboxes& layout_mailboxes() const;
  const Accounts& accounts() const;
  const RemoteWorkerSlots& remote_worker_slots() const;
  const SlabPool& slabs() const;

  // Supervisor: after a worker died.
  /// Frees the slabs a dead simulator was filling (their rollouts are played again) and idles its slots.
  /// Returns agent decisions lost. Waits up to 2 s for StepSlots::withdraw(); reclaim a policy worker that died at the same
  /// time first.
  uint64_t reclaim_sim_worker(int sim_worker) const;
  /// Puts slots that a dead policy worker had in its batch back to kReady. Returns how many.
  int reclaim_policy_worker(int policy_worker) const;
  /// Puts kLearning slabs of a dead learner back to kFree. Returns how many.
  int reclaim_learner() const;

 private:
  struct Rooms;
  Arena(Segment segment, std::unique_ptr<Rooms> rooms);
  Segment segment_;
  std::unique_ptr<Rooms> rooms_;
};

}  // namespace comrad::shm
