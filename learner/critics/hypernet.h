// Small networks that turn the state into the weights of a mixer. Several of one shape live side by side in
// one tensor per layer (attention heads, kernels of lambda), so that a batch costs one product per layer.
#pragma once

#include <ATen/core/Generator.h>
#include <torch/types.h>

#include <string>
#include <vector>

#include "learner/critics/mixer.h"

namespace comrad::learn {

enum class HypernetInit {
  kFramework,  ///< weights and biases uniform in +-1/sqrt(inputs)
  kXavier,     ///< weights uniform in +-0.5 sqrt(6 / (inputs + outputs)), biases 0
};

struct HypernetOptions {
  std::string name;            ///< parameters are called name.<layer>.weight and .bias
  int64_t count = 1;           ///< K networks side by side
  std::vector<int64_t> sizes;  ///< inputs, hidden units..., outputs of each
  HypernetInit init = HypernetInit::kFramework;
  bool first_bias = true, last_bias = true;  ///< with a single layer both must hold for it to have a bias
};

/// K multi-layer perceptrons on one input, ReLU between the layers.
class Hypernet {
 public:
  Hypernet() = default;
  static Hypernet create(const HypernetOptions& options, at::Generator generator, torch::Device device);

  /// x [B, inputs] -> [B, K, outputs].
  Tensor forward(const Tensor& x) const;
  void append_parameters(NamedTensors& named) const;
  /// Multiplies all outputs, or the first layer's weights of the last input, in place and without gradient.
  void scale_outputs(double factor);
  void scale_last_input(double factor);

 private:
  struct Layer {
    Tensor weight;  // [K, outputs, inputs]
    Tensor bias;    // [K, outputs] or undefined
  };
  std::string name_;
  std::vector<Layer> layers_;
};

}  // namespace comrad::learn
