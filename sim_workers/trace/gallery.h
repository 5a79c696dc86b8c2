// Pictures of scenarios as their agents see them: one row of views per scenario, side by side, some way into
// an episode. For READMEs. Stage: render.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::trace {

struct GalleryOptions {
  std::string folder;                  ///< receives <scenario>.png
  std::vector<std::string> scenarios;  ///< empty: all
  int num_agents = 0;                  ///< 0: each scenario's default
  int64_t decisions = 100;             ///< played before the picture; fewer where the episode ends
  int width = 256, height = 144;       ///< of one view: twice an observation's
  uint64_t seed = 42;
};

/// Plays each scenario with its oracle (random actions where it has none) on its default map and writes
/// the row of views; of several scenarios also games.png, their last agents' views in rows of seven. Returns the files, in
/// order. Errors: as loading a game; kSystem for a file that
/// cannot be written.
Expected<std::vector<std::string>> draw_gallery(const GalleryOptions& options);

}  // namespace comrad::trace
