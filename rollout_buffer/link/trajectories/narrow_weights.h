// The policy's weights in half of the bytes, for the way to other hosts: parameters as bfloat16, input statistics as f32.
// Stages: publish, refresh.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::link {

/// `weights` are `parameter_count` f32 parameters and then input statistics, f64, as the learner publishes them; `narrow`
/// becomes half as long: bfloat16, rounded to the nearest and to even at a tie, and then f32. Statistics are not made
/// bfloat16: a mean with three digits would move every input.
/// Errors: kBadFormat where `weights` cannot be these.
Status narrow_weights(std::span<const std::byte> weights, uint64_t parameter_count,
                      std::vector<std::byte>& narrow);

/// The way back: `weights` as the arena has them, with what rounding left. Errors: kBadFormat.
Status widen_weights(std::span<const std::byte> narrow, uint64_t parameter_count,
                     std::vector<std::byte>& weights);

}  // namespace comrad::link
