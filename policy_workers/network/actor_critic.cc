#include "policy_workers/network/actor_critic.h"

#include <spdlog/fmt/fmt.h>

#include <string_view>
#include <utility>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/device/upload.h"
#include "policy_workers/network/critic.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {

/// The network's parts in the order that a frame passes them.
class ActorCriticImpl {
 public:
  /// One for all agents, or one per agent.
  struct Actor {
    std::string prefix;  // of its names in checkpoints
    Tower tower;
    Layer action_head;              // [A, F]
    std::vector<Layer> value_head;  // of CriticKind::kOwn: one
  };

  NetworkOptions options;
  torch::Device device = torch::kCPU;
  std::shared_ptr<ObservationNormalizer> normalizer;
  std::vector<Actor> actors;
  std::shared_ptr<const Critic> critic;
  device::Upload upload;  // of weights that came from the learner

  int64_t agents() const { return options.env.num_agents; }
  int64_t actor_state_count() const { return actors.front().tower.state_count(); }

  /// The agent whose rows actor `index` gets.
  int64_t agent_of(std::size_t index) const {
    return options.separate_agents ? static_cast<int64_t>(index) : kAllAgents;
  }
  Tensor rows_of_actor(const Tensor& rows, int64_t axis, std::size_t index) const {
    return options.separate_agents ? rows_of_agent(rows, axis, agent_of(index), agents()) : rows;
  }

  /// Encoded rows with the agent's index beside them, where the options require it. All agents' rows.
  Tensor with_agent_id(const Tensor& encoded) const {
    if (!options.agent_id_input) return encoded;
    const Tensor id = torch::eye(agents(), encoded.options()).repeat({encoded.size(0) / agents(), 1});
    return at::cat({encoded, id}, 1);
  }

  /// One step of all agents.
  PolicyOutput act(const Encode& encode, const Tensor& recurrent_state, const Tensor& global_state) const {
    const int64_t own = actor_state_count(), of_critic = critic->state_count();
    const Tensor state = recurrent_state.defined() && recurrent_state.size(1) > 0 ? recurrent_state.to(device)
                                                                                  : recurrent_state;
    const Tensor actor_state = own > 0 ? state.slice(1, 0, own) : state;
    std::vector<Tensor> features, logits, states;
    for (std::size_t i = 0; i < actors.size(); ++i) {
      const Actor& actor = actors[i];
      const CoreOutput after = actor.tower.step(with_agent_id(encode(actor.tower.encoder(), agent_of(i))),
                                                own > 0 ? rows_of_actor(actor_state, 0, i) : actor_state);
      logits.push_back(actor.action_head(after.features));
      features.push_back(after.features);
      states.push_back(after.state);
    }
    const Tensor all_logits = interleave(logits, 0);
    const CriticOutput critical =
        critic->step({.actor_features = features, .logits = all_logits, .global_state = global_state},
                     of_critic > 0 ? state.slice(1, own, own + of_critic) : state, encode);
    Tensor after = own > 0 ? interleave(states, 0) : recurrent_state;
    if (of_critic > 0) after = own > 0 ? at::cat({after, critical.state}, 1) : critical.state;
    return {all_logits, critical.value, after};
  }

  NamedTensors named_actor_parameters(std::size_t index) const {
    const Actor& actor = actors[index];
    NamedTensors named = actor.tower.named_parameters(actor.prefix);
    append(named, actor.prefix, actor.action_head);
    for (const Layer& head : actor.value_head) append(named, actor.prefix, head);
    return named;
  }

  NamedTensors named_parameters() const {
    NamedTensors named;
    for (std::size_t i = 0; i < actors.size(); ++i) append(named, "", named_actor_parameters(i));
    append(named, "", critic->named_parameters());
    return named;
  }

  NamedTensors named_state() const {
    NamedTensors named = named_parameters();
    append(named, "", normalizer->named_buffers());
    return named;
  }
};

ActorCritic ActorCritic::create(const NetworkOptions& options, uint64_t seed, torch::Device device) {
  return make(options, seed, device,
              ObservationNormalizer::create(options.env, options.normalize_input, device,
                                            options.global_state_count));
}

ActorCritic ActorCritic::create_for_loading(NetworkOptions options, torch::Device device) {
  options.init = Initialization::kZero;
  return create(options, 0, device);
}

ActorCritic ActorCritic::twin() const {
  NetworkOptions own = options();
  own.init = Initialization::kZero;  // all are copied
  ActorCritic twin = make(own, 0, device(), impl_->normalizer);
  torch::NoGradGuard no_grad;
  const std::vector<Tensor> mine = parameters(), its = twin.parameters();
  for (std::size_t i = 0; i < mine.size(); ++i) its[i].copy_(mine[i]);
  return twin;
}

ActorCritic ActorCritic::make(const NetworkOptions& options, uint64_t seed, torch::Device device,
                              std::shared_ptr<ObservationNormalizer> normalizer) {
  COMRAD_CHECK(!options.agent_id_input || !options.separate_agents,
               "settings were resolved: an agent index is for a shared network");
  torch::NoGradGuard no_grad;
  ActorCritic net;
  net.impl_ = std::make_shared<ActorCriticImpl>();
  ActorCriticImpl& impl = *net.impl_;
  impl.options = options;
  impl.device = device;
  impl.normalizer = std::move(normalizer);
  const LayerMaker make = {.init = options.init,
                           .gain = options.init_gain,
                           .generator = at::make_generator<at::CPUGeneratorImpl>(seed),
                           .device = device,
                           .precision = options.precision};
  const int64_t agents = options.env.num_agents;
  std::vector<Layer> value_heads;
  for (int64_t i = 0; i < (options.separate_agents ? agents : 1); ++i) {
    Tower tower(options, options.use_rnn, options.agent_id_input ? agents : 0, impl.normalizer, make);
    const int64_t features = tower.feature_count();
    Layer action_head = make("action_head", {options.env.logit_count(), features});
    std::vector<Layer> value_head;
    if (options.critic == CriticKind::kOwn) {
      value_head = {make("value_head", {1, features})};
      value_heads.push_back(value_head.front());
    }
    impl.actors.push_back({.prefix = options.separate_agents ? fmt::format("agent{}.", i) : "",
                           .tower = std::move(tower),
                           .action_head = std::move(action_head),
                           .value_head = std::move(value_head)});
  }
  impl.critic = make_critic({.options = options,
                             .normalizer = impl.normalizer,
                             .actor_feature_count = impl.actors.front().tower.feature_count(),
                             .actor_state_count = impl.actor_state_count(),
                             .value_heads = std::move(value_heads)},
                            make);
  return net;
}

PolicyOutput ActorCritic::step(const Tensor& frame, const Tensor& measurement, const Tensor& recurrent_state,
                               const Tensor& global_state) const {
  torch::NoGradGuard no_grad;
  const int64_t agents = impl_->agents();
  return impl_->act(
      [&](const Encoder& encoder, int64_t agent) {
        if (agent == kAllAgents) return encoder.forward(frame, measurement);
        return encoder.forward(rows_of_agent(frame, 0, agent, agents),
                               rows_of_agent(measurement, 0, agent, agents));
      },
      recurrent_state, global_state);
}

PolicyOutput ActorCritic::step_rows(std::span<const uint8_t* const> frames, const Tensor& measurement,
                                    const Tensor& recurrent_state, const Tensor& global_state) const {
  torch::NoGradGuard no_grad;
  const int64_t agents = impl_->agents();
  std::vector<const uint8_t*> rows;
  return impl_->act(
      [&](const Encoder& encoder, int64_t agent) {
        if (agent == kAllAgents) return encoder.forward_rows(frames, measurement);
        rows.clear();
        for (auto row = static_cast<std::size_t>(agent); row < frames.size();
             row += static_cast<std::size_t>(agents))
          rows.push_back(frames[row]);
        return encoder.forward_rows(rows, rows_of_agent(measurement, 0, agent, agents));
      },
      recurrent_state, global_state);
}

PolicyOutput ActorCritic::step_agents(std::span<const uint8_t* const> frames, const Tensor& measurement,
                                      const Tensor& recurrent_state, std::span<const int> agents) const {
  torch::NoGradGuard no_grad;
  const ActorCriticImpl& impl = *impl_;
  const auto count = static_cast<int64_t>(agents.size());
  const int64_t state_count = impl.actor_state_count();
  const Tensor state = state_count > 0 ? recurrent_state.slice(1, 0, state_count).to(impl.device) : Tensor();
  std::vector<Tensor> logits, states;
  const auto act = [&](const ActorCriticImpl::Actor& actor, const Tensor& encoded, const Tensor& before) {
    const CoreOutput after = actor.tower.step(encoded, before);
    logits.push_back(actor.action_head(after.features));
    states.push_back(after.state);
  };
  if (impl.options.separate_agents) {
    std::vector<const uint8_t*> rows;
    for (int64_t k = 0; k < count; ++k) {
      const ActorCriticImpl::Actor& actor =
          impl.actors[static_cast<std::size_t>(agents[static_cast<std::size_t>(k)])];
      rows.clear();
      for (auto row = static_cast<std::size_t>(k); row < frames.size(); row += agents.size())
        rows.push_back(frames[row]);
      act(actor, actor.tower.encoder().forward_rows(rows, rows_of_agent(measurement, 0, k, count)),
          rows_of_agent(state, 0, k, count));
    }
  } else {
    const ActorCriticImpl::Actor& actor = impl.actors.front();
    Tensor encoded = actor.tower.encoder().forward_rows(frames, measurement);
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

SequenceOutput ActorCritic::sequence(const SequenceInput& input) const {
  const ActorCriticImpl& impl = *impl_;
  const int64_t steps = input.frame.size(0), rows = input.frame.size(1);
  std::vector<Tensor> features, logits;
  for (std::size_t i = 0; i < impl.actors.size(); ++i) {
    const ActorCriticImpl::Actor& actor = impl.actors[i];
    features.push_back(impl.options.separate_agents
                           ? actor.tower.sequence(input.of_agent(impl.agent_of(i), impl.agents()), 0)
                           : actor.tower.sequence(input, 0, [&](const Tensor& encoded) {
                               return impl.with_agent_id(encoded);
                             }));
    logits.push_back(actor.action_head(features.back()));
  }
  const Tensor value = impl.critic->sequence(
      {.actor_features = features,
       .global_state = input.global_state.defined() ? input.global_state.flatten(0, 1) : Tensor()},
      input);
  return {interleave(logits, 0).view({steps, rows, -1}), value.defined() ? value.view({steps, rows}) : value};
}

SequenceOutput ActorCritic::sequence(const Tensor& frame, const Tensor& measurement,
                                     const Tensor& recurrent_state, const Tensor& reset) const {
  return sequence(
      {.frame = frame, .measurement = measurement, .recurrent_state = recurrent_state, .reset = reset});
}

Tensor ActorCritic::encode(const Tensor& frame, const Tensor& measurement) const {
  const ActorCriticImpl& impl = *impl_;
  std::vector<Tensor> encoded;
  for (std::size_t i = 0; i < impl.actors.size(); ++i)
    encoded.push_back(impl.actors[i].tower.encoder().forward(impl.rows_of_actor(frame, 0, i),
                                                             impl.rows_of_actor(measurement, 0, i)));
  return to_f32(impl.with_agent_id(interleave(encoded, 0)));
}

Tensor ActorCritic::logits_of(const Tensor& encoded, const Tensor& recurrent_state,
                              const Tensor& reset) const {
  const ActorCriticImpl& impl = *impl_;
  const int64_t steps = encoded.size(0);
  std::vector<Tensor> logits;
  for (std::size_t i = 0; i < impl.actors.size(); ++i) {
    const Tensor features = impl.actors[i].tower.sequence(impl.rows_of_actor(encoded, 1, i).flatten(0, 1),
                                                          impl.rows_of_actor(recurrent_state, 0, i),
                                                          impl.rows_of_actor(reset, 1, i), steps);
    logits.push_back(impl.actors[i].action_head(features));
  }
  return interleave(logits, 0).view({steps, encoded.size(1), -1});
}

Tensor ActorCritic::state_after(const Tensor& encoded, const Tensor& recurrent_state,
                                const Tensor& reset) const {
  const ActorCriticImpl& impl = *impl_;
  std::vector<Tensor> states;
  for (std::size_t i = 0; i < impl.actors.size(); ++i)
    states.push_back(impl.actors[i]
                         .tower
                         .unrolled(impl.rows_of_actor(encoded, 1, i),
                                   impl.rows_of_actor(recurrent_state, 0, i), impl.rows_of_actor(reset, 1, i))
                         .state);
  return interleave(states, 0);
}

int64_t ActorCritic::encoded_count() const {
  return impl_->actors.front().tower.encoder().feature_count() +
         (impl_->options.agent_id_input ? impl_->agents() : 0);
}

Tensor ActorCritic::actor_sequence(int64_t agent, const SequenceInput& input) const {
  COMRAD_CHECK(impl_->options.separate_agents, "each agent has its own actor");
  const ActorCriticImpl::Actor& actor = impl_->actors[static_cast<std::size_t>(agent)];
  return actor.action_head(actor.tower.sequence(input, 0))
      .view({input.frame.size(0), input.frame.size(1), -1});
}

Tensor ActorCritic::joint_value_sequence(const SequenceInput& input) const {
  COMRAD_CHECK(impl_->options.critic == CriticKind::kJoint, "the network has a joint critic");
  return impl_->critic->sequence_without_actors(input).view({input.frame.size(0), input.frame.size(1)});
}

void ActorCritic::update_input_statistics(const Tensor& frame, const Tensor& measurement,
                                          const AddUp& add_up_frames) const {
  impl_->normalizer->frame.update(frame, add_up_frames);
  if (impl_->options.env.measurement_count > 0 && measurement.defined())
    impl_->normalizer->measurement.update(measurement);
}

void ActorCritic::update_state_statistics(const Tensor& global_state) const {
  impl_->normalizer->global_state.update(global_state);
}

Tensor ActorCritic::normalized_state(const Tensor& global_state) const {
  return impl_->normalizer->global_state.normalize(global_state.to(impl_->device));
}

std::vector<Tensor> ActorCritic::parameters() const {
  std::vector<Tensor> parameters;
  for (auto& [name, tensor] : impl_->named_parameters()) parameters.push_back(tensor);
  return parameters;
}

NamedTensors ActorCritic::named_parameters() const { return impl_->named_parameters(); }

std::vector<Tensor> ActorCritic::actor_parameters(int64_t agent) const {
  COMRAD_CHECK(impl_->options.separate_agents, "each agent has its own actor");
  std::vector<Tensor> parameters;
  for (auto& [name, tensor] : impl_->named_actor_parameters(static_cast<std::size_t>(agent)))
    parameters.push_back(tensor);
  return parameters;
}

std::vector<Tensor> ActorCritic::joint_critic_parameters() const {
  std::vector<Tensor> parameters;
  for (auto& [name, tensor] : impl_->critic->named_parameters()) parameters.push_back(tensor);
  return parameters;
}

NamedTensors ActorCritic::named_state() const { return impl_->named_state(); }

int64_t ActorCritic::parameter_count() const {
  int64_t count = 0;
  for (const Tensor& parameter : parameters()) count += parameter.numel();
  return count;
}

int64_t ActorCritic::weights_bytes() const {
  int64_t bytes = 0;
  for (auto& [name, tensor] : named_state()) bytes += static_cast<int64_t>(tensor.nbytes());
  return bytes;
}

std::vector<Tensor> ActorCritic::weight_tensors() const {
  std::vector<Tensor> state;
  for (auto& [name, tensor] : named_state()) state.push_back(tensor.detach());
  return state;
}

std::vector<std::byte> ActorCritic::weights() const {
  device::Snapshot copy;
  copy.take(weight_tensors());
  const std::span<const std::byte> bytes = copy.wait();
  return {bytes.begin(), bytes.end()};
}

Status ActorCritic::read_weights(std::span<const std::byte> in) const {
  if (static_cast<int64_t>(in.size()) != weights_bytes())
    return Error{ErrorCode::kBadFormat, fmt::format("weights of {} bytes, but this network has {}; learner "
                                                    "and policy worker must run the same config.toml",
                                                    in.size(), weights_bytes())};
  impl_->upload.put(in, weight_tensors());
  state_changed();
  return {};
}

void ActorCritic::rescale_values(double scale, double shift) const {
  torch::NoGradGuard no_grad;
  for (const Layer& layer : impl_->critic->output_layers()) {
    layer.weight.mul_(scale);
    layer.bias.mul_(scale).add_(shift);
  }
}

void ActorCritic::state_changed() const { impl_->normalizer->refresh(); }

const NetworkOptions& ActorCritic::options() const { return impl_->options; }

std::string ActorCritic::description() const {
  constexpr std::string_view kValues[] = {"own", "central", "joint", "no"};  // of CriticKind
  const NetworkOptions& o = impl_->options;
  const std::string core =
      o.use_rnn ? fmt::format("{} of {}", word_of(o.rnn_type), o.rnn_size) : "no recurrent core";
  return "encoder " + o.encoder + " by " + impl_->actors.front().tower.encoder().implementation() + ", " +
         core + ", " + std::string(kValues[static_cast<std::size_t>(o.critic)]) + " values, " +
         word_of(o.precision) + " products" + (o.layer_norm ? ", layer normalisation" : "");
}

torch::Device ActorCritic::device() const { return impl_->device; }

}  // namespace comrad::policy
