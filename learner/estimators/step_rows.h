// A batch's tensors as Eigen arrays: row t holds step t of all trajectories, so that a recursion over time is
// one line a term. Stage: update, before the loss.
#pragma once

#include <torch/types.h>

#include <Eigen/Core>

#include "rollout_buffer/core/check.h"

namespace comrad::learn {

using torch::Tensor;

template <typename T>
using StepRows = Eigen::Map<Eigen::Array<T, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>>;

/// One step of all trajectories, in double: 4096-step rollouts keep their last digits.
using StepRow = Eigen::Array<double, 1, Eigen::Dynamic>;
using StepMask = Eigen::Array<bool, 1, Eigen::Dynamic>;

/// The entries of a contiguous CPU tensor [steps, columns], not copied: the tensor must outlive the result.
template <typename T>
StepRows<T> step_rows(const Tensor& tensor, int64_t steps, int64_t columns) {
  COMRAD_CHECK(tensor.defined() && tensor.sizes() == at::IntArrayRef({steps, columns}),
               "estimator input has the batch's shape");
  COMRAD_CHECK(tensor.is_contiguous() && tensor.device().is_cpu(),
               "estimator input is contiguous on the CPU");
  return {tensor.data_ptr<T>(), steps, columns};
}

/// Which trajectories' episodes end in a step, and which of them continue from the value of their last
/// observation: a time-out does not terminate the episode, unless `legacy_timeouts` is on.
struct StepEnds {
  StepMask done, bootstraps;
};

inline StepEnds step_ends(const StepRows<uint8_t>& terminated, const StepRows<uint8_t>& truncated, int64_t t,
                          bool legacy_timeouts) {
  const StepMask by_rules = terminated.row(t) != 0, by_time = truncated.row(t) != 0;
  return {.done = by_rules || by_time,
          .bootstraps = by_time && !by_rules && StepMask::Constant(by_time.size(), !legacy_timeouts)};
}

}  // namespace comrad::learn
