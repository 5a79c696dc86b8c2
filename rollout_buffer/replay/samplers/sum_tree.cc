#include "rollout_buffer/replay/samplers/sum_tree.h"

#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "rollout_buffer/core/check.h"

namespace comrad::replay {

SumTree::SumTree(int64_t capacity)
    : capacity_(static_cast<int64_t>(std::bit_ceil(static_cast<uint64_t>(std::max<int64_t>(capacity, 1))))),
      nodes_(static_cast<std::size_t>(2 * capacity_), Node{0, std::numeric_limits<double>::infinity()}) {}

void SumTree::set(int64_t leaf, double weight) {
  COMRAD_CHECK(leaf >= 0 && leaf < capacity_, "the leaf exists");
  COMRAD_CHECK(std::isfinite(weight) && weight >= 0, "a weight is finite and not negative");
  auto node = static_cast<std::size_t>(capacity_ + leaf);
  nodes_[node] = {weight, weight > 0 ? weight : std::numeric_limits<double>::infinity()};
  while (node > 1) {
    node /= 2;
    const Node &left = nodes_[2 * node], &right = nodes_[2 * node + 1];
    nodes_[node] = {left.sum + right.sum, std::min(left.min, right.min)};
  }
}

int64_t SumTree::find(double mass) const {
  COMRAD_CHECK(total() > 0, "there is something to draw");
  std::size_t node = 1;
  while (node < static_cast<std::size_t>(capacity_)) {
    const Node &left = nodes_[2 * node], &right = nodes_[2 * node + 1];
    if (mass < left.sum || right.sum <= 0) {
      node = 2 * node;
    } else {
      mass -= left.sum;
      node = 2 * node + 1;
    }
  }
  return static_cast<int64_t>(node) - capacity_;
}

}  // namespace comrad::replay
