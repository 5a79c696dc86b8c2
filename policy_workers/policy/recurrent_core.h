// The recurrent core between encoder and heads: GRU or LSTM cells in PyTorch's gate conventions, any
// number of layers, or nothing. One step at a time for policy workers, whole sequences with resets inside
// for the learner.
#pragma once

#include <ATen/core/Generator.h>
#include <torch/types.h>

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "policy_workers/policy/precision.h"

namespace comrad::policy {

using torch::Tensor;
using NamedTensors = std::vector<std::pair<std::string, Tensor>>;

enum class CoreKind { kNone, kGru, kLstm };

/// Weights of one recurrent layer; GRU gates r, z, n and LSTM gates i, f, g, o lie below each other.
struct CoreLayer {
  Tensor weight_ih;  ///< [gates * hidden, input]
  Tensor weight_hh;  ///< [gates * hidden, hidden]
  Tensor bias_ih;    ///< [gates * hidden]
  Tensor bias_hh;    ///< [gates * hidden]
};

/// What a core returns: features of the last layer and the state after the last step.
struct CoreOutput {
  Tensor features;  ///< [B, hidden] or [T, B, hidden]
  Tensor state;     ///< [B, H]
};

/// Layers of cells. State per row: every layer's h, then (LSTM) every layer's c.
class RecurrentCore {
 public:
  RecurrentCore() = default;
  /// Weights and biases uniform in +-1/sqrt(hidden), PyTorch's default, drawn from `generator`.
  static RecurrentCore create(CoreKind kind, int64_t input_count, int64_t hidden_count, int64_t layer_count,
                              at::Generator generator, torch::Device device,
                              Precision precision = Precision::kFp32);

  /// One step: input [B, input], state [B, H]. The caller decides whether gradients are recorded.
  CoreOutput step(const Tensor& input, const Tensor& state) const;

  /// T steps with gradient: input [T, B, input], state [B, H] before step 0, keep f32 [T, B, 1] (0 where the
  /// state is zeroed before the step) or undefined for no resets. Equals repeated step() up to rounding.
  CoreOutput sequence(const Tensor& input, const Tensor& state, const Tensor& keep) const;

  int64_t feature_count() const { return feature_count_; }
  int64_t state_count() const;
  NamedTensors named_parameters() const;
  std::vector<CoreLayer>& layers() { return layers_; }

 private:
  CoreKind kind_ = CoreKind::kNone;
  Precision precision_ = Precision::kFp32;
  int64_t hidden_count_ = 0;
  int64_t feature_count_ = 0;
  std::vector<CoreLayer> layers_;
};

}  // namespace comrad::policy
