// Where the agents of an evaluation were: one line of JSON for each map and each finished episode, for occupancy maps.
// Stage: beside step, for eyes.
#pragma once

#include <cstdint>
#include <cstdio>
#include <memory>
#include <set>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/env/doom_env.h"

namespace comrad::sim {

/// Writes, in map units rounded to whole ones:
///
///   {"layout": "<hash of the WAD>", "lines": [[x1, y1, x2, y2, blocks], ...]}   when a map is first played; blocks: 0 or 1
///   {"layout": "<hash>", "decisions": 512, "positions": [[x, y, x, y, ...], ...]}   an episode: per agent [2 * (decisions + 1)]
///
/// An episode's first position is where it starts, the others stand after each decision. Dead agents stay where they fell.
/// Threads: the simulator's.
class PositionLog {
 public:
  /// Begins the file anew. Errors: kSystem.
  static Expected<std::unique_ptr<PositionLog>> create(const std::string& path);

  /// Every environment of the set is shown to this log from now on; both outlive the play.
  void watch(DoomEnvironmentSet& environments);
  /// The file is whole. Errors: kSystem, kNoSpace: the first that came meanwhile.
  Status finish();

 private:
  /// One environment's episode so far.
  class Trace final : public TicWatcher {
   public:
    explicit Trace(PositionLog& log) : log_(log) {}
    void began(const DoomEnvironment& environment) override;
    void ticked(const DoomEnvironment& environment) override;

   private:
    void note(const DoomEnvironment& environment);
    PositionLog& log_;
    int tics_ = 0;                                 ///< of the decision under way
    std::vector<std::vector<int32_t>> positions_;  ///< [N][2 * rows]
  };
  PositionLog(std::FILE* file, std::string path) : file_(file, &std::fclose), path_(std::move(path)) {}
  void write_map(const DoomGame& game);
  void write_line(const std::string& line);

  std::unique_ptr<std::FILE, int (*)(std::FILE*)> file_;
  std::string path_;
  std::set<uint64_t> maps_;
  std::vector<std::unique_ptr<Trace>> traces_;
  Status status_;
};

}  // namespace comrad::sim
