// QPLEX: the team's value is the sum of transformed utilities plus advantages that a second network weighs by
// state and action, which keeps the joint argmax with the agents and yet represents every payoff that does
// so.
//
//   Q_tot = sum_i Q'_i + sum_i (lambda_i(s, a) - 1) [Q'_i - m'_i]      [..]: no gradient, m'_i = max Q'_i
//
// QPLEX-D (mixer dmaq) transforms utilities by positive weights of the state, QPLEX-Q (dmaq_qatten) by
// attention over the agents. Source: Wang et al. 2021, arXiv:2008.01062; Yang et al. 2020, arXiv:2002.03939.
// Loss and targets: value_decomposition.h; the mixing: critics/qplex_mixer.
#pragma once

#include "learner/algorithms/value_decomposition.h"

namespace comrad::learn {

/// `config.run.algo` must be "qplex_d" or "qplex_q".
class Qplex final : public ValueDecomposition {
 public:
  using ValueDecomposition::ValueDecomposition;
};

}  // namespace comrad::learn
