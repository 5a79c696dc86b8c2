// One finished episode: what the environment counted, and the identity that replays it. The simulator writes it, the
// learner, the curriculum and the supervisor read it as it is. Stage: beside append.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>

#include "rollout_buffer/schema/spec.h"

namespace comrad {

constexpr uint32_t kNoLayoutIndex = UINT32_MAX;

/// Trivially copyable; it lies in the arena (shm/episode_stream.h).
struct EpisodeRecord {
  uint64_t episode_id = 0;
  uint64_t episode_seed = 0;
  uint64_t layout_id = 0;     ///< hash of the map's content
  uint32_t layout_index = 0;  ///< in the run's pool; kNoLayoutIndex where another host has drawn the map
  uint32_t env_index = 0;
  uint32_t length_steps = 0;  ///< decisions
  uint32_t length_tics = 0;
  uint32_t terminated = 0;  ///< 1 terminated, 0 truncated
  uint32_t agent_count = 0;
  float score = 0;    ///< J, team level
  float ceiling = 0;  ///< the best J that the map allows so many agents; 0: not known
  std::array<float, kMaxAgents> agent_return{};  ///< sum of rewards before scale, clip and sharing
  std::array<float, kMaxAgents>
      agent_score{};  ///< J per agent, where the scenario scores agents separately; else J

  std::span<const float> returns() const { return of_agents(agent_return); }
  std::span<const float> scores() const { return of_agents(agent_score); }

 private:
  std::span<const float> of_agents(const std::array<float, kMaxAgents>& values) const {
    return std::span(values).first(std::min<std::size_t>(agent_count, kMaxAgents));
  }
};
static_assert(sizeof(EpisodeRecord) == 56 + 8 * kMaxAgents, "changing this bumps kArenaVersion");

}  // namespace comrad
