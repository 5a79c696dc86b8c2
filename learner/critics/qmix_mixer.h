// QMIX: a two-layer network joins the utilities; its weights are made from the state and are positive, so the
// team value rises with every agent's utility and the agents' own argmaxes are the joint one.
//
//   W1(s) = |MLP_{S,64,N E}(s)| + 1e-8    b1(s) = Linear_{S,E}(s)
//   W2(s) = |MLP_{S,64,E}(s)| + 1e-8      b2(s) = MLP_{S,E,1}(s)
//   Q_tot = ELU(q^T W1 + b1) W2 + b2
//
// Source: Rashid et al. 2018, arXiv:1803.11485, section 4 and figure 2.
#pragma once

#include "learner/critics/hypernet.h"
#include "learner/critics/mixer.h"

namespace comrad::learn {

/// The mixing network of every row.
struct QmixWeights {
  Tensor w1;  ///< [B, N, E] > 0
  Tensor b1;  ///< [B, E]
  Tensor w2;  ///< [B, E] > 0
  Tensor b2;  ///< [B]
};

/// Q_tot [B] of utilities q [B, N] under given weights, and its gain.
MixerOutput qmix_value(const Tensor& q, const QmixWeights& weights);

class QmixMixer : public Mixer {
 public:
  QmixMixer(const MixerOptions& options, at::Generator generator, torch::Device device);

  MixerOutput mix(const MixerInput& input) const override;
  NamedTensors named_parameters() const override;
  /// Q_tot is not linear in the utilities (ELU), but it is in W2 and b2.
  void rescale(double factor) override;
  bool scales_with_utilities() const override { return false; }

  /// What the hypernets make of state [B, S].
  QmixWeights weights(const Tensor& state) const;

 private:
  MixerOptions options_;
  Hypernet w1_, b1_, w2_, b2_;
};

}  // namespace comrad::learn
