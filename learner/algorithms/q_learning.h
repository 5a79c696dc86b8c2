// What the algorithms that learn Q-values share: online and target network (and mixer), Q-values of stored
// observations and of those behind them, the loss accumulated over micro-batches, the guarded optimizer step,
// reports and checkpoints. Idqn and ValueDecomposition say what a sample's loss is.
//
//   y     = r + gamma (1 - terminated) Q_target(o', a*)      a* = argmax_a Q(o', a), of the online network
//   loss  = mean over valid samples of w huber(Q(o, a) - y)  (double_dqn; squared error: use_huber_loss off)
//   theta_target <- (1 - tau) theta_target + tau theta       after every step; tau = 1: a copy now and then
//
// o' is the true observation behind the step: where time cut an episode, its own last one, with the recurrent
// state that led there, and never the first of the next episode. Sequences start from the state stored when
// they were played. Source: van Hasselt et al. 2016, arXiv:1509.06461.
// With normalize_q_values a network's Q is in units of sigma (q_scale.h); y, the clamp and all reports are in
// natural units, the loss compares Q and y / sigma. Stage: update.
//
// Several ranks take one step on B samples, of which each of the N draws B / N from a replay of its own. Gradients, counts
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
#include <optional>
#include <string>
#include <vector>

#include "learner/algorithms/adam_optimizer.h"
#include "learner/algorithms/algorithm.h"
#include "learner/algorithms/lr_schedule.h"
#include "learner/algorithms/q_scale.h"
#include "learner/algorithms/step_guard.h"
#include "learner/critics/mixer.h"
#include "policy_workers/device/part_pool.h"
#include "policy_workers/device/queue.h"
#include "policy_workers/policy/policy_net.h"

namespace comrad::learn {

/// Share of random decisions after so many env frames: linear from epsilon_start to epsilon_end.
double epsilon_at(const RunConfig& config, double env_frames);

class QLearning : public OffPolicyAlgorithm {
 public:
  PolicyVersion version() const override { return version_; }
  int64_t parameter_count() const override;
  int64_t weights_bytes() const override { return net_.weights_bytes(); }
  void copy_weights(device::Snapshot& into) const override { net_.copy_weights(into); }
  std::vector<std::byte> weights() const override { return net_.weights(); }
  void append_diagnostics(NamedNumbers& values) const override;
  Status learn_with(RankGroup& ranks) override;
  void save(StateDict& state) const override;
  Status load(const StateDict& state) override;

  void observe(const Tensor& frame, const Tensor& measurement, const Tensor& global_state) override;
  Expected<UpdateStats> update(ReplayBatch& batch, const UpdateContext& context) override;

  /// Sums over the micro-batches of one batch; means over valid samples unless said otherwise.
  struct LossSums {
    double loss = 0, regularizer = 0, td = 0, predicted = 0, predicted_max = -1e30, predicted_min = 1e30,
           target = 0, target_max = -1e30;
    double utility = 0, utility_max = -1e30, utility_min = 1e30, spread = 0;
    double terminated = 0, truncated = 0, head_entropy = 0, mixer_gain = 0, state_rms = 0;
    double target_square = 0, unclamped = 0, clipped = 0;
  };
  /// Adds the gradient of the loss over a whole batch to the parameters' .grad and writes batch.abs_td, in
  /// units of sigma: the mean |TD error| of a world's valid samples or, with per_sequences, eta max + (1 - eta)
  /// mean over those behind the burn-in (of all agents; Kapturowski et al. 2019, R2D2, section 2.3). False when
  /// keep_going() said no.
  bool accumulate_gradient(ReplayBatch& batch, const UpdateContext& context, LossSums& sums);

  /// What the networks' Q-values are multiplied by to be in natural units; 1 without normalize_q_values.
  double q_sigma() const { return scale_.sigma(); }
  /// Rescales the last layers of the online and target networks (of mixers that are not linear in the utilities,
  /// their own) from units of `before` to units of `after`: Q-values in natural units stay, to f32 rounding.
  void rescale_outputs(double before, double after);

  const policy::PolicyNet& net() const { return net_; }
  const policy::PolicyNet& target_net() const { return target_net_; }
  const Mixer* mixer() const { return mixer_.get(); }
  /// Of the network, then of the mixer; and those of the targets.
  const std::vector<Tensor>& parameters() const { return optimizer_.parameters(); }
  const std::vector<Tensor>& target_parameters() const { return target_parameters_; }

 protected:
  QLearning(const RunConfig& config, const EnvShape& env, torch::Device device);

  /// What one network says of a batch.
  struct QValues {
    Tensor now;         ///< f32 [T, R, A]  of the observations that were decided on; undefined for a target
                        ///<                without a recurrent core
    Tensor next;        ///< f32 [T, R, A]  of the true observations behind them; no gradient
    Tensor state;       ///< f32 [T, R, E]  encoder features of the former; detached; undefined as `now`
    Tensor next_state;  ///< f32 [T, R, E]  encoder features of the latter; detached
  };
  /// A batch on the device, what lies behind its steps, and both networks' words.
  struct Scene {
    ReplayBatch batch;
    Tensor next_mask;    ///< u8 [T, R, A]; undefined when everything was allowed
    Tensor next_active;  ///< u8 [T, R]
    Tensor state,
        next_state;  ///< f32 [T, W, S] the worlds' true states, normalised; undefined where mixers see none
    QValues online, target;
    Tensor sigma;         ///< f64 []: q_sigma()
    Tensor mask() const;  ///< of the observations that were decided on; undefined as above
  };
  /// Loss of every sample; S = R (each agent's decision) or W (each world's).
  struct SampleLoss {
    Tensor loss;               ///< f32 [T, S]  with gradient
    Tensor regularizer;        ///< f32 [T, S]  with gradient; may be undefined
    Tensor error;              ///< f32 [T, S]  |TD error|, detached; this and the next two in natural units
    Tensor predicted;          ///< f32 [T, S]  detached
    Tensor target;             ///< f32 [T, S]
    Tensor unclamped;          ///< f32 [T, S]  the target before q_value_clamp; may be undefined
    Tensor head_entropy = {};  ///< f32 [T, S]; may be undefined, as the next two
    Tensor mixer_gain = {};    ///< f32 [T, S]  MixerOutput::gain, in the networks' units
    Tensor state_rms = {};     ///< f32 [T, S]  root mean square of the mixer's state, where it reads one
  };
  virtual SampleLoss loss_of(const Scene& scene) const = 0;
  /// u8 [T, S]: samples that count.
  virtual Tensor sample_valid(const ReplayBatch& batch) const = 0;

  /// The actions that a target looks at, i64 [T, R, heads]: with double_dqn the online network's choice, else
  /// the target network's own (van Hasselt et al. 2016, equation 4).
  Tensor next_action(const Scene& scene) const;
  /// The loss of an error by use_huber_loss.
  Tensor loss_of_error(const Tensor& error) const;

  RunConfig config_;
  EnvShape env_;
  torch::Device device_;
  policy::PolicyNet net_, target_net_;
  std::unique_ptr<Mixer> mixer_, target_mixer_;  ///< null: values of agents are not mixed

 private:
  /// Some worlds of a batch, on the device.
  struct Micro {
    ReplayBatch batch;   ///< of the steps that are trained
    ReplayBatch before;  ///< with a burn-in: observations and resets of the steps that warm up the state
    Tensor final_row, final_step;  ///< i64 [F]: batch.final_row, batch.final_step
  };
  struct Part {
    std::vector<Tensor> gradients;
    Tensor loss;     ///< f32 [], the regularizer in it
    Tensor numbers;  ///< f32 [K], in the order of kNumbers
    Tensor abs_td;   ///< f32 [W]
  };
  /// What the micro-batches of a batch said, on the device.
  struct Numbers {
    std::vector<Tensor> of_parts;  ///< f32 [K] each
    std::vector<Tensor> abs_td;    ///< f32 [W] each
    Tensor loss;                   ///< f32 []
    /// All of it as one row, to be read in one go.
    std::vector<Tensor> to_read() const;
    /// Adds up what lies on the host now, part after part, and writes batch.abs_td. `worlds` of all ranks.
    LossSums sums(const double* values, int64_t worlds, ReplayBatch& batch) const;
  };
  /// Of a batch of all ranks.
  struct Totals {
    double valid = 0, places = 0;
    double trained = 0;  ///< valid behind the burn-in, 1 at least: what means divide by
    double rewards_read = 0, rewards_clipped = 0;
    double least_probability = 0;  ///< the smallest of the ranks'
  };
  Totals totals_of(const ReplayBatch& batch);
  int64_t worlds_of_all(const ReplayBatch& batch) const { return batch.world_count * ranks_->count(); }
  /// What a step divides by, f64 [] each.
  struct Divisors {
    Tensor samples;  ///< Totals::trained
    Tensor sigma;    ///< q_sigma()
  };
  Divisors divisors_of(const Totals& totals) const;
  /// What a step asks of a device, recorded: its gradient, the clip and the optimizer's step.
  struct RecordedStep {
    std::vector<std::vector<int64_t>>
        shapes;                 ///< of the micro-batches' fields: others have recordings of their own
    std::vector<Micro> micros;  ///< what it reads; each batch is copied there
    Tensor settings;            ///< f64 [3]: Divisors, the learning rate
    Numbers numbers;
    Tensor outcome;  ///< f64 [K]: what update() reads
    device::Graph graph;
  };
  /// Whether steps are recorded: on a device, by one learner.
  bool records_steps() const;
  /// The recording for micro-batches of these shapes, made where there is none.
  RecordedStep& recorded_step(const std::vector<Micro>& micros);
  /// Gives the device a whole step. Returns what it will say, f64 [K]: with_optimizer(). Nothing when keep_going() said no, or
  /// a rank has left.
  std::optional<Tensor> give(const std::vector<Micro>& micros, const Totals& totals,
                             const UpdateContext& context, UpdateStats& stats, Numbers& numbers);
  /// The same as one piece.
  Tensor give_recorded(const std::vector<Micro>& micros, const Totals& totals, Numbers& numbers);
  /// Numbers::to_read(), AdamOptimizer::step()'s two, the largest second moment.
  Tensor with_optimizer(const Numbers& numbers, const Tensor& taken_and_norm) const;
  /// Adds the gradient of a whole batch, of all ranks. False when keep_going() said no, or a rank has left.
  bool add_gradient(const std::vector<Micro>& micros, const Divisors& divisors,
                    const std::function<bool()>& keep_going, Numbers& numbers);
  static void visit_fields(Micro& micro, const std::function<void(Tensor&)>& visit);
  /// The micro-batches of a batch, all on the device before the step begins.
  std::vector<Micro> micros_of(const ReplayBatch& batch) const;
  Part part_of(const Micro& micro, const Divisors& divisors) const;
  Scene scene_of(const Micro& micro) const;
  QValues q_values(const policy::PolicyNet& net, const Micro& micro, const Tensor& recurrent_state,
                   bool has_gradient) const;
  void update_targets();
  void report(const LossSums& sums, UpdateStats& stats) const;
  int64_t micro_worlds(const ReplayBatch& batch) const;

  AdamOptimizer optimizer_;
  std::vector<Tensor> target_parameters_;
  device::Graph follow_;  ///< of the targets, where they do after each step
  std::vector<std::unique_ptr<RecordedStep>> recorded_steps_;
  LrSchedule schedule_;
  QScale scale_;
  StepGuard guard_;
  device::PartPool pool_;
  RankGroup alone_;
  RankGroup* ranks_ = &alone_;
  PolicyVersion version_ = 0;
  int64_t updates_ = 0;  ///< batches seen
  double max_second_moment_ = 0;
};

}  // namespace comrad::learn
