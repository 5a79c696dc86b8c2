// Where a run is in its life, and why it stopped: the two words behind its exit code, its status and what it may still be asked.
#pragma once

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/process.h"

namespace comrad::deploy {

///                  pause
///   kStarting ──▶ kRunning ⇄ kPaused        kEvaluating: the workers have left, the last evaluations are played
///      ▲             │  resume │
///      └─────────────┴─────────┘ lock step: all workers start again
///   each of them ── stop ──▶ kStopping ──▶ kEvaluating ──▶ kEnded
///                                └──────────────────────────▲
enum class RunPhase { kStarting, kRunning, kPaused, kStopping, kEvaluating, kEnded };

enum class RunEvent {
  kAllJoined,    ///< every worker
  kPause,        ///< the user's request
  kResume,       ///< the user's request
  kStartAgain,   ///< all workers, in lock step
  kStop,         ///< whatever the reason
  kWorkersLeft,  ///< evaluations are still played
  kAllLeft,      ///< nothing is left to wait for
};

/// "starting", "running", "paused", "stopping": as status and monitors have it; kEvaluating and kEnded are "stopping" too.
const char* word_of(RunPhase phase);
const char* word_of(RunEvent event);

/// The table of the picture above. Errors: kBadInput where `event` may not come in `phase`; in words for the user:
/// "the run is paused already".
Expected<RunPhase> next_phase(RunPhase phase, RunEvent event);

/// No worker is started any more, and nothing is asked of them but to leave.
constexpr bool is_over(RunPhase phase) { return phase >= RunPhase::kStopping; }

/// Why a run stopped. A graver one that comes later takes the place of an earlier one (later_reason()).
enum class StopReason {
  kNone,         ///< it has not
  kFinished,     ///< it has done what it was started for
  kInterrupted,  ///< a signal, `comrad ctl stop`, the end of its input, a learner that was stopped
  kNotSaved,     ///< its learner left no last checkpoint
  kKilled,       ///< by a second SIGINT
  kFailed,       ///< it could not continue
};

/// "finished", "interrupted", "not saved", "killed", "failed"; "continues" for kNone.
const char* word_of(StopReason reason);

/// The reason that stays when `next` comes to a run that stopped for `now`: what is finished is not interrupted any more.
constexpr StopReason later_reason(StopReason now, StopReason next) {
  const bool stays = now != StopReason::kNone && (next <= now || next == StopReason::kInterrupted);
  return stays ? now : next;
}

// Of a stop, so that it is over within 10 s: workers and hosts that still run get SIGTERM, then SIGKILL. One that saves
// something gets SIGKILL so long after it was last seen at work.
constexpr double kTermAfterS = 8.0;
constexpr double kKillAfterS = 9.5;

/// A SIGINT so soon after the last one is the same Ctrl-C: wrappers pass on what the terminal has sent to the whole group.
constexpr double kSameInterruptS = 0.25;

constexpr int kExitInterruptedTwice = 130;  ///< as a shell reports SIGINT

/// The exit code of a run that stopped for `reason`, and the state that status.json keeps.
constexpr int exit_code_of(StopReason reason) {
  return reason == StopReason::kKilled                                      ? kExitInterruptedTwice
         : reason == StopReason::kNotSaved || reason == StopReason::kFailed ? kExitFailed
                                                                            : kExitDone;
}
constexpr const char* final_state_of(StopReason reason) {
  return reason == StopReason::kFinished ? "finished" : reason == StopReason::kFailed ? "failed" : "paused";
}

}  // namespace comrad::deploy
