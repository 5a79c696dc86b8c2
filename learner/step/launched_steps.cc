#include "learner/step/launched_steps.h"

namespace comrad::learn {

LaunchedSteps::Outcome LaunchedSteps::take_outcome(UpdateStats& stats) {
  Pending oldest = std::move(steps_.front());
  steps_.pop_front();
  const bool is_of_this_phase = oldest.phase == phase_;
  UpdateStats of_before;
  StepOutcome outcome = runner_.complete(oldest.step, is_of_this_phase ? stats : of_before);
  stats.skipped_steps += of_before.skipped_steps;
  return {.step = std::move(outcome),
          .trains_policy = oldest.step.trains_policy,
          .is_of_this_phase = is_of_this_phase};
}

void LaunchedSteps::settle(const std::function<void(const StepOutcome&)>& see) {
  UpdateStats stats;
  begin_phase();
  while (!steps_.empty()) {
    const Outcome outcome = take_outcome(stats);
    if (see) see(outcome.step);
  }
  late_skipped_ += stats.skipped_steps;
}

}  // namespace comrad::learn
