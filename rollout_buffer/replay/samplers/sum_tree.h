// Leaves with a weight each, drawn in proportion to it: a complete binary tree whose inner nodes hold the sum
// and the smallest positive weight below them. Nodes are computed from their children, never adjusted by
// differences, so rounding does not pile up. Stage: sample.
#pragma once

#include <cstdint>
#include <vector>

namespace comrad::replay {

class SumTree {
 public:
  /// All leaves 0. `capacity` is rounded up to a power of two.
  explicit SumTree(int64_t capacity = 1);

  int64_t capacity() const { return capacity_; }
  /// `weight` is finite and >= 0; 0 takes the leaf out. O(log capacity).
  void set(int64_t leaf, double weight);
  double get(int64_t leaf) const { return nodes_[static_cast<std::size_t>(capacity_ + leaf)].sum; }
  double total() const { return nodes_[1].sum; }
  /// The smallest positive weight, exactly; infinity where there is none.
  double min_positive() const { return nodes_[1].min; }
  /// The leaf in which the running sum of weights passes `mass`, 0 <= mass < total(); always one with a
  /// positive weight, also where rounding moved `mass` a little. The tree must not be empty.
  int64_t find(double mass) const;

 private:
  struct Node {
    double sum = 0;
    double min = 0;
  };
  int64_t capacity_;
  std::vector<Node> nodes_;  // root 1, children of n at 2n and 2n+1, leaf i at capacity + i
};

}  // namespace comrad::replay
