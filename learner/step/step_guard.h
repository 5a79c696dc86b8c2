// The last look before an optimizer steps: a loss or gradient that is not finite, or a batch in which nothing is
// valid, is skipped and counted, and too many in a row end the run. Stage: update.
#pragma once

#include "learner/step/adam_optimizer.h"
#include "learner/step/update_stats.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::learn {

class StepGuard {
 public:
  /// Launches the step, which the device takes where `loss` (one number on the device) and the gradient are finite, and
  /// counts it in `version` and `stats` as taken. Returns AdamOptimizer::step()'s two numbers.
  torch::Tensor step(AdamOptimizer& optimizer, const torch::Tensor& loss, double learning_rate,
                     PolicyVersion& version, UpdateStats& stats);
  /// Counts a step that was launched otherwise, as step() does.
  static void count_step(PolicyVersion& version, UpdateStats& stats);
  /// What became of a step, in the order of the steps. One that was not taken is taken back out of the counts.
  struct Outcome {
    bool was_taken = false;
    double grad_norm = 0;  ///< before the clip
    double loss = 0;
    double learning_rate = 0;
  };
  void complete(const Outcome& outcome, PolicyVersion& version, UpdateStats& stats);
  /// A batch without a valid sample: no step is taken. `dropped` samples of it were too old. Errors: as status().
  Status skip_invalid_batch(int64_t dropped, UpdateStats& stats);
  /// Errors: kBadInput after 20 skipped steps or batches in a row, with what to do.
  Status status() const;

  double grad_norm() const { return grad_norm_; }          ///< of the last step, before clipping
  double learning_rate() const { return learning_rate_; }  ///< of the last step taken

 private:
  int64_t skipped_in_a_row_ = 0;
  int64_t invalid_in_a_row_ = 0;
  double grad_norm_ = 0;
  double learning_rate_ = 0;
};

}  // namespace comrad::learn
