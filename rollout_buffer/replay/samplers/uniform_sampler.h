// Every unit with the same probability, independently. Stage: sample.
#pragma once

#include "rollout_buffer/replay/samplers/sampler.h"

namespace comrad::replay {

class UniformSampler : public Sampler {
 public:
  void push(int64_t count) override { end_ += count; }
  void pop(int64_t count) override;
  void draw(int64_t count, double beta, Rng& rng, std::vector<Pick>& picks) const override;
  void set_priorities(std::span<const int64_t>, std::span<const float>) override {}
  double least_probability() const override { return size() > 0 ? 1.0 / static_cast<double>(size()) : 0.0; }
  SamplerState state() const override { return {.first = first_}; }
  void restore(const SamplerState& state, int64_t count) override;
};

}  // namespace comrad::replay
