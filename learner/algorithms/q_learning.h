// What the algorithms that learn Q-values share: online and target network (and mixer), Q-values of stored
// observations and of those behind them, reports and checkpoints. Idqn and ValueDecomposition say what a sample's
// loss is; losses/td_loss.h is their mean, step/step_runner.h the step.
//
//   y     = r + gamma (1 - terminated) Q_target(o', a*)      a* = argmax_a Q(o', a), of the online network
//   loss  = mean over valid samples of w huber(Q(o, a) - y)  (double_dqn; squared error: use_huber_loss off)
//
// o' is the true observation behind the step: where time cut an episode, its own last one, with the recurrent
// state that led there, and never the first of the next episode. Sequences start from the state stored when
// they were played. Source: van Hasselt et al. 2016, arXiv:1509.06461.
// With normalize_q_values a network's Q is in units of sigma (q_scale.h); y, the clamp and all reports are in
// natural units, the loss compares Q and y / sigma. Stage: update.
//
// With q_reset_every_updates = K, after every K-th step the decoder, the action heads and the mixer of both networks are drawn
// anew, their moments of Adam are 0, and encoder and core w become (1 - s) w + s w', s = q_reset_fresh_share and w' as fresh:
// networks that have fitted early targets lose the ability to fit later ones, and the replay teaches the fresh layers soon.
// Source: Schwarzer et al. 2023, BBF, arXiv:2305.19452, section 4 (shrink and perturb: Ash and Adams 2020, arXiv:1910.08475).
//
// Several ranks take one step on B samples, of which each of the N draws B / N from its own replay. Gradients, counts
// and reports are over all of them. A unit i of rank k, whose M_k units have the priorities p with the sum S_k, is drawn
// with the probability q_i = p_i / (N S_k); that is the p_i / S of one replay where the S_k are equal. As there
// (prioritized_sampler.h) its weight takes the bias out again, relative to the largest weight of all ranks:
//
//   w_i = (M q_i)^-beta / max_j (M q_j)^-beta = (p_min,k / p_i)^beta f_k
//   f_k = (l_min / l_k)^beta      l_k = p_min,k / S_k, the smallest probability inside rank k; l_min the smallest l_k
//
// The replay of rank k gives the first factor, QLearning::update the second. Without priorities l_k is 1 / M_k and beta
// 1: units of the ranks count alike, however many each has. A rank's new units have the largest priority that it has seen.
#pragma once

#include <torch/types.h>

#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "learner/critics/mixer.h"
#include "learner/critics/td_scene.h"
#include "learner/losses/q_scale.h"
#include "learner/losses/td_loss.h"
#include "learner/schedules/lr_schedule.h"
#include "learner/step/launched_steps.h"
#include "learner/step/step_runner.h"
#include "learner/step/target_parameters.h"
#include "policy_workers/network/actor_critic.h"

namespace comrad::learn {

class QLearning : public OffPolicyAlgorithm {
 public:
  PolicyVersion version() const override { return runner_.version(); }
  int64_t parameter_count() const override;
  std::vector<Tensor> weight_tensors() const override { return net_.weight_tensors(); }
  int64_t weights_bytes() const override { return net_.weights_bytes(); }
  std::vector<std::byte> weights() const override { return net_.weights(); }
  void append_diagnostics(NamedNumbers& values) const override;
  Status learn_with(RankGroup& ranks) override;
  void settle() override;
  void save(StateDict& state) const override;
  Status load(const StateDict& state) override;

  void observe(const Tensor& frame, const Tensor& measurement, const Tensor& global_state) override;
  Expected<UpdateStats> update(ReplayBatch& batch, const UpdateContext& context) override;

  /// Adds the gradient of the loss over a whole batch to the parameters' .grad and writes batch.abs_td (td_loss.h). False when
  /// keep_going() returned false.
  bool accumulate_gradient(ReplayBatch& batch, const UpdateContext& context, TermValues& terms);

  /// What the networks' Q-values are multiplied by to be in natural units; 1 without normalize_q_values.
  double q_sigma() const { return scale_.sigma(); }
  /// Rescales the last layers of the online and target networks (of mixers that are not linear in the utilities,
  /// their own) from units of `before` to units of `after`: Q-values in natural units stay, to f32 rounding.
  void rescale_outputs(double before, double after);

  const policy::ActorCritic& net() const { return net_; }
  const policy::ActorCritic& target_net() const { return target_net_; }
  const Mixer* mixer() const { return mixer_.get(); }
  /// Of the network, then of the mixer; and those of the targets.
  const std::vector<Tensor>& parameters() const { return optimizer_.parameters(); }
  const std::vector<Tensor>& target_parameters() const { return targets_.tensors(); }

 protected:
  QLearning(const RunConfig& config, const EnvShape& env, torch::Device device);

  using Scene = TdScene;
  virtual SampleLoss loss_of(const Scene& scene) const = 0;
  /// u8 [T, S]: samples that count.
  virtual Tensor sample_valid(const ReplayBatch& batch) const = 0;

  /// The actions that a target looks at, i64 [T, R, heads]: with double_dqn the online network's choice, else
  /// the target network's own (van Hasselt et al. 2016, equation 4).
  Tensor next_action(const Scene& scene) const;
  /// Of targets over sequences at this batch; single decisions come with theirs.
  int64_t n_step() const { return n_step_; }
  /// The loss of an error by use_huber_loss.
  Tensor loss_of_error(const Tensor& error) const;

  RunConfig config_;
  EnvShape env_;
  torch::Device device_;
  policy::ActorCritic net_, target_net_;
  std::unique_ptr<Mixer> mixer_, target_mixer_;  ///< null: values of agents are not mixed

 private:
  class Input;
  /// Of a batch of all ranks.
  struct Totals {
    double valid = 0, places = 0;
    double trained = 0;  ///< valid behind the burn-in, 1 at least: what means divide by
    double worlds = 0;
    double rewards_read = 0, rewards_clipped = 0;
    double least_probability = 0;  ///< the smallest of the ranks'
  };
  /// Puts what changes over the run where it stands at these env frames.
  void place_schedules(double env_frames);
  bool is_reset_due() const;
  bool is_scale_due() const { return config_.q_learning.normalize_q_values && scale_.is_due(version()); }
  /// The unit of Q-values follows the targets of steps that were taken.
  void see(const StepOutcome& outcome);
  /// Outcomes that are there, or all; that of this update's step where it is among them. Errors: as StepRunner::status.
  Expected<std::optional<StepOutcome>> complete_steps(bool waits, UpdateStats& stats);
  /// At the versions of q_reset_every_updates; what it draws is a function of the run's seed and the version.
  void reset();
  Totals totals_of(const ReplayBatch& batch);
  StepRequest request_for(Input& input, const Totals& totals, const UpdateContext& context);
  /// The micro-batches of a batch, all on the device before the step begins.
  std::vector<ReplayPart> parts_of(const ReplayBatch& batch) const;
  LossTerms loss_of_part(const ReplayPart& part, std::span<const Tensor> scalars) const;
  /// Whether QMIX's mixer gives utilities their unit: then they have none themselves.
  bool utilities_have_a_unit() const { return !mixer_ || mixer_->scales_with_utilities(); }
  void report(const StepOutcome& outcome, const Totals& totals, UpdateStats& stats) const;
  int64_t micro_worlds(const ReplayBatch& batch) const;
  RankGroup& ranks() const { return runner_.ranks(); }

  AdamOptimizer optimizer_;
  TargetParameters targets_;
  LrSchedule schedule_;
  QScale scale_;
  StepRunner runner_;
  LaunchedSteps launched_;
  int64_t n_step_;       ///< n_step's schedule at the last batch
  int64_t updates_ = 0;  ///< batches seen
};

}  // namespace comrad::learn
