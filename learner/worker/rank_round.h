// What the first learner of a run and the others say to each other besides what the algorithm exchanges: where to begin, and
// what each round is made of. Stage: drain > update.
#pragma once

#include <cstdint>
#include <string>

#include "learner/algorithms/algorithm.h"
#include "learner/ranks/rank_group.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::learn {

/// Where training begins.
struct BeginsFrom {
  std::string path;     ///< of a checkpoint; empty: fresh weights
  bool is_own = false;  ///< of this run, rather than another's
};
/// Both sides of the first learner's word. Errors: those of RankGroup::status().
Status tell_checkpoint(RankGroup& ranks, const BeginsFrom& begins);
Expected<BeginsFrom> hear_checkpoint(RankGroup& ranks);

/// Errors: kBadInput where learners begin with different weights, those of RankGroup::status().
Status expect_same_weights(RankGroup& ranks, const Algorithm& algorithm);

/// Every learner holds a batch: the decisions of all of them together. Errors: kSystem where learners are at different
/// versions; those of RankGroup::status().
Expected<int64_t> begin_round(RankGroup& ranks, int64_t transitions, PolicyVersion version);

}  // namespace comrad::learn
