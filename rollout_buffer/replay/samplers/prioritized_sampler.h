// Units with large temporal-difference errors more often, and importance weights that take the bias out
// again.
//
//   p_i = (|TD_i| + 1e-6)^omega,   P(i) = p_i / sum_k p_k,   w_i = (size * P(i))^-beta / max_k w_k
//
// max_k w_k is the weight of the smallest stored priority, so w_i = (min_k p_k / p_i)^beta. A draw of k units
// cuts the probability mass into k equal segments and takes one point of each. New units get the largest p so
// far. Source: Schaul et al. 2016, Prioritized Experience Replay, arXiv:1511.05952, section 3.3, 3.4 and
// appendix B.2.1. Stage: sample.
#pragma once

#include "rollout_buffer/replay/samplers/sampler.h"
#include "rollout_buffer/replay/samplers/sum_tree.h"

namespace comrad::replay {

class PrioritizedSampler : public Sampler {
 public:
  explicit PrioritizedSampler(double omega);

  void push(int64_t count) override;
  void pop(int64_t count) override;
  void draw(int64_t count, double beta, Rng& rng, std::vector<Pick>& picks) const override;
  void set_priorities(std::span<const int64_t> serials, std::span<const float> abs_td) override;
  double least_probability() const override {
    return size() > 0 ? tree_.min_positive() / tree_.total() : 0.0;
  }
  SamplerState state() const override;
  void restore(const SamplerState& state, int64_t count) override;

  double total() const { return tree_.total(); }
  double priority(int64_t serial) const { return tree_.get(leaf_of(serial)); }
  double max_priority() const { return max_priority_; }

 private:
  int64_t leaf_of(int64_t serial) const { return serial & (tree_.capacity() - 1); }
  void grow(int64_t capacity);

  double omega_;
  double max_priority_ = 1;
  SumTree tree_;  // a ring of leaves: live serials are fewer than leaves, so no two share one
};

}  // namespace comrad::replay
