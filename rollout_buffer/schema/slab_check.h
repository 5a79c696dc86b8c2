// What a slab may be trusted with. Other processes write it, and may still write while it is read, so every number is
// copied once, then judged; what is broken becomes a harmless number, and the check reports it. Used by the learner's
// batches and by the replay: both call the same decision broken. Stage: drain.
#pragma once

#include <cstdint>
#include <span>

#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/schema/trajectory.h"

namespace comrad {

bool all_finite(std::span<const float> numbers);

/// Copies `source` to `target`. False, and zeros, where one of them is not finite.
bool take_floats(std::span<const float> source, float* target);

/// Copies one agent's mask [A] as 0 and 1. False, and all ones, where a head has nothing allowed: that breaks the
/// decision of an agent that is alive. A dead one decides nothing; as a broken decision it would take what is paid now
/// with it.
bool take_mask(const EnvShape& env, std::span<const uint8_t> source, uint8_t* target);

/// Copies one agent's choices [heads] to `u8` or `i64`. False where one lies outside its head; it becomes 0.
template <typename Choice>
bool take_action(const EnvShape& env, std::span<const int32_t> source, Choice* target) {
  bool is_sound = true;
  for (std::size_t head = 0; head < source.size(); ++head) {
    const int32_t choice = source[head];
    const bool is_in_range = choice >= 0 && choice < env.head_sizes[head];
    target[head] = is_in_range ? static_cast<Choice>(choice) : Choice{0};
    is_sound &= is_in_range;
  }
  return is_sound;
}

/// How a step ended.
struct StepEnd {
  bool is_terminated = false;
  bool is_truncated = false;
  int32_t final_row = -1;  ///< of the true last observation of a truncated step; -1: there is none
  bool is_sound = true;    ///< false: the row is out of range, or a truncated step has none
};
StepEnd take_end(const SlabView& slab, int step);

}  // namespace comrad
