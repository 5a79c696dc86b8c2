#include "learner/critics/vdn_mixer.h"

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {

MixerOutput VdnMixer::mix(const MixerInput& input) const {
  COMRAD_CHECK(input.chosen.dim() == 2, "utilities are [B, N]");
  return {.q_tot = input.chosen.sum(1)};
}

}  // namespace comrad::learn
