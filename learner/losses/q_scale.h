// The unit of a network's Q-values. With normalize_q_values the network predicts Q / sigma, where sigma follows
// the size of the targets, so that errors and gradients are of one size whether a scenario pays 0.01 or 100:
//
//   nu_t    = (1 - beta) nu_{t-1} + beta mean(y^2)        y: the targets of update t, in natural units
//   sigma_t = sqrt(nu_t / (1 - (1 - beta)^t))             within [1e-4, 1e6]; beta = 1e-3
//
// Sigma moves at each of the first updates and then at every 64th, so that a learner seldom waits for its device. When it moves,
// the last layers are divided by as much, so Q-values in natural units stay (QLearning::rescale_outputs). That is PopArt with its
// scale alone: a shift would not pass through a mixer. Until the first reward nothing is known of the size, and sigma is 1; then it
// begins with the size of that batch's rewards.
// Source: van Hasselt et al. 2016, Learning values across many orders of magnitude, arXiv:1602.07714, eqs. 5-7
// and proposition 1. Stage: update, checkpoint.
#pragma once

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/version.h"

namespace comrad::learn {

class QScale {
 public:
  double sigma() const { return sigma_; }
  bool has_begun() const { return has_begun_; }

  /// The first size, of rewards; nothing that was predicted before is kept. Nothing happens at 0.
  void begin(double reward_rms);
  /// Continues from networks that were trained in natural units: sigma is 1 until the next move().
  void begin_natural();
  /// An update's targets had this mean square.
  void observe(double target_mean_square);
  /// Whether sigma moves after the update that made `version`.
  bool is_due(PolicyVersion version) const;
  /// Sigma follows what was observed. Returns it.
  double move();

  /// Section "q_scale".
  void save(StateDict& state) const;
  static bool is_in(const StateDict& state) { return state.has("q_scale/sigma"); }
  /// Errors: kBadFormat.
  static Expected<QScale> load(const StateDict& state);

 private:
  double sigma_ = 1;
  double mean_square_ = 0;  ///< nu, not debiased
  double weight_ = 0;       ///< 1 - (1 - beta)^t
  bool has_begun_ = false;
};

}  // namespace comrad::learn
