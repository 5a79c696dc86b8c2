// How the learning rate moves: as --learning_rate sets it over env frames, linearly to zero at the run's end, or after the KL
// between new and behaviour policy. Stage: update, checkpoint.
#pragma once

#include <cstdint>
#include <string>

#include "learner/checkpoint/checkpoint.h"
#include "learner/schedules/linear_schedule.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// The learning rate of one optimizer. Its position is a function of the run's env frames (linear_decay) or
/// the current rate itself (kl_adaptive_*).
class LrSchedule {
 public:
  explicit LrSchedule(const RunConfig& config);

  double learning_rate() const { return learning_rate_; }
  /// Whether the KL of every minibatch, or of every epoch, must be known before the next one.
  bool follows_minibatches() const { return kind_ == RateSchedule::kKlAdaptiveMinibatch; }
  bool follows_epochs() const { return kind_ == RateSchedule::kKlAdaptiveEpoch; }
  /// Before a batch is trained: `env_frames` counted so far. The setting's own schedule moves here, and linear_decay:
  /// lr = lr_0 * max(0, 1 - env_frames / train_for_env_frames). A run that is resumed with another
  /// train_for_env_frames continues from the rate it had, in a line to 0 at the new end (linear_schedule.h).
  void before_batch(double env_frames);
  /// After an optimizer step with the minibatch's mean KL; kl_adaptive_minibatch moves here.
  void after_minibatch(double kl);
  /// After an epoch with the mean KL of its minibatches; kl_adaptive_epoch moves here.
  void after_epoch(double mean_kl);

  /// Section "schedule" of a checkpoint.
  void save(StateDict& state) const;
  /// Constant and linear schedules follow this run's flags, the latter on its saved line; the adaptive ones
  /// live from their last position. Errors: kBadFormat.
  Status load(const StateDict& state);

 private:
  void adapt(double kl);

  RateSchedule kind_;
  Schedule rate_;  // kConstant, which may be its own schedule
  double learning_rate_ = 0;
  double env_frames_ = 0;  // of the last batch
  LinearSchedule line_;    // kLinearDecay
  double kl_threshold_ = 0;
  double min_ = 0;
  double max_ = 0;
};

}  // namespace comrad::learn
