// How large a run's replay is, whether its frames are compressed and where it lies: chosen from the settings,
// the shapes and what is free on the host. The learner makes the replay by this and reports it at the start of a run;
// `comrad config` prints it, and `comrad train` refuses a run that would end before learning begins.
// Stage: before store.
#pragma once

#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::replay {

/// What is free on the host, in bytes.
struct HostSpace {
  int64_t memory_bytes = 0;  ///< MemAvailable, or less where a control group allows less
  int64_t disk_bytes = 0;    ///< on the disk of the run's folder
};

/// Looks. `folder` need not exist yet: its nearest parent counts.
HostSpace probe_space(const std::string& folder);

/// Memory that the rest of a run takes: arena, weights with gradients and moments, batches, programs. An
/// estimate from above. `config` must be resolved.
int64_t reserved_bytes(const RunConfig& config, const TrajectoryShape& shape, int64_t weights_bytes);

struct ReplayPlan {
  int64_t capacity_bytes = 0;
  int64_t capacity_transitions = 0;  ///< agent decisions at most: replay_capacity_decisions
  bool compress = false;
  std::string file = {};          ///< empty: memory
  std::string reason = {};        ///< why, in words
  int64_t fitting_decisions = 0;  ///< agent decisions that fit for sure: frames that LZ4 does not shrink
  int64_t decisions_before_training =
      0;  ///< learning_starts_decisions, or half of those that fit if that is less

  /// The part of learner `rank` of `learners`: its own replay, in its own file. When training begins is for all
  /// of them together to say, and stays.
  ReplayPlan share_of(int rank, int learners) const;

  /// "replay: room for 35840 agent decisions in 3.1 GB (why); learning begins with 17920".
  std::string words() const;
};

/// A pure function. `wanted` below are the bytes of replay_capacity_decisions decisions, uncompressed.
///
///   capacity   replay_gb, at most wanted; where it is 0: wanted, at most a third of what `reserved_bytes` leave
///              of the free memory (of the free disk, with replay_file)
///   compress   as replay_compress describes; auto: where wanted is more than the capacity may be
///   file       replay_file; without one <run_dir>/replay.ring where a typed replay_gb is more than memory
///              allows, else memory
///
/// Errors: kNoSpace where that file does not fit on its disk either (needed, free, flags).
Expected<ReplayPlan> replay_plan(const RunConfig& config, const TrajectoryShape& shape,
                                 const HostSpace& space, int64_t reserved_bytes, const std::string& run_dir);

}  // namespace comrad::replay
