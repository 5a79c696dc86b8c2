// Plays a trace from its first row to its last and writes it, with pictures at some tics. Stage: tic > frame
// > step.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/trace/trace_game.h"

namespace comrad::trace {

struct RunOptions {
  GameOptions game;
  std::string actions_path;  ///< CSV; empty: random or none
  int64_t random_tics = 0;   ///< where there is no CSV
  std::string start_path;    ///< a trace whose row 0 is the pose to start in; empty: the game's
  std::optional<uint64_t> seed;
  std::string out_path;     ///< empty: standard output
  std::string things_path;  ///< actors of each tic, as the reference traces' _things.csv; empty: none
  std::vector<std::string> variables;  ///< further columns, named as in a cfg
  bool with_hash = false;
  std::string frames_folder;  ///< empty: no pictures
  std::vector<int64_t> frame_tics;
  int frame_width = 160, frame_height = 120;
};

/// Plays until the actions or the episode end. Warnings go to standard error. Errors: those of
/// open_trace_game(), of the CSV files, and of writing.
Status run_trace(const RunOptions& options);

}  // namespace comrad::trace
