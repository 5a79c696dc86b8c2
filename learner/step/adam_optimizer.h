// Adam with a global gradient clip, the check that everything is finite, and a state that goes into checkpoints. A step
// is a few passes over the parameters on the device they live on; the host reads the outcome afterwards.
// Stage: update.
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

/// Adam over `parameters`, in that order. Source: Kingma and Ba 2015, arXiv:1412.6980, algorithm 1.
///
///   m <- b1 m + (1 - b1) c g      v <- b2 v + (1 - b2) (c g)^2      p <- p - lr m_hat / (sqrt(v_hat) + eps)
///   c  = min(1, max_grad_norm / (|g| + 1e-6)), |g| over all parameters
///   m_hat = m / (1 - b1^t), v_hat = v / (1 - b2^t), t the steps since the parameter's moments were 0
class AdamOptimizer {
 public:
  AdamOptimizer(std::vector<torch::Tensor> parameters, const AdamSettings& settings);
  ~AdamOptimizer();
  AdamOptimizer(AdamOptimizer&&) noexcept;
  AdamOptimizer& operator=(AdamOptimizer&&) noexcept;

  const std::vector<torch::Tensor>& parameters() const;
  void zero_grad();
  /// One step by the parameters' gradients, which stay as they are. Where `loss` (one number of any type; may be
  /// undefined) or the norm is not finite, nothing moves. Returns f64 [2], on the device: whether the step was taken (1
  /// or 0) and the norm before the clip. Nothing waits for the device.
  torch::Tensor step(double learning_rate, const torch::Tensor& loss = {});
  /// The same with a rate f64 [] that lies on the device, by torch's operators alone: it can be recorded (device/queue.h).
  torch::Tensor step(const torch::Tensor& learning_rate, const torch::Tensor& loss);

  /// Sets the moments of parameter `index` to 0: its next step is a first one.
  void clear_moments(std::size_t index);

  /// Of parameter `index`: whether it has moments, the norm of its gradient at the last step (before the clip; 0 without one), and the mean over its elements of s / (s + epsilon),
  /// s = sqrt(exp_avg_sq / (1 - beta2^t)), 0 before the first step.
  bool has_stepped(std::size_t index) const;
  double gradient_norm(std::size_t index) const;
  double step_multiplier(std::size_t index) const;

  /// Largest exp_avg_sq, f64 []; 0 before the first step.
  torch::Tensor max_second_moment() const;

  /// Keys "<section>/<prefix><index>.exp_avg", ".exp_avg_sq", ".step"; a parameter without steps has none.
  void save(StateDict& state, const std::string& section, const std::string& prefix = "") const;
  /// Errors: kBadFormat when shapes differ.
  Status load(const StateDict& state, const std::string& section, const std::string& prefix = "");

 private:
  /// Those that have a gradient, which have stepped from now on.
  std::vector<std::size_t> with_gradient();
  torch::Tensor step_on_cpu(const std::vector<std::size_t>& indices, double learning_rate,
                            const torch::Tensor& loss);
  torch::Tensor step_on_device(const torch::Tensor& learning_rate, const torch::Tensor& loss);
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace comrad::learn
