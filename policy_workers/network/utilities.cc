#include "policy_workers/network/utilities.h"

#include <limits>
#include <vector>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {

Tensor chosen_utility(const Tensor& q, const Tensor& action, const EnvShape& env) {
  return chosen_entries(q, action, env).sum(-1);
}

Tensor greedy_action(const Tensor& q, const Tensor& mask, const EnvShape& env) {
  COMRAD_CHECK(q.size(-1) == env.logit_count(), "q ends in one entry per choice");
  const Tensor values = q.detach();
  std::vector<Tensor> choice;
  for_each_head(env, [&](int32_t, int64_t first, int64_t size) {
    Tensor of_head = values.slice(-1, first, first + size);
    if (mask.defined())
      of_head = of_head.masked_fill(allowed_choices(mask, first, size).logical_not(),
                                    -std::numeric_limits<double>::infinity());
    choice.push_back(of_head.argmax(-1));
  });
  return at::stack(choice, -1);
}

Tensor greedy_utility(const Tensor& q, const Tensor& mask, const EnvShape& env) {
  return chosen_utility(q, greedy_action(q, mask, env), env);
}

}  // namespace comrad::policy
