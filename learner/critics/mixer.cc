#include "learner/critics/mixer.h"

#include "learner/critics/qmix_mixer.h"
#include "learner/critics/qplex_mixer.h"
#include "learner/critics/vdn_mixer.h"
#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {

MixerOptions MixerOptions::from(const RunConfig& config, const EnvShape& env, int64_t features,
                                int64_t global_state_count) {
  return {.kind = config.run.algo->mixer,
          .num_agents = env.num_agents,
          .state_count = features * env.num_agents + global_state_count,
          .logit_count = env.logit_count(),
          .state_slice = features,
          .embed_dim = config.mixers.qmix_embed_dim,
          .hypernet_hidden = config.mixers.qmix_hypernet_hidden,
          .qplex_embed_dim = config.mixers.qplex_embed_dim,
          .qplex_hypernet_embed = config.mixers.qplex_hypernet_embed,
          .adv_hypernet_layers = config.mixers.qplex_adv_hypernet_layers,
          .adv_hypernet_embed = config.mixers.qplex_adv_hypernet_embed,
          .num_kernel = config.mixers.qplex_num_kernel,
          .n_head = config.mixers.qplex_n_head,
          .attend_reg_coef = config.mixers.qplex_attend_reg_coef,
          .is_minus_one = config.mixers.qplex_is_minus_one,
          .weighted_head = config.mixers.qplex_weighted_head,
          .nonlinear = config.mixers.qplex_nonlinear,
          .state_bias = config.mixers.qplex_state_bias};
}

std::unique_ptr<Mixer> make_mixer(const MixerOptions& options, uint64_t seed, torch::Device device) {
  at::Generator generator = at::make_generator<at::CPUGeneratorImpl>(seed);
  if (options.kind == MixerKind::kQmix) return std::make_unique<QmixMixer>(options, generator, device);
  if (options.kind == MixerKind::kQplexDuelling || options.kind == MixerKind::kQplexAttention)
    return std::make_unique<QplexMixer>(options, generator, device);
  return std::make_unique<VdnMixer>();
}

}  // namespace comrad::learn
