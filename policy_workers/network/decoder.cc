#include "policy_workers/network/decoder.h"

#include "policy_workers/device/torch_ops.h"

namespace comrad::policy {

Decoder::Decoder(int64_t input_count, std::span<const int64_t> widths, const LayerMaker& make)
    : feature_count_(input_count), precision_(make.precision) {
  for (const int64_t width : widths) {
    layers_.push_back(make("decoder." + std::to_string(layers_.size()), {width, feature_count_}));
    feature_count_ = width;
  }
}

Tensor Decoder::operator()(Tensor x) const {
  for (const Layer& layer : layers_) x = at::elu(linear(x, layer.weight, layer.bias, precision_));
  return x;
}

NamedTensors Decoder::named_parameters() const {
  NamedTensors named;
  for (const Layer& layer : layers_) append(named, "", layer);
  return named;
}

}  // namespace comrad::policy
