// Encoder, core and decoder: from an observation to features, with NetworkOptions::layer_norm normalised behind each linear layer and
// behind the core, as in PQN (Gallici et al. 2025, arXiv:2407.04811), whose convolutions have it, too. One tower serves all agents, or each agent has its own; rows are then whole
// worlds, row = world * N + agent.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "policy_workers/network/core.h"
#include "policy_workers/network/decoder.h"
#include "policy_workers/network/encoder.h"
#include "policy_workers/network/network_options.h"

namespace comrad::policy {

/// T steps of B rows: what a network is shown.
struct SequenceInput {
  Tensor frame;            ///< u8  [T, B, C, H, W]
  Tensor measurement;      ///< f32 [T, B, M], undefined when M = 0
  Tensor recurrent_state;  ///< f32 [B, H] before step 0
  Tensor reset;            ///< u8 or bool [T, B]: 1 where the state is zeroed before step t; may be undefined
  Tensor global_state = {};  ///< f32 [T, W, S] of the B / N worlds; undefined when S = 0

  /// The rows of one agent.
  SequenceInput of_agent(int64_t agent, int64_t agents) const;
};

/// Rows [..., W * N, ...] of whole worlds along `axis` to those of one agent [..., W, ...], a view.
Tensor rows_of_agent(const Tensor& rows, int64_t axis, int64_t agent, int64_t agents);
/// The inverse: N tensors [..., W, ...] to [..., W * N, ...]; one tensor stays as it is.
Tensor interleave(const std::vector<Tensor>& of_agents, int64_t axis);

/// Encodes the rows of one agent, or of all where `agent` is kAllAgents.
constexpr int64_t kAllAgents = -1;
using Encode = std::function<Tensor(const Encoder& encoder, int64_t agent)>;

class Tower {
 public:
  /// `with_core` off: no recurrence. `extra_inputs`: numbers that stand beside the encoder's features (an agent's index).
  Tower(const NetworkOptions& options, bool with_core, int64_t extra_inputs,
        std::shared_ptr<const ObservationNormalizer> normalizer, const LayerMaker& make);

  const Encoder& encoder() const { return *encoder_; }
  int64_t feature_count() const { return decoder_.feature_count(); }
  int64_t state_count() const { return core_->state_count(); }

  /// `encoded` [B, E] of one step; features [B, F] and the state behind it.
  CoreOutput step(const Tensor& encoded, const Tensor& state) const;
  /// `encoded` [T * B, E] of T steps; features [T * B, F].
  Tensor sequence(const Tensor& encoded, const Tensor& state, const Tensor& reset, int64_t steps) const;
  /// The same from observations. The tower's state begins at column `first_state`; `extend` may put numbers beside the encoded rows.
  Tensor sequence(const SequenceInput& input, int64_t first_state,
                  const std::function<Tensor(const Tensor&)>& extend = {}) const;
  /// The core over `encoded` [T, B, E].
  CoreOutput unrolled(const Tensor& encoded, const Tensor& state, const Tensor& reset) const;

  /// Encoder's, core's, "core_norm.weight" and ".bias" with a core and layer_norm, decoder's, behind `prefix`.
  NamedTensors named_parameters(const std::string& prefix) const;

 private:
  /// What the decoder gets of the core's features [..., F].
  Tensor normalised(const Tensor& features) const;

  std::shared_ptr<const Encoder> encoder_;
  std::shared_ptr<const Core> core_;
  std::optional<Layer> core_norm_;
  Decoder decoder_;
};

}  // namespace comrad::policy
