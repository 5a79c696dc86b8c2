// What all parts of a network are made of: named tensors, weights as they begin, and linear layers.
#pragma once

#include <ATen/core/Generator.h>
#include <torch/types.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "policy_workers/kernels/precision.h"

namespace comrad::policy {

using torch::Tensor;
using NamedTensors = std::vector<std::pair<std::string, Tensor>>;

/// How weights of linear and convolution layers begin.
enum class Initialization {
  kOrthogonal,        ///< orthogonal with a gain, zero biases
  kFrameworkDefault,  ///< weights and biases uniform in +-1/sqrt(inputs), PyTorch's default
  kZero,              ///< for networks that are given others' weights
};

/// Weight of these sizes (outputs first) and bias [outputs] of a fresh layer.
std::pair<Tensor, Tensor> initial_layer(at::IntArrayRef sizes, Initialization init, double gain,
                                        at::Generator generator);

/// Orthogonal matrix with `gain`, rows x columns being the first axis x all others; drawn from `generator`.
Tensor orthogonal(at::IntArrayRef sizes, double gain, at::Generator generator);

/// A weight [outputs, inputs] or [outputs, inputs, kernel, kernel] with its bias [outputs].
struct Layer {
  std::string name;
  Tensor weight, bias;

  /// x W^T + b in f32, for heads and critics.
  Tensor operator()(const Tensor& x) const { return at::linear(x, weight, bias); }
};

/// Makes the layers of a network one after the other, from one generator.
struct LayerMaker {
  Initialization init = Initialization::kOrthogonal;
  double gain = 1.0;
  at::Generator generator;
  torch::Device device = torch::kCPU;
  Precision precision = Precision::kFp32;

  Layer operator()(std::string name, at::IntArrayRef sizes) const;
  /// Weights of 1 and biases of 0, for layer_norm() of rows of these sizes.
  Layer norm(std::string name, at::IntArrayRef sizes) const;
};

/// Rows [B, sizes] with mean 0 and variance 1 each, then a weight and a bias for every element, in f32. Differentiable.
/// Source: Ba et al. 2016, arXiv:1607.06450.
Tensor layer_norm(const Tensor& rows, const Tensor& weight, const Tensor& bias);

/// Appends "<prefix><name>.weight" and ".bias".
void append(NamedTensors& named, const std::string& prefix, const Layer& layer);
void append(NamedTensors& named, const std::string& prefix, const NamedTensors& more);

}  // namespace comrad::policy
