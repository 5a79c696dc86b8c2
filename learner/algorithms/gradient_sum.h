// The gradient of a minibatch as the sum over its micro-batches, computed side by side and added in their
// order, so that the sum does not depend on which thread was first. Stage: update.
#pragma once

#include <torch/types.h>

#include <functional>
#include <mutex>
#include <optional>
#include <vector>

#include "policy_workers/device/part_pool.h"
#include "policy_workers/policy/torch_ops.h"

namespace comrad::learn {

/// Adds what `part_of(i)` of every i in [0, count) says to the parameters' .grad and to `add(part)`. A Part
/// has `gradients`, in the order of the parameters, undefined where the loss does not reach. A part that is
/// done waits for those before it, then it is freed. False when keep_going() said no.
template <typename Part>
bool sum_gradients(device::PartPool& pool, const std::vector<torch::Tensor>& parameters, int64_t count,
                   const std::function<Part(int64_t)>& part_of, const std::function<void(const Part&)>& add,
                   const std::function<bool()>& keep_going) {
  std::mutex adding;
  std::vector<std::optional<Part>> waiting(static_cast<std::size_t>(count));
  std::size_t added = 0;
  const auto work = [&](int64_t i) {
    Part made = part_of(i);
    const torch::NoGradGuard no_grad;
    const std::lock_guard lock(adding);
    waiting[static_cast<std::size_t>(i)] = std::move(made);
    for (; added < waiting.size() && waiting[added]; ++added) {
      const Part& part = *waiting[added];
      for (std::size_t p = 0; p < parameters.size(); ++p) {
        if (!part.gradients[p].defined()) continue;
        torch::Tensor& sum = parameters[p].mutable_grad();
        if (sum.defined())
          sum.add_(part.gradients[p]);
        else
          sum = part.gradients[p].clone();
      }
      add(part);
      waiting[added].reset();
    }
  };
  return pool.run(count, work, keep_going);
}

}  // namespace comrad::learn
