#include "learner/critics/qplex_mixer.h"

#include <cmath>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {
namespace {

constexpr double kLeastWeight = 1e-10;

}  // namespace

MixerOutput qplex_value(const Tensor& chosen, const Tensor& greedy, const QplexTransform& transform,
                        const Tensor& lambda, bool is_minus_one) {
  const Tensor value = transform.weight * chosen + transform.bias;
  // Q' - m' without its bias, which cancels.
  const Tensor advantage = (transform.weight * (chosen - greedy)).detach();
  MixerOutput output;
  output.v_tot = value.sum(1);
  output.a_tot = (advantage * (is_minus_one ? lambda - 1 : lambda)).sum(1);
  output.q_tot = output.v_tot + output.a_tot;
  output.gain = transform.weight.detach().expand_as(chosen).mean(1);
  output.regularizer = transform.regularizer;
  output.head_entropy = transform.head_entropy;
  return output;
}

Tensor si_weights(const Tensor& key, const Tensor& agents, const Tensor& action) {
  return ((key.abs() + kLeastWeight).unsqueeze(2) * agents.sigmoid() * action.sigmoid()).sum(1);
}

QplexTransform qatten_weights(const Tensor& selector, const Tensor& key, const Tensor& head_scale,
                              double coefficient) {
  const Tensor logits = (selector.unsqueeze(1) * key).sum(3);  // [B, N, H]
  const Tensor log_attention = (logits / std::sqrt(static_cast<double>(selector.size(2)))).log_softmax(1);
  const Tensor attention = log_attention.exp();
  QplexTransform result;
  result.weight =
      (head_scale.defined() ? attention * head_scale.unsqueeze(1) : attention).sum(2) + kLeastWeight;
  result.regularizer = coefficient * logits.square().mean(1).sum(1);
  result.head_entropy = -(attention * log_attention).detach().sum(1).mean(1);
  return result;
}

QplexMixer::QplexMixer(const MixerOptions& options, at::Generator generator, torch::Device device)
    : options_(options), attends_(options.kind == MixerKind::kQplexAttention) {
  const int64_t state = options.state_count, agents = options.num_agents;
  const int64_t hidden = options.qplex_hypernet_embed, embed = options.qplex_embed_dim;
  auto make = [&](HypernetOptions net) { return Hypernet::create(net, generator, device); };
  if (attends_) {
    COMRAD_CHECK(state >= agents * options.state_slice, "the state has one slice for each agent");
    selector_ = make(
        {.name = "selector", .count = options.n_head, .sizes = {state, hidden, embed}, .last_bias = false});
    attention_key_ = make({.name = "attention_key",
                           .count = options.n_head,
                           .sizes = {options.state_slice + (options.nonlinear ? 1 : 0), embed},
                           .last_bias = false});
    if (options.weighted_head) head_ = make({.name = "head", .sizes = {state, hidden, options.n_head}});
    value_ = make({.name = "value", .sizes = {state, embed, 1}});
  } else {
    weight_ = make({.name = "weight", .sizes = {state, hidden, agents}});
    bias_ = make({.name = "bias", .sizes = {state, hidden, agents}});
  }
  auto make_lambda = [&](const char* name, int64_t inputs, int64_t outputs) {
    std::vector<int64_t> sizes = {inputs};
    for (int64_t layer = 1; layer < options.adv_hypernet_layers; ++layer)
      sizes.push_back(options.adv_hypernet_embed);
    sizes.push_back(outputs);
    return make({.name = name, .count = options.num_kernel, .sizes = std::move(sizes)});
  };
  key_ = make_lambda("lambda_key", state, 1);
  agents_ = make_lambda("lambda_agents", state, agents);
  action_ = make_lambda("lambda_action", state + agents * options.logit_count, agents);
}

QplexTransform QplexMixer::transform(const Tensor& state, const Tensor& greedy) const {
  const int64_t rows = state.size(0), agents = options_.num_agents;
  if (!attends_) {
    if (!options_.weighted_head)
      return {.weight = torch::ones({1, agents}, state.options()),
              .bias = torch::zeros({1, agents}, state.options())};
    return {.weight = weight_.forward(state).squeeze(1).abs() + kLeastWeight,
            .bias = bias_.forward(state).squeeze(1)};
  }
  Tensor slices =
      state.narrow(1, 0, agents * options_.state_slice).reshape({rows * agents, options_.state_slice});
  if (options_.nonlinear) slices = at::cat({slices, greedy.reshape({rows * agents, 1})}, 1);
  const Tensor key =
      attention_key_.forward(slices).view({rows, agents, options_.n_head, options_.qplex_embed_dim});
  const Tensor head_scale =
      options_.weighted_head ? head_.forward(state).squeeze(1).abs() + kLeastWeight : Tensor();
  QplexTransform result = qatten_weights(selector_.forward(state), key, head_scale, options_.attend_reg_coef);
  if (options_.state_bias)
    result.bias = (value_.forward(state).squeeze(1) / static_cast<double>(agents)).expand({rows, agents});
  else
    result.bias = torch::zeros({1, agents}, state.options());
  return result;
}

Tensor QplexMixer::lambda(const Tensor& state, const Tensor& action) const {
  return si_weights(key_.forward(state).squeeze(2), agents_.forward(state),
                    action_.forward(at::cat({state, action}, 1)));
}

MixerOutput QplexMixer::mix(const MixerInput& input) const {
  const int64_t rows = input.chosen.size(0), agents = options_.num_agents;
  COMRAD_CHECK(input.chosen.dim() == 2 && input.chosen.size(1) == agents, "utilities are [B, N]");
  COMRAD_CHECK(input.greedy.sizes() == input.chosen.sizes(), "greedy utilities are [B, N]");
  COMRAD_CHECK(input.action.dim() == 2 && input.action.size(0) == rows &&
                   input.action.size(1) == agents * options_.logit_count,
               "multi-hot actions are [B, N*A]");
  COMRAD_CHECK(
      input.state.dim() == 2 && input.state.size(0) == rows && input.state.size(1) == options_.state_count,
      "the mixer's state is [B, S]");
  const Tensor state = input.state.detach(), greedy = input.greedy.detach();
  return qplex_value(input.chosen, greedy, transform(state, greedy), lambda(state, input.action),
                     options_.is_minus_one);
}

void QplexMixer::rescale(double factor) {
  if (!attends_ && options_.weighted_head) bias_.scale_outputs(factor);
  if (attends_ && options_.state_bias) value_.scale_outputs(factor);
  if (attends_ && options_.nonlinear) attention_key_.scale_last_input(1 / factor);
}

NamedTensors QplexMixer::named_parameters() const {
  NamedTensors named;
  if (attends_) {
    selector_.append_parameters(named);
    attention_key_.append_parameters(named);
    if (options_.weighted_head) head_.append_parameters(named);
    value_.append_parameters(named);
  } else {
    weight_.append_parameters(named);
    bias_.append_parameters(named);
  }
  for (const Hypernet* net : {&key_, &agents_, &action_}) net->append_parameters(named);
  return named;
}

}  // namespace comrad::learn
