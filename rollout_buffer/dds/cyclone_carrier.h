// One Cyclone DDS participant that carries the messages of link_bus.h: their topics, types and QoS.
#pragma once

#include <memory>

#include "rollout_buffer/dds/link_bus.h"

namespace comrad::dds {

/// Writers and readers are made on first use. Errors: those of LinkBus::open().
Expected<std::unique_ptr<LinkCarrier>> open_cyclone_carrier(const BusConfig& config, uint32_t version);

}  // namespace comrad::dds
