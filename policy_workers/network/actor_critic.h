// The network that both sides run: policy workers forward it one step at a time, the learner over whole
// sequences. Encoder > recurrent core > decoder (tower.h) > action heads and value (critic.h). One such tower serves all agents or
// each agent has its own; the value is the agent's own (IPPO), comes from the features of all agents of its
// world (MAPPO), or from encoders and cores of the critic alone (HAPPO); both may see the world's true state beside
// the features. The networks of Q-learning have no critic: their heads give a Q-value per choice. Stage: forward
// (policy worker), update (learner).
#pragma once

#include <torch/types.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "policy_workers/device/snapshot.h"
#include "policy_workers/network/encoder.h"
#include "policy_workers/network/network_options.h"
#include "policy_workers/network/tower.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::policy {

using torch::Tensor;

/// One forward pass over B agent rows.
struct PolicyOutput {
  Tensor logits;           ///< [B, A] f32, heads side by side
  Tensor value;            ///< [B] f32, normalised when normalize_returns is on
  Tensor recurrent_state;  ///< [B, H] f32
};

/// A pass over T steps of B rows; what was not requested stays undefined.
struct SequenceOutput {
  Tensor logits;  ///< [T, B, A]
  Tensor value;   ///< [T, B]; undefined without a critic
};

class ActorCriticImpl;

/// Handle to a network; copies share it.
class ActorCritic {
 public:
  ActorCritic() = default;
  /// Deterministic initialisation from `seed`: by `init` for linear and convolution layers, framework
  /// defaults for the recurrent cell.
  static ActorCritic create(const NetworkOptions& options, uint64_t seed, torch::Device device);
  /// One that is given another's weights before it is used: none are drawn, which takes most of the time of create().
  static ActorCritic create_for_loading(NetworkOptions options, torch::Device device);

  /// One step. frame u8 [B, C, H, W], measurement f32 [B, M] (may be undefined), state f32 [B, H], global state f32
  /// [B / N, S] of the worlds (undefined when S = 0). No gradient is recorded.
  PolicyOutput step(const Tensor& frame, const Tensor& measurement, const Tensor& recurrent_state,
                    const Tensor& global_state = {}) const;

  /// The same from B frames that lie anywhere in CPU memory, C*H*W bytes each: read once, straight into
  /// the network.
  PolicyOutput step_rows(std::span<const uint8_t* const> frames, const Tensor& measurement,
                         const Tensor& recurrent_state, const Tensor& global_state = {}) const;

  /// The same of some agents alone, in worlds whose others this network does not play: row = world * K + k belongs to
  /// agents[k]. What only the critic needs is left out: the value stays undefined, and of the recurrent state
  /// [B, H] the critic's part comes back as it was.
  PolicyOutput step_agents(std::span<const uint8_t* const> frames, const Tensor& measurement,
                           const Tensor& recurrent_state, std::span<const int> agents) const;

  /// A sequence with gradient. frame u8 [T, B, C, H, W], state f32 [B, H] at t = 0, reset u8/bool [T, B]: 1
  /// where the state is zeroed before step t.
  SequenceOutput sequence(const Tensor& frame, const Tensor& measurement, const Tensor& recurrent_state,
                          const Tensor& reset) const;

  SequenceOutput sequence(const SequenceInput& input) const;

  /// The logits [T, W, A] of one agent from the rows of that agent alone, W worlds. Separate agents only.
  Tensor actor_sequence(int64_t agent, const SequenceInput& input) const;
  /// The joint critic's values [T, B] of whole worlds, the same for all agents of a world. kJoint only.
  Tensor joint_value_sequence(const SequenceInput& input) const;

  /// The two halves of a pass over a sequence, for callers that need the features between them or steps that follow
  /// no stored frame. Features [B, E] of frames u8 [B, C, H, W] and measurements; then logits [T, B, A] of
  /// features [T, B, E], with state and reset as above. With gradient.
  Tensor encode(const Tensor& frame, const Tensor& measurement) const;
  Tensor logits_of(const Tensor& encoded, const Tensor& recurrent_state, const Tensor& reset) const;
  /// The recurrent state [B, H] behind the last of encoded rows [T, B, E].
  Tensor state_after(const Tensor& encoded, const Tensor& recurrent_state, const Tensor& reset) const;
  /// E: features of a row's encoder.
  int64_t encoded_count() const;

  /// A network of the same options with its own weights, equal to these now, that shares the input
  /// statistics: a target network.
  ActorCritic twin() const;

  /// Merges a batch of frames (and measurements) into the running input statistics: mean and unbiased
  /// variance per element, parallel-variance merge, double precision. Learner only.
  /// `frame` is one learner's part of the batch where `add_up_frames` adds up sums over all of them.
  void update_input_statistics(const Tensor& frame, const Tensor& measurement,
                               const AddUp& add_up_frames = {}) const;
  /// The same of global states [..., S].
  void update_state_statistics(const Tensor& global_state) const;
  /// What critics and mixers make of global states [..., S]: by the running statistics, within +-5.
  Tensor normalized_state(const Tensor& global_state) const;

  /// From now on all values are `scale` times what they were, plus `shift`.
  /// Source: PopArt, van Hasselt et al. 2016, arXiv:1602.07714, section 2.2.
  void rescale_values(double scale, double shift) const;

  /// Parameters in a fixed order, for the optimizer; and named tensors (parameters and statistics)
  /// for checkpoints.
  std::vector<Tensor> parameters() const;
  /// Those of one agent's actor (separate agents) and of the joint critic: disjoint, together parameters().
  std::vector<Tensor> actor_parameters(int64_t agent) const;
  std::vector<Tensor> joint_critic_parameters() const;
  NamedTensors named_parameters() const;
  NamedTensors named_state() const;
  int64_t parameter_count() const;

  /// What travels from learner to policy workers: the tensors of named_state, and all of them as flat bytes in that order.
  std::vector<Tensor> weight_tensors() const;
  int64_t weights_bytes() const;
  std::vector<std::byte> weights() const;
  Status read_weights(std::span<const std::byte> in) const;

  /// Call after writing into tensors of named_state() or weight_tensors(): recomputes what is derived from them.
  void state_changed() const;

  const NetworkOptions& options() const;
  /// "encoder simple by oneDNN convolutions, gru of 512, own values, bf16 products": one line for the log.
  std::string description() const;
  torch::Device device() const;

 private:
  static ActorCritic make(const NetworkOptions& options, uint64_t seed, torch::Device device,
                          std::shared_ptr<ObservationNormalizer> normalizer);
  std::shared_ptr<ActorCriticImpl> impl_;
};

}  // namespace comrad::policy
