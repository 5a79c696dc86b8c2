#include "rollout_buffer/link/episodes.h"

#include <algorithm>
#include <cmath>

namespace comrad::link {

dds::FeederEpisode wire_of(const shm::EpisodeRecord& record, uint64_t feeder_id, int num_agents) {
  return {.feeder_id = feeder_id,
          .env_index = record.env_index,
          .episode_id = record.episode_id,
          .episode_seed = record.episode_seed,
          .layout_id = record.layout_id,
          .length_steps = record.length_steps,
          .length_tics = record.length_tics,
          .terminated = record.terminated != 0,
          .score = record.score,
          .ceiling = record.ceiling,
          .agent_return = {record.agent_return, record.agent_return + num_agents},
          .agent_score = {record.agent_score, record.agent_score + num_agents}};
}

std::optional<shm::EpisodeRecord> record_of(const dds::FeederEpisode& episode, int env, int num_agents) {
  const auto agents = static_cast<std::size_t>(num_agents);
  const auto is_finite = [](float number) { return std::isfinite(number); };
  if (env < 0 || episode.agent_return.size() != agents || episode.agent_score.size() != agents ||
      !is_finite(episode.score) || !is_finite(episode.ceiling) ||
      !std::ranges::all_of(episode.agent_return, is_finite) ||
      !std::ranges::all_of(episode.agent_score, is_finite))
    return std::nullopt;
  shm::EpisodeRecord record{};
  record.episode_id = episode.episode_id;
  record.episode_seed = episode.episode_seed;
  record.layout_id = episode.layout_id;
  record.env_index = static_cast<uint32_t>(env);
  record.length_steps = episode.length_steps;
  record.length_tics = episode.length_tics;
  record.terminated = episode.terminated;
  record.score = episode.score;
  record.ceiling = episode.ceiling;
  std::ranges::copy(episode.agent_return, record.agent_return);
  std::ranges::copy(episode.agent_score, record.agent_score);
  return record;
}

}  // namespace comrad::link
