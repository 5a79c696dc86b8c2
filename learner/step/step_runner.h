// One optimizer step, of every algorithm: the loss of a minibatch in micro-batches that are computed side by side, their gradients
// and numbers added in order and over all ranks, the clip, Adam, the guard, and what all of it said, read back in one go.
//
//   StepInput   the tensors that a step reads, and the loss of each of its micro-batches
//   launch()    queues a step on the device; nothing waits
//   complete()  what became of it, in the order of the steps
//
// A GPU gets the step of a learner that is alone as one recorded piece: everything the work reads lies in tensors that are filled
// before it is replayed, and what changes from step to step is a number on the device. Threads: the learner's. Stage: update.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "learner/losses/loss_terms.h"
#include "learner/ranks/rank_group.h"
#include "learner/step/adam_optimizer.h"
#include "learner/step/step_guard.h"
#include "learner/step/update_stats.h"
#include "policy_workers/device/part_pool.h"
#include "policy_workers/device/queue.h"
#include "policy_workers/device/readback.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// The loss of one micro-batch, with gradient. `scalars`, f64 [] each and at least as many as the step has: what means
/// divide by, and settings that may be others at the next step. Called in several threads at once.
using MicroLoss = std::function<LossTerms(std::span<const Tensor> scalars)>;

class StepInput {
 public:
  virtual ~StepInput() = default;
  virtual std::vector<MicroLoss> micro_losses() const = 0;
  /// The same work, with the same tensors until visit() puts others there.
  virtual std::unique_ptr<StepInput> clone() const = 0;
  /// Calls `visit` with each tensor that the work reads, in one order.
  virtual void visit(const std::function<void(Tensor&)>& visit) = 0;
};

/// What the micro-batches of a minibatch said, on the device.
struct MinibatchTerms {
  std::vector<TermName> names;
  std::vector<Tensor> of_parts;  ///< f32 [K] each, of all ranks
  std::vector<Tensor> kept;      ///< LossTerms::kept, of this rank
  Tensor loss;                   ///< f32 []
  /// Joins what lies on the host now, part after part.
  TermValues values(const double* numbers) const;
};

struct StepRequest {
  AdamOptimizer& optimizer;
  StepInput& input;
  std::vector<double> scalars;
  double learning_rate = 0;
  bool keeps = false;       ///< MinibatchTerms::kept, on the device
  bool reads_kept = false;  ///< with keeps: StepOutcome::kept
  bool reads_second_moment = false;
  std::function<bool()> keep_going = {};  ///< asked before every micro-batch; may be empty
  /// Asked between gradient and step, for which the host waits; false: no step. May be empty.
  std::function<bool(const TermValues&)> is_wanted = {};
};

/// A step whose outcome is not known yet.
struct LaunchedStep {
  MinibatchTerms terms;
  device::Readback read;
  double learning_rate = 0;
  bool has_second_moment = false;
  bool trains_policy = true;  ///< set by the algorithm that launched it
};

struct StepOutcome {
  bool was_taken = false;  ///< loss and gradient were finite
  TermValues terms;
  std::vector<double> kept;
  double max_second_moment = 0;
};

class StepRunner {
 public:
  StepRunner(const RunConfig& config, torch::Device device);

  /// From now on each step is that of all ranks, each with its share of the minibatch.
  void learn_with(RankGroup& ranks) { ranks_ = &ranks; }
  RankGroup& ranks() const { return *ranks_; }
  device::PartPool& pool() const { return pool_; }

  /// Optimizer steps of the policy so far.
  PolicyVersion version() const { return version_; }
  /// Continues from a checkpoint; recordings are rebuilt, moments may have moved.
  void resume(PolicyVersion version);
  /// Makes recordings anew: what they do beside reading tensors has changed.
  void forget_recordings();

  enum class Result {
    kLaunched,
    kAbandoned,  ///< keep_going() returned false, or a rank has left
    kRefused,    ///< is_wanted() returned false
  };
  Result launch(const StepRequest& request, UpdateStats& stats, LaunchedStep& step);
  /// Waits where the numbers are not there yet. A step that was not taken is taken back out of the counts.
  StepOutcome complete(LaunchedStep& step, UpdateStats& stats);

  /// Adds the gradient of a whole minibatch, of all ranks, to the parameters' .grad: the sum does not depend on which thread was
  /// first. False when keep_going() returned false, or a rank has left.
  bool add_gradient(const StepInput& input, const AdamOptimizer& optimizer, std::span<const Tensor> scalars,
                    bool keeps, const std::function<bool()>& keep_going, MinibatchTerms& terms);
  /// The same, and its numbers on the host.
  std::optional<StepOutcome> gradient_of(const StepRequest& request);

  /// What `look` returns for an input, without gradient. `for_what` distinguishes the looks at inputs of one shape.
  std::vector<Tensor> evaluate(StepInput& input, const void* for_what,
                               const std::function<std::vector<Tensor>(const StepInput&)>& look);

  /// Whether a GPU gets steps as recorded pieces: by one learner.
  bool records() const;

  Status skip_invalid_batch(int64_t dropped, UpdateStats& stats) {
    return guard_.skip_invalid_batch(dropped, stats);
  }
  Status status() const { return guard_.status(); }
  double grad_norm() const { return guard_.grad_norm(); }  ///< of the last step completed, before clipping
  double learning_rate() const { return guard_.learning_rate(); }  ///< of the last step taken

 private:
  class Recorded;
  struct RecordedStep;
  struct RecordedLook;
  RecordedStep& recorded_step(const StepRequest& request);
  void launch_recorded(const StepRequest& request, LaunchedStep& step);
  static Tensor to_read(const StepRequest& request, const MinibatchTerms& terms, const Tensor& outcome);

  torch::Device device_;
  mutable device::PartPool pool_;
  RankGroup alone_;
  RankGroup* ranks_ = &alone_;
  PolicyVersion version_ = 0;
  StepGuard guard_;
  std::vector<std::shared_ptr<RecordedStep>> recorded_steps_;
  std::vector<std::shared_ptr<RecordedLook>> recorded_looks_;
};

}  // namespace comrad::learn
