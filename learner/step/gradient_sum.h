// The gradient of a minibatch as the sum over its micro-batches: they are computed side by side and added in their order, so
// that the sum does not depend on which thread was first. Stage: update.
#pragma once

#include <torch/types.h>

#include <algorithm>
#include <cstdint>
#include <functional>
#include <span>
#include <vector>

#include "policy_workers/device/part_pool.h"

namespace comrad::learn {

/// How many micro-batches' gradients are kept until they are added: as many as `threads` make at once and 16 at least (13 MB
/// each, of a network of `small`); one where work goes to a device, which does it in order anyway.
int64_t gradients_held(const std::vector<torch::Tensor>& parameters, int threads);

/// parameters[p].grad += gradients[0][p] + gradients[1][p] + ..., in that order; undefined ones count as 0. On a CPU all of
/// libtorch's threads share the elements. Thread: the learner's.
void add_gradients(const std::vector<torch::Tensor>& parameters,
                   std::span<const std::vector<torch::Tensor>* const> gradients);

/// Adds what `part_of(i)` of every i in [0, count) returns to the parameters' .grad and to `add(part)`. A Part
/// has `gradients`, in the order of the parameters, undefined where the loss does not reach. Parts are freed when they are
/// added. False once keep_going() returned false.
template <typename Part>
bool sum_gradients(device::PartPool& pool, const std::vector<torch::Tensor>& parameters, int64_t count,
                   const std::function<Part(int64_t)>& part_of, const std::function<void(const Part&)>& add,
                   const std::function<bool()>& keep_going) {
  const int64_t held = gradients_held(parameters, pool.threads());
  for (int64_t first = 0; first < count; first += held) {
    std::vector<Part> parts(static_cast<std::size_t>(std::min(held, count - first)));
    const auto work = [&](int64_t i) { parts[static_cast<std::size_t>(i)] = part_of(first + i); };
    if (!pool.run(static_cast<int64_t>(parts.size()), work, keep_going)) return false;
    std::vector<const std::vector<torch::Tensor>*> gradients;
    for (const Part& part : parts) gradients.push_back(&part.gradients);
    add_gradients(parameters, gradients);
    for (const Part& part : parts) add(part);
  }
  return true;
}

}  // namespace comrad::learn
