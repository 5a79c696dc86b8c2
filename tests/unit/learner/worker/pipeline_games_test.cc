// Games whose Q-values are known, through the whole pipeline (tests/support/pipeline_game.h).

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <memory>
#include <string>

#include "learner/algorithms/on_policy.h"
#include "learner/algorithms/q_learning.h"
#include "policy_workers/device/operator_path.h"
#include "rollout_buffer/settings/resolve.h"
#include "tests/support/pipeline_game.h"

namespace comrad::learn {
namespace pipeline_games_test {

using test::PipelineGame;

/// Rashid et al. 2018: agent 0's first action leads to state 1, where everything pays 7, or to state 2 with a
/// table of payoffs.
class TwoStepGame : public PipelineGame {
 protected:
  void play(std::span<const int32_t> action) override {
    constexpr double kPayoff[2][2] = {{0, 1}, {1, 8}};
    last_.terminated = state_ != 0;
    pay(state_ == 0 ? 0 : state_ == 1 ? 7 : kPayoff[action[0]][action[1]]);
    if (state_ == 0) state_ = 1 + action[0];
  }
};

/// Pays 1 to each agent for every decision; over after five, by time or by its rules.
class PayingGame : public PipelineGame {
 public:
  explicit PayingGame(bool ends_by_time) : ends_by_time_(ends_by_time) {}

 protected:
  void play(std::span<const int32_t>) override {
    pay(2);
    (ends_by_time_ ? last_.truncated : last_.terminated) = step_ == 4;
  }

 private:
  bool ends_by_time_;
};

/// Four decisions in which the team is paid 1 each or loses 1 each: which, only the world's state contains. The
/// global state shows it, and how many decisions were made.
class HiddenGame : public PipelineGame {
 public:
  static constexpr double kGamma = 0.9;
  HiddenGame() { shape_.global_state_count = 2; }
  /// What the rest of the episode pays.
  static double value(bool pays, int step) {
    double sum = 0;
    for (int left = step; left < 4; ++left) sum = 1 + kGamma * sum;
    return pays ? sum : -sum;
  }

 protected:
  void begin(uint64_t episode_seed) override { pays_ = mix64(episode_seed) % 2 == 1; }
  void play(std::span<const int32_t>) override {
    pay(pays_ ? 1 : -1);
    last_.terminated = step_ == 3;
  }
  void write_global_state(float* state) const override {
    state[0] = pays_ ? 1.0f : 0.0f;
    state[1] = static_cast<float>(step_);
  }

 private:
  bool pays_ = false;
};

RunConfig game_config(const std::string& algo) {
  RunConfig config = test::pipeline_game_config(algo);
  config.collection.rollout = 8;
  config.optimisation.batch_size = 256;
  // QPLEX' losing utilities get V_tot's gradient whole, however little their lambda lets them count, so at high
  // rates lambda shrinks and they run away (to -1e5 at 1e-3, where two of five runs ended in the wrong branch).
  config.optimisation.learning_rate = algo.starts_with("qplex") ? 2e-4 : 1e-3;
  config.optimisation.lr_schedule = RateSchedule::kLinearDecay;
  config.q_learning.epsilon = 1;  // uniform play: every joint action is equally likely
  config.replay.per = false;
  config.q_learning.learning_starts_decisions = 512;
  config.q_learning.replay_ratio = 4;
  config.q_learning.target_update_tau = 0.02;
  config.q_learning.replay_batch_size = 32;
  config.q_learning.dqn_reward_clip = 0;
  // Where not every target can be met, Huber's loss ends nearer to their median than to their mean.
  config.q_learning.use_huber_loss = algo != "vdn" && algo != "idqn";
  EXPECT_TRUE(resolve_settings(config, 2));
  return config;
}

/// Trains through the pipeline and returns what was learned.
std::unique_ptr<QLearning> train(const RunConfig& config, const test::GameMaker& make) {
  return std::unique_ptr<QLearning>(
      dynamic_cast<QLearning*>(test::train_game(config, make).algorithm.release()));
}

/// Q-values [2 agents, choices] in a state.
torch::Tensor q_values(const QLearning& learner, int state) {
  const torch::Tensor frame = torch::full({2, 3, 20, 20}, PipelineGame::shade(state), torch::kUInt8);
  return learner.net().step(frame, {}, torch::zeros({2, 0})).logits;
}

double greedy_return(const QLearning& learner) {
  const auto best = [&](int state, int agent) {
    return static_cast<std::size_t>(q_values(learner, state)[agent].argmax().item<int64_t>());
  };
  if (best(0, 0) == 0) return 7;
  constexpr double kPayoff[2][2] = {{0, 1}, {1, 8}};
  return kPayoff[best(2, 0)][best(2, 1)];
}

double two_step(const char* algo, int seed) {
  RunConfig config = game_config(algo);
  config.run.seed = seed;
  config.optimisation.gamma = 0.99;
  config.run.train_for_env_frames = 4 * 60'000;
  const auto learner = train(config, [] { return std::make_unique<TwoStepGame>(); });
  const double result = greedy_return(*learner);
  const torch::Tensor first = q_values(*learner, 0)[0], second = q_values(*learner, 2)[0];
  std::printf(
      "two-step game, %s, seed %d: greedy return %.0f after %u updates; Q of agent 0: %.2f %.2f, in state 2B "
      "%.2f %.2f\n",
      algo, seed, result, learner->version(), first[0].item<float>(), first[1].item<float>(),
      second[0].item<float>(), second[1].item<float>());
  return result;
}

TEST(TwoStepGameLong, VdnCannotSeeTheBetterBranch) { EXPECT_EQ(two_step("vdn", 42), 7); }
TEST(TwoStepGameLong, QmixFindsTheOptimum) { EXPECT_EQ(two_step("qmix", 42), 8); }

/// QPLEX finds it from most starts, not from all (21 of 21 on 2026-11-22, fewer at higher rates).
TEST(TwoStepGameLong, QplexFindsTheOptimumFromThreeOfFourStarts) {
  int found = 0;
  for (const char* form : {"qplex_d", "qplex_q"})
    for (const int seed : {42, 68}) found += two_step(form, seed) == 8;
  EXPECT_GE(found, 3);
}

double value_of_paying_game(bool ends_by_time) {
  RunConfig config = game_config("idqn");
  config.optimisation.gamma = 0.9;
  config.run.train_for_env_frames = 4 * 20'000;
  const auto learner = train(config, [&] { return std::make_unique<PayingGame>(ends_by_time); });
  const double value = q_values(*learner, 0).mean().item<double>();
  std::printf("paying game that ends by %s: Q %.3f\n", ends_by_time ? "time" : "its rules", value);
  return value;
}

TEST(PayingGame, ATimeOutIsNoEnd) { EXPECT_NEAR(value_of_paying_game(true), 1 / (1 - 0.9), 0.5); }
// All five steps look alike, so a fifth of all values has no future: Q = 1 + 0.9 * 0.8 Q.
TEST(PayingGameLong, AnEndIsAnEnd) { EXPECT_NEAR(value_of_paying_game(false), 1 / (1 - 0.72), 0.4); }

/// Pays each agent that chooses what the picture shows; one decision an episode.
class ShownGame : public PipelineGame {
 protected:
  void begin(uint64_t episode_seed) override { state_ = static_cast<int>(mix64(episode_seed) % 2); }
  void play(std::span<const int32_t> action) override {
    for (std::size_t agent = 0; agent < 2; ++agent)
      last_.reward[agent] = action[agent] == state_ ? 1.0f : 0.0f;
    last_.terminated = true;
  }
};

// As on a GPU that learner and policy threads share: what is learned from are the frames that were acted on.
TEST(ShownGame, IsLearnedFromFramesThatWentUpOnce) {
  const device::OperatorPath as_on_a_gpu;
  RunConfig config = test::pipeline_game_config("ippo");
  config.collection.policy_processes = false;
  config.collection.policy_workers = 1;
  config.collection.rollout = 8;
  config.optimisation.batch_size = 256;
  config.optimisation.learning_rate = 1e-3;
  config.run.train_for_env_frames = 4 * 30'000;
  EXPECT_TRUE(resolve_settings(config, 2));
  EXPECT_GE(test::train_game(config, [] { return std::make_unique<ShownGame>(); }, {.score = 1.9}).best_score,
            1.9);
}

RunConfig hidden_config(const std::string& algo, CriticState state) {
  RunConfig config = test::pipeline_game_config(algo);
  config.network.critic_state = state;
  config.network.critic_hidden_sizes = "64,32";
  config.environment.shared_reward_alpha = algo == "mappo" || algo == "happo" ? 1 : 0;
  config.collection.rollout = 8;
  config.optimisation.batch_size = 256;
  config.optimisation.learning_rate = 1e-3;
  config.optimisation.gamma = HiddenGame::kGamma;
  config.optimisation.num_epochs = 4;
  config.q_learning.epsilon = 1;
  config.q_learning.learning_starts_decisions = 512;
  config.q_learning.replay_ratio = 4;
  config.q_learning.target_update_tau = 0.02;
  config.replay.per = false;
  config.mixers.qplex_weighted_head = config.mixers.qplex_state_bias =
      true;  // values that depend on the state alone
  config.run.train_for_env_frames = 4 * (config.run.algo->learns_q_values() ? 15'000 : 30'000);
  EXPECT_TRUE(resolve_settings(config, 2));
  return config;
}

/// A trained critic's or mixer's value of a world: the sum over both agents where they are paid alike.
double value_of(const Algorithm& algorithm, bool pays, int step) {
  const torch::Tensor frame = torch::full({2, 3, 20, 20}, PipelineGame::shade(0), torch::kUInt8);
  const torch::Tensor state = torch::tensor({{pays ? 1.0f : 0.0f, static_cast<float>(step)}});
  torch::NoGradGuard no_grad;
  if (const auto* on_policy = dynamic_cast<const OnPolicy*>(&algorithm)) {
    const torch::Tensor value = on_policy->net().step(frame, {}, torch::zeros({2, 0}), state).value;
    return on_policy->return_normalizer().denormalize(value).mean().item<double>();
  }
  const auto& learner = dynamic_cast<const QLearning&>(algorithm);
  const torch::Tensor features = learner.net().encode(frame, {}), q = q_values(learner, 0);
  torch::Tensor seen = features.view({1, -1});
  if (learner.net().options().global_state_count > 0)
    seen = at::cat({seen, learner.net().normalized_state(state)}, 1);
  const torch::Tensor best = std::get<0>(q.max(1)).view({1, 2});
  const torch::Tensor action = torch::one_hot(q.argmax(1), 2).to(torch::kFloat32).view({1, 4});
  return learner.mixer()
             ->mix({.chosen = best, .greedy = best, .action = action, .state = seen})
             .q_tot.item<double>() *
         learner.q_sigma();
}

/// How far the values of a trained learner lie from the truth, at most.
double hidden_game_error(const char* algo, int seed) {
  RunConfig config = hidden_config(algo, CriticState::kGlobal);
  config.run.seed = seed;
  const auto trained = test::train_game(config, [] { return std::make_unique<HiddenGame>(); });
  double worst = 0;
  for (const bool pays : {true, false})
    for (const int step : {0, 3}) {
      const double value = value_of(*trained.algorithm, pays, step), truth = HiddenGame::value(pays, step);
      std::printf("hidden game, %s, seed %d, %s, step %d: value %.2f, truth %.2f\n", algo, seed,
                  pays ? "pays" : "loses", step, value, truth);
      worst = std::max(worst, std::abs(value - truth));
    }
  return worst;
}

TEST(HiddenGame, WhatNoPictureShowsIsLearnedFromTheGlobalState) {
  EXPECT_LE(hidden_game_error("mappo", 42), 0.7);
}

TEST(HiddenGameLong, OtherAlgorithmsLearnItToo) {
  for (const char* algo : {"happo", "qmix"}) EXPECT_LE(hidden_game_error(algo, 42), 0.7) << algo;
  // QPLEX from most starts, not from all: a run of qplex_q was 3 away on 2026-11-25.
  for (const char* algo : {"qplex_d", "qplex_q"}) {
    double least = 1e30;
    for (const int seed : {42, 68, 81})
      if (least > 0.7) least = std::min(least, hidden_game_error(algo, seed));
    EXPECT_LE(least, 0.7) << algo << ", from each of three seeds";
  }
}

TEST(HiddenGame, ACheckpointOfAnotherCriticStateIsRefusedByName) {
  const EnvShape env = HiddenGame().shape();
  for (const char* algo : {"mappo", "qmix"}) {
    const auto features = *make_algorithm(hidden_config(algo, CriticState::kFeatures), env, torch::kCPU),
               global = *make_algorithm(hidden_config(algo, CriticState::kGlobal), env, torch::kCPU);
    StateDict of_features, of_global;
    features->save(of_features);
    global->save(of_global);
    const Status one = features->load(of_global), other = global->load(of_features);
    ASSERT_FALSE(one);
    EXPECT_EQ(one.error().message,
              "checkpoint was made with critic_state global (2 numbers), this run has critic_state features");
    ASSERT_FALSE(other);
    EXPECT_EQ(other.error().message,
              "checkpoint was made with critic_state features, this run has critic_state global (2 numbers)");
    EXPECT_TRUE(global->load(of_global));
  }
}

TEST(HiddenGameLong, FeaturesOfPicturesKnowNothingOfIt) {
  for (const char* algo : {"mappo", "qmix"}) {
    const auto trained = test::train_game(hidden_config(algo, CriticState::kFeatures),
                                          [] { return std::make_unique<HiddenGame>(); });
    const double value = value_of(*trained.algorithm, true, 0);
    std::printf("hidden game, %s, features alone: value %.2f of +-%.2f\n", algo, value,
                HiddenGame::value(true, 0));
    EXPECT_NEAR(value, 0, 1.5) << algo << ": the mean of both";
  }
}

}  // namespace pipeline_games_test
}  // namespace comrad::learn
