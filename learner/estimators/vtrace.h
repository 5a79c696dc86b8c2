// V-trace: value targets and policy-gradient advantages of trajectories that an older policy collected.
// Stage: update, before the loss; on the CPU, with Eigen.
#pragma once

#include <torch/types.h>

#include "learner/estimators/gae.h"

namespace comrad::learn {

/// Caps of the importance weights.
struct VtraceOptions {
  double gamma = 0.99;
  double rho_clip = 1.0;
  double c_clip = 1.0;
  bool legacy_timeouts = false;  ///< treat time-outs as terminal
};

/// V-trace with a true bootstrap, x = min(ratio, cap):
///
///   delta_t = rho_t (r_t + gamma N_t - V_t)      N_t = V_{t+1}; terminated: 0; truncated: V(final_t)
///   vs_t    = V_t + delta_t + gamma (1 - d_t) c_t (vs_{t+1} - V_{t+1})
///   adv_t   = rho_t (r_t + gamma M_t - V_t)      M_t = vs_{t+1}, with the same exceptions
///
///   log_rho  f32 [T, B]  log pi(a|o) - log mu(a|o), learner minus behaviour policy
///   returns  advantage and target (vs), f32 [T, B], detached. `valid` is not read: callers mask the loss.
///
/// Errors: none at run time; shapes are checked.  Threads: pure function.
/// Source: Espeholt et al. 2018, IMPALA, arXiv:1802.01561, eq. 1 and section 4.2.
Advantages vtrace(const Tensor& log_rho, const ReturnInput& input, const VtraceOptions& options);

}  // namespace comrad::learn
