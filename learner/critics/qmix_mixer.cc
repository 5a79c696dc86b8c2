#include "learner/critics/qmix_mixer.h"

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {
namespace {

constexpr double kLeastStateWeight = 1e-8;

}  // namespace

MixerOutput qmix_value(const Tensor& q, const QmixWeights& weights) {
  const Tensor hidden =
      at::baddbmm(weights.b1.unsqueeze(1), q.unsqueeze(1), weights.w1).squeeze(1);  // [B, E]
  MixerOutput output;
  output.q_tot = (at::elu(hidden) * weights.w2).sum(1) + weights.b2;
  torch::NoGradGuard no_grad;
  const Tensor slope = hidden.clamp_max(0).exp() * weights.w2;  // ELU' = exp(min(h, 0))
  output.gain = at::bmm(weights.w1, slope.unsqueeze(2)).squeeze(2).mean(1);
  return output;
}

QmixMixer::QmixMixer(const MixerOptions& options, at::Generator generator, torch::Device device)
    : options_(options) {
  const int64_t state = options.state_count, embed = options.embed_dim, hidden = options.hypernet_hidden;
  auto make = [&](const char* name, std::vector<int64_t> sizes) {
    return Hypernet::create({.name = name, .sizes = std::move(sizes), .init = HypernetInit::kXavier},
                            generator, device);
  };
  w1_ = make("w1", {state, hidden, options.num_agents * embed});
  b1_ = make("b1", {state, embed});
  w2_ = make("w2", {state, hidden, embed});
  b2_ = make("b2", {state, embed, 1});
}

QmixWeights QmixMixer::weights(const Tensor& state) const {
  const int64_t rows = state.size(0), agents = options_.num_agents, embed = options_.embed_dim;
  return {.w1 = w1_.forward(state).view({rows, agents, embed}).abs() + kLeastStateWeight,
          .b1 = b1_.forward(state).view({rows, embed}),
          .w2 = w2_.forward(state).view({rows, embed}).abs() + kLeastStateWeight,
          .b2 = b2_.forward(state).view({rows})};
}

MixerOutput QmixMixer::mix(const MixerInput& input) const {
  COMRAD_CHECK(input.chosen.dim() == 2 && input.chosen.size(1) == options_.num_agents,
               "utilities are [B, N]");
  COMRAD_CHECK(input.state.dim() == 2 && input.state.size(0) == input.chosen.size(0) &&
                   input.state.size(1) == options_.state_count,
               "the mixer's state is [B, S]");
  return qmix_value(input.chosen, weights(input.state.detach()));
}

void QmixMixer::rescale(double factor) {
  w2_.scale_outputs(factor);
  b2_.scale_outputs(factor);
}

NamedTensors QmixMixer::named_parameters() const {
  NamedTensors named;
  for (const Hypernet* net : {&w1_, &b1_, &w2_, &b2_}) net->append_parameters(named);
  return named;
}

}  // namespace comrad::learn
