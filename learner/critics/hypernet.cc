#include "learner/critics/hypernet.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::learn {

Hypernet Hypernet::create(const HypernetOptions& options, at::Generator generator, torch::Device device) {
  COMRAD_CHECK(options.sizes.size() >= 2, "a hypernet has inputs and outputs");
  Hypernet net;
  net.name_ = options.name;
  const size_t layer_count = options.sizes.size() - 1;
  for (size_t index = 0; index < layer_count; ++index) {
    const int64_t inputs = options.sizes[index], outputs = options.sizes[index + 1];
    const bool framework = options.init == HypernetInit::kFramework;
    const double bound = framework ? 1.0 / std::sqrt(static_cast<double>(inputs))
                                   : 0.5 * std::sqrt(6.0 / static_cast<double>(inputs + outputs));
    Layer layer;
    // Drawn on the CPU, so that a GPU starts from the same numbers.
    layer.weight = torch::empty({options.count, outputs, inputs})
                       .uniform_(-bound, bound, generator)
                       .to(device)
                       .requires_grad_();
    const bool has_bias = (index > 0 || options.first_bias) && (index + 1 < layer_count || options.last_bias);
    if (has_bias) {
      layer.bias = torch::zeros({options.count, outputs});
      if (framework) layer.bias.uniform_(-bound, bound, generator);
      layer.bias = layer.bias.to(device).requires_grad_();
    }
    net.layers_.push_back(std::move(layer));
  }
  return net;
}

Tensor Hypernet::forward(const Tensor& x) const {
  const int64_t rows = x.size(0), count = layers_.front().weight.size(0);
  // The first layers share their input, so together they are one wide layer.
  const Layer& first = layers_.front();
  const int64_t width = first.weight.size(1);
  Tensor h = at::linear(x, first.weight.reshape({count * width, x.size(1)}),
                        first.bias.defined() ? first.bias.reshape({count * width}) : Tensor());
  for (size_t index = 1; index < layers_.size(); ++index) {
    const Layer& layer = layers_[index];
    const int64_t inputs = layer.weight.size(2), outputs = layer.weight.size(1);
    h = h.relu();
    if (count == 1) {
      h = at::linear(h, layer.weight.reshape({outputs, inputs}),
                     layer.bias.defined() ? layer.bias.reshape({outputs}) : Tensor());
      continue;
    }
    const Tensor product = h.view({rows, count, inputs}).transpose(0, 1).bmm(layer.weight.transpose(1, 2));
    h = product.transpose(0, 1);  // [B, K, outputs]
    if (layer.bias.defined()) h = h + layer.bias;
    h = h.reshape({rows, count * outputs});
  }
  return h.view({rows, count, layers_.back().weight.size(1)});
}

void Hypernet::scale_outputs(double factor) {
  torch::NoGradGuard no_grad;
  layers_.back().weight.mul_(factor);
  if (layers_.back().bias.defined()) layers_.back().bias.mul_(factor);
}

void Hypernet::scale_last_input(double factor) {
  torch::NoGradGuard no_grad;
  layers_.front().weight.select(2, layers_.front().weight.size(2) - 1).mul_(factor);
}

void Hypernet::append_parameters(NamedTensors& named) const {
  for (size_t index = 0; index < layers_.size(); ++index) {
    const std::string prefix = fmt::format("{}.{}", name_, index);
    named.emplace_back(prefix + ".weight", layers_[index].weight);
    if (layers_[index].bias.defined()) named.emplace_back(prefix + ".bias", layers_[index].bias);
  }
}

}  // namespace comrad::learn
