// Plays the files of `comrad eval --episodes_dir` again, one after the other. Stage: beside step, for eyes.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/env/environment.h"

namespace comrad::sim {

/// One recorded episode (sim_workers/worker/episode_recorder.h, deploy/evaluation/recorded_episodes.h).
struct RecordedEpisode {
  std::string file, scenario, heads, wad;
  int num_agents = 0, frame_skip = 0;
  uint64_t seed = 0;
  uint32_t decisions = 0;
  std::vector<int32_t> choices;  ///< [decisions, N, heads]
};

/// Errors: kNotFound; kBadFormat naming the file and what is wrong with it.
Expected<RecordedEpisode> read_recorded_episode(const std::string& path);
/// Those of a folder, sorted by name. Errors: kNotFound where it has none, those of read_recorded_episode(), kBadInput where
/// they are not of one game and team.
Expected<std::vector<RecordedEpisode>> read_recorded_episodes(const std::string& folder);

/// What environments are made of that play them, one map each.
EnvironmentOptions options_of(const std::vector<RecordedEpisode>& episodes);

}  // namespace comrad::sim
