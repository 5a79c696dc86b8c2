#include "policy_workers/network/critic.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/utilities.h"
#include "rollout_buffer/core/check.h"

namespace comrad::policy {
namespace {

/// Q-learning: the value of a step is its best choice's.
class NoCritic : public Critic {
 public:
  explicit NoCritic(const EnvShape& env) : env_(env) {}
  CriticOutput step(const CriticInput& input, const Tensor& state, const Encode&) const override {
    return {greedy_utility(input.logits, {}, env_), state};
  }
  Tensor sequence(const CriticInput&, const SequenceInput&) const override { return {}; }

 private:
  EnvShape env_;
};

/// A value head beside each actor's action head.
class OwnCritic : public Critic {
 public:
  explicit OwnCritic(std::vector<Layer> heads) : heads_(std::move(heads)) {}
  CriticOutput step(const CriticInput& input, const Tensor& state, const Encode&) const override {
    return {values(input), state};
  }
  Tensor sequence(const CriticInput& input, const SequenceInput&) const override { return values(input); }
  std::vector<Layer> output_layers() const override { return heads_; }

 private:
  Tensor values(const CriticInput& input) const {
    std::vector<Tensor> of_actors;
    for (std::size_t i = 0; i < heads_.size(); ++i) of_actors.push_back(heads_[i](input.actor_features[i]));
    return interleave(of_actors, 0).flatten();
  }
  std::vector<Layer> heads_;
};

/// Linear layers over a team's features, tanh between them, and the world's state beside the first one's input.
class TeamCritic : public Critic {
 public:
  std::vector<Layer> output_layers() const override { return {layers_.back()}; }

 protected:
  explicit TeamCritic(const CriticParts& parts)
      : agents_(parts.options.env.num_agents),
        state_size_(parts.options.global_state_count),
        normalizer_(parts.normalizer) {}

  void make_layers(int64_t inputs, std::vector<int64_t> widths, int64_t outputs, const LayerMaker& make) {
    widths.push_back(outputs);
    for (const int64_t width : widths) {
      layers_.push_back(make(fmt::format("critic.{}", layers_.size()), {width, inputs}));
      inputs = width;
    }
  }

  /// Input [worlds, X] of the critic with the state [worlds, S] of the worlds behind it, where it sees one.
  Tensor with_state(const Tensor& x, const Tensor& state) const {
    if (state_size_ == 0) return x;
    COMRAD_CHECK(state.defined() && state.size(0) == x.size(0) && state.size(1) == state_size_,
                 "the critic sees the global state [worlds, S]");
    return at::cat({x, normalizer_->global_state.normalize(state.to(x.device()))}, 1);
  }

  Tensor outputs(Tensor x) const {
    for (std::size_t i = 0; i < layers_.size(); ++i) {
      x = layers_[i](x);
      if (i + 1 < layers_.size()) x = at::tanh(x);
    }
    return x;
  }

  NamedTensors layer_parameters() const {
    NamedTensors named;
    for (const Layer& layer : layers_) append(named, "", layer);
    return named;
  }

  int64_t agents_, state_size_;

 private:
  std::shared_ptr<const ObservationNormalizer> normalizer_;
  std::vector<Layer> layers_;
};

/// MAPPO: one pass over the features that the actors have made.
class CentralCritic : public TeamCritic {
 public:
  CentralCritic(const CriticParts& parts, const LayerMaker& make)
      : TeamCritic(parts), is_own_first_(parts.options.critic_view == CriticView::kOwnFirst) {
    int64_t inputs = parts.actor_feature_count * (is_own_first_ ? std::min<int64_t>(agents_, 2) : agents_);
    if (state_size_ > 0) inputs += state_size_ + (is_own_first_ ? agents_ : 0);  // and whose value it is
    make_layers(inputs, parts.options.critic_widths, is_own_first_ ? 1 : agents_, make);
  }

  CriticOutput step(const CriticInput& input, const Tensor& state, const Encode&) const override {
    return {values(input), state};
  }
  Tensor sequence(const CriticInput& input, const SequenceInput&) const override { return values(input); }
  NamedTensors named_parameters() const override { return layer_parameters(); }

 private:
  Tensor values(const CriticInput& input) const {
    const Tensor rows = interleave({input.actor_features.begin(), input.actor_features.end()}, 0);
    if (is_own_first_) return outputs(with_state_and_index(own_first(rows), input.global_state)).flatten();
    const Tensor of_worlds = rows.reshape({rows.size(0) / agents_, rows.size(1) * agents_});
    return outputs(with_state(of_worlds, input.global_state)).flatten();
  }

  /// Features [worlds * N, F] to the critic's input for each agent, [worlds * N, F or 2F]: its own features
  /// first, then the mean of the others'.
  Tensor own_first(const Tensor& rows) const {
    if (agents_ == 1) return rows;
    // One product with the matrix of weights 1/(N-1), 0 on the diagonal: subtracting an agent from the sum of
    // all would round differently for every agent.
    const Tensor others = (1 - torch::eye(agents_, rows.options())) / static_cast<double>(agents_ - 1);
    const Tensor of_worlds = rows.view({rows.size(0) / agents_, agents_, rows.size(1)});
    return at::cat({rows, at::matmul(others, of_worlds).flatten(0, 1)}, 1);
  }

  /// own_first() [worlds * N, X] with the state and the agent's index behind it: it shows which of the state's numbers are the agent's own.
  Tensor with_state_and_index(const Tensor& x, const Tensor& state) const {
    if (state_size_ == 0) return x;
    const Tensor id = torch::eye(agents_, x.options()).repeat({x.size(0) / agents_, 1});
    return at::cat({with_state(x, state.repeat_interleave(agents_, 0)), id}, 1);
  }

  bool is_own_first_;
};

/// HAPPO: a tower per agent that the actors do not share, and one value for the team.
class JointCritic : public TeamCritic {
 public:
  JointCritic(const CriticParts& parts, const LayerMaker& make)
      : TeamCritic(parts), first_state_(parts.actor_state_count) {
    const NetworkOptions& options = parts.options;
    for (int64_t agent = 0; agent < agents_; ++agent)
      towers_.emplace_back(options, options.use_rnn && options.critic_rnn, 0, parts.normalizer, make);
    make_layers(towers_.back().feature_count() * agents_ + state_size_, options.critic_widths, 1, make);
  }

  CriticOutput step(const CriticInput& input, const Tensor& state, const Encode& encode) const override {
    std::vector<Tensor> features, states;
    for (int64_t agent = 0; agent < agents_; ++agent) {
      const Tower& tower = towers_[static_cast<std::size_t>(agent)];
      const CoreOutput after =
          tower.step(encode(tower.encoder(), agent),
                     state_count() > 0 ? rows_of_agent(state, 0, agent, agents_) : state);
      features.push_back(after.features);
      states.push_back(after.state);
    }
    return {team_value(features, input.global_state), state_count() > 0 ? interleave(states, 0) : state};
  }

  Tensor sequence(const CriticInput&, const SequenceInput& rows) const override {
    return sequence_without_actors(rows);
  }
  Tensor sequence_without_actors(const SequenceInput& rows) const override {
    std::vector<Tensor> features;
    for (int64_t agent = 0; agent < agents_; ++agent)
      features.push_back(
          towers_[static_cast<std::size_t>(agent)].sequence(rows.of_agent(agent, agents_), first_state_));
    return team_value(features,
                      rows.global_state.defined() ? rows.global_state.flatten(0, 1) : rows.global_state);
  }

  int64_t state_count() const override { return towers_.front().state_count(); }
  NamedTensors named_parameters() const override {
    NamedTensors named;
    for (std::size_t i = 0; i < towers_.size(); ++i)
      append(named, "", towers_[i].named_parameters(fmt::format("critic.agent{}.", i)));
    append(named, "", layer_parameters());
    return named;
  }

 private:
  /// Features [worlds, F] of each agent to the team's value, repeated for all agents: [worlds * N].
  Tensor team_value(const std::vector<Tensor>& features, const Tensor& state) const {
    return outputs(with_state(at::cat(features, 1), state)).expand({-1, agents_}).flatten();
  }

  int64_t first_state_;
  std::vector<Tower> towers_;
};

}  // namespace

Tensor Critic::sequence_without_actors(const SequenceInput&) const {
  COMRAD_CHECK(false, "only a joint critic has values without the actors");
  return {};
}

std::shared_ptr<const Critic> make_critic(const CriticParts& parts, const LayerMaker& make) {
  switch (parts.options.critic) {
    case CriticKind::kNone:
      return std::make_shared<NoCritic>(parts.options.env);
    case CriticKind::kOwn:
      return std::make_shared<OwnCritic>(parts.value_heads);
    case CriticKind::kCentral:
      return std::make_shared<CentralCritic>(parts, make);
    case CriticKind::kJoint:
      return std::make_shared<JointCritic>(parts, make);
  }
  return nullptr;
}

}  // namespace comrad::policy
