#include "rollout_buffer/replay/samplers/prioritized_sampler.h"

#include <algorithm>
#include <cmath>

#include "rollout_buffer/core/check.h"

namespace comrad::replay {
namespace {

constexpr double kSmallestError = 1e-6;  // added to |TD|, so that nothing is never drawn again
constexpr int64_t kFirstLeaves = 1024;

}  // namespace

PrioritizedSampler::PrioritizedSampler(double omega) : omega_(omega), tree_(kFirstLeaves) {}

void PrioritizedSampler::grow(int64_t capacity) {
  const SumTree before = std::move(tree_);
  tree_ = SumTree(capacity);
  for (int64_t serial = first_; serial < end_; ++serial)
    tree_.set(leaf_of(serial), before.get(serial & (before.capacity() - 1)));
}

void PrioritizedSampler::push(int64_t count) {
  if (size() + count > tree_.capacity()) grow(2 * (size() + count));
  for (; count > 0; --count) tree_.set(leaf_of(end_++), max_priority_);
}

void PrioritizedSampler::pop(int64_t count) {
  COMRAD_CHECK(count >= 0 && count <= size(), "only units that are there leave");
  for (; count > 0; --count) tree_.set(leaf_of(first_++), 0);
}

void PrioritizedSampler::draw(int64_t count, double beta, Rng& rng, std::vector<Pick>& picks) const {
  if (size() == 0) return;
  const double segment = tree_.total() / static_cast<double>(count), smallest = tree_.min_positive();
  for (int64_t i = 0; i < count; ++i) {
    const int64_t leaf = tree_.find((static_cast<double>(i) + rng.uniform()) * segment);
    // The only live serial on this leaf.
    const int64_t serial = first_ + ((leaf - first_) & (tree_.capacity() - 1));
    picks.push_back({.serial = serial, .weight = std::pow(smallest / tree_.get(leaf), beta)});
  }
}

void PrioritizedSampler::set_priorities(std::span<const int64_t> serials, std::span<const float> abs_td) {
  COMRAD_CHECK(serials.size() == abs_td.size(), "one error for each unit");
  for (std::size_t i = 0; i < serials.size(); ++i) {
    if (!contains(serials[i]) || !std::isfinite(abs_td[i])) continue;
    const double priority = std::pow(std::abs(static_cast<double>(abs_td[i])) + kSmallestError, omega_);
    tree_.set(leaf_of(serials[i]), priority);
    max_priority_ = std::max(max_priority_, priority);
  }
}

SamplerState PrioritizedSampler::state() const {
  SamplerState state{.first = first_, .leaf_capacity = tree_.capacity(), .max_priority = max_priority_};
  state.priorities.reserve(static_cast<std::size_t>(size()));
  for (int64_t serial = first_; serial < end_; ++serial) state.priorities.push_back(priority(serial));
  return state;
}

void PrioritizedSampler::restore(const SamplerState& state, int64_t count) {
  first_ = end_ = state.first;
  max_priority_ = state.max_priority;
  // The same number of leaves gives the same sums in the same order, and so the same draws.
  tree_ = SumTree(std::max({state.leaf_capacity, count, kFirstLeaves}));
  for (int64_t i = 0; i < count; ++i) {
    const bool known = static_cast<std::size_t>(i) < state.priorities.size();
    tree_.set(leaf_of(end_++), known ? state.priorities[static_cast<std::size_t>(i)] : max_priority_);
  }
}

}  // namespace comrad::replay
