// VDN: the team's value is the sum of its agents' utilities, Q_tot = sum_i Q_i(a_i). Source: Sunehag et al.
// 2018, arXiv:1706.05296. Loss and targets: value_decomposition.h; the sum:
// critics/vdn_mixer.
#pragma once

#include "learner/algorithms/value_decomposition.h"

namespace comrad::learn {

/// `config.run.algo` must be "vdn".
class Vdn final : public ValueDecomposition {
 public:
  using ValueDecomposition::ValueDecomposition;
};

}  // namespace comrad::learn
