// VDN: the team value is the plain sum of the agents' utilities,
//
//   Q_tot(s, a) = sum_i Q_i(a_i)
//
// without parameters or state. Source: Sunehag et al. 2018, arXiv:1706.05296, eq. 1.
#pragma once

#include "learner/critics/mixer.h"

namespace comrad::learn {

class VdnMixer : public Mixer {
 public:
  MixerOutput mix(const MixerInput& input) const override;
  NamedTensors named_parameters() const override { return {}; }
  void rescale(double /*factor*/) override {}
  bool scales_with_utilities() const override { return true; }
};

}  // namespace comrad::learn
