// What surrounds an update, and what it did. Stage: update.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "learner/batch/collate.h"

namespace comrad::learn {

/// What surrounds one update. Functions may be empty.
struct UpdateContext {
  double env_frames = 0;             ///< counted before this batch; places the learning-rate schedule
  std::function<void()> after_step;  ///< called when an optimizer step made a new version
  std::function<bool()>
      begin_step;  ///< asked before every optimizer step but the first; false ends the update
  std::function<bool()> keep_going;  ///< asked before every micro-batch; false abandons the step in hand
  /// Whether `UpdateStats::values` are wanted. Without them an update need not wait for its device: what became of its last steps
  /// may be known at a later update.
  bool reports = true;
};

/// Numbers for a report by name, in the order they are written.
using NamedNumbers = std::vector<std::pair<std::string, double>>;

/// What one update did.
struct UpdateStats {
  int64_t optimizer_steps = 0;
  int64_t skipped_steps =
      0;  ///< non-finite loss or gradient, or no valid sample; also steps of updates before
  int64_t rows_trained = 0;  ///< agent decisions times epochs that went forward and backward
  bool abandoned = false;    ///< keep_going returned false
  LagStats lag;
  NamedNumbers values;  ///< "train/policy_loss", ... of the last minibatch; none where no report was wanted
};

}  // namespace comrad::learn
