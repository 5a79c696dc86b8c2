// What the on-policy algorithms share: lag filter, input statistics, advantages and normalised returns, the
// loop over epochs and minibatches, PPO's loss accumulated over micro-batches, the guarded optimizer step,
// reports and checkpoints. Ippo, Mappo and Happo say which networks an optimizer trains on which rows, in
// which order.
//
//   ratio  = clamp(exp(log pi - log mu), 0.05, 20)
//   loss   = - mean min(ratio A, clip(ratio, 1/(1+eps), 1+eps) A)             eps = ppo_clip_ratio
//            + value_loss_coeff mean max((V-R)^2, (V_old + clamp(V-V_old, +-ppo_clip_value) - R)^2)
//            + exploration_loss_coeff mean exploration(pi) + kl_loss_coeff mean KL(pi, mu)
//
// exploration being the symmetric KL to the uniform distribution or the negative entropy; V and R in
// normalised units. The value's mean runs over valid samples, the others over those of them in which the
// agent was alive (RolloutBatch::acting): a dead agent's actions teach nothing, but its values go on being
// trained, because GAE carries what is paid after a death through them to the last living decision.
// Back-propagation through time runs over the whole rollout. Source: Schulman et al. 2017,
// arXiv:1707.06347. Stage: update.
#pragma once

#include <torch/types.h>

#include <array>
#include <deque>
#include <functional>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "learner/algorithms/adam_optimizer.h"
#include "learner/algorithms/algorithm.h"
#include "learner/algorithms/lr_schedule.h"
#include "learner/algorithms/step_guard.h"
#include "learner/batch/normalizer.h"
#include "policy_workers/device/part_pool.h"
#include "policy_workers/device/readback.h"
#include "policy_workers/policy/policy_net.h"

namespace comrad::learn {

class OnPolicy : public OnPolicyAlgorithm {
 public:
  PolicyVersion version() const override { return version_; }
  int64_t parameter_count() const override { return net_.parameter_count(); }
  int64_t weights_bytes() const override { return net_.weights_bytes(); }
  void copy_weights(device::Snapshot& into) const override { net_.copy_weights(into); }
  std::vector<std::byte> weights() const override { return net_.weights(); }
  void append_diagnostics(NamedNumbers& values) const override;
  Status learn_with(RankGroup& ranks) override;
  void save(StateDict& state) const override;
  Status load(const StateDict& state) override;

  /// Fills `advantage` and `target` of a lag-filtered batch: GAE on denormalised values with a true bootstrap
  /// at time-outs, then the returns enter the running statistics and become normalised targets.
  void prepare_targets(RolloutBatch& batch);

  /// Sums that one minibatch collects over its micro-batches: means over valid samples of what is said of
  /// values, over acting ones of what is said of the policy.
  struct LossSums {
    double policy = 0, value = 0, exploration = 0, kl_penalty = 0;
    double kl = 0, kl_max = 0, entropy = 0, predicted_value = 0, value_delta = 0, value_delta_max = 0;
    double ratio = 0, ratio_min = kRatioUnset, ratio_max = 0, clipped = 0, log_prob_max = 0;
    double value_clipped = 0;  ///< share in which ppo_clip_value decides about the value loss
    double kl_first = 0,
           clipped_first = 0;  ///< of the phase's first minibatch, before its first step: staleness
    std::array<double, kMaxHeads> head_entropy{};
    bool has_policy = false;  ///< some sample was an acting one, and the phase trains the policy
    static constexpr double kRatioUnset = 1e30;
    double actor() const { return policy + exploration + kl_penalty; }
    double total() const { return actor() + value; }
    /// Adds the sums of another micro-batch of the same minibatch.
    void add(const LossSums& part);
    /// Adds what `part` knows of the policy, in the proportion `share`; extremes are merged.
    void add_policy(const LossSums& part, double share);
    /// Takes over what `part` knows of the value.
    void take_value(const LossSums& part);
  };

  const policy::PolicyNet& net() const { return net_; }
  const ReturnNormalizer& return_normalizer() const { return returns_; }

 protected:
  OnPolicy(const RunConfig& config, const EnvShape& env, torch::Device device);

  /// The networks' outputs for rows of a minibatch; undefined logits or values leave their losses out.
  using Forward = std::function<policy::SequenceOutput(const policy::SequenceInput&)>;

  /// Some epochs over some rows with one optimizer.
  struct Phase {
    AdamOptimizer& optimizer;
    Forward forward;
    bool trains_policy = true;  ///< KL and actor loss say when to stop
    bool trains_value = true;   ///< a minibatch without an acting sample is trained on, too
    uint64_t shuffle_key = 0;   ///< tells the phases of one update apart
    /// Called with every minibatch before its gradient; may be empty.
    std::function<void(RolloutBatch&)> prepare = {};
    /// Set to log pi(a|o) [T, rows] of the first minibatch before the first step.
    Tensor* first_log_prob = nullptr;
  };
  enum class PhaseEnd { kDone, kStopped, kAbandoned };

  /// Moves the schedule, filters by lag, updates input statistics. False when nothing valid is left. Errors:
  /// kBadInput where that was so in too many batches in a row.
  Expected<bool> begin_update(RolloutBatch& batch, const UpdateContext& context, UpdateStats& stats);
  /// num_epochs x num_batches_per_epoch optimizer steps on a batch, moved to the device where to_device() did not; `sums` are those of the last one
  /// taken. What a step says of itself is read once, when the phase is over, unless settings ask for it earlier: a rate or
  /// an early stop that follows the KL needs it after every step, epochs need the loss of the one before. kStopped
  /// when begin_step, kAbandoned when keep_going said no. Errors: kBadInput after too many steps in a row
  /// that were not finite.
  Expected<PhaseEnd> train_phase(const RolloutBatch& batch, const Phase& phase, const UpdateContext& context,
                                 UpdateStats& stats, LossSums& sums);
  /// Adds the gradient of the loss over a whole minibatch to the parameters' .grad, with
  /// `minibatch.advantage` as it is. On a CPU micro-batches are computed side by side and added in their
  /// order: the sum does not depend on which thread was first. False when keep_going() said no.
  bool accumulate(const RolloutBatch& minibatch, const Phase& phase, const UpdateContext& context,
                  LossSums& sums);

  /// What the networks say of a batch now, without gradient, on the batch's device.
  struct Evaluation {
    Tensor log_prob;  ///< f32 [T, R] of the actions taken; undefined without logits
    Tensor value;     ///< f32 [T, R]; undefined without values
  };
  Evaluation evaluate(const RolloutBatch& batch, const Phase& phase);

  /// `more`: further numbers, one value a tensor, to be read from the device with the others.
  void report(const RolloutBatch& batch, const LossSums& sums, UpdateStats& stats,
              const std::vector<std::pair<std::string, Tensor>>& more = {}) const;
  policy::SequenceInput input_of(const RolloutBatch& rows) const;
  /// A batch in parts, as views: whole worlds, at least one, and no more than lets every thread have a part.
  std::vector<RolloutBatch> micro_batches(const RolloutBatch& batch) const;

  /// The advantages of a minibatch of all ranks with mean 0 and deviation 1 over `acting`; this rank's part of them.
  Tensor standardized(const Tensor& advantage, const Tensor& acting);

  RunConfig config_;
  EnvShape env_;
  torch::Device device_;
  policy::PolicyNet net_;
  /// With the prefix of their keys in checkpoints; derived classes make them.
  std::vector<std::pair<std::string, AdamOptimizer>> optimizers_;
  LrSchedule schedule_;
  ReturnNormalizer returns_;
  mutable device::PartPool pool_;  ///< for micro-batches
  RankGroup alone_;
  RankGroup* ranks_ = &alone_;
  PolicyVersion version_ = 0;
  int64_t updates_ = 0;  ///< batches seen; keys the shuffling
  double last_grad_norm_ = 0;
  Tensor reported_advantage_, reported_acting_;          ///< before standardisation
  double explained_variance_ = 0, targets_clipped_ = 0;  ///< of the newest batch

 private:
  /// Where a number of a micro-batch goes, and how.
  struct Number {
    double LossSums::*sum;
    int head = -1;  ///< of head_entropy, if not negative
    enum How { kAdd, kMax, kMin } how = kAdd;
  };
  /// What one micro-batch adds.
  struct Part {
    std::vector<Tensor> gradients;  ///< as the optimizer's parameters; undefined where it does not reach
    Tensor loss;                    ///< f32 []
    Tensor numbers;                 ///< f32 [K]
    std::vector<Number> places;     ///< K
    Tensor log_prob;                ///< without gradient; where the phase asks for it
  };
  /// What the micro-batches of a minibatch said, on the device.
  struct Numbers {
    std::vector<Tensor> of_parts;  ///< f32 [K] each
    std::vector<Number> places;
    Tensor loss;  ///< f32 []
    /// Adds up what lies on the host now, part after part.
    LossSums sums(const double* values) const;
  };
  /// Samples of a minibatch of all ranks.
  struct SampleTotals {
    double valid = 0, acting = 0, places = 0;
  };
  /// The same, 1 at least: what means divide by. f64 [].
  struct SampleCounts {
    Tensor valid, acting;
    static SampleCounts of(const SampleTotals& totals);
  };
  /// An optimizer step whose outcome is not known yet.
  struct Step {
    Numbers numbers;
    device::Readback read;  ///< of_parts, then AdamOptimizer::step()'s numbers
    bool has_policy = false;
    double learning_rate = 0;
  };
  /// Work on a minibatch that is recorded. Other shapes and other phases have recordings of their own.
  struct Recorded {
    Recorded(const RolloutBatch& like, const Phase& phase);
    bool fits(const RolloutBatch& minibatch, const Phase& phase) const;
    void read(const RolloutBatch& minibatch);

    const AdamOptimizer* optimizer;
    bool keeps_log_prob;
    RolloutBatch minibatch;  ///< what the work reads: a copy
    device::Graph graph;
  };
  /// What a minibatch's step asks of a device: its gradient, the clip and the optimizer's step.
  struct RecordedStep : Recorded {
    using Recorded::Recorded;
    Tensor settings;  ///< f64 [3]: SampleCounts, the learning rate
    Numbers numbers;
    Tensor log_prob;  ///< where the phase asks for it
    Tensor outcome;   ///< f64 [K]: what a Step reads
  };
  struct RecordedEvaluation : Recorded {
    using Recorded::Recorded;
    Evaluation result;
  };
  enum class StepResult { kGiven, kSkipped, kAbandoned, kKlReached };
  SampleTotals totals_of(const RolloutBatch& minibatch);
  Part part_of(const RolloutBatch& micro, const Phase& phase, const SampleCounts& counts) const;
  /// Adds the gradient of a minibatch of to_device(), of all ranks. False when keep_going() said no, or a rank has left.
  bool add_gradient(const RolloutBatch& minibatch, const Phase& phase, const SampleCounts& counts,
                    const std::function<bool()>& keep_going, Numbers& numbers, Tensor* first_log_prob);
  Evaluation evaluate_now(const RolloutBatch& batch, const Forward& forward) const;
  /// The recordings that a minibatch needs, made where there is none.
  RecordedStep& recorded_step(const RolloutBatch& minibatch, const Phase& phase);
  RecordedEvaluation& recorded_evaluation(const RolloutBatch& batch, const Phase& phase);
  /// Gives the device a minibatch's whole step as one piece.
  void give_recorded(const RolloutBatch& minibatch, const Phase& phase, const SampleTotals& totals,
                     Step& step);
  StepResult train_minibatch(RolloutBatch& minibatch, const Phase& phase, const UpdateContext& context,
                             bool is_first, UpdateStats& stats, std::deque<Step>& given);
  /// What became of the oldest step given; its sums where it was taken.
  std::optional<LossSums> settle(std::deque<Step>& given, UpdateStats& stats);

  StepGuard guard_;
  std::vector<std::unique_ptr<RecordedStep>> recorded_steps_;
  std::vector<std::unique_ptr<RecordedEvaluation>> recorded_evaluations_;
};

}  // namespace comrad::learn
