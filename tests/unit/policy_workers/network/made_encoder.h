// An encoder with its input statistics, for tests.
#pragma once

#include <cstdint>
#include <memory>
#include <string>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/encoder.h"

namespace comrad::policy {

struct MadeEncoder {
  std::shared_ptr<ObservationNormalizer> normalizer;
  std::shared_ptr<const Encoder> encoder;

  void update_statistics(const Tensor& frame, const Tensor& measurement) const {
    normalizer->frame.update(frame);
    if (measurement.defined()) normalizer->measurement.update(measurement);
  }
};

/// On the CPU, weights from seed 1, fresh statistics.
inline MadeEncoder made_encoder(const EnvShape& env = {}, const std::string& name = "simple") {
  torch::NoGradGuard no_grad;
  MadeEncoder made{ObservationNormalizer::create(env, true, torch::kCPU), nullptr};
  made.encoder = make_encoder({.env = env, .encoder = name, .normalizer = made.normalizer},
                              {.generator = at::make_generator<at::CPUGeneratorImpl>(uint64_t{1})});
  return made;
}

}  // namespace comrad::policy
