#include "rollout_buffer/dds/episode_wire.h"

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

}  // namespace comrad::dds
