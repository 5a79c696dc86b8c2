// The network that both sides run: policy workers forward it one step at a time, the learner over whole
// sequences. Encoder > recurrent core > decoder > action heads and value. One such tower serves all agents or
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
#include "policy_workers/policy/encoder.h"
#include "policy_workers/policy/precision.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::policy {

using torch::Tensor;

/// Options of the network, from the settings and the shapes. With separate towers, an agent index or a critic
/// other than kOwn the rows of every pass are whole worlds: row = world * N + agent.
struct PolicyNetOptions {
  EnvShape env;
  std::string encoder = "convnet_simple";
  bool use_rnn = true;
  RnnType rnn_type = RnnType::kGru;
  int64_t rnn_size = 512;
  int64_t rnn_num_layers = 1;
  std::vector<int64_t> decoder_widths;  ///< ELU layers between core and heads
  Initialization init = Initialization::kOrthogonal;
  double init_gain = 1.0;
  bool normalize_input = true;
  bool separate_agents = false;  ///< a tower and heads per agent instead of one for all
  bool agent_id_input = false;   ///< the agent's index, one-hot, beside the encoder's features
  CriticKind critic = CriticKind::kOwn;
  CriticView critic_view = CriticView::kOwnFirst;   ///< kCentral
  std::vector<int64_t> critic_widths = {512, 256};  ///< hidden, tanh after each; of kCentral and kJoint
  bool critic_rnn = true;                           ///< kJoint: a core per agent in the critic
  int64_t global_state_count =
      0;  ///< S: the team's critic (or mixer) also sees the world's true state; 0: it does not
  Precision precision = Precision::kFp32;

  static PolicyNetOptions from(const RunConfig& config, const EnvShape& env);
  /// Floats of one core's state per agent: layers * size for GRU, twice that for LSTM (all h, then all c);
  /// 0 without.
  int64_t core_state_count() const;
  /// Floats of recurrent state per agent: the actor's core, then the critic's if it has one.
  int64_t recurrent_state_count() const;
};

/// One forward pass over B agent rows.
struct PolicyOutput {
  Tensor logits;           ///< [B, A] f32, heads side by side
  Tensor value;            ///< [B] f32, normalised when normalize_returns is on
  Tensor recurrent_state;  ///< [B, H] f32
};

/// A pass over T steps of B rows; what was not asked for stays undefined.
struct SequenceOutput {
  Tensor logits;  ///< [T, B, A]
  Tensor value;   ///< [T, B]; undefined without a critic
};

/// T steps of B rows: what a network is shown.
struct SequenceInput {
  Tensor frame;            ///< u8  [T, B, C, H, W]
  Tensor measurement;      ///< f32 [T, B, M], undefined when M = 0
  Tensor recurrent_state;  ///< f32 [B, H] before step 0
  Tensor reset;            ///< u8 or bool [T, B]: 1 where the state is zeroed before step t; may be undefined
  Tensor global_state = {};  ///< f32 [T, W, S] of the B / N worlds; undefined when S = 0
};

class PolicyNetImpl;

/// Handle to a network; copies share it.
class PolicyNet {
 public:
  PolicyNet() = default;
  /// Deterministic initialisation from `seed`: by `init` for linear and convolution layers, framework
  /// defaults for the recurrent cell.
  static PolicyNet create(const PolicyNetOptions& options, uint64_t seed, torch::Device device);
  /// One that is given another's weights before it is used: none are drawn, which takes most of the time of create().
  static PolicyNet create_for_loading(PolicyNetOptions options, torch::Device device);

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

  /// The two halves of a pass over a sequence, for who needs the features between them or steps that follow
  /// no stored frame. Features [B, E] of frames u8 [B, C, H, W] and measurements; then logits [T, B, A] of
  /// features [T, B, E], with state and reset as above. With gradient.
  Tensor encode(const Tensor& frame, const Tensor& measurement) const;
  Tensor logits_of(const Tensor& encoded, const Tensor& recurrent_state, const Tensor& reset) const;
  /// The recurrent state [B, H] behind the last of encoded rows [T, B, E].
  Tensor state_after(const Tensor& encoded, const Tensor& recurrent_state, const Tensor& reset) const;
  /// E: features of a row's encoder.
  int64_t encoded_count() const;

  /// A network of the same options with weights of its own, equal to these now, that shares the input
  /// statistics: a target network.
  PolicyNet twin() const;

  /// Merges a batch of frames (and measurements) into the running input statistics: mean and unbiased
  /// variance per element, parallel-variance merge, double precision. Learner only.
  /// `frame` is one learner's part of the batch where `add_up_frames` adds up sums over all of them.
  void update_input_statistics(const Tensor& frame, const Tensor& measurement,
                               const AddUp& add_up_frames = {}) const;
  /// The same of global states [..., S].
  void update_state_statistics(const Tensor& global_state) const;
  /// What critics and mixers make of global states [..., S]: by the running statistics, within +-5.
  Tensor normalized_state(const Tensor& global_state) const;

  /// Parameters in a fixed order, for the optimizer; and named tensors (parameters and statistics)
  /// for checkpoints.
  std::vector<Tensor> parameters() const;
  /// Those of one agent's actor (separate agents) and of the joint critic: disjoint, together parameters().
  std::vector<Tensor> actor_parameters(int64_t agent) const;
  std::vector<Tensor> joint_critic_parameters() const;
  NamedTensors named_parameters() const;
  NamedTensors named_state() const;
  int64_t parameter_count() const;

  /// All of named_state as flat bytes in that order: what travels from learner to policy workers.
  int64_t weights_bytes() const;
  void copy_weights(device::Snapshot& into) const;
  std::vector<std::byte> weights() const;
  Status read_weights(std::span<const std::byte> in) const;

  /// Call after writing into tensors of named_state() (a loaded checkpoint): recomputes what is derived
  /// from them.
  void state_changed() const;

  const PolicyNetOptions& options() const;
  torch::Device device() const;

 private:
  std::vector<Tensor> state_tensors() const;  // of named_state
  static PolicyNet make(const PolicyNetOptions& options, uint64_t seed, torch::Device device,
                        std::shared_ptr<ObservationNormalizer> normalizer);
  std::shared_ptr<PolicyNetImpl> impl_;
};

/// The device a setting names: "auto" takes the first CUDA device where there is one, else the CPU.
/// Errors: kBadInput for another word; kUnsupported for a CUDA device that this build or machine lacks.
Expected<torch::Device> choose_device(const std::string& setting);

}  // namespace comrad::policy
