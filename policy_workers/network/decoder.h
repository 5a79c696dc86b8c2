// Layers with ELU between core and heads.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <span>
#include <vector>

#include "policy_workers/network/layers.h"

namespace comrad::policy {

class Decoder {
 public:
  /// One layer a width; none passes features unchanged. `normalises`: layer_norm() before each ELU.
  Decoder(int64_t input_count, std::span<const int64_t> widths, bool normalises, const LayerMaker& make);

  /// Features [B, input] to [B, F].
  Tensor operator()(Tensor x) const;

  int64_t feature_count() const { return feature_count_; }
  /// "decoder.0.weight", "decoder.0.bias", ..., then "decoder_norm.0.weight", ...
  NamedTensors named_parameters() const;

 private:
  int64_t feature_count_;
  Precision precision_;
  std::vector<Layer> layers_, norms_;
};

}  // namespace comrad::policy
