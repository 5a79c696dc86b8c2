// Where the learner's batches come from: a queue of full ones, a replay, or, in lock step, one rollout after the
// other. All three have one face, so the learner's loop reads the same. Stage: drain > sample.
#pragma once

#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>

#include "learner/algorithms/algorithm.h"
#include "learner/batch/collate.h"
#include "learner/batch/replay_batch.h"
#include "learner/checkpoint/checkpoint.h"
#include "learner/ranks/rank_group.h"
#include "learner/sources/replay_feed.h"
#include "learner/sources/stop_signal.h"
#include "policy_workers/batching/slab_frames.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::learn {

constexpr uint64_t kUnlimited = std::numeric_limits<uint64_t>::max();  ///< rollouts that simulators may begin

/// What the learner does next with what was drained: counts and observes what is new in the replay, then trains on
/// the batch, if there is one. At most one batch is set.
struct Sample {
  Inserted inserted;                            ///< off-policy
  std::unique_ptr<RolloutBatch> rollout_batch;  ///< on-policy
  std::unique_ptr<ReplayBatch> replay_batch;    ///< off-policy

  bool has_batch() const { return rollout_batch != nullptr || replay_batch != nullptr; }
};

/// What every source works with; all of it outlives the source.
struct SourceOptions {
  const RunConfig& config;
  const shm::Arena& arena;
  StopSignal& stop;
  std::function<void()> poll;  ///< called now and then by a drain() that waits
  std::string run_dir;
  bool is_off_policy = false;
  torch::Device device = torch::kCPU;  ///< that trains
  RankGroup& ranks;                    ///< each of the learners fills its part of every batch
  /// Where policy threads keep frames on the device; null: nowhere.
  const policy::SlabFrames* frames = nullptr;
};

/// Threads: the learner's.
class BatchSource {
 public:
  virtual ~BatchSource() = default;

  /// Called once, after load() and before the first drain(): threads begin, or journals go into the arena.
  /// Errors: kBadFormat of journals that belong to another arena.
  virtual Status start() = 0;
  /// The number of rollouts that simulators may begin, once everything else is ready for them.
  virtual uint64_t rollouts_allowed() const = 0;

  /// Takes in sealed slabs. False where none came in a short while; in lock step it waits for a whole rollout, and
  /// false is a stop. Also false where another learner has left (RankGroup::failure). Errors: kSystem (a thread of the
  /// source failed), kPeerLost (a simulator left lock step).
  virtual Expected<bool> drain() = 0;
  /// The next sample of what was drained; none when it is used up, or another learner has left. `version` is the
  /// learner's.
  virtual std::optional<Sample> sample(PolicyVersion version) = 0;
  /// The sample was trained on: priorities are taken over, memory is used again.
  virtual void finish(Sample sample) = 0;

  /// Training is over: a thread that only drains ends.
  virtual void stop() {}

  // Lock step: between two rollouts.
  /// The rollout is trained on; what checkpoints hold is its end.
  virtual void close_rollout() {}
  /// Whether the last boundary, or the checkpoint that was loaded, can be resumed exactly.
  virtual bool resumes_exactly() const { return false; }
  /// Gives the rollout's slabs back and lets the next one begin, if the run continues.
  virtual void open_rollout(bool goes_on) { (void)goes_on; }

  /// Continues from a checkpoint of this run (`is_own`) or of another. Errors: kBadFormat; those of ReplayFeed::load.
  virtual Status load(const StateDict& state, const std::string& path, bool is_own);
  virtual void save(StateDict& state) const;

  /// The replay; null on-policy.
  virtual ReplayFeed* feed() { return nullptr; }
  const ReplayFeed* feed() const { return const_cast<BatchSource*>(this)->feed(); }
  virtual int waiting() const = 0;                ///< full batches
  virtual uint64_t broken_decisions() const = 0;  ///< that were found damaged
};

/// One update on the batch that a sample has. Errors: those of the algorithm's update().
Expected<UpdateStats> update_on(Sample& sample, Algorithm& algorithm, const UpdateContext& context);

/// Slabs that make a batch of these settings, of all learners together.
int64_t slabs_per_batch(const RunConfig& config, const EnvShape& env);

/// The source that the settings select. Errors: those of ReplayFeed::create.
Expected<std::unique_ptr<BatchSource>> make_batch_source(const SourceOptions& options);

}  // namespace comrad::learn
