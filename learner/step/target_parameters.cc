#include "learner/step/target_parameters.h"

#include <utility>

#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {

TargetParameters::TargetParameters(std::vector<torch::Tensor> targets, std::vector<torch::Tensor> trained,
                                   double tau, int64_t interval, torch::Device device)
    : targets_(std::move(targets)), trained_(std::move(trained)), tau_(tau), interval_(interval) {
  share_.record_at_second_replay(device, [this] {
    for (std::size_t i = 0; i < targets_.size(); ++i) targets_[i].lerp_(trained_[i], tau_);
  });
}

void TargetParameters::follow(PolicyVersion version) {
  torch::NoGradGuard no_grad;
  if (tau_ < 1) return share_.replay();
  if (version % static_cast<PolicyVersion>(interval_) != 0) return;
  for (std::size_t i = 0; i < targets_.size(); ++i) targets_[i].copy_(trained_[i]);
}

}  // namespace comrad::learn
