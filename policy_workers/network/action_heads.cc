#include "policy_workers/network/action_heads.h"

#include <algorithm>
#include <cmath>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

constexpr double kForbiddenLogit = -1e9;

/// One head of one agent: its values and which of its choices are allowed.
struct Head {
  std::span<const float> value;
  std::span<const uint8_t> mask;  ///< empty: everything is allowed

  bool allows(std::size_t choice) const { return mask.empty() || mask[choice] != 0; }
  std::size_t allowed_count() const {
    return mask.empty() ? value.size()
                        : value.size() - static_cast<std::size_t>(std::count(mask.begin(), mask.end(), 0));
  }
  /// The first of the largest allowed values.
  std::size_t best() const {
    std::size_t best = value.size();
    for (std::size_t choice = 0; choice < value.size(); ++choice)
      if (allows(choice) && (best == value.size() || value[choice] > value[best])) best = choice;
    return best;
  }
  /// The allowed choice with `rank` allowed ones before it.
  std::size_t allowed_at(std::size_t rank) const {
    std::size_t choice = 0;
    while (!allows(choice) || rank-- > 0) ++choice;
    return choice;
  }
};

/// A mask that forbids every choice is no mask.
Head head_at(std::span<const float> values, std::span<const uint8_t> mask, int64_t first, int64_t size) {
  const auto begin = static_cast<std::size_t>(first), count = static_cast<std::size_t>(size);
  Head head{values.subspan(begin, count), {}};
  if (mask.empty()) return head;
  const std::span<const uint8_t> of_head = mask.subspan(begin, count);
  if (std::any_of(of_head.begin(), of_head.end(), [](uint8_t byte) { return byte != 0; }))
    head.mask = of_head;
  return head;
}

}  // namespace

Tensor allowed_choices(const Tensor& mask, int64_t first, int64_t size) {
  const Tensor allowed = mask.slice(-1, first, first + size).ne(0);
  return allowed.logical_or(allowed.any(-1, /*keepdim=*/true).logical_not());
}

// Choices are counted from each head's own 0, and heads are cut out one by one: offsets in their own tensor would have
// to be copied to a GPU, which waits.
Tensor chosen_entries(const Tensor& row, const Tensor& action, const EnvShape& env) {
  COMRAD_CHECK(row.size(-1) == env.logit_count(), "a row ends in one entry per choice");
  COMRAD_CHECK(action.size(-1) == env.head_count, "an action has one entry per head");
  std::vector<Tensor> heads;
  for_each_head(env, [&](int32_t head, int64_t first, int64_t size) {
    heads.push_back(row.slice(-1, first, first + size).gather(-1, action.slice(-1, head, head + 1)));
  });
  return heads.size() == 1 ? heads.front() : at::cat(heads, -1);
}

Tensor multi_hot(const Tensor& action, const EnvShape& env) {
  COMRAD_CHECK(action.size(-1) == env.head_count, "an action has one entry per head");
  std::vector<int64_t> sizes = action.sizes().vec();
  sizes.back() = env.logit_count();
  const Tensor hot = torch::zeros(sizes, action.options().dtype(torch::kFloat32));
  for_each_head(env, [&](int32_t head, int64_t first, int64_t size) {
    hot.slice(-1, first, first + size).scatter_(-1, action.slice(-1, head, head + 1), 1.0);
  });
  return hot;
}

Tensor head_log_probs(const Tensor& logits, const Tensor& mask, const EnvShape& env) {
  COMRAD_CHECK(logits.size(-1) == env.logit_count(), "logits end in one entry per choice");
  std::vector<Tensor> heads;
  for_each_head(env, [&](int32_t, int64_t first, int64_t size) {
    Tensor head_logits = logits.slice(-1, first, first + size);
    if (mask.defined()) {
      const Tensor allowed = allowed_choices(mask, first, size).to(logits.scalar_type());
      head_logits = head_logits + (1 - allowed) * kForbiddenLogit;
    }
    heads.push_back(at::log_softmax(head_logits, -1));
  });
  return heads.size() == 1 ? heads.front() : at::cat(heads, -1);
}

Tensor action_log_prob(const Tensor& log_probs, const Tensor& action, const EnvShape& env) {
  return chosen_entries(log_probs, action, env).sum(-1);
}

Tensor entropy(const Tensor& log_probs, const EnvShape& env) {
  COMRAD_CHECK(log_probs.size(-1) == env.logit_count(), "log_probs end in one entry per choice");
  // A masked choice has p = 0 exactly and a finite log p, so its term is 0.
  return -(log_probs.exp() * log_probs).sum(-1);
}

Tensor head_entropies(const Tensor& log_probs, const EnvShape& env) {
  COMRAD_CHECK(log_probs.size(-1) == env.logit_count(), "log_probs end in one entry per choice");
  const Tensor terms = log_probs.exp() * log_probs;
  std::vector<Tensor> heads;
  for_each_head(env, [&](int32_t, int64_t first, int64_t size) {
    heads.push_back(-terms.slice(-1, first, first + size).sum(-1));
  });
  return torch::stack(heads, -1);
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
      const Tensor allowed = allowed_choices(mask, first, size).to(log_probs.scalar_type());
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
  for_each_head(env, [&](int32_t index, int64_t first, int64_t size) {
    const Head head = head_at(logits, mask, first, size);
    std::size_t chosen = head.best();
    const double largest = head.value[chosen];
    double sum = 0.0;
    for (std::size_t choice = 0; choice < head.value.size(); ++choice)
      if (head.allows(choice)) sum += std::exp(head.value[choice] - largest);
    if (!greedy) {
      // Walks the distribution function; rounding can leave u at its very end, where the last allowed
      // choice is.
      const double threshold = double{key.split(static_cast<uint64_t>(index)).uniform()} * sum;
      double reached = 0.0;
      for (std::size_t choice = 0; choice < head.value.size(); ++choice) {
        if (!head.allows(choice)) continue;
        chosen = choice;
        reached += std::exp(head.value[choice] - largest);
        if (threshold < reached) break;
      }
    }
    action[static_cast<std::size_t>(index)] = static_cast<int32_t>(chosen);
    log_prob += head.value[chosen] - largest - std::log(sum);
  });
  return static_cast<float>(log_prob);
}

float explore_action(std::span<const float> q_values, std::span<const uint8_t> mask, const EnvShape& env,
                     RngKey key, float epsilon, Exploration exploration, std::span<int32_t> action) {
  const bool per_head = exploration == Exploration::kPerHead;
  const bool all_explore = !per_head && key.split("explore").uniform() < epsilon;
  const double greedy_probability = 1.0 - double{epsilon};
  double per_head_log_prob = 0.0, random_probability = 1.0;
  bool is_greedy = true;
  for_each_head(env, [&](int32_t index, int64_t first, int64_t size) {
    const Head head = head_at(q_values, mask, first, size);
    const RngKey head_key = key.split(static_cast<uint64_t>(index));
    const std::size_t best = head.best(), allowed = head.allowed_count();
    const bool explores = per_head ? head_key.split("explore").uniform() < epsilon : all_explore;
    std::size_t chosen = best;
    if (explores) {
      const double u = head_key.uniform();
      chosen =
          head.allowed_at(std::min(allowed - 1, static_cast<std::size_t>(u * static_cast<double>(allowed))));
    }
    action[static_cast<std::size_t>(index)] = static_cast<int32_t>(chosen);
    is_greedy &= chosen == best;
    random_probability /= static_cast<double>(allowed);
    per_head_log_prob += std::log(double{epsilon} / static_cast<double>(allowed) +
                                  (chosen == best ? greedy_probability : 0.0));
  });
  if (per_head) return static_cast<float>(per_head_log_prob);
  return static_cast<float>(
      std::log(double{epsilon} * random_probability + (is_greedy ? greedy_probability : 0.0)));
}

}  // namespace comrad::policy
