// Temporal-difference targets of Q-learning over sequences, from rewards and the value of the observation
// after each step; single transitions are sequences of one step. Also the loss on their error. Stage: update,
// before the loss; no gradient goes through a target.
#pragma once

#include <torch/types.h>

#include <cstdint>

namespace comrad::learn {

using torch::Tensor;

/// A batch of sequences, B columns; all on one device. Where the episode terminated and where a step is
/// invalid, next_value is not read.
struct TdInput {
  Tensor reward;      ///< f32 [T, B]
  Tensor terminated;  ///< u8  [T, B]  the episode ended in a state without future
  Tensor truncated;   ///< u8  [T, B]  the episode was cut by a time limit
  Tensor next_value;  ///< f32 [T, B]  V_t: value of the true observation after step t; where time cut the
                      ///<             episode, that of its last observation
  Tensor valid;       ///< u8  [T, B]  0: padding or a broken step; no return runs across it
};

struct TdOptions {
  double gamma = 0.99;
  int64_t n_step = 1;            ///< rewards in a target, at most
  double lambda = -1;            ///< 0..1: TD(lambda) instead of n_step; negative: off
  bool legacy_timeouts = false;  ///< treat time-outs as terminal
};

/// Targets f32 [T, B], detached; 0 at invalid steps.
///
///   end_t  = r_t + gamma V_t, without V_t where the episode terminated
///   G_t    = sum_{k<m} gamma^k r_{t+k} + gamma^m V_{t+m-1}, the last term as above               (n-step)
///            m = steps until n, the end of the episode, an invalid step or the end of the data
///   G_t    = r_t + gamma ((1 - lambda) V_t + lambda G_{t+1}) where step t+1 continues, else end_t (TD(lambda))
///
/// Errors: none at run time; shapes are checked.  Threads: pure function.
/// Source: Sutton and Barto 2018, eqs. 7.1 and 12.2 in the recursive form; time limits: Pardo et al. 2018,
/// arXiv:1712.00378, eq. 8.
Tensor td_targets(const TdInput& input, const TdOptions& options);

/// e^2 / 2 within +-1, |e| - 1/2 outside, of every entry. Source: Huber 1964, with delta = 1.
Tensor huber(const Tensor& error);

}  // namespace comrad::learn
