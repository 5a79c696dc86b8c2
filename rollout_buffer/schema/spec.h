// The shapes of one run: how many agents, what they see, what they choose. Everything that is sized at
// start-up is sized from here; the arena's header carries a copy, so that a process that joins needs no
// other source.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad {

constexpr int kMaxAgents = 8;
constexpr int kMaxHeads = 8;

/// Shapes of observations and actions, fixed for a run. Trivially copyable: it lies in shared memory as
/// it is.
struct EnvShape {
  int32_t num_agents = 2;                       ///< N
  int32_t channels = 3;                         ///< C of a frame
  int32_t height = 72;                          ///< H of a frame
  int32_t width = 128;                          ///< W of a frame
  int32_t measurement_count = 0;                ///< M; 0 where the scenario has no vector
  int32_t global_state_count = 0;               ///< S of a world's true state; 0 where no critic requests it
  int32_t head_count = 3;                       ///< factorised action heads
  std::array<int32_t, kMaxHeads> head_sizes{};  ///< choices of each head, index 0 = "no button"

  int64_t frame_bytes() const { return int64_t{channels} * height * width; }  ///< one agent's frame, u8
  int32_t logit_count() const;                                                ///< sum of head sizes
  int64_t joint_action_count() const;                                         ///< product of head sizes, |A|
};

/// Shapes of one trajectory slab and its pool (design: "Trajectory slab").
struct TrajectoryShape {
  EnvShape env;
  int32_t rollout_steps = 32;           ///< T
  int32_t recurrent_state_count = 512;  ///< H floats per agent; GRU 512, LSTM 1024 (h then c); 0 without RNN
  int32_t recurrent_snapshots = 1;      ///< S: 1 (start of the slab) or T+1
  int32_t final_capacity = 4;           ///< K: episodes that may end inside one slab
};

/// Checks ranges (agents 1..8, heads 1..8 of size 2..32, positive sizes).
/// Errors: kBadInput naming the field, its value and its range.
Status validate(const TrajectoryShape& shape);

}  // namespace comrad
