// The last look before an optimizer steps: a loss or gradient that is not finite, or a batch in which nothing is
// valid, is skipped and counted, and too many in a row end the run. Stage: update.
#pragma once

#include "learner/algorithms/adam_optimizer.h"
#include "learner/algorithms/algorithm.h"

namespace comrad::learn {

class StepGuard {
 public:
  /// Clips the gradient and takes the step; counts it in `version` and `stats`. False when it was skipped.
  bool step(AdamOptimizer& optimizer, double loss, double learning_rate, PolicyVersion& version,
            UpdateStats& stats);
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
