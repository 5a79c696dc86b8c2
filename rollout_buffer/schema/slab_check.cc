#include "rollout_buffer/schema/slab_check.h"

#include <algorithm>
#include <cmath>

namespace comrad {

bool all_finite(std::span<const float> numbers) {
  return std::ranges::all_of(numbers, [](float number) { return std::isfinite(number); });
}

bool take_floats(std::span<const float> source, float* target) {
  std::ranges::copy(source, target);
  if (all_finite({target, source.size()})) return true;
  std::fill_n(target, source.size(), 0.0f);
  return false;
}

bool take_mask(const EnvShape& env, std::span<const uint8_t> source, uint8_t* target) {
  bool is_sound = true;
  std::size_t choice = 0;
  for (int head = 0; head < env.head_count; ++head) {
    bool any_allowed = false;
    for (int i = 0; i < env.head_sizes[static_cast<std::size_t>(head)]; ++i, ++choice) {
      target[choice] = source[choice] != 0;
      any_allowed |= target[choice] != 0;
    }
    is_sound &= any_allowed;
  }
  if (!is_sound) std::fill_n(target, source.size(), uint8_t{1});
  return is_sound;
}

StepEnd take_end(const SlabView& slab, int step) {
  const int32_t row = slab.final_index(step);
  StepEnd end;
  end.is_terminated = slab.terminated(step) != 0;
  end.is_truncated = slab.truncated(step) != 0;
  end.is_sound = row >= -1 && row < slab.shape().final_capacity && (!end.is_truncated || row >= 0);
  if (end.is_truncated && end.is_sound) end.final_row = row;
  return end;
}

}  // namespace comrad
