// One-step matrix games for the learning algorithms: two agents see the same constant picture, act at once,
// are both paid the cell of a payoff table, and the episode ends. Trajectories lie in memory; the algorithm
// is the real one.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string>
#include <vector>

#include "learner/algorithms/algorithm.h"
#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/action_heads.h"
#include "policy_workers/network/actor_critic.h"
#include "rollout_buffer/core/rng.h"

namespace comrad::test {

/// payoff[a][b]: what both agents get when agent 0 plays a and agent 1 plays b.
using PayoffTable = std::vector<std::vector<float>>;

inline EnvShape matrix_game_shape(const PayoffTable& payoff) {
  EnvShape env;
  env.num_agents = 2;
  env.height = env.width = 20;  // the smallest that the encoder impala takes
  env.head_count = 1;
  env.head_sizes = {static_cast<int32_t>(payoff.size())};
  return env;
}

/// Settings under which a game of a hundred updates is learned: feed-forward, `worlds` x 4 steps x 2 agents
/// a batch.
inline RunConfig matrix_game_config(const std::string& algo, uint64_t seed) {
  RunConfig config;
  config.run.algo = algo;
  config.network.share_parameters = algo != "happo";
  config.run.seed = static_cast<int64_t>(seed);
  config.collection.rollout = 4;
  config.network.use_rnn = false;
  config.network.normalize_input = false;
  config.network.encoder = "impala";
  config.network.critic_hidden_sizes = "64,32";
  config.optimisation.learning_rate = 1e-3;
  config.optimisation.num_epochs = 4;
  config.run.train_for_env_frames = 1e12;
  return config;
}

/// Plays and trains. `Learner` is one of the on-policy algorithms.
template <typename Learner>
class MatrixGame {
 public:
  MatrixGame(const RunConfig& config, PayoffTable payoff, int64_t worlds)
      : payoff_(std::move(payoff)),
        env_(matrix_game_shape(payoff_)),
        learner_(config, env_, torch::kCPU),
        key_(RngKey(static_cast<uint64_t>(config.run.seed)).split("matrix_game")),
        picture_(torch::full({2, 3, 20, 20}, 128, torch::kUInt8)) {
    TrajectoryShape shape;
    shape.env = env_;
    shape.rollout_steps = static_cast<int32_t>(config.collection.rollout);
    shape.recurrent_state_count = 0;
    batch_ = learn::make_rollout_batch(shape, worlds);
    batch_.frame.fill_(128);
  }

  /// Makes every agent play `action` with `probability`, the others alike, whatever it sees.
  void bias_to(int64_t action, double probability) {
    torch::NoGradGuard no_grad;
    const double others = static_cast<double>(payoff_.size()) - 1;
    for (const auto& [name, tensor] : learner_.net().named_state()) {
      if (name.ends_with("action_head.weight")) tensor.zero_();
      if (!name.ends_with("action_head.bias")) continue;
      tensor.zero_();
      tensor[action] = std::log(probability * others / (1 - probability));
    }
  }

  /// Probabilities [2, actions] of both agents.
  torch::Tensor policy() const {
    return torch::softmax(learner_.net().step(picture_, {}, torch::zeros({2, 0})).logits, 1);
  }

  /// Expected payoff under the policy, exactly.
  double expected_return() const {
    const torch::Tensor p = policy();
    double sum = 0;
    for (size_t a = 0; a < payoff_.size(); ++a)
      for (size_t b = 0; b < payoff_.size(); ++b)
        sum += p[0][static_cast<int64_t>(a)].template item<double>() *
               p[1][static_cast<int64_t>(b)].template item<double>() * payoff_[a][b];
    return sum;
  }

  /// Payoff of both agents' most probable actions.
  double greedy_return() const {
    const torch::Tensor best = policy().argmax(1);
    return payoff_[static_cast<size_t>(best[0].template item<int64_t>())]
                  [static_cast<size_t>(best[1].template item<int64_t>())];
  }

  /// One batch of play and what the algorithm makes of it. False when it failed.
  bool update() {
    const policy::PolicyOutput output = learner_.net().step(picture_, {}, torch::zeros({2, 0}));
    const torch::Tensor logits = output.logits.contiguous();
    const auto choices = static_cast<int64_t>(payoff_.size());
    learn::clear(batch_);
    for (int64_t t = 0; t < batch_.steps(); ++t)
      for (int64_t world = 0; world < batch_.slab_count; ++world) {
        int32_t action[2];
        for (int64_t agent = 0; agent < 2; ++agent) {
          const int64_t at = t * batch_.rows() + world * 2 + agent;
          const std::span<const float> row(logits.data_ptr<float>() + agent * choices,
                                           static_cast<size_t>(choices));
          batch_.log_prob.template data_ptr<float>()[at] =
              policy::sample_action(row, {}, env_, key_.split(updates_).split(static_cast<uint64_t>(at)),
                                    false, {&action[agent], 1});
          batch_.action.template data_ptr<int64_t>()[at] = action[agent];
          std::copy(row.begin(), row.end(), batch_.logits.template data_ptr<float>() + at * choices);
          batch_.value.template data_ptr<float>()[at] = output.value[agent].template item<float>();
        }
        for (int64_t agent = 0; agent < 2; ++agent)
          batch_.reward.template data_ptr<float>()[t * batch_.rows() + world * 2 + agent] =
              payoff_[static_cast<size_t>(action[0])][static_cast<size_t>(action[1])];
      }
    batch_.terminated.fill_(1);
    batch_.filled.fill_(1);
    batch_.valid.fill_(1);
    batch_.agent_active.fill_(1);
    batch_.policy_version.fill_(static_cast<int64_t>(learner_.version()));
    batch_.transitions = batch_.steps() * batch_.rows();
    ++updates_;
    const Expected<learn::UpdateStats> stats = learner_.update(batch_, {});
    if (stats) stats_ = *stats;
    return stats.has_value();
  }

  Learner& learner() { return learner_; }
  /// Of the last update.
  const learn::UpdateStats& stats() const { return stats_; }

 private:
  learn::UpdateStats stats_;
  PayoffTable payoff_;
  EnvShape env_;
  Learner learner_;
  RngKey key_;
  torch::Tensor picture_;
  learn::RolloutBatch batch_;
  uint64_t updates_ = 0;
};

}  // namespace comrad::test
