// An episode record as it travels, on the bus and between hosts: the one place where it becomes the IDL's type and back.
#pragma once

#include <comrad.h>

#include "rollout_buffer/schema/episode_record.h"

namespace comrad::dds {

/// Its lists point into `record`, which outlives it.
comrad_wire_EpisodeRecord wire_of(const EpisodeRecord& record);
/// Of lists that are unequally long no agent is taken.
EpisodeRecord record_of(const comrad_wire_EpisodeRecord& wire);

}  // namespace comrad::dds
