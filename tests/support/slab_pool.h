// Trajectory slabs in plain memory, for tests that need no arena.
#pragma once

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/schema/trajectory.h"

namespace comrad::test {

/// `count` zeroed slabs; masks are ones, every step is valid and nothing ends.
class SlabPool {
 public:
  SlabPool(const TrajectoryShape& shape, int count)
      : offsets_(shape),
        bytes_(static_cast<std::size_t>(offsets_.slab_bytes) * static_cast<std::size_t>(count)) {
    for (int i = 0; i < count; ++i) {
      const SlabView slab = view(i);
      for (int t = 0; t <= shape.rollout_steps; ++t)
        for (int agent = 0; agent < shape.env.num_agents; ++agent) {
          std::ranges::fill(slab.action_mask(t, agent), uint8_t{1});
          slab.agent_active(t, agent) = 1;
        }
      for (int t = 0; t < shape.rollout_steps; ++t) {
        slab.final_index(t) = -1;
        slab.valid(t) = 1;
      }
    }
  }

  SlabView view(int index) const {
    return SlabView(offsets_,
                    const_cast<std::byte*>(bytes_.data()) +
                        static_cast<std::size_t>(offsets_.slab_bytes) * static_cast<std::size_t>(index));
  }

  /// Fills frames, measurements, rewards, actions, values and behaviour outputs with noise from `seed`.
  void fill_with_noise(uint64_t seed) const {
    Rng rng(seed);
    const TrajectoryShape& shape = offsets_.shape;
    const auto number = [&rng] { return static_cast<float>(rng.uniform() * 2 - 1); };
    for (int64_t i = 0; i < static_cast<int64_t>(bytes_.size()) / offsets_.slab_bytes; ++i) {
      const SlabView slab = view(static_cast<int>(i));
      for (int t = 0; t <= shape.rollout_steps; ++t)
        for (float& x : slab.global_state(t)) x = number();
      for (int agent = 0; agent < shape.env.num_agents; ++agent) {
        for (float& x : slab.recurrent_state(0, agent)) x = number();
        for (int t = 0; t <= shape.rollout_steps; ++t) {
          for (uint8_t& pixel : slab.frame(t, agent)) pixel = static_cast<uint8_t>(rng.next());
          for (float& x : slab.measurement(t, agent)) x = number();
          slab.value(t, agent) = number();
          if (t == shape.rollout_steps) continue;
          for (float& x : slab.logits(t, agent)) x = number();
          for (int head = 0; head < shape.env.head_count; ++head)
            slab.action(t, agent)[static_cast<std::size_t>(head)] = static_cast<int32_t>(
                rng.below(static_cast<uint32_t>(shape.env.head_sizes[static_cast<std::size_t>(head)])));
          slab.reward(t, agent) = number();
          slab.log_prob(t, agent) = -1.0f - static_cast<float>(rng.uniform());
        }
      }
    }
  }

 private:
  SlabOffsets offsets_;
  std::vector<std::byte> bytes_;
};

}  // namespace comrad::test
