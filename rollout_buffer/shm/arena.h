// The arena: one sealed memfd per host and run, through which simulators, policy workers and the learner
// meet.
//
//   header | control | counters | step slots (one per environment) | episode ring | weights (two buffers) |
//   environment journals (deterministic mode) | layout desks | environment accounts | trajectory slabs
//
// Every hand-over is a state word with one writer per state and a doorbell beside it. There are no linked
// lists or index rings that a peer killed half way could leave broken: who owns what can always be read off
// the state words, and the supervisor gives a dead owner's slabs and slots back with reclaim_*().
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/trajectory.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/segment.h"

namespace comrad::shm {

/// Everything that sizes an arena. Trivially copyable; stored in the header.
struct ArenaShape {
  TrajectoryShape trajectory;
  int32_t sim_worker_count = 1;
  int32_t envs_per_worker = 16;   ///< env_index = worker * envs_per_worker + local index
  int32_t splits_per_worker = 2;  ///< parts of a worker's environments that alternate: 1 or 2
  int32_t policy_worker_count = 1;
  int32_t slab_count = 64;
  int32_t journal_steps = 0;  ///< decisions kept per environment for exact resume; 0: no journal
  int32_t episode_ring_capacity = 4096;
  int64_t weights_bytes = 0;       ///< capacity of one weights buffer
  int32_t guest_worker_count = 0;  ///< the last of the sim workers: played by other hosts
  int32_t frame_guest_count = 0;   ///< the first of the guests: policy workers of this host play with them

  /// Simulators of this host.
  int32_t own_worker_count() const { return sim_worker_count - guest_worker_count; }
  /// Simulators that policy workers of this host answer: the first ones.
  int32_t served_worker_count() const { return own_worker_count() + frame_guest_count; }
  int32_t env_count() const { return sim_worker_count * envs_per_worker; }
  /// Environments [first, last) of one split of a worker, as local indices.
  int32_t split_begin(int32_t split) const { return envs_per_worker * split / splits_per_worker; }
  int32_t split_end(int32_t split) const { return envs_per_worker * (split + 1) / splits_per_worker; }
  /// The policy worker that serves a split: splits are dealt out in turn.
  int32_t policy_worker_of(int32_t sim_worker, int32_t split) const {
    return (sim_worker * splits_per_worker + split) % policy_worker_count;
  }
};

/// What a simulator asks of the policy worker in one hand-over.
enum class RequestKind : uint32_t {
  kAct,    ///< row `step` of the slab: choose an action, advance the recurrent state, write value
  kValue,  ///< row `step` == T of a full slab: write value[T] only; the recurrent state stays
  kFinal,  ///< row `final_row` of the finals: write final_value only; the recurrent state stays
};

/// Hand-over of one environment's decision (all N agents): observation out, action back.
///
///   kIdle -commit-> kReady -gather-> kInBatch -scatter-> kActed -take-> kIdle
///         (sim)            (policy)            (policy)         (sim)
///
/// A policy worker that dies leaves slots in kInBatch; its successor gathers kReady and kInBatch slots of its
/// own splits at start-up and answers them again, which is harmless: the recurrent state is read from one
/// parity of `recurrent` and written to the other, and the simulator reads the answer only in kActed.
enum class SlotState : uint32_t { kIdle, kReady, kInBatch, kActed };

struct alignas(kCacheLineBytes) StepSlot {
  // Simulator writes before commit.
  uint64_t step_id;     ///< decisions since the run began in this environment; parity picks the state buffer
  uint64_t episode_id;  ///< keys the action draw together with episode_step, so that an episode replays
  uint32_t episode_step;  ///< decisions since reset
  uint32_t slab_index;
  uint32_t step;       ///< row t in the slab
  uint32_t final_row;  ///< for kFinal
  RequestKind kind;
  uint32_t reset_state;  ///< 1: the recurrent input is zero (first decision of an episode)
  // Handshake: release on every store, acquire on every load.
  alignas(kCacheLineBytes) std::atomic<SlotState> state;
};
static_assert(std::atomic<SlotState>::is_always_lock_free);
static_assert(sizeof(StepSlot) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// Moves a slot along one arrow of the picture above; false (and no change) if it is not in state `from`,
/// which happens when the supervisor gave a dead peer's slot back in the meantime.
inline bool advance(StepSlot& slot, SlotState from, SlotState to) {
  return slot.state.compare_exchange_strong(from, to, std::memory_order_acq_rel, std::memory_order_acquire);
}

/// What a split of environments asks for in its present round. The simulator stores it before it commits the
/// round's first slot, and no slot of an older round is outstanding then; so a policy worker that counts
/// `request_count` slots of the split in kReady holds the whole round (deterministic mode).
struct alignas(kCacheLineBytes) SplitRound {
  std::atomic<uint32_t> request_count;  ///< slots that this round commits
};
static_assert(sizeof(SplitRound) == kCacheLineBytes, "changing this bumps kArenaVersion");

/// Life of a trajectory slab.
///
///   kFree -acquire-> kFilling -seal-> kSealed -drain-> kLearning -release-> kFree
///          (sim)              (sim)           (learner)          (learner)
enum class SlabState : uint32_t { kFree, kFilling, kSealed, kLearning };

struct alignas(kCacheLineBytes) SlabHeader {
  uint32_t env_index;
  uint32_t length;         ///< rows filled: T, or fewer where K episode ends sealed it early
  uint64_t rollout_index;  ///< counts slabs of this environment from 0
  uint64_t seal_ticket;    ///< order of sealing over all environments
  uint64_t layout_id;
  EpisodeStamp first_episode;
  uint64_t position;  ///< steps of this environment in slabs that were sealed before; see EnvAccount
  /// A slab is free when `state` is kFree and `owner` is 0. The owner word is the lock that acquiring takes;
  /// it is given back just before the state moves on. While kFilling, env_index tells whose the slab is, so a
  /// simulator killed between any two of these stores loses nothing.
  alignas(kCacheLineBytes) std::atomic<SlabState> state;
  std::atomic<uint32_t> owner;  ///< sim worker index + 1 while kFilling, else 0
};
static_assert(sizeof(SlabHeader) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// One finished episode, as the supervisor publishes it (topic EpisodeResult).
struct EpisodeRecord {
  uint64_t episode_id;
  uint64_t episode_seed;
  uint64_t layout_id;
  uint32_t env_index;
  uint32_t length_steps;  ///< decisions
  uint32_t length_tics;
  uint32_t terminated;             ///< 1 terminated, 0 truncated
  float score;                     ///< J, team level
  float ceiling;                   ///< the best J that the map allows so many agents; 0: not known
  float agent_return[kMaxAgents];  ///< sum of rewards before scale, clip and sharing
  float agent_score[kMaxAgents];   ///< J per agent, where the scenario tells them apart; else J
};

/// What everybody should do, not a command: a late or restarted reader does the right thing.
enum class RunState : uint32_t { kStarting, kRunning, kPaused, kStopping };

enum class WorkerState : uint32_t { kAbsent, kStarting, kRunning, kStopped };

/// Per-worker rates and totals, one writer each.
struct alignas(kCacheLineBytes) WorkerCounters {
  std::atomic<uint64_t>
      decisions;  ///< sim: agent decisions taken; policy: rows answered; learner: rows trained
  std::atomic<uint64_t> batches;  ///< policy: forward passes; learner: optimizer steps
  std::atomic<uint64_t> wait_ns;  ///< time spent waiting for somebody else
  std::atomic<uint64_t> busy_ns;
  std::atomic<uint32_t> pid;
  std::atomic<uint32_t> epoch;  ///< starts of this worker
  std::atomic<WorkerState> state;

  /// A worker's first words in a new life: kStarting, with this process's pid.
  void begin_life();
};
static_assert(std::atomic<WorkerState>::is_always_lock_free);

/// The desired state, limits that the supervisor or the learner sets, and what they tell each other in a word.
struct alignas(kCacheLineBytes) ControlBlock {
  std::atomic<RunState> run_state;
  std::atomic<uint32_t> policy_version;      ///< newest version in the weights buffers
  std::atomic<uint64_t> rollouts_allowed;    ///< deterministic mode: rollouts with index < this may start
  std::atomic<uint64_t> episodes_per_run;    ///< evaluation: episodes in all; UINT64_MAX while training
  std::atomic<uint64_t> slabs_sealed;        ///< next seal ticket
  std::atomic<uint64_t> learner_env_frames;  ///< counted by the learner
  std::atomic<uint64_t> learner_decisions_before;  ///< of the run when this learner began (learner)
  std::atomic<uint64_t>
      schedule_env_frames;  ///< of the run, where schedules stand: the learner's count, on other hosts from the link
  std::atomic<uint32_t> checkpoint_seq;  ///< grows: the learner is to save a checkpoint (supervisor)
  std::atomic<uint32_t>
      goal_reached;  ///< 1: the learner ended because a limit of the run was reached; link/feeder.h
  std::atomic<uint64_t> saved_env_frames;    ///< of the newest checkpoint (learner)
  std::atomic<uint64_t> env_frames_lost;     ///< by learners that went back to a checkpoint (supervisor)
  std::atomic<uint32_t> checkpoint_done;     ///< the last checkpoint_seq that the learner has dealt with
  std::atomic<uint32_t> checkpoints_failed;  ///< that the learners of this arena could not write
  std::atomic<uint64_t> decisions_lost_on_the_way;  ///< to a learner's host that began anew (feeder)
  alignas(kCacheLineBytes) Doorbell run_state_changed;
  Doorbell slab_sealed;    ///< rung by simulators, heard by the learner
  Doorbell slab_released;  ///< rung by the learner (and when rollouts_allowed grows), heard by simulators
  Doorbell weights_published;
};

constexpr std::size_t kCheckpointPathBytes = 512;

/// What the learner says of itself once a second, for the supervisor.
struct LearnerReport {
  double time_s = 0;  ///< of training, earlier processes included
  uint64_t env_frames = 0;
  uint64_t decisions = 0;
  double env_frames_per_s = 0;
  double decisions_per_s = 0;
  double score_mean = 0;  ///< J over the last stats_avg episodes; NaN before the first
  double return_mean = 0;
  uint64_t episodes = 0;
  double policy_lag_mean = 0;
  double replay_filled = 1;  ///< share of the decisions that learning waits for; 1: it waits for none
  uint32_t learner_version = 0;
  uint32_t policy_lag_max = 0;
  char last_checkpoint[kCheckpointPathBytes] = {};  ///< ends in 0; a longer path is cut
};

/// What exact resume needs of one environment (deterministic mode): replaying `actions` from `episode_seed`
/// gives its world back; `recurrent` lies in the arena's state buffers.
struct JournalHeader {
  uint64_t episode_seed;
  uint64_t episode_id;
  uint64_t step_id;
  uint64_t rollout_index;
  uint32_t
      length;  ///< decisions since reset; more than journal_steps: the journal overflowed, no exact resume
  uint32_t is_resume;  ///< 1: written by the learner before start; the simulator replays it first
  uint32_t in_use;  ///< 1 once the environment has begun; a restarted simulator counts its ids on from here
};

constexpr std::size_t kDeskOutcomes = 8;

/// Where one environment's maps come from while it trains on a pool of layouts: the simulator reports how its
/// episodes ended and takes what it is granted; the learner's curriculum reads the one and writes the other.
/// Nobody waits: a simulator whose draw is due while no new grant lies there plays its layout once more.
///
///   simulator  outcome[reported % 8], ++reported     granted != taken: playing = layout_index, taken = granted
///   learner    reads outcomes [heard, reported)      granted == taken: layout_index = a draw, ++granted
struct alignas(kCacheLineBytes) LayoutDesk {
  // Simulator.
  std::array<std::atomic<uint64_t>, kDeskOutcomes> outcome;  ///< pack_outcome() of finished episodes
  alignas(kCacheLineBytes) std::atomic<uint64_t> reported;
  std::atomic<uint32_t> taken;    ///< grants taken so far
  std::atomic<uint32_t> playing;  ///< layout of the present episode, by its index in the pool
  std::atomic<uint32_t> late;     ///< draws that were due while no new grant lay there
  // Learner.
  alignas(kCacheLineBytes) std::atomic<uint64_t> heard;
  std::atomic<uint32_t> granted;       ///< grants given so far
  std::atomic<uint32_t> layout_index;  ///< of the newest grant, in the pool
};
static_assert(sizeof(LayoutDesk) == 3 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// One finished episode in a word, so that it is never seen half written.
struct LayoutOutcome {
  uint32_t layout_index = 0;
  float score = 0;  ///< J, team level
};
uint64_t pack_outcome(const LayoutOutcome& outcome);
LayoutOutcome unpack_outcome(uint64_t word);

/// What became of the steps (decisions of all agents) that one environment has played since the arena was made:
///
///   made = sealed + in the slab in hand + lost         sealed = taken + in sealed slabs
///
/// Each word alone is the truth about what it counts, so that a process killed between any two stores leaves sums that
/// add up: `made` and `sealed` are stored before what they announce, and reclaim_sim_worker() takes back what was announced
/// and not done.
struct alignas(kCacheLineBytes) EnvAccount {
  // Simulator; while it is dead, the supervisor.
  std::atomic<uint64_t> made;
  std::atomic<uint64_t> sealed;  ///< in slabs that were sealed
  // Supervisor.
  std::atomic<uint64_t> lost;  ///< in slabs that dead simulators left half full
  // Learners; while they are dead, the supervisor. It only grows.
  alignas(kCacheLineBytes) std::atomic<uint64_t> taken;  ///< in slabs that were drained
};
static_assert(sizeof(EnvAccount) == 2 * kCacheLineBytes, "changing this bumps kArenaVersion");

/// The accounts of all environments together, in agent decisions.
struct DecisionCounts {
  uint64_t made = 0;
  uint64_t sealed = 0;
  uint64_t taken = 0;
  uint64_t lost = 0;
};

/// Whose slabs a reader takes, where several readers share them out: those of some environments. Environments come in
/// blocks of `block`, a multiple of `count`; of each block the first ones are reader 0's, the next ones reader 1's.
struct EnvShare {
  int rank = 0, count = 1;  ///< of the readers
  int block = 1;

  bool has(uint32_t env_index) const {
    return count == 1 || static_cast<int>(env_index) % block / (block / count) == rank;
  }
  /// Of an environment of this share: how many of the share come before it.
  int place_of(uint32_t env_index) const {
    const int env = static_cast<int>(env_index), of_block = block / count;
    return count == 1 ? env : env / block * of_block + env % block % of_block;
  }
};

/// How many slabs are in which state.
struct SlabCounts {
  int free = 0;
  int filling = 0;
  int sealed = 0;
  int learning = 0;
};

/// A mapped arena. Move-only; all methods are safe to call from every process that has it mapped.
class Arena {
 public:
  /// Bytes that an arena of this shape needs.
  static int64_t size_bytes(const ArenaShape& shape);

  /// Makes a fresh arena; all slots kIdle, all slabs kFree.
  /// Errors: kBadInput for a bad shape; kNoSpace saying how much is needed, how much there is, and which
  /// flags
  /// (--trajectory_slabs, --num_workers, --num_envs_per_worker, --rollout) lower it.
  static Expected<Arena> create(const ArenaShape& shape, uint64_t run_id);

  /// Maps a peer's arena. Errors: kBadFormat when magic, version or sizes do not fit this build.
  static Expected<Arena> adopt(int descriptor);

  Arena(Arena&&) noexcept;
  Arena& operator=(Arena&&) noexcept;
  ~Arena();

  const ArenaShape& shape() const;
  uint64_t run_id() const;
  int descriptor() const;
  ControlBlock& control() const;

  // Workers' counters.
  WorkerCounters& sim_counters(int sim_worker) const;
  WorkerCounters& policy_counters(int policy_worker) const;
  WorkerCounters& learner_counters() const;

  // Step slots: one per environment.
  StepSlot& slot(int env_index) const;
  /// Live recurrent state [N, H] of an environment; `parity` = step_id & 1 is the input, the other
  /// the output.
  std::span<float> recurrent(int env_index, uint64_t parity) const;
  Doorbell& slots_ready(int policy_worker) const;            ///< rung after a split committed
  Doorbell& slots_acted(int sim_worker, int split) const;    ///< rung after a batch was scattered
  SplitRound& split_round(int sim_worker, int split) const;  ///< requests of the split's present round

  // Trajectory slabs.
  const SlabOffsets& slab_offsets() const;
  SlabView slab(int slab_index) const;
  SlabHeader& slab_header(int slab_index) const;
  /// A free slab for `sim_worker`, or nothing (back-pressure). kFree -> kFilling by compare-and-swap.
  std::optional<uint32_t> acquire_slab(int sim_worker) const;
  void seal_slab(uint32_t slab_index) const;     ///< kFilling -> kSealed, takes a ticket, rings
  void abandon_slab(uint32_t slab_index) const;  ///< kFilling -> kFree, rings: its owner needs it no more
  /// Takes up to `max_count` sealed slabs of a share in ticket order: kSealed -> kLearning. An environment's slabs
  /// never overtake each other. Several readers may take from one share.
  std::vector<uint32_t> drain_slabs(int max_count, const EnvShare& share = {}) const;
  /// What a dead reader had drained and not released, in order of sealing; it is counted as taken.
  std::vector<uint32_t> adopt_slabs() const;
  int sealed_count() const;
  SlabCounts slab_counts() const;
  void release_slab(uint32_t slab_index) const;  ///< kLearning -> kFree, rings

  // Episode records: one ring per simulator (record.env_index tells which), one reader (the supervisor). A
  // simulator killed half way leaves a record that was never announced. A full ring drops the newest and
  // counts it.
  bool push_episode(const EpisodeRecord& record) const;
  std::optional<EpisodeRecord> pop_episode() const;
  uint64_t episodes_dropped() const;
  // One more ring, from the supervisor to the learner. What a learner that is away does not take is dropped.
  bool forward_episode(const EpisodeRecord& record) const;
  std::optional<EpisodeRecord> pop_forwarded_episode() const;

  // The learner's report, behind a sequence lock: one writer (the learner), one reader (the supervisor).
  void publish_report(const LearnerReport& report) const;
  /// The newest report if `sequence` is not its number, which is stored there; nothing otherwise, or while one
  /// is being written (a learner killed half way leaves none until its successor speaks).
  std::optional<LearnerReport> read_report(uint64_t& sequence) const;

  // Weights: two buffers behind a sequence lock.
  /// Copies `bytes` into the older buffer, then makes it current as `version`.
  void publish_weights(std::span<const std::byte> bytes, PolicyVersion version) const;
  /// Version that lies ready; 0 before the first publish makes has_weights() false.
  PolicyVersion weights_version() const;
  bool has_weights() const;
  /// Copies the current weights into `out` (resized) and returns their version; never torn, checksum
  /// verified. Errors: kBadFormat when the checksum keeps failing.
  Expected<PolicyVersion> read_weights(std::vector<std::byte>& out) const;

  // Journals (deterministic mode).
  JournalHeader& journal(int env_index) const;
  std::span<uint8_t> journal_action(int env_index, int step) const;  ///< [N * heads]

  // Layout pools.
  LayoutDesk& layout_desk(int env_index) const;

  // Accounts.
  EnvAccount& env_account(int env_index) const;
  /// While processes are at work: made >= sealed + lost, sealed >= taken.
  DecisionCounts decision_counts() const;

  // Supervisor: after a worker died.
  /// Idles a dead simulator's slots, but for those that a policy worker has in its batch: it still writes into their slabs.
  /// Whether there are none.
  bool withdraw_requests(int sim_worker) const;
  /// Frees the slabs a dead simulator was filling (their rollouts are played again) and idles its slots.
  /// Returns agent decisions lost. Waits up to 2 s for withdraw_requests(); reclaim a policy worker that died at the same
  /// time first.
  uint64_t reclaim_sim_worker(int sim_worker) const;
  /// Puts slots that a dead policy worker had in its batch back to kReady. Returns how many.
  int reclaim_policy_worker(int policy_worker) const;
  /// Puts kLearning slabs of a dead learner back to kFree. Returns how many.
  int reclaim_learner() const;

 private:
  struct Offsets;
  struct EpisodeQueue;
  Arena(Segment segment, std::unique_ptr<Offsets> offsets);
  void note_taken(const SlabHeader& header) const;
  Segment segment_;
  std::unique_ptr<Offsets> offsets_;
};

}  // namespace comrad::shm
