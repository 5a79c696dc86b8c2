#include "learner/critics/mixer.h"

#include "learner/critics/qmix_mixer.h"
#include "learner/critics/qplex_mixer.h"
#include "learner/critics/vdn_mixer.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {

MixerOptions MixerOptions::from(const RunConfig& config, const EnvShape& env, int64_t features) {
  return {.kind = config.mixer,
          .num_agents = env.num_agents,
          .state_count = features * env.num_agents,
          .logit_count = env.logit_count(),
          .state_slice = features,
          .embed_dim = config.qmix_embed_dim,
          .hypernet_hidden = config.qmix_hypernet_hidden,
          .qplex_embed_dim = config.qplex_embed_dim,
          .qplex_hypernet_embed = config.qplex_hypernet_embed,
          .adv_hypernet_layers = config.qplex_adv_hypernet_layers,
          .adv_hypernet_embed = config.qplex_adv_hypernet_embed,
          .num_kernel = config.qplex_num_kernel,
          .n_head = config.qplex_n_head,
          .attend_reg_coef = config.qplex_attend_reg_coef,
          .is_minus_one = config.qplex_is_minus_one,
          .weighted_head = config.qplex_weighted_head,
          .nonlinear = config.qplex_nonlinear,
          .state_bias = config.qplex_state_bias};
}

std::string check_mixer(const MixerOptions& options) {
  const std::string& kind = options.kind;
  if (kind != "vdn" && kind != "qmix" && kind != "dmaq" && kind != "dmaq_qatten")
    return "mixer is " + kind + "; it must be vdn, qmix, dmaq or dmaq_qatten";
  const struct {
    const char* name;
    int64_t value, low, high;
  } ranges[] = {
      {"num_agents", options.num_agents, 1, 64},
      {"qmix_embed_dim", options.embed_dim, 1, 4096},
      {"qmix_hypernet_hidden", options.hypernet_hidden, 1, 4096},
      {"qplex_embed_dim", options.qplex_embed_dim, 1, 4096},
      {"qplex_hypernet_embed", options.qplex_hypernet_embed, 1, 4096},
      {"qplex_adv_hypernet_layers", options.adv_hypernet_layers, 1, 3},
      {"qplex_adv_hypernet_embed", options.adv_hypernet_embed, 1, 4096},
      {"qplex_num_kernel", options.num_kernel, 1, 256},
      {"qplex_n_head", options.n_head, 1, 256},
  };
  for (const auto& range : ranges)
    if (range.value < range.low || range.value > range.high)
      return std::string(range.name) + " is " + std::to_string(range.value) + "; it must lie in " +
             std::to_string(range.low) + ".." + std::to_string(range.high);
  if (!(options.attend_reg_coef >= 0))
    return "qplex_attend_reg_coef is " + std::to_string(options.attend_reg_coef) +
           "; it must not be negative";
  if (kind == "dmaq_qatten" && options.state_count != options.num_agents * options.state_slice)
    return "the state has " + std::to_string(options.state_count) +
           " entries; dmaq_qatten needs one slice of " + std::to_string(options.state_slice) + " per agent";
  return "";
}

std::unique_ptr<Mixer> make_mixer(const MixerOptions& options, uint64_t seed, torch::Device device) {
  const std::string complaint = check_mixer(options);
  COMRAD_CHECK(complaint.empty(), complaint.c_str());
  at::Generator generator = at::make_generator<at::CPUGeneratorImpl>(seed);
  if (options.kind == "qmix") return std::make_unique<QmixMixer>(options, generator, device);
  if (options.kind == "dmaq" || options.kind == "dmaq_qatten")
    return std::make_unique<QplexMixer>(options, generator, device);
  return std::make_unique<VdnMixer>();
}

}  // namespace comrad::learn
