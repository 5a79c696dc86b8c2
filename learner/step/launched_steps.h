// Steps that a device was given and whose outcome the host does not know yet, in their order. Stage: update.
#pragma once

#include <cstdint>
#include <deque>
#include <functional>
#include <utility>

#include "learner/step/step_runner.h"

namespace comrad::learn {

/// Where no report is wanted, what became of the last steps of a phase is known in a phase after it.
/// Threads: the learner's.
class LaunchedSteps {
 public:
  explicit LaunchedSteps(StepRunner& runner) : runner_(runner) {}

  /// What was launched before is of a phase that has ended: its optimizer steps are no longer counted there.
  void begin_phase() { ++phase_; }
  void add(LaunchedStep step) { steps_.push_back({std::move(step), phase_}); }

  /// Whether the oldest one's outcome is there, or waits for it.
  bool has_outcome(bool waits) const {
    return !steps_.empty() && (waits || steps_.front().step.read.is_ready());
  }
  struct Outcome {
    StepOutcome step;
    bool trains_policy = false;     ///< LaunchedStep::trains_policy
    bool is_of_this_phase = false;  ///< else only its skipped step is counted
  };
  /// The oldest one's; waits where it is not there yet.
  Outcome take_outcome(UpdateStats& stats);

  /// Waits for all and shows each to `see`; what was not taken is counted by the next take_late().
  void settle(const std::function<void(const StepOutcome&)>& see = nullptr);
  /// Adds what settle() found to the update that begins.
  void take_late(UpdateStats& stats) { stats.skipped_steps += std::exchange(late_skipped_, 0); }
  void forget() { steps_.clear(); }

 private:
  struct Pending {
    LaunchedStep step;
    int64_t phase = 0;  ///< that launched it
  };

  StepRunner& runner_;
  std::deque<Pending> steps_;
  int64_t phase_ = 0;
  int64_t late_skipped_ = 0;
};

}  // namespace comrad::learn
