#include "deploy/launch/run_phase.h"

#include <cstddef>
#include <string>

namespace comrad::deploy {
namespace {

constexpr std::size_t kPhases = 6, kEvents = 7;
constexpr RunPhase kNo = static_cast<RunPhase>(-1);
constexpr RunPhase kBegins = RunPhase::kStarting, kRuns = RunPhase::kRunning, kPauses = RunPhase::kPaused,
                   kStops = RunPhase::kStopping, kPlays = RunPhase::kEvaluating, kEnds = RunPhase::kEnded;

// clang-format off
constexpr RunPhase kNext[kPhases][kEvents] = {
    //               all joined  pause    resume  start again  stop    workers left  all left
    /* starting   */ {kRuns,     kNo,     kNo,    kBegins,     kStops, kNo,          kNo},
    /* running    */ {kNo,       kPauses, kNo,    kBegins,     kStops, kNo,          kNo},
    /* paused     */ {kNo,       kNo,     kRuns,  kBegins,     kStops, kNo,          kNo},
    /* stopping   */ {kNo,       kNo,     kNo,    kNo,         kNo,    kPlays,       kEnds},
    /* evaluating */ {kNo,       kNo,     kNo,    kNo,         kNo,    kNo,          kEnds},
    /* ended      */ {kNo,       kNo,     kNo,    kNo,         kNo,    kNo,          kNo},
};
// clang-format on

constexpr const char* kPhaseWords[kPhases] = {"starting", "running",  "paused",
                                              "stopping", "stopping", "stopping"};
constexpr const char* kEventWords[kEvents] = {"all joined", "pause",        "resume",  "start again",
                                              "stop",       "workers left", "all left"};

}  // namespace

const char* word_of(StopReason reason) {
  constexpr const char* kWords[] = {"continues", "finished", "interrupted", "not saved", "killed", "failed"};
  return kWords[static_cast<std::size_t>(reason)];
}
const char* word_of(RunPhase phase) { return kPhaseWords[static_cast<std::size_t>(phase)]; }
const char* word_of(RunEvent event) { return kEventWords[static_cast<std::size_t>(event)]; }

Expected<RunPhase> next_phase(RunPhase phase, RunEvent event) {
  const RunPhase next = kNext[static_cast<std::size_t>(phase)][static_cast<std::size_t>(event)];
  if (next != kNo) return next;
  if (event == RunEvent::kPause && phase == RunPhase::kPaused)
    return Error{ErrorCode::kBadInput, "the run is paused already"};
  if (event == RunEvent::kResume && phase == RunPhase::kRunning)
    return Error{ErrorCode::kBadInput, "the run is not paused"};
  if (event == RunEvent::kPause || event == RunEvent::kResume)
    return Error{ErrorCode::kBadInput, std::string("the run is ") + word_of(phase)};
  return Error{ErrorCode::kBadInput,
               std::string("'") + word_of(event) + "' cannot come while a run is " + word_of(phase)};
}

}  // namespace comrad::deploy
