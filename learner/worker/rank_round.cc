#include "learner/worker/rank_round.h"

#include <cstddef>
#include <vector>

#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/checksum.h"

namespace comrad::learn {
namespace {

Status status_of(const RankGroup& ranks) { return ranks.failure() ? Status(*ranks.failure()) : Status(); }

/// Whether all ranks have the same number.
bool is_same(RankGroup& ranks, int64_t number) {
  const torch::Tensor all = ranks.gather(torch::full({1}, number, torch::kInt64), 0);
  return (all == number).all().item<bool>();
}

constexpr char kOwn = 'o', kOfAnother = 'a';

}  // namespace

void tell_checkpoint(RankGroup& ranks, const BeginsFrom& begins) {
  (void)ranks.from_leader((begins.is_own ? kOwn : kOfAnother) + begins.path);
}

BeginsFrom hear_checkpoint(RankGroup& ranks) {
  const std::string text = ranks.from_leader("");
  return text.empty() ? BeginsFrom{} : BeginsFrom{.path = text.substr(1), .is_own = text[0] == kOwn};
}

Status expect_same_weights(RankGroup& ranks, const Algorithm& algorithm) {
  if (ranks.is_alone()) return {};
  std::vector<std::byte> weights(static_cast<std::size_t>(algorithm.weights_bytes()));
  algorithm.write_weights(weights);
  const bool are_same = is_same(ranks, static_cast<int64_t>(checksum64(weights)));
  COMRAD_TRY(status_of(ranks));
  if (are_same) return {};
  return Error{ErrorCode::kBadInput,
               "learners begin with different weights; is the checkpoint being replaced? Start again"};
}

Expected<int64_t> begin_round(RankGroup& ranks, int64_t transitions, PolicyVersion version) {
  if (ranks.is_alone()) return transitions;
  const bool are_same = is_same(ranks, version);
  const std::vector<double> sum = ranks.add_up(std::vector<double>{static_cast<double>(transitions)});
  COMRAD_TRY(status_of(ranks));
  if (!are_same) return Error{ErrorCode::kSystem, "learners are at different versions"};
  return static_cast<int64_t>(sum.front());
}

}  // namespace comrad::learn
