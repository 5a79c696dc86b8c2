// Records as they travel between hosts: the one place where they become the IDL's types and back.
#pragma once

#include <comrad.h>

#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/train_stats.h"

namespace comrad::dds {

/// Its lists point into `record`, which outlives it.
comrad_wire_EpisodeRecord wire_of(const EpisodeRecord& record);
/// Of lists that are unequally long no agent is taken.
EpisodeRecord record_of(const comrad_wire_EpisodeRecord& wire);

comrad_wire_TrainStats wire_of(const TrainStats& stats);
TrainStats stats_of(const comrad_wire_TrainStats& wire);

}  // namespace comrad::dds
