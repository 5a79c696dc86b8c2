// Parameters of target networks, which follow those that are trained.
//
//   theta_target <- (1 - tau) theta_target + tau theta       after every step; tau = 1: a copy every `interval` steps
//
// Source: Lillicrap et al. 2016, arXiv:1509.02971, section 3; copies: Mnih et al. 2015. Stage: update.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <vector>

#include "policy_workers/device/queue.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::learn {

class TargetParameters {
 public:
  /// `targets` and `trained` in one order, on `device`.
  TargetParameters(std::vector<torch::Tensor> targets, std::vector<torch::Tensor> trained, double tau,
                   int64_t interval, torch::Device device);
  TargetParameters(const TargetParameters&) = delete;
  TargetParameters& operator=(const TargetParameters&) = delete;

  /// After the step that made `version`.
  void follow(PolicyVersion version);
  const std::vector<torch::Tensor>& tensors() const { return targets_; }

 private:
  const std::vector<torch::Tensor> targets_, trained_;
  const double tau_;
  const int64_t interval_;
  device::Graph share_;
};

}  // namespace comrad::learn
