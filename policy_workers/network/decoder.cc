#include "policy_workers/network/decoder.h"

#include <spdlog/fmt/fmt.h>

#include "policy_workers/device/torch_ops.h"

namespace comrad::policy {

Decoder::Decoder(int64_t input_count, std::span<const int64_t> widths, bool normalises,
                 const LayerMaker& make)
    : feature_count_(input_count), precision_(make.precision) {
  for (const int64_t width : widths) {
    const std::string index = std::to_string(layers_.size());
    layers_.push_back(make("decoder." + index, {width, feature_count_}));
    if (normalises) norms_.push_back(make.norm("decoder_norm." + index, {width}));
    feature_count_ = width;
  }
}

Tensor Decoder::operator()(Tensor x) const {
  for (std::size_t i = 0; i < layers_.size(); ++i) {
    x = linear(x, layers_[i].weight, layers_[i].bias, precision_);
    if (!norms_.empty()) x = layer_norm(x, norms_[i].weight, norms_[i].bias);
    x = at::elu(x);
  }
  return to_f32(x);
}

NamedTensors Decoder::named_parameters() const {
  NamedTensors named;
  for (const Layer& layer : layers_) append(named, "", layer);
  for (const Layer& norm : norms_) append(named, "", norm);
  return named;
}

}  // namespace comrad::policy
