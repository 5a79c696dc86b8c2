// The recurrent core between encoder and decoder: GRU or LSTM cells in PyTorch's gate conventions, any
// number of layers, or nothing. One step at a time for policy workers, whole sequences with resets inside
// for the learner.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "policy_workers/network/layers.h"

namespace comrad::policy {

/// What a core returns: features of the last layer and the state after the last step.
struct CoreOutput {
  Tensor features;  ///< [B, hidden] or [T, B, hidden]
  Tensor state;     ///< [B, H]
};

/// State per row: every layer's h, then (LSTM) every layer's c.
class Core {
 public:
  virtual ~Core() = default;

  /// One step: input [B, input], state [B, H]. The caller decides whether gradients are recorded.
  virtual CoreOutput step(const Tensor& input, const Tensor& state) const = 0;
  /// T steps with gradient: input [T, B, input], state [B, H] before step 0, keep f32 [T, B, 1] (0 where the
  /// state is zeroed before the step) or undefined for no resets. Equals repeated step() up to rounding.
  virtual CoreOutput sequence(const Tensor& input, const Tensor& state, const Tensor& keep) const = 0;

  virtual int64_t feature_count() const = 0;
  /// H.
  virtual int64_t state_count() const = 0;
  /// "core.weight_ih_l0" [gates * hidden, input], "core.weight_hh_l0", "core.bias_ih_l0", "core.bias_hh_l0", ... as PyTorch's GRU and
  /// LSTM name them; GRU gates r, z, n and LSTM gates i, f, g, o lie below each other.
  virtual NamedTensors named_parameters() const = 0;
};

/// What a core is made from.
struct CoreInput {
  std::string kind = "gru";  ///< gru, lstm or none
  int64_t input_count = 0, hidden_count = 512, layer_count = 1;
};
/// Weights and biases uniform in +-1/sqrt(hidden), PyTorch's default, from `make.generator`. Aborts for an unknown kind.
std::shared_ptr<const Core> make_core(const CoreInput& input, const LayerMaker& make);
/// Floats of state per row that make_core() gives such a core.
int64_t core_state_count(const CoreInput& input);

}  // namespace comrad::policy
