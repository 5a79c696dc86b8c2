// QMIX: the team's value is a monotonic function of its agents' utilities, whose non-negative weights a
// hypernetwork makes from the state: dQ_tot/dQ_i >= 0, so that the joint argmax is every agent's own.
//
//   Q_tot = ELU(Q^T W1(s) + b1(s)) W2(s) + b2(s)
//
// Source: Rashid et al. 2018, arXiv:1803.11485. Loss and targets: value_decomposition.h;
// the mixing: critics/qmix_mixer.
#pragma once

#include "learner/algorithms/value_decomposition.h"

namespace comrad::learn {

/// `config.run.algo` must be "qmix".
class Qmix final : public ValueDecomposition {
 public:
  using ValueDecomposition::ValueDecomposition;
};

}  // namespace comrad::learn
