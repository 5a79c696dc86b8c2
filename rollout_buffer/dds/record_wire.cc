#include "rollout_buffer/dds/record_wire.h"

#include <algorithm>
#include <span>

#include "rollout_buffer/dds/participant.h"

namespace comrad::dds {

comrad_wire_EpisodeRecord wire_of(const EpisodeRecord& record) {
  comrad_wire_EpisodeRecord wire{};
  wire.episode_id = record.episode_id;
  wire.episode_seed = record.episode_seed;
  wire.layout_id = record.layout_id;
  wire.layout_index = record.layout_index;
  wire.env_index = record.env_index;
  wire.length_steps = record.length_steps;
  wire.length_tics = record.length_tics;
  wire.terminated = record.terminated != 0;
  wire.score = record.score;
  wire.ceiling = record.ceiling;
  wire.agent_return = sequence_of<dds_sequence_float>(record.returns());
  wire.agent_score = sequence_of<dds_sequence_float>(record.scores());
  return wire;
}

EpisodeRecord record_of(const comrad_wire_EpisodeRecord& wire) {
  EpisodeRecord record{.episode_id = wire.episode_id,
                       .episode_seed = wire.episode_seed,
                       .layout_id = wire.layout_id,
                       .layout_index = wire.layout_index,
                       .env_index = wire.env_index,
                       .length_steps = wire.length_steps,
                       .length_tics = wire.length_tics,
                       .terminated = wire.terminated,
                       .score = wire.score,
                       .ceiling = wire.ceiling};
  const uint32_t agents = wire.agent_return._length;
  if (agents != wire.agent_score._length || agents > kMaxAgents) return record;
  record.agent_count = agents;
  std::copy_n(wire.agent_return._buffer, agents, record.agent_return.data());
  std::copy_n(wire.agent_score._buffer, agents, record.agent_score.data());
  return record;
}

comrad_wire_TrainStats wire_of(const TrainStats& stats) {
  comrad_wire_TrainStats wire{};
  wire.time_s = stats.time_s;
  wire.env_frames = stats.env_frames;
  wire.decisions = stats.decisions;
  wire.env_frames_per_s = stats.env_frames_per_s;
  wire.decisions_per_s = stats.decisions_per_s;
  wire.score_mean = stats.score_mean;
  wire.return_mean = stats.return_mean;
  wire.episodes = stats.episodes;
  wire.policy_lag_mean = stats.policy_lag_mean;
  wire.replay_filled = stats.replay_filled;
  wire.learner_version = stats.learner_version;
  wire.policy_lag_max = stats.policy_lag_max;
  put(wire.last_checkpoint, stats.last_checkpoint);
  return wire;
}

TrainStats stats_of(const comrad_wire_TrainStats& wire) {
  TrainStats stats{.time_s = wire.time_s,
                   .env_frames = wire.env_frames,
                   .decisions = wire.decisions,
                   .env_frames_per_s = wire.env_frames_per_s,
                   .decisions_per_s = wire.decisions_per_s,
                   .score_mean = wire.score_mean,
                   .return_mean = wire.return_mean,
                   .episodes = wire.episodes,
                   .policy_lag_mean = wire.policy_lag_mean,
                   .replay_filled = wire.replay_filled,
                   .learner_version = wire.learner_version,
                   .policy_lag_max = wire.policy_lag_max};
  put(stats.last_checkpoint, get(wire.last_checkpoint));
  return stats;
}

}  // namespace comrad::dds
