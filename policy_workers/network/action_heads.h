// Factorised action heads side by side in one row, and products of categorical distributions over them, with
// action masks that count everywhere alike: in sampling, log-probabilities, entropy, divergences and argmax.
// Serves forward and update.
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/schema/spec.h"

namespace comrad::policy {

using torch::Tensor;

/// Calls `visit(head, first, size)` for every head's range of columns.
template <typename Visitor>
void for_each_head(const EnvShape& env, Visitor&& visit) {
  int64_t first = 0;
  for (int32_t head = 0; head < env.head_count; ++head) {
    const int64_t size = env.head_sizes[static_cast<std::size_t>(head)];
    visit(head, first, size);
    first += size;
  }
}

/// True where a choice of the head at columns [first, first + size) is allowed; mask [..., A] u8, returns
/// [..., size] bool. A head without any allowed choice counts as unmasked, so that a dead agent's all-zero
/// mask gives finite numbers everywhere.
Tensor allowed_choices(const Tensor& mask, int64_t first, int64_t size);

/// The entry of every head's choice: Q_h(a_h) or log pi_h(a_h).
///   row     [..., A]      f32  one entry per choice, heads side by side
///   action  [..., heads]  i64  choices counted from each head's own 0
///   returns [..., heads]  f32, differentiable in row
Tensor chosen_entries(const Tensor& row, const Tensor& action, const EnvShape& env);

/// One-hot vectors of all heads side by side: [..., heads] i64 -> [..., A] f32 on the action's device.
Tensor multi_hot(const Tensor& action, const EnvShape& env);

/// Log-probabilities of every choice of every head, masked choices at about -1e9.
///   logits  [..., A] f32   mask  [..., A] u8 or undefined (all allowed)   returns [..., A] f32
Tensor head_log_probs(const Tensor& logits, const Tensor& mask, const EnvShape& env);

/// log pi(a|o), summed over heads. action i64 [..., heads]; log_probs from head_log_probs. Returns [...].
Tensor action_log_prob(const Tensor& log_probs, const Tensor& action, const EnvShape& env);

/// Entropy of every head, in nats: [..., heads].
Tensor head_entropies(const Tensor& log_probs, const EnvShape& env);

/// Entropy, KL(p||q) and symmetric KL to the uniform distribution over allowed choices, summed over
/// heads. [...].
Tensor entropy(const Tensor& log_probs, const EnvShape& env);
Tensor kl_divergence(const Tensor& log_probs_p, const Tensor& log_probs_q, const EnvShape& env);
Tensor symmetric_kl_to_uniform(const Tensor& log_probs, const Tensor& mask, const EnvShape& env);

/// Draws one action for one agent on the CPU from `key` (one child per head); the same logits and key
/// give the same action in every batch. `greedy` takes each head's argmax. Writes `action` [heads],
/// returns log pi(a|o).
float sample_action(std::span<const float> logits, std::span<const uint8_t> mask, const EnvShape& env,
                    RngKey key, bool greedy, std::span<int32_t> action);

/// Whether chance decides for each head of an agent apart, or for all of them at once.
enum class Exploration { kPerHead, kAllHeads };

/// Chooses for one agent by its Q-values: with probability `epsilon` a head uniformly among its allowed
/// choices, else its argmax. kPerHead draws that for every head anew, so that mostly one head alone leaves
/// the greedy action; of H heads all keep to it with (1 - epsilon)^H, not counting chance hits. kAllHeads, the
/// reference's way, draws once, and all heads explore together: what one head's deviation is worth is hardly
/// ever seen. Arguments and result as sample_action, the log-probability being that of this mixture.
float explore_action(std::span<const float> q_values, std::span<const uint8_t> mask, const EnvShape& env,
                     RngKey key, float epsilon, Exploration exploration, std::span<int32_t> action);

}  // namespace comrad::policy
