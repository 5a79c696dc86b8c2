// Adam with a global gradient clip and a state that goes into checkpoints. Stage: update.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

struct AdamSettings {
  double beta1 = 0.9;
  double beta2 = 0.999;
  double epsilon = 1e-6;
  double max_grad_norm = 4.0;  ///< 0: no clipping

  static AdamSettings from(const RunConfig& config);
};

/// One torch::optim::Adam over `parameters`, in that order.
class AdamOptimizer {
 public:
  AdamOptimizer(std::vector<torch::Tensor> parameters, const AdamSettings& settings);
  ~AdamOptimizer();
  AdamOptimizer(AdamOptimizer&&) noexcept;
  AdamOptimizer& operator=(AdamOptimizer&&) noexcept;

  const std::vector<torch::Tensor>& parameters() const;
  void zero_grad();
  /// Scales all gradients by max_grad_norm / (norm + 1e-6) where that is below 1. Returns the norm before.
  /// A norm that is not finite leaves the gradients as they are.
  double clip_gradients();
  void step(double learning_rate);

  /// Of parameter `index`: whether it has moments, the norm of its gradient at the last clip_gradients() (before
  /// it was clipped; 0 before the first), and the mean over its elements of s / (s + epsilon),
  /// s = sqrt(exp_avg_sq / (1 - beta2^step)), 0 before the first step.
  bool has_stepped(std::size_t index) const;
  double gradient_norm(std::size_t index) const;
  double step_multiplier(std::size_t index) const;

  /// Largest exp_avg_sq; 0 before the first step.
  double max_second_moment() const;

  /// Keys "<section>/<prefix><index>.exp_avg", ".exp_avg_sq", ".step"; a parameter without steps has none.
  void save(StateDict& state, const std::string& section, const std::string& prefix = "") const;
  /// Errors: kBadFormat when shapes differ.
  Status load(const StateDict& state, const std::string& section, const std::string& prefix = "");

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace comrad::learn
