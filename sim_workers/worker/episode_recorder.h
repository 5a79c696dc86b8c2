// The episodes of an evaluation as files that play again: what every agent chose, and how it ended.
// Stage: beside step, for eyes.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/env/doom_env.h"

namespace comrad::sim {

/// Writes `<folder>/<episode seed>.comrad` for each episode that ends: a line of JSON,
///
///   {"episode_seed": 7, "num_agents": 2, "frame_skip": 4, "head_sizes": [3, 2], "decisions": 512, "terminated": true,
///    "score": 3.0, "returns": [1.5, 1.5], "length_tics": 2047, "state_hash": "<16 hex digits, DoomEnvironment::state_hash()>"}
///
/// and behind it the choices u8 [decisions, N, heads]. Threads: the simulator's.
class EpisodeRecorder {
 public:
  /// `folder` must be there.
  explicit EpisodeRecorder(std::string folder) : folder_(std::move(folder)) {}

  /// Every environment of the set is shown to this recorder from now on; both outlive the play.
  void watch(DoomEnvironmentSet& environments);
  /// Errors: kSystem, kNoSpace: the first that came meanwhile; kUnsupported where an agent pressed what no choice presses.
  const Status& status() const { return status_; }

 private:
  /// One environment's episode so far.
  class Trace final : public TicWatcher {
   public:
    explicit Trace(EpisodeRecorder& recorder) : recorder_(recorder) {}
    void began(const DoomEnvironment& environment) override;
    void ticked(const DoomEnvironment& environment) override;

   private:
    void note(const DoomEnvironment& environment);
    EpisodeRecorder& recorder_;
    int tics_ = 0;         ///< of the decision under way
    std::string choices_;  ///< [decisions, N, heads], a byte each
  };
  void write(const DoomEnvironment& environment, const std::string& choices);

  std::string folder_;
  std::vector<std::unique_ptr<Trace>> traces_;
  Status status_;
};

}  // namespace comrad::sim
