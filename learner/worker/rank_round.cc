#include "learner/worker/rank_round.h"

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/checksum.h"

namespace comrad::learn {
namespace {

constexpr char kOwn = 'o', kOfAnother = 'a';

}  // namespace

Status tell_checkpoint(RankGroup& ranks, const BeginsFrom& begins) {
  (void)ranks.from_leader((begins.is_own ? kOwn : kOfAnother) + begins.path);
  return ranks.status();
}

Expected<BeginsFrom> hear_checkpoint(RankGroup& ranks) {
  const std::string text = ranks.from_leader("");
  COMRAD_TRY(ranks.status());
  return BeginsFrom{.path = text.substr(1), .is_own = text[0] == kOwn};
}

Status expect_same_weights(RankGroup& ranks, const Algorithm& algorithm) {
  if (ranks.is_alone()) return {};
  const auto mine = static_cast<int64_t>(checksum64(algorithm.weights()));
  const torch::Tensor all = ranks.gather(torch::full({1}, mine, torch::kInt64), 0);
  COMRAD_TRY(ranks.status());
  if ((all == mine).all().item<bool>()) return {};
  return Error{ErrorCode::kBadInput,
               "learners begin with different weights; is the checkpoint being replaced? Start again"};
}

Expected<int64_t> begin_round(RankGroup& ranks, int64_t transitions, PolicyVersion version) {
  if (ranks.is_alone()) return transitions;
  const torch::Tensor all =
      ranks.gather(torch::tensor({transitions, int64_t{version}}, torch::kInt64).unsqueeze(0), 0);
  COMRAD_TRY(ranks.status());
  if (!(all.select(1, 1) == int64_t{version}).all().item<bool>())
    return Error{ErrorCode::kSystem, "learners are at different versions"};
  return all.select(1, 0).sum().item<int64_t>();
}

}  // namespace comrad::learn
