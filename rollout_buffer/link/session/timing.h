// How long the ends of both links wait and how often they report. Stage: beside the flow.
#pragma once

#include <cstdint>

namespace comrad::link {

constexpr int kWaitMs = 5;  ///< longest wait for the network; a slab takes far longer to play
constexpr int64_t kPollUs =
    100;  ///< between looks at slots and at the network, while both may bring something
constexpr double kTellIntervalS = 0.5;  ///< between two states sent to the other hosts
constexpr double kTellOfEndS = 1.0;     ///< how long the end of a run is repeated
constexpr int kEpisodesAtOnce = 64;     ///< episodes sent in one turn

}  // namespace comrad::link
