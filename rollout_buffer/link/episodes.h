// Episodes of a host that feeds another one's learner, as they travel and as the learner's arena keeps them.
#pragma once

#include <cstdint>
#include <optional>

#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/shm/episode_stream.h"

namespace comrad::link {

dds::FeederEpisode wire_of(const shm::EpisodeRecord& record, uint64_t feeder_id, int num_agents);
/// The record as of environment `env` of this arena; nothing for one that no simulator could have written.
std::optional<shm::EpisodeRecord> record_of(const dds::FeederEpisode& episode, int env, int num_agents);

}  // namespace comrad::link
