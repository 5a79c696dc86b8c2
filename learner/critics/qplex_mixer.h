// QPLEX, duplex duelling: the team value is a monotone part, which carries the agents' gradient, and an
// advantage part with weights that may depend on the joint action. The second never raises a joint action
// above the greedy one, so any payoff can be represented while the agents' own argmaxes stay the joint one.
//
//   Q'_i = w_i(s) q_i + b_i(s)   m'_i = w_i(s) m_i + b_i(s)   w_i > 0      q_i = Q_i(a_i), m_i = max_a Q_i(a)
//   V_tot = sum_i Q'_i
//   A_tot = sum_i stopgrad(Q'_i - m'_i) (lambda_i(s, a) - 1)                lambda_i >= 0
//   Q_tot = V_tot + A_tot = sum_i m'_i + sum_i lambda_i (Q'_i - m'_i)
//
// The last line is what it is numerically: greedy value plus weighted advantages. Gradients take the first
// form: q_i, w and b learn through V_tot alone, lambda through A_tot alone. (`is_minus_one` off weighs A_tot
// by lambda_i, which makes Q_tot = V_tot + sum_i lambda_i (Q'_i - m'_i).)
//
// The two kinds differ in the transformation:
//
//   dmaq         w_i = 1, b_i = 0; with `weighted_head`
//                w_i = |MLP_{S,64,N}(s)_i| + 1e-10, b_i = MLP_{S,64,N}(s)_i
//   dmaq_qatten  w_i = sum_h v_h softmax_i(<selector_h(s), key_h(u_i)> / sqrt(embed)) + 1e-10, v_h = 1; with
//                `weighted_head` v_h = |MLP_{S,64,heads}(s)_h| + 1e-10; with `state_bias` b_i = c(s) / N
//
// `nonlinear` shows the key of agent i its utility as well. Here that is m_i: with the chosen q_i the weights
// would depend on the action, and the joint argmax would no longer be the agents' own.
//
// Source: Wang et al. 2021, arXiv:2008.01062, eqs. 6-12; attention: Yang et al. 2020, Qatten,
// arXiv:2002.03939, section 4.
#pragma once

#include "learner/critics/hypernet.h"
#include "learner/critics/mixer.h"

namespace comrad::learn {

/// w_i > 0 and b_i of every row; what attention adds is undefined in dmaq.
struct QplexTransform {
  Tensor weight = {};        ///< [B, N]
  Tensor bias = {};          ///< [B, N]
  Tensor regularizer = {};   ///< [B]
  Tensor head_entropy = {};  ///< [B]
};

/// V_tot, A_tot and Q_tot (each [B]) from chosen and greedy utilities, the transformation and lambda, all
/// [B, N].
MixerOutput qplex_value(const Tensor& chosen, const Tensor& greedy, const QplexTransform& transform,
                        const Tensor& lambda, bool is_minus_one);

/// lambda_i = sum_k (|key_k| + 1e-10) sigmoid(agents_ki) sigmoid(action_ki).
///   key [B, K], agents [B, K, N], action [B, K, N]; returns [B, N], all >= 0
Tensor si_weights(const Tensor& key, const Tensor& agents, const Tensor& action);

/// Attention of H heads over N agents.
///   selector    [B, H, E]
///   key         [B, N, H, E]
///   head_scale  [B, H] or undefined (1)
/// Returns w_i = sum_h scale_h softmax_i(logit_hi / sqrt(E)) + 1e-10, the regulariser coefficient * sum_h
/// mean_i(logit_hi^2) of the unscaled logits, and the heads' mean entropy; no bias.
QplexTransform qatten_weights(const Tensor& selector, const Tensor& key, const Tensor& head_scale,
                              double coefficient);

class QplexMixer : public Mixer {
 public:
  QplexMixer(const MixerOptions& options, at::Generator generator, torch::Device device);

  MixerOutput mix(const MixerInput& input) const override;
  NamedTensors named_parameters() const override;
  /// Weights and lambda multiply utilities and stay; biases by state are values themselves, and with
  /// `nonlinear` a key must see the utility that it saw.
  void rescale(double factor) override;
  bool scales_with_utilities() const override { return true; }

  /// w and b of state [B, S]; greedy [B, N] is read with `nonlinear` only.
  QplexTransform transform(const Tensor& state, const Tensor& greedy) const;
  /// lambda [B, N] of state [B, S] and multi-hot actions [B, N*A].
  Tensor lambda(const Tensor& state, const Tensor& action) const;

 private:
  MixerOptions options_;
  bool attends_;
  Hypernet weight_, bias_;                            // dmaq
  Hypernet selector_, attention_key_, head_, value_;  // dmaq_qatten
  Hypernet key_, agents_, action_;                    // lambda
};

}  // namespace comrad::learn
