// What the fuzzers of the link have in common.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>
#include <span>

#include "rollout_buffer/schema/trajectory.h"

namespace comrad::fuzz {

inline TrajectoryShape small_shape() {
  TrajectoryShape shape;
  shape.env = {
      .num_agents = 2, .channels = 3, .height = 6, .width = 8, .measurement_count = 1, .head_count = 2};
  shape.env.head_sizes = {3, 4};
  shape.rollout_steps = 4;
  shape.recurrent_state_count = 3;
  shape.final_capacity = 2;
  return shape;
}

/// Numbers and bytes out of the input, zeros behind its end.
class Input {
 public:
  Input(const uint8_t* data, std::size_t size) : at_(data), end_(data + size) {}
  bool is_empty() const { return at_ == end_; }
  template <typename T>
  T number() {
    T value{};
    const std::size_t count = std::min(sizeof value, static_cast<std::size_t>(end_ - at_));
    std::memcpy(&value, at_, count);
    at_ += count;
    return value;
  }
  std::span<const std::byte> bytes(std::size_t count) {
    count = std::min(count, static_cast<std::size_t>(end_ - at_));
    const std::span<const std::byte> taken(reinterpret_cast<const std::byte*>(at_), count);
    at_ += count;
    return taken;
  }
  std::span<const std::byte> rest() { return bytes(static_cast<std::size_t>(end_ - at_)); }

 private:
  const uint8_t *at_, *end_;
};

inline void require(bool holds) {
  if (!holds) std::abort();
}

}  // namespace comrad::fuzz
