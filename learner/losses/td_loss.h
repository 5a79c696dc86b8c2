// The loss of Q-values against targets, and what reports show of it.
//
//   loss = mean over samples of w huber(Q - y / sigma)  (use_huber_loss off: the squared error)  + mean of the regularizer
//
// A sample is an agent's decision (idqn) or a world's (mixers). Q is in the network's unit, of which sigma make a natural one
// (losses/q_scale.h); targets, errors and reports are in natural units. Source: Mnih et al. 2015, Human-level control through
// deep reinforcement learning; weights w: Schaul et al. 2016, arXiv:1511.05952, section 3.4. Stage: update.
#pragma once

#include <torch/types.h>

#include <span>

#include "learner/batch/replay_batch.h"
#include "learner/losses/loss_terms.h"

namespace comrad::learn {

/// An algorithm's values of every sample; S = R (each agent's decision) or W (each world's).
struct SampleLoss {
  Tensor loss;               ///< f32 [T, S]  with gradient
  Tensor regularizer;        ///< f32 [T, S]  with gradient; may be undefined
  Tensor error;              ///< f32 [T, S]  |TD error|, detached; this and the next two in natural units
  Tensor predicted;          ///< f32 [T, S]  detached
  Tensor target;             ///< f32 [T, S]
  Tensor unclamped;          ///< f32 [T, S]  the target before q_value_clamp; may be undefined
  Tensor head_entropy = {};  ///< f32 [T, S]; may be undefined, as the next two
  Tensor mixer_gain = {};    ///< f32 [T, S]  MixerOutput::gain, in the networks' units
  Tensor state_rms = {};     ///< f32 [T, S]  root mean square of the mixer's state, where it reads one
};

struct TdLossOptions {
  bool is_joint = false;      ///< samples are worlds: the names of reports
  double sequence_share = 0;  ///< eta of a sequence's priority eta max + (1 - eta) mean; 0: the mean
};

/// Of a micro-batch of `batch`. `valid` u8 [T, S]: samples that count; `q` f32 [T, R, A] of the online network, and what
/// its utilities are multiplied by in reports, f64 []. `scalars`: samples of the whole batch, sigma, worlds; f64 [] each.
/// LossTerms::kept becomes |TD error| f32 [W] in units of sigma: the mean of a world's valid samples or, with a
/// sequence_share, eta max + (1 - eta) mean (Kapturowski et al. 2019, R2D2, section 2.3).
LossTerms td_loss(const SampleLoss& sample, const Tensor& valid, const Tensor& q, const Tensor& q_unit,
                  const ReplayBatch& batch, std::span<const Tensor> scalars, const TdLossOptions& options);

}  // namespace comrad::learn
