// How old the decisions of all learners are. Stage: drain > update.
#pragma once

#include <cstdint>

#include "learner/batch/collate.h"
#include "learner/ranks/rank_group.h"

namespace comrad::learn {

/// Of the shares of all ranks, of which this one's has `places` decisions.
LagStats lag_of_ranks(const LagStats& mine, int64_t places, RankGroup& ranks);

}  // namespace comrad::learn
