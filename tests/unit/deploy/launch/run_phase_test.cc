#include "deploy/launch/run_phase.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace run_phase_test {

std::string refusal(RunPhase phase, RunEvent event) {
  const Expected<RunPhase> next = next_phase(phase, event);
  return next ? "" : next.error().message;
}

TEST(RunPhase, AnEventThatCannotComeIsRefusedByName) {
  EXPECT_EQ(refusal(RunPhase::kPaused, RunEvent::kPause), "the run is paused already");
  EXPECT_EQ(refusal(RunPhase::kRunning, RunEvent::kResume), "the run is not paused");
  EXPECT_EQ(refusal(RunPhase::kStarting, RunEvent::kPause), "the run is starting");
  EXPECT_EQ(refusal(RunPhase::kEvaluating, RunEvent::kResume), "the run is stopping");
  EXPECT_EQ(refusal(RunPhase::kRunning, RunEvent::kAllJoined),
            "'all joined' cannot come while a run is running");
  EXPECT_EQ(refusal(RunPhase::kPaused, RunEvent::kAllLeft), "'all left' cannot come while a run is paused");
  EXPECT_EQ(refusal(RunPhase::kStopping, RunEvent::kStartAgain),
            "'start again' cannot come while a run is stopping");
}

TEST(RunPhase, WhatHasStoppedNeverRunsAgain) {
  for (const RunPhase phase : {RunPhase::kStopping, RunPhase::kEvaluating, RunPhase::kEnded})
    for (int event = 0; event <= static_cast<int>(RunEvent::kAllLeft); ++event) {
      const Expected<RunPhase> next = next_phase(phase, static_cast<RunEvent>(event));
      EXPECT_TRUE(!next || *next > phase) << word_of(static_cast<RunEvent>(event));
    }
}

TEST(StopReason, AGraverOneStaysAndWhatIsFinishedIsNotInterrupted) {
  using enum StopReason;
  EXPECT_EQ(later_reason(kNone, kInterrupted), kInterrupted);
  EXPECT_EQ(later_reason(kFinished, kInterrupted), kFinished);
  EXPECT_EQ(later_reason(kInterrupted, kFinished), kInterrupted);
  EXPECT_EQ(later_reason(kFinished, kNotSaved), kNotSaved);
  EXPECT_EQ(later_reason(kNotSaved, kKilled), kKilled);
  EXPECT_EQ(later_reason(kKilled, kNotSaved), kKilled);
  EXPECT_EQ(later_reason(kFailed, kKilled), kFailed);
}

TEST(StopReason, GivesExitCodeAndFinalState) {
  EXPECT_EQ(exit_code_of(StopReason::kFinished), 0);
  EXPECT_EQ(exit_code_of(StopReason::kInterrupted), 0);
  EXPECT_EQ(exit_code_of(StopReason::kNotSaved), 1);
  EXPECT_EQ(exit_code_of(StopReason::kKilled), 130);
  EXPECT_STREQ(final_state_of(StopReason::kFinished), "finished");
  EXPECT_STREQ(final_state_of(StopReason::kInterrupted), "paused");
  EXPECT_STREQ(final_state_of(StopReason::kFailed), "failed");
}

}  // namespace run_phase_test
}  // namespace comrad::deploy
