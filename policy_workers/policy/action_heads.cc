#include "policy_workers/policy/action_heads.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

constexpr double kForbiddenLogit = -1e9;

/// Calls `visit(head, first, size)` for every head's range of logits.
template <typename Visitor>
void for_each_head(const EnvShape& env, Visitor&& visit) {
  int64_t first = 0;
  for (int32_t head = 0; head < env.head_count; ++head) {
    visit(head, first, int64_t{env.head_sizes[head]});
    first += env.head_sizes[head];
  }
}

/// 1.0 where a choice of the head is allowed. A head without any allowed choice counts as unmasked, so that a
/// dead agent's all-zero mask gives finite numbers everywhere.
Tensor allowed_choices(const Tensor& mask, int64_t first, int64_t size, torch::ScalarType dtype) {
  const Tensor allowed = mask.slice(-1, first, first + size).ne(0);
  return allowed.logical_or(allowed.any(-1, /*keepdim=*/true).logical_not()).to(dtype);
}

}  // namespace

Tensor head_log_probs(const Tensor& logits, const Tensor& mask, const EnvShape& env) {
  COMRAD_CHECK(logits.size(-1) == env.logit_count(), "logits end in one entry per choice");
  std::vector<Tensor> heads;
  for_each_head(env, [&](int32_t, int64_t first, int64_t size) {
    Tensor head_logits = logits.slice(-1, first, first + size);
    if (mask.defined()) {
      const Tensor allowed = allowed_choices(mask, first, size, logits.scalar_type());
      head_logits = head_logits + (1 - allowed) * kForbiddenLogit;
    }
    heads.push_back(at::log_softmax(head_logits, -1));
  });
  return heads.size() == 1 ? heads.front() : at::cat(heads, -1);
}

Tensor action_log_prob(const Tensor& log_probs, const Tensor& action, const EnvShape& env) {
  COMRAD_CHECK(action.size(-1) == env.head_count, "an action has one entry per head");
  // Choices are counted from each head's own 0; the offsets turn them into columns of log_probs.
  std::vector<int64_t> offsets;
  for_each_head(env, [&](int32_t, int64_t first, int64_t) { offsets.push_back(first); });
  const Tensor columns = action + torch::tensor(offsets, torch::kInt64).to(action.device());
  return log_probs.gather(-1, columns).sum(-1);
}

Tensor entropy(const Tensor& log_probs, const EnvShape& env) {
  COMRAD_CHECK(log_probs.size(-1) == env.logit_count(), "log_probs end in one entry per choice");
  // A masked choice has p = 0 exactly and a finite log p, so its term is 0.
  return -(log_probs.exp() * log_probs).sum(-1);
}

Tensor kl_divergence(const Tensor& log_probs_p, const Tensor& log_probs_q, const EnvShape& env) {
  COMRAD_CHECK(log_probs_p.size(-1) == env.logit_count(), "log_probs end in one entry per choice");
  return (log_probs_p.exp() * (log_probs_p - log_probs_q)).sum(-1);
}

Tensor symmetric_kl_to_uniform(const Tensor& log_probs, const Tensor& mask, const EnvShape& env) {
  COMRAD_CHECK(log_probs.size(-1) == env.logit_count(), "log_probs end in one entry per choice");
  Tensor total;
  for_each_head(env, [&](int32_t, int64_t first, int64_t size) {
    const Tensor log_p = log_probs.slice(-1, first, first + size);
    Tensor uniform, log_uniform;  // [..., size] over the allowed choices, 0 elsewhere; [..., 1]
    if (mask.defined()) {
      const Tensor allowed = allowed_choices(mask, first, size, log_probs.scalar_type());
      const Tensor count = allowed.sum(-1, /*keepdim=*/true);
      uniform = allowed / count;
      log_uniform = -count.log();
    } else {
      uniform = torch::full({size}, 1.0 / static_cast<double>(size), log_probs.options());
      log_uniform = torch::full({1}, -std::log(static_cast<double>(size)), log_probs.options());
    }
    // KL(p||u) + KL(u||p) = sum (p - u) (log p - log u), masked choices having p = u = 0.
    const Tensor head = 0.5 * ((log_p.exp() - uniform) * (log_p - log_uniform)).sum(-1);
    total = total.defined() ? total + head : head;
  });
  return total;
}

float sample_action(std::span<const float> logits, std::span<const uint8_t> mask, const EnvShape& env,
                    RngKey key, bool greedy, std::span<int32_t> action) {
  COMRAD_DCHECK(static_cast<int32_t>(logits.size()) == env.logit_count(), "one logit per choice");
  COMRAD_DCHECK(mask.empty() || mask.size() == logits.size(), "one mask byte per choice");
  double log_prob = 0.0;
  for_each_head(env, [&](int32_t head, int64_t first, int64_t size) {
    const float* logit = logits.data() + first;
    const uint8_t* allowed = mask.empty() ? nullptr : mask.data() + first;
    if (allowed != nullptr && std::all_of(allowed, allowed + size, [](uint8_t byte) { return byte == 0; }))
      allowed = nullptr;
    int64_t best = -1;
    for (int64_t choice = 0; choice < size; ++choice) {
      if (allowed != nullptr && allowed[choice] == 0) continue;
      if (best < 0 || logit[choice] > logit[best]) best = choice;
    }
    const double largest = logit[best];
    double sum = 0.0;
    for (int64_t choice = 0; choice < size; ++choice)
      if (allowed == nullptr || allowed[choice] != 0) sum += std::exp(logit[choice] - largest);
    int64_t chosen = best;
    if (!greedy) {
      // Walks the distribution function; rounding can leave u at its very end, where the last allowed choice
      // is.
      const double threshold = double{key.split(static_cast<uint64_t>(head)).uniform()} * sum;
      double reached = 0.0;
      for (int64_t choice = 0; choice < size; ++choice) {
        if (allowed != nullptr && allowed[choice] == 0) continue;
        chosen = choice;
        reached += std::exp(logit[choice] - largest);
        if (threshold < reached) break;
      }
    }
    action[static_cast<size_t>(head)] = static_cast<int32_t>(chosen);
    log_prob += logit[chosen] - largest - std::log(sum);
  });
  return static_cast<float>(log_prob);
}

float explore_action(std::span<const float> q_values, std::span<const uint8_t> mask, const EnvShape& env,
                     RngKey key, float epsilon, std::span<int32_t> action) {
  std::array<int32_t, kMaxHeads> greedy{};
  sample_action(q_values, mask, env, key, /*greedy=*/true, greedy);
  const bool explores = key.split("explore").uniform() < epsilon;
  double random_probability = 1.0;
  bool is_greedy = true;
  for_each_head(env, [&](int32_t head, int64_t first, int64_t size) {
    const auto is_allowed = [&](int64_t choice) {
      return mask.empty() || mask[static_cast<size_t>(first + choice)] != 0;
    };
    int64_t allowed = 0;
    for (int64_t choice = 0; choice < size; ++choice) allowed += is_allowed(choice);
    const bool everything = allowed == 0;  // a mask that forbids all is no mask
    if (everything) allowed = size;
    int32_t chosen = greedy[static_cast<size_t>(head)];
    if (explores) {
      int64_t rank = std::min(allowed - 1,
                              static_cast<int64_t>(double{key.split(static_cast<uint64_t>(head)).uniform()} *
                                                   static_cast<double>(allowed)));
      for (int64_t choice = 0; choice < size; ++choice) {
        if (!everything && !is_allowed(choice)) continue;
        if (rank-- > 0) continue;
        chosen = static_cast<int32_t>(choice);
        break;
      }
    }
    action[static_cast<size_t>(head)] = chosen;
    is_greedy &= chosen == greedy[static_cast<size_t>(head)];
    random_probability /= static_cast<double>(allowed);
  });
  return static_cast<float>(
      std::log(double{epsilon} * random_probability + (is_greedy ? 1.0 - double{epsilon} : 0.0)));
}

}  // namespace comrad::policy
