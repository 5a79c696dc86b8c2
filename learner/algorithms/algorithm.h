// The learner's interface to a learning algorithm: it turns minibatches into new weights, and its state into a
// checkpoint and back. Stage: update > publish.
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "learner/batch/collate.h"
#include "learner/batch/replay_batch.h"
#include "learner/checkpoint/checkpoint.h"
#include "learner/ranks/rank_group.h"
#include "learner/step/update_stats.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/schema/version.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

class OnPolicyAlgorithm;
class OffPolicyAlgorithm;

/// One of the learning algorithms. Not thread-safe: the learner's training thread owns it.
class Algorithm {
 public:
  virtual ~Algorithm() = default;

  /// Which of the two it is; the other is null.
  virtual OnPolicyAlgorithm* on_policy() { return nullptr; }
  virtual OffPolicyAlgorithm* off_policy() { return nullptr; }

  /// Optimizer steps of the policy so far.
  virtual PolicyVersion version() const = 0;
  virtual int64_t parameter_count() const = 0;

  /// The behaviour policy's weights as policy workers read them: tensors on the device, and flat bytes of all of them.
  virtual std::vector<Tensor> weight_tensors() const = 0;
  virtual int64_t weights_bytes() const = 0;
  virtual std::vector<std::byte> weights() const = 0;

  /// From now on each update is that of all ranks together, each with its share of the batch; `ranks` outlives the
  /// algorithm. Errors: kUnsupported where the algorithm learns alone.
  virtual Status learn_with(RankGroup& ranks);

  /// Waits until all that was launched is done, and takes back what was not taken: after it version() is that of the weights.
  virtual void settle() {}

  /// Numbers that are too dear for every update, for a report that is written: gradient norm and Adam's step
  /// of every part of the networks (part_statistics.h), after the last update.
  virtual void append_diagnostics(NamedNumbers& values) const = 0;

  /// All state, under the sections "network", "optimizer", "normalizer", "schedule" and "algorithm", and of
  /// Q-learning "target" and "mixer".
  virtual void save(StateDict& state) const = 0;
  /// Errors: kBadFormat when `state` was made by another algorithm, model or scenario; nothing is changed
  /// then that a second load does not repair.
  virtual Status load(const StateDict& state) = 0;
};

/// Learns from what its own policy just did: every batch once.
class OnPolicyAlgorithm : public Algorithm {
 public:
  OnPolicyAlgorithm* on_policy() override { return this; }
  /// Trains on one batch: num_epochs x num_batches_per_epoch optimizer steps. Masks, advantages and targets
  /// are written into `batch`. A step whose loss or gradient is not finite is skipped and counted. Errors:
  /// kBadInput when too many steps in a row were not finite; the weights are those of the last good step.
  virtual Expected<UpdateStats> update(RolloutBatch& batch, const UpdateContext& context) = 0;
};

/// Learns from a replay.
class OffPolicyAlgorithm : public Algorithm {
 public:
  OffPolicyAlgorithm* off_policy() override { return this; }
  /// New decisions have come in: their frames u8 [B, C, H, W], measurements f32 [B, M] and global states f32 [B / N, S]
  /// enter the running input statistics, once. What is not looked at may be undefined. All ranks observe together, each
  /// its own, of which a rank may have no rows.
  virtual void observe(const Tensor& frame, const Tensor& measurement, const Tensor& global_state) = 0;
  /// One optimizer step on a batch; writes `batch.abs_td`. Errors: as OnPolicyAlgorithm::update.
  virtual Expected<UpdateStats> update(ReplayBatch& batch, const UpdateContext& context) = 0;
};

/// A learner for an algorithm of one's own, whose row add_algorithm() made known before. Threads: one, before any is made.
using MakeAlgorithm = std::unique_ptr<Algorithm> (*)(const RunConfig&, const EnvShape&, torch::Device);
void add_learner(const std::string& name, MakeAlgorithm make);

/// Makes the algorithm named `config.run.algo`, initialised from `config.run.seed`.
/// Errors: kBadInput where it has a row and no learner.
Expected<std::unique_ptr<Algorithm>> make_algorithm(const RunConfig& config, const EnvShape& env,
                                                    torch::Device device);

}  // namespace comrad::learn
