#include "learner/critics/utilities.h"

#include <limits>
#include <vector>

#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {
namespace {

/// Choices are counted from each head's own 0; the offsets turn them into columns of q.
Tensor columns_of(const Tensor& action, const EnvShape& env) {
  COMRAD_CHECK(action.size(-1) == env.head_count, "an action has one entry per head");
  std::vector<int64_t> first;
  int64_t offset = 0;
  for (int32_t head = 0; head < env.head_count; ++head) {
    first.push_back(offset);
    offset += env.head_sizes[static_cast<size_t>(head)];
  }
  return action + torch::tensor(first, torch::kInt64).to(action.device());
}

}  // namespace

Tensor chosen_values(const Tensor& q, const Tensor& action, const EnvShape& env) {
  COMRAD_CHECK(q.size(-1) == env.logit_count(), "q ends in one entry per choice");
  return q.gather(-1, columns_of(action, env));
}

Tensor chosen_utility(const Tensor& q, const Tensor& action, const EnvShape& env) {
  return chosen_values(q, action, env).sum(-1);
}

Tensor greedy_action(const Tensor& q, const Tensor& mask, const EnvShape& env) {
  COMRAD_CHECK(q.size(-1) == env.logit_count(), "q ends in one entry per choice");
  const Tensor values = q.detach();
  std::vector<Tensor> choice;
  int64_t first = 0;
  for (int32_t head = 0; head < env.head_count; ++head) {
    const int64_t size = env.head_sizes[static_cast<size_t>(head)];
    Tensor of_head = values.slice(-1, first, first + size);
    if (mask.defined()) {
      const Tensor allowed = mask.slice(-1, first, first + size).ne(0);
      const Tensor counts = allowed.logical_or(allowed.any(-1, /*keepdim=*/true).logical_not());
      of_head = of_head.masked_fill(counts.logical_not(), -std::numeric_limits<double>::infinity());
    }
    choice.push_back(of_head.argmax(-1));
    first += size;
  }
  return at::stack(choice, -1);
}

Tensor greedy_utility(const Tensor& q, const Tensor& mask, const EnvShape& env) {
  return chosen_utility(q, greedy_action(q, mask, env), env);
}

Tensor multi_hot(const Tensor& action, const EnvShape& env) {
  std::vector<int64_t> sizes = action.sizes().vec();
  sizes.back() = env.logit_count();
  const Tensor hot = torch::zeros(sizes, action.options().dtype(torch::kFloat32));
  return hot.scatter_(-1, columns_of(action, env), 1.0);
}

}  // namespace comrad::learn
