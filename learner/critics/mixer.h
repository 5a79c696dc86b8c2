// What joins the agents' utilities into one team value: the interface of all mixers and their factory. Serves
// update; policy workers never see a mixer, since every kind keeps the joint argmax at the agents' own.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

using torch::Tensor;
using NamedTensors = std::vector<std::pair<std::string, Tensor>>;

/// What a mixer is made from: RunConfig's settings (its defaults are the benchmark's) and sizes.
struct MixerOptions {
  MixerKind kind = MixerKind::kVdn;

  int64_t num_agents = {};
  int64_t state_count = {};  ///< S
  int64_t logit_count = {};  ///< A: sum of head sizes of one agent
  int64_t state_slice =
      {};  ///< entries of agent i's part u_i of the state; what follows the N parts is the world's

  // qmix
  int64_t embed_dim = {};        ///< E: units of the mixing layer
  int64_t hypernet_hidden = {};  ///< units of the hypernets of W1 and W2

  // dmaq and dmaq_qatten
  int64_t qplex_embed_dim = {};       ///< attention keys and selectors; hidden units of the state bias
  int64_t qplex_hypernet_embed = {};  ///< hidden units of selectors and of the weights' hypernets
  int64_t adv_hypernet_layers = {};   ///< 1..3 layers in each network behind lambda
  int64_t adv_hypernet_embed = {};    ///< their hidden units
  int64_t num_kernel = {};            ///< K: terms of lambda
  int64_t n_head = {};                ///< attention heads
  double attend_reg_coef = {};        ///< of the squared attention logits
  bool is_minus_one = {};             ///< A_tot weighs by lambda - 1 instead of lambda
  bool weighted_head = {};            ///< dmaq: learn w, b; dmaq_qatten: weigh each head by |w_h(s)|
  bool nonlinear = {};                ///< dmaq_qatten: an agent's key also sees its greedy utility
  bool state_bias = {};               ///< dmaq_qatten: add c(s) to the total

  /// As a run's settings name them. The state is the agents' `features` side by side, then `global_state_count` numbers of
  /// the world's true state.
  static MixerOptions from(const RunConfig& config, const EnvShape& env, int64_t features,
                           int64_t global_state_count = 0);
};

/// One row per (world, time). A mixer reads the fields its kind has a use for; the others may be undefined.
struct MixerInput {
  Tensor chosen = {};  ///< f32 [B, N]    Q_i(a_i), with gradient
  Tensor greedy = {};  ///< f32 [B, N]    max_a Q_i(a), used detached          (dmaq, dmaq_qatten)
  Tensor action = {};  ///< f32 [B, N*A]  multi-hot actions, agent by agent    (dmaq, dmaq_qatten)
  Tensor state =
      {};  ///< f32 [B, S]    used detached: no gradient into what it was made from    (all but vdn)
};

struct MixerOutput {
  Tensor q_tot = {};              ///< [B]
  Tensor v_tot = {}, a_tot = {};  ///< [B], q_tot = v_tot + a_tot; QPLEX only
  Tensor gain = {};  ///< [B], dQ_tot / dQ_i, mean over agents, detached; undefined in vdn, where it is 1
  Tensor regularizer = {};  ///< [B], already times its coefficient; its mean is a loss term; dmaq_qatten only
  Tensor head_entropy = {};  ///< [B], nats, mean over attention heads, detached; dmaq_qatten only
};

/// A mixer with its parameters.
///
/// Parameters keep a hard order and names without prefix; those that an option leaves without use (the w and
/// b of dmaq, the bias of dmaq_qatten in the benchmark's settings) exist all the same and get no gradient at
/// all. Threads: mix() writes nothing; parameters must not change while it runs.
class Mixer {
 public:
  virtual ~Mixer() = default;
  /// Errors: none at run time; shapes are checked.
  virtual MixerOutput mix(const MixerInput& input) const = 0;
  virtual NamedTensors named_parameters() const = 0;

  /// Makes Q_tot `factor` > 0 times what it is, in place and to f32 rounding: where `scales_with_utilities()`, of
  /// utilities that are `factor` times what they were, else of the same utilities. Nothing else changes.
  virtual void rescale(double factor) = 0;
  virtual bool scales_with_utilities() const = 0;
};

/// A mixer with fresh parameters; equal options and seeds give equal ones on every device.
std::unique_ptr<Mixer> make_mixer(const MixerOptions& options, uint64_t seed, torch::Device device);

}  // namespace comrad::learn
