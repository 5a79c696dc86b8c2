// Generalised advantage estimation over sealed trajectories: from rewards and the behaviour policy's values
// to advantages and return targets. Stage: update, before the loss; on the CPU, with Eigen.
#pragma once

#include <torch/types.h>

namespace comrad::learn {

using torch::Tensor;

/// What one trajectory batch gives to an estimator; all on the CPU, B rows = trajectories of single agents.
struct ReturnInput {
  Tensor reward;       ///< f32 [T, B]
  Tensor terminated;   ///< u8  [T, B]    the episode ended in a state without future
  Tensor truncated;    ///< u8  [T, B]    the episode was cut by a time limit
  Tensor value;        ///< f32 [T+1, B]  denormalised; the last row bootstraps
  Tensor final_value;  ///< f32 [T, B]    value of the true last observation where truncated, else unread
  Tensor valid;        ///< u8  [T, B]    v_t: the transition may be learned from
  Tensor value_valid;  ///< u8  [T+1, B]  v of the value rows; row T repeats the validity of row T-1
};

struct GaeOptions {
  double gamma = 0.99;
  double lambda = 0.95;
  bool legacy_timeouts = false;  ///< treat time-outs as terminal
};

/// Advantages and returns, f32 [T, B]; entries of invalid steps have no meaning.
struct Advantages {
  Tensor advantage;
  Tensor target;  ///< advantage + value
};

/// GAE(gamma, lambda) with validity masks and a true bootstrap at time-outs:
///
///   d_t     = terminated_t or truncated_t
///   delta_t = (r_t - V_t) v_t + (1 - d_t) gamma V_{t+1} v_{t+1} + [truncated_t] gamma V(final_t) v_t
///   A_t     = delta_t + (v_t ? gamma lambda : 1) (1 - d_t) A_{t+1}
///
/// so an invalid step is transparent: the advantage behind it passes through undiscounted.
/// Errors: none at run time; shapes are checked.  Threads: pure function.
/// Source: Schulman et al. 2016, arXiv:1506.02438, eq. 16; time limits: Pardo et al. 2018, arXiv:1712.00378,
/// eq. 8.
Advantages gae(const ReturnInput& input, const GaeOptions& options);

}  // namespace comrad::learn
