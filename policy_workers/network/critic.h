// Values of a pass: of each agent's own features (IPPO), of the features of all agents of its world (MAPPO), by towers of the critic's own
// (HAPPO), or none (Q-learning, whose heads give a Q-value per choice). The critics of teams may see the world's true state beside
// the features. Serves forward and update.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "policy_workers/network/input_normalizer.h"
#include "policy_workers/network/layers.h"
#include "policy_workers/network/network_options.h"
#include "policy_workers/network/tower.h"

namespace comrad::policy {

/// What the actors made of a pass over B rows, or over T steps of them.
struct CriticInput {
  std::span<const Tensor> actor_features;  ///< of each actor's rows, [rows, F]
  Tensor logits = {};                      ///< [B, A], in step()
  Tensor global_state = {};                ///< f32 [worlds, S]; undefined when S = 0
};

struct CriticOutput {
  Tensor value;  ///< [B]
  Tensor state;  ///< [B, Hc], the critic's part
};

class Critic {
 public:
  virtual ~Critic() = default;

  /// One step: `state` [B, Hc] is the critic's part; `encode` encodes this step's rows.
  virtual CriticOutput step(const CriticInput& input, const Tensor& state, const Encode& encode) const = 0;
  /// [T * B] values of a sequence that the actors have passed; undefined without a critic.
  virtual Tensor sequence(const CriticInput& input, const SequenceInput& rows) const = 0;
  /// The same without the actors. Joint critics only.
  virtual Tensor sequence_without_actors(const SequenceInput& rows) const;

  /// Hc: floats of state per agent.
  virtual int64_t state_count() const { return 0; }
  /// What the critic alone owns; a value head beside an actor is that actor's.
  virtual NamedTensors named_parameters() const { return {}; }
  /// Those whose outputs are the values.
  virtual std::vector<Layer> output_layers() const { return {}; }
};

/// What a critic is made from.
struct CriticParts {
  const NetworkOptions& options;
  std::shared_ptr<const ObservationNormalizer> normalizer;
  int64_t actor_feature_count = 0;
  int64_t actor_state_count = 0;   ///< the critic's state stands behind it
  std::vector<Layer> value_heads;  ///< kOwn: one an actor
};
std::shared_ptr<const Critic> make_critic(const CriticParts& parts, const LayerMaker& make);

}  // namespace comrad::policy
