#include "rollout_buffer/replay/samplers/uniform_sampler.h"

#include <limits>

#include "rollout_buffer/core/check.h"

namespace comrad::replay {

void UniformSampler::pop(int64_t count) {
  COMRAD_CHECK(count >= 0 && count <= size(), "only units that are there leave");
  first_ += count;
}

void UniformSampler::draw(int64_t count, double /*beta*/, Rng& rng, std::vector<Pick>& picks) const {
  if (size() == 0) return;
  COMRAD_CHECK(size() <= int64_t{std::numeric_limits<uint32_t>::max()}, "units are counted in 32 bits");
  for (int64_t i = 0; i < count; ++i)
    picks.push_back({.serial = first_ + rng.below(static_cast<uint32_t>(size()))});
}

void UniformSampler::restore(const SamplerState& state, int64_t count) {
  first_ = state.first;
  end_ = first_ + count;
}

}  // namespace comrad::replay
