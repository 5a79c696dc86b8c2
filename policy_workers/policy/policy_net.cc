#include "policy_workers/policy/policy_net.h"

#include <algorithm>
#include <charconv>
#include <functional>
#include <optional>
#include <string_view>

#include "policy_workers/device/queue.h"
#include "policy_workers/device/upload.h"
#include "policy_workers/policy/encoder.h"
#include "policy_workers/policy/recurrent_core.h"
#include "policy_workers/policy/torch_ops.h"
#include "policy_workers/policy/utilities.h"
#include "rollout_buffer/core/check.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::policy {
namespace {

struct Dense {
  std::string name;
  Tensor weight, bias;

  Tensor operator()(const Tensor& x) const { return at::linear(x, weight, bias); }
};

void append(NamedTensors& named, const std::string& prefix, const Dense& layer) {
  named.emplace_back(prefix + layer.name + ".weight", layer.weight);
  named.emplace_back(prefix + layer.name + ".bias", layer.bias);
}

/// Rows [..., W * N, ...] of whole worlds along `axis` to those of one agent [..., W, ...], a view.
Tensor rows_of_agent(const Tensor& rows, int64_t axis, int64_t agent, int64_t agents) {
  return rows.defined() ? rows.slice(axis, agent, c10::nullopt, agents) : rows;
}

/// The inverse: N tensors [..., W, ...] to [..., W * N, ...].
Tensor interleave(const std::vector<Tensor>& of_agents, int64_t axis) {
  return of_agents.size() == 1 ? of_agents.front()
                               : torch::stack(of_agents, axis + 1).flatten(axis, axis + 1);
}

}  // namespace

/// Encoder, recurrent core and decoder: from an observation to features.
struct Tower {
  Encoder encoder;
  RecurrentCore core;
  std::vector<Dense> decoder;
  Precision precision = Precision::kFp32;

  int64_t feature_count() const {
    return decoder.empty() ? core.feature_count() : decoder.back().weight.size(0);
  }

  Tensor decoded(Tensor x) const {
    for (const Dense& layer : decoder) x = at::elu(linear(x, layer.weight, layer.bias, precision));
    return x;
  }

  /// `encoded` [B, E] of one step; features [B, F] and the state behind it.
  CoreOutput step(const Tensor& encoded, const Tensor& state) const {
    CoreOutput after = core.step(encoded, state);
    return {decoded(after.features), after.state};
  }

  /// `encoded` [T * B, E] of T steps; features [T * B, F].
  Tensor sequence(const Tensor& encoded, const Tensor& state, const Tensor& reset, int64_t steps) const {
    if (core.state_count() == 0) return decoded(encoded);
    const Tensor x = encoded.view({steps, encoded.size(0) / steps, encoded.size(1)});
    return decoded(unrolled(x, state, reset).features.flatten(0, 1));
  }

  /// The core over `encoded` [T, B, E].
  CoreOutput unrolled(const Tensor& encoded, const Tensor& state, const Tensor& reset) const {
    Tensor keep;
    if (reset.defined()) keep = reset.eq(0).to(torch::kFloat32).unsqueeze(-1);
    return core.sequence(encoded, state, keep);
  }

  NamedTensors named_parameters(const std::string& prefix) const {
    NamedTensors named;
    for (auto& [name, tensor] : encoder.named_parameters()) named.emplace_back(prefix + name, tensor);
    for (auto& [name, tensor] : core.named_parameters()) named.emplace_back(prefix + name, tensor);
    for (const Dense& layer : decoder) append(named, prefix, layer);
    return named;
  }
};

/// The network's parts in the order that a frame passes them.
class PolicyNetImpl {
 public:
  /// One for all agents, or one per agent.
  struct Actor {
    std::string prefix;  // of its names in checkpoints
    Tower tower;
    Dense action_head;                // [A, F]
    std::optional<Dense> value_head;  // kOwn
  };

  PolicyNetOptions options;
  torch::Device device = torch::kCPU;
  std::shared_ptr<ObservationNormalizer> normalizer;
  std::vector<Actor> actors;
  std::vector<Tower> critic_towers;  // kJoint: one per agent
  std::vector<Dense> critic;         // kCentral and kJoint: joint features of a world to values

  int64_t agents() const { return options.env.num_agents; }
  int64_t actor_state_count() const { return actors.front().tower.core.state_count(); }
  bool critic_has_state() const {
    return !critic_towers.empty() && critic_towers.front().core.state_count() > 0;
  }

  /// All rows of a shared tower, those of one agent where each has its own.
  Tensor rows_of_actor(const Tensor& rows, int64_t axis, std::size_t actor) const {
    return options.separate_agents ? rows_of_agent(rows, axis, static_cast<int64_t>(actor), agents()) : rows;
  }

  /// Encoded rows with the agent's index beside them, where the options ask for it. All agents' rows.
  Tensor with_agent_id(const Tensor& encoded) const {
    if (!options.agent_id_input) return encoded;
    const Tensor id = torch::eye(agents(), encoded.options()).repeat({encoded.size(0) / agents(), 1});
    return at::cat({encoded, id}, 1);
  }

  /// Features [worlds * N, F] to the critic's input for each agent, [worlds * N, F or 2F]: its own features
  /// first, then the mean of the others'.
  Tensor own_first(const Tensor& rows) const {
    const int64_t count = agents();
    if (count == 1) return rows;
    // One product with the matrix of weights 1/(N-1), 0 on the diagonal: subtracting an agent from the sum of
    // all would round differently for every agent.
    const Tensor others = (1 - torch::eye(count, rows.options())) / static_cast<double>(count - 1);
    const Tensor of_worlds = rows.view({rows.size(0) / count, count, rows.size(1)});
    return at::cat({rows, at::matmul(others, of_worlds).flatten(0, 1)}, 1);
  }

  /// Input [worlds, X] of the critic with the state [worlds, S] of the worlds behind it, where it sees one.
  Tensor with_state(const Tensor& x, const Tensor& state) const {
    if (options.global_state_count == 0) return x;
    COMRAD_CHECK(state.defined() && state.size(0) == x.size(0) && state.size(1) == options.global_state_count,
                 "the critic sees the global state [worlds, S]");
    return at::cat({x, normalizer->global_state.normalize(state.to(device))}, 1);
  }

  /// The same of own_first() [worlds * N, X], where the agent's index stands behind the state: it says whose of the
  /// state's numbers are its own.
  Tensor with_state_and_index(const Tensor& x, const Tensor& state) const {
    if (options.global_state_count == 0) return x;
    const Tensor id = torch::eye(agents(), x.options()).repeat({x.size(0) / agents(), 1});
    return at::cat({with_state(x, state.repeat_interleave(agents(), 0)), id}, 1);
  }

  /// The critic's input to its outputs: [worlds, F * N] to [worlds, 1 or N], own_first() to [worlds * N, 1].
  Tensor critic_values(Tensor x) const {
    for (std::size_t i = 0; i < critic.size(); ++i) {
      x = critic[i](x);
      if (i + 1 < critic.size()) x = at::tanh(x);
    }
    return x;
  }

  /// Values [B] of the rows whose features [B, F] the actors made, in worlds of state [worlds, S]; undefined without a
  /// critic.
  Tensor values(const std::vector<Tensor>& features_of_actors, const Tensor& state) const {
    if (options.critic == CriticKind::kCentral) {
      const Tensor rows = interleave(features_of_actors, 0);
      if (options.critic_view == CriticView::kOwnFirst)
        return critic_values(with_state_and_index(own_first(rows), state)).flatten();
      const Tensor of_worlds = rows.reshape({rows.size(0) / agents(), rows.size(1) * agents()});
      return critic_values(with_state(of_worlds, state)).flatten();
    }
    if (options.critic == CriticKind::kNone) return {};
    std::vector<Tensor> of_actors;
    for (std::size_t i = 0; i < actors.size(); ++i)
      of_actors.push_back((*actors[i].value_head)(features_of_actors[i]));
    return interleave(of_actors, 0).flatten();
  }

  /// Features [worlds, F] of each agent to the joint value, repeated for all agents: [worlds * N].
  Tensor joint_values(const std::vector<Tensor>& features_of_agents, const Tensor& state) const {
    return critic_values(with_state(at::cat(features_of_agents, 1), state)).expand({-1, agents()}).flatten();
  }

  /// One step. `encode(tower, agent)` gives a tower's encoded rows; agent is -1 for all of them.
  template <typename Encode>
  PolicyOutput act(Encode&& encode, const Tensor& recurrent_state, const Tensor& global_state) const {
    const int64_t state_count = actor_state_count();
    const Tensor state = recurrent_state.defined() && recurrent_state.size(1) > 0 ? recurrent_state.to(device)
                                                                                  : recurrent_state;
    const auto state_of = [&](int64_t first, int64_t count, int64_t agent) {
      if (count == 0) return state;
      const Tensor part = state.slice(1, first, first + count);
      return agent < 0 ? part : rows_of_agent(part, 0, agent, agents());
    };
    std::vector<Tensor> features, logits, states, critic_features, critic_states;
    for (std::size_t i = 0; i < actors.size(); ++i) {
      const int64_t agent = actors.size() == 1 && !options.separate_agents ? -1 : static_cast<int64_t>(i);
      const Tensor encoded = encode(actors[i].tower, agent);
      CoreOutput after =
          actors[i].tower.step(agent < 0 ? with_agent_id(encoded) : encoded, state_of(0, state_count, agent));
      logits.push_back(actors[i].action_head(after.features));
      features.push_back(after.features);
      states.push_back(after.state);
    }
    Tensor value;
    if (options.critic == CriticKind::kJoint) {
      for (std::size_t i = 0; i < critic_towers.size(); ++i) {
        const int64_t agent = static_cast<int64_t>(i);
        const int64_t count = critic_towers[i].core.state_count();
        CoreOutput after =
            critic_towers[i].step(encode(critic_towers[i], agent), state_of(state_count, count, agent));
        critic_features.push_back(after.features);
        critic_states.push_back(after.state);
      }
      value = joint_values(critic_features, global_state);
    } else {
      value = options.critic == CriticKind::kNone ? greedy_utility(interleave(logits, 0), {}, options.env)
                                                  : values(features, global_state);
    }
    Tensor after = state_count > 0 ? interleave(states, 0) : recurrent_state;
    if (critic_has_state())
      after =
          state_count > 0 ? at::cat({after, interleave(critic_states, 0)}, 1) : interleave(critic_states, 0);
    return {interleave(logits, 0), value, after};
  }

  NamedTensors named_actor_parameters(std::size_t index) const {
    const Actor& actor = actors[index];
    NamedTensors named = actor.tower.named_parameters(actor.prefix);
    append(named, actor.prefix, actor.action_head);
    if (actor.value_head) append(named, actor.prefix, *actor.value_head);
    return named;
  }

  NamedTensors named_critic_parameters() const {
    NamedTensors named;
    for (std::size_t i = 0; i < critic_towers.size(); ++i)
      for (auto& entry : critic_towers[i].named_parameters("critic.agent" + std::to_string(i) + "."))
        named.push_back(entry);
    for (const Dense& layer : critic) append(named, "", layer);
    return named;
  }

  NamedTensors named_parameters() const {
    NamedTensors named;
    for (std::size_t i = 0; i < actors.size(); ++i)
      for (auto& entry : named_actor_parameters(i)) named.push_back(entry);
    for (auto& entry : named_critic_parameters()) named.push_back(entry);
    return named;
  }

  device::Upload upload;  // of weights that came from the learner

  NamedTensors named_state() const {
    NamedTensors named = named_parameters();
    for (auto& entry : normalizer->named_buffers()) named.push_back(entry);
    return named;
  }
};

PolicyNetOptions PolicyNetOptions::from(const RunConfig& config, const EnvShape& env) {
  const auto widths = [](const std::string& text) {
    Expected<std::vector<int64_t>> parsed = parse_widths(text);
    COMRAD_CHECK(parsed.has_value(), "settings were resolved: widths are numbers");
    return *std::move(parsed);
  };
  PolicyNetOptions options;
  options.env = env;
  options.encoder = config.network.encoder_conv_architecture;
  options.use_rnn = config.network.use_rnn;
  options.rnn_type = config.network.rnn_type;
  options.rnn_size = config.network.rnn_size;
  options.rnn_num_layers = config.network.rnn_num_layers;
  options.decoder_widths = widths(config.network.decoder_mlp_layers);
  options.init_gain = config.network.policy_init_gain;
  options.normalize_input = config.network.normalize_input;
  options.separate_agents = !config.network.share_parameters || config.run.algo->separate_agents;
  options.agent_id_input = config.network.agent_id_input;
  options.critic = config.run.algo->critic;
  if (config.run.algo->mixes_q_values()) options.init = Initialization::kFrameworkDefault;
  options.critic_view = config.network.mappo_critic_view;
  options.critic_widths = widths(config.network.critic_hidden_sizes);
  options.critic_rnn = config.network.happo_critic_rnn;
  if (sees_global_state(config)) options.global_state_count = env.global_state_count;
  // "auto" stands in settings that were not resolved for a machine: then the same numbers everywhere.
  options.precision = config.collection.precision == Precision::kBf16 ? Precision::kBf16 : Precision::kFp32;
  return options;
}

int64_t PolicyNetOptions::core_state_count() const {
  if (!use_rnn) return 0;
  return rnn_num_layers * rnn_size * (rnn_type == RnnType::kLstm ? 2 : 1);
}

int64_t PolicyNetOptions::recurrent_state_count() const {
  return core_state_count() * (critic == CriticKind::kJoint && critic_rnn ? 2 : 1);
}

PolicyNet PolicyNet::create(const PolicyNetOptions& options, uint64_t seed, torch::Device device) {
  return make(options, seed, device,
              ObservationNormalizer::create(options.env, options.normalize_input, device,
                                            options.global_state_count));
}

PolicyNet PolicyNet::create_for_loading(PolicyNetOptions options, torch::Device device) {
  options.init = Initialization::kZero;
  return create(options, 0, device);
}

PolicyNet PolicyNet::twin() const {
  PolicyNetOptions own = options();
  own.init = Initialization::kZero;  // all are copied
  PolicyNet twin = make(own, 0, device(), impl_->normalizer);
  torch::NoGradGuard no_grad;
  const std::vector<Tensor> mine = parameters(), its = twin.parameters();
  for (std::size_t i = 0; i < mine.size(); ++i) its[i].copy_(mine[i]);
  return twin;
}

PolicyNet PolicyNet::make(const PolicyNetOptions& options, uint64_t seed, torch::Device device,
                          std::shared_ptr<ObservationNormalizer> normalizer) {
  COMRAD_CHECK(!options.agent_id_input || !options.separate_agents,
               "settings were resolved: an agent index is for a shared network");
  torch::NoGradGuard no_grad;
  at::Generator generator = at::make_generator<at::CPUGeneratorImpl>(seed);
  PolicyNet net;
  net.impl_ = std::make_shared<PolicyNetImpl>();
  PolicyNetImpl& impl = *net.impl_;
  impl.options = options;
  impl.device = device;
  impl.normalizer = std::move(normalizer);
  const int64_t agents = options.env.num_agents, logits = options.env.logit_count();

  const auto make_dense = [&](std::string name, int64_t inputs, int64_t outputs) {
    const auto [weight, bias] = initial_layer({outputs, inputs}, options.init, options.init_gain, generator);
    return Dense{std::move(name), weight.to(device).requires_grad_(), bias.to(device).requires_grad_()};
  };
  const auto make_tower = [&](bool has_core, int64_t extra_inputs) {
    Tower tower;
    tower.precision = options.precision;
    tower.encoder = Encoder::create({.env = options.env,
                                     .architecture = options.encoder,
                                     .init = options.init,
                                     .init_gain = options.init_gain,
                                     .normalize_input = options.normalize_input,
                                     .precision = options.precision},
                                    generator, device, impl.normalizer);
    const CoreKind kind = !has_core                            ? CoreKind::kNone
                          : options.rnn_type == RnnType::kLstm ? CoreKind::kLstm
                                                               : CoreKind::kGru;
    tower.core = RecurrentCore::create(kind, tower.encoder.feature_count() + extra_inputs, options.rnn_size,
                                       options.rnn_num_layers, generator, device, options.precision);
    for (const int64_t width : options.decoder_widths)
      tower.decoder.push_back(
          make_dense("decoder." + std::to_string(tower.decoder.size()), tower.feature_count(), width));
    return tower;
  };

  const int64_t actor_count = options.separate_agents ? agents : 1;
  for (int64_t i = 0; i < actor_count; ++i) {
    PolicyNetImpl::Actor actor;
    actor.prefix = options.separate_agents ? "agent" + std::to_string(i) + "." : "";
    actor.tower = make_tower(options.use_rnn, options.agent_id_input ? agents : 0);
    const int64_t features = actor.tower.feature_count();
    actor.action_head = make_dense("action_head", features, logits);
    if (options.critic == CriticKind::kOwn) actor.value_head = make_dense("value_head", features, 1);
    impl.actors.push_back(std::move(actor));
  }
  if (options.critic == CriticKind::kJoint)
    for (int64_t i = 0; i < agents; ++i)
      impl.critic_towers.push_back(make_tower(options.use_rnn && options.critic_rnn, 0));
  if (options.critic == CriticKind::kCentral || options.critic == CriticKind::kJoint) {
    const Tower& last = impl.critic_towers.empty() ? impl.actors.back().tower : impl.critic_towers.back();
    const bool is_own_first =
        options.critic == CriticKind::kCentral && options.critic_view == CriticView::kOwnFirst;
    int64_t inputs = last.feature_count() * (is_own_first ? std::min<int64_t>(agents, 2) : agents);
    if (options.global_state_count > 0)
      inputs += options.global_state_count + (is_own_first ? agents : 0);  // and whose value it is
    std::vector<int64_t> widths = options.critic_widths;
    widths.push_back(options.critic == CriticKind::kCentral && !is_own_first ? agents : 1);
    for (const int64_t width : widths) {
      impl.critic.push_back(make_dense("critic." + std::to_string(impl.critic.size()), inputs, width));
      inputs = width;
    }
  }
  return net;
}

PolicyOutput PolicyNet::step(const Tensor& frame, const Tensor& measurement, const Tensor& recurrent_state,
                             const Tensor& global_state) const {
  torch::NoGradGuard no_grad;
  const int64_t agents = impl_->agents();
  return impl_->act(
      [&](const Tower& tower, int64_t agent) {
        if (agent < 0) return tower.encoder.forward(frame, measurement);
        return tower.encoder.forward(rows_of_agent(frame, 0, agent, agents),
                                     rows_of_agent(measurement, 0, agent, agents));
      },
      recurrent_state, global_state);
}

PolicyOutput PolicyNet::step_rows(std::span<const uint8_t* const> frames, const Tensor& measurement,
                                  const Tensor& recurrent_state, const Tensor& global_state) const {
  torch::NoGradGuard no_grad;
  const int64_t agents = impl_->agents();
  std::vector<const uint8_t*> rows;
  return impl_->act(
      [&](const Tower& tower, int64_t agent) {
        if (agent < 0) return tower.encoder.forward_rows(frames, measurement);
        rows.clear();
        for (std::size_t row = static_cast<std::size_t>(agent); row < frames.size();
             row += static_cast<std::size_t>(agents))
          rows.push_back(frames[row]);
        return tower.encoder.forward_rows(rows, rows_of_agent(measurement, 0, agent, agents));
      },
      recurrent_state, global_state);
}

PolicyOutput PolicyNet::step_agents(std::span<const uint8_t* const> frames, const Tensor& measurement,
                                    const Tensor& recurrent_state, std::span<const int> agents) const {
  torch::NoGradGuard no_grad;
  const PolicyNetImpl& impl = *impl_;
  const auto count = static_cast<int64_t>(agents.size());
  const int64_t state_count = impl.actor_state_count();
  const Tensor state = state_count > 0 ? recurrent_state.slice(1, 0, state_count).to(impl.device) : Tensor();
  std::vector<Tensor> logits, states;
  const auto act = [&](const PolicyNetImpl::Actor& actor, const Tensor& encoded, const Tensor& before) {
    const CoreOutput after = actor.tower.step(encoded, before);
    logits.push_back(actor.action_head(after.features));
    states.push_back(after.state);
  };
  if (impl.options.separate_agents) {
    std::vector<const uint8_t*> rows;
    for (int64_t k = 0; k < count; ++k) {
      const PolicyNetImpl::Actor& actor =
          impl.actors[static_cast<std::size_t>(agents[static_cast<std::size_t>(k)])];
      rows.clear();
      for (std::size_t row = static_cast<std::size_t>(k); row < frames.size(); row += agents.size())
        rows.push_back(frames[row]);
      act(actor, actor.tower.encoder.forward_rows(rows, rows_of_agent(measurement, 0, k, count)),
          rows_of_agent(state, 0, k, count));
    }
  } else {
    const PolicyNetImpl::Actor& actor = impl.actors.front();
    Tensor encoded = actor.tower.encoder.forward_rows(frames, measurement);
    if (impl.options.agent_id_input) {
      Tensor id = torch::zeros({count, impl.agents()}, encoded.options());
      for (int64_t k = 0; k < count; ++k) id[k][agents[static_cast<std::size_t>(k)]] = 1;
      encoded = at::cat({encoded, id.repeat({encoded.size(0) / count, 1})}, 1);
    }
    act(actor, encoded, state);
  }
  Tensor after = recurrent_state;
  if (state_count > 0) {
    after = recurrent_state.clone();
    after.slice(1, 0, state_count).copy_(interleave(states, 0));
  }
  return {interleave(logits, 0), Tensor(), after};
}

namespace {

/// A tower's features [T * B, F] of a sequence; `first` and `count` say where its state lies in the
/// rows' state.
Tensor tower_sequence(const Tower& tower, const SequenceInput& input, int64_t first,
                      const std::function<Tensor(const Tensor&)>& extend = {}) {
  Tensor encoded = tower.encoder.forward(input.frame.flatten(0, 1), input.measurement.defined()
                                                                        ? input.measurement.flatten(0, 1)
                                                                        : input.measurement);
  if (extend) encoded = extend(encoded);
  const int64_t count = tower.core.state_count();
  return tower.sequence(encoded, count > 0 ? input.recurrent_state.slice(1, first, first + count) : Tensor(),
                        input.reset, input.frame.size(0));
}

SequenceInput input_of_agent(const SequenceInput& input, int64_t agent, int64_t agents) {
  return {.frame = rows_of_agent(input.frame, 1, agent, agents),
          .measurement = rows_of_agent(input.measurement, 1, agent, agents),
          .recurrent_state = rows_of_agent(input.recurrent_state, 0, agent, agents),
          .reset = rows_of_agent(input.reset, 1, agent, agents)};
}

/// The global states of all steps and worlds, one after the other [T * W, S].
Tensor worlds_of(const SequenceInput& input) {
  return input.global_state.defined() ? input.global_state.flatten(0, 1) : input.global_state;
}

}  // namespace

SequenceOutput PolicyNet::sequence(const SequenceInput& input) const {
  const PolicyNetImpl& impl = *impl_;
  const int64_t steps = input.frame.size(0), rows = input.frame.size(1);
  std::vector<Tensor> features, logits;
  for (std::size_t i = 0; i < impl.actors.size(); ++i) {
    const PolicyNetImpl::Actor& actor = impl.actors[i];
    features.push_back(
        impl.options.separate_agents
            ? tower_sequence(actor.tower, input_of_agent(input, static_cast<int64_t>(i), impl.agents()), 0)
            : tower_sequence(actor.tower, input, 0,
                             [&](const Tensor& encoded) { return impl.with_agent_id(encoded); }));
    logits.push_back(actor.action_head(features.back()));
  }
  Tensor value;
  if (impl.options.critic == CriticKind::kJoint)
    value = joint_value_sequence(input);
  else if (impl.options.critic != CriticKind::kNone)
    value = impl.values(features, worlds_of(input)).view({steps, rows});
  return {interleave(logits, 0).view({steps, rows, -1}), value};
}

SequenceOutput PolicyNet::sequence(const Tensor& frame, const Tensor& measurement,
                                   const Tensor& recurrent_state, const Tensor& reset) const {
  return sequence(
      {.frame = frame, .measurement = measurement, .recurrent_state = recurrent_state, .reset = reset});
}

Tensor PolicyNet::encode(const Tensor& frame, const Tensor& measurement) const {
  const PolicyNetImpl& impl = *impl_;
  if (!impl.options.separate_agents)
    return impl.with_agent_id(impl.actors.front().tower.encoder.forward(frame, measurement));
  std::vector<Tensor> encoded;
  for (std::size_t i = 0; i < impl.actors.size(); ++i) {
    const int64_t agent = static_cast<int64_t>(i);
    encoded.push_back(impl.actors[i].tower.encoder.forward(
        rows_of_agent(frame, 0, agent, impl.agents()), rows_of_agent(measurement, 0, agent, impl.agents())));
  }
  return interleave(encoded, 0);
}

Tensor PolicyNet::logits_of(const Tensor& encoded, const Tensor& recurrent_state, const Tensor& reset) const {
  const PolicyNetImpl& impl = *impl_;
  const int64_t steps = encoded.size(0);
  std::vector<Tensor> logits;
  for (std::size_t i = 0; i < impl.actors.size(); ++i) {
    const Tower& tower = impl.actors[i].tower;
    const Tensor features =
        tower.sequence(impl.rows_of_actor(encoded, 1, i).flatten(0, 1),
                       impl.rows_of_actor(recurrent_state, 0, i), impl.rows_of_actor(reset, 1, i), steps);
    logits.push_back(impl.actors[i].action_head(features));
  }
  return interleave(logits, 0).view({steps, encoded.size(1), -1});
}

Tensor PolicyNet::state_after(const Tensor& encoded, const Tensor& recurrent_state,
                              const Tensor& reset) const {
  const PolicyNetImpl& impl = *impl_;
  std::vector<Tensor> states;
  for (std::size_t i = 0; i < impl.actors.size(); ++i)
    states.push_back(impl.actors[i]
                         .tower
                         .unrolled(impl.rows_of_actor(encoded, 1, i),
                                   impl.rows_of_actor(recurrent_state, 0, i), impl.rows_of_actor(reset, 1, i))
                         .state);
  return interleave(states, 0);
}

int64_t PolicyNet::encoded_count() const {
  return impl_->actors.front().tower.encoder.feature_count() +
         (impl_->options.agent_id_input ? impl_->agents() : 0);
}

Tensor PolicyNet::actor_sequence(int64_t agent, const SequenceInput& input) const {
  COMRAD_CHECK(impl_->options.separate_agents, "each agent has an actor of its own");
  const PolicyNetImpl::Actor& actor = impl_->actors[static_cast<std::size_t>(agent)];
  return actor.action_head(tower_sequence(actor.tower, input, 0))
      .view({input.frame.size(0), input.frame.size(1), -1});
}

Tensor PolicyNet::joint_value_sequence(const SequenceInput& input) const {
  const PolicyNetImpl& impl = *impl_;
  COMRAD_CHECK(impl.options.critic == CriticKind::kJoint, "the network has a joint critic");
  std::vector<Tensor> features;
  for (std::size_t i = 0; i < impl.critic_towers.size(); ++i)
    features.push_back(tower_sequence(impl.critic_towers[i],
                                      input_of_agent(input, static_cast<int64_t>(i), impl.agents()),
                                      impl.actor_state_count()));
  return impl.joint_values(features, worlds_of(input)).view({input.frame.size(0), input.frame.size(1)});
}

void PolicyNet::update_input_statistics(const Tensor& frame, const Tensor& measurement,
                                        const AddUp& add_up_frames) const {
  impl_->actors.front().tower.encoder.update_statistics(frame, measurement, add_up_frames);
}

void PolicyNet::update_state_statistics(const Tensor& global_state) const {
  impl_->normalizer->global_state.update(global_state);
}

Tensor PolicyNet::normalized_state(const Tensor& global_state) const {
  return impl_->normalizer->global_state.normalize(global_state.to(impl_->device));
}

std::vector<Tensor> PolicyNet::parameters() const {
  std::vector<Tensor> parameters;
  for (auto& [name, tensor] : impl_->named_parameters()) parameters.push_back(tensor);
  return parameters;
}

NamedTensors PolicyNet::named_parameters() const { return impl_->named_parameters(); }

std::vector<Tensor> PolicyNet::actor_parameters(int64_t agent) const {
  COMRAD_CHECK(impl_->options.separate_agents, "each agent has an actor of its own");
  std::vector<Tensor> parameters;
  for (auto& [name, tensor] : impl_->named_actor_parameters(static_cast<std::size_t>(agent)))
    parameters.push_back(tensor);
  return parameters;
}

std::vector<Tensor> PolicyNet::joint_critic_parameters() const {
  std::vector<Tensor> parameters;
  for (auto& [name, tensor] : impl_->named_critic_parameters()) parameters.push_back(tensor);
  return parameters;
}

NamedTensors PolicyNet::named_state() const { return impl_->named_state(); }

int64_t PolicyNet::parameter_count() const {
  int64_t count = 0;
  for (const Tensor& parameter : parameters()) count += parameter.numel();
  return count;
}

int64_t PolicyNet::weights_bytes() const {
  int64_t bytes = 0;
  for (auto& [name, tensor] : named_state()) bytes += static_cast<int64_t>(tensor.nbytes());
  return bytes;
}

std::vector<Tensor> PolicyNet::state_tensors() const {
  std::vector<Tensor> state;
  for (auto& [name, tensor] : named_state()) state.push_back(tensor.detach());
  return state;
}

void PolicyNet::copy_weights(device::Snapshot& into) const { into.take(state_tensors()); }

std::vector<std::byte> PolicyNet::weights() const {
  device::Snapshot copy;
  copy_weights(copy);
  const std::span<const std::byte> bytes = copy.wait();
  return {bytes.begin(), bytes.end()};
}

Status PolicyNet::read_weights(std::span<const std::byte> in) const {
  if (static_cast<int64_t>(in.size()) != weights_bytes())
    return Error{ErrorCode::kBadFormat, "weights of " + std::to_string(in.size()) +
                                            " bytes, but this network has " +
                                            std::to_string(weights_bytes()) +
                                            "; learner and policy worker must run the same config.toml"};
  impl_->upload.put(in, state_tensors());
  impl_->normalizer->refresh();
  return {};
}

void PolicyNet::state_changed() const { impl_->normalizer->refresh(); }

const PolicyNetOptions& PolicyNet::options() const { return impl_->options; }
torch::Device PolicyNet::device() const { return impl_->device; }

Expected<torch::Device> choose_device(const std::string& setting) {
  if (setting == "cpu") return torch::Device(torch::kCPU);
  const bool has_cuda = at::hasCUDA();
  if (setting == "auto") return torch::Device(has_cuda ? torch::kCUDA : torch::kCPU);
  int64_t index = 0;
  if (setting != "cuda") {
    constexpr std::string_view kPrefix = "cuda:";
    const char* first = setting.data() + std::min(kPrefix.size(), setting.size());
    const char* last = setting.data() + setting.size();
    const auto parsed = std::from_chars(first, last, index);
    if (!setting.starts_with(kPrefix) || parsed.ec != std::errc() || parsed.ptr != last || index < 0 ||
        index > 127)
      return Error{ErrorCode::kBadInput,
                   "device is '" + setting + "'; it may be auto, cpu, cuda or cuda:<n>"};
  }
  const int64_t count = has_cuda ? static_cast<int64_t>(at::getNumGPUs()) : 0;
  if (index >= count)
    return Error{ErrorCode::kUnsupported,
                 "device is '" + setting + "', but there are " + std::to_string(count) +
                     " CUDA devices here (or this libtorch was built without CUDA); use --device cpu"};
  return torch::Device(torch::kCUDA, static_cast<torch::DeviceIndex>(index));
}

}  // namespace comrad::policy
