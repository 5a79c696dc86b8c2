// Games whose Q-values are known, through the whole pipeline (tests/support/pipeline_game.h).

#include <gtest/gtest.h>

#include <cstdio>
#include <memory>
#include <string>

#include "learner/algorithms/q_learning.h"
#include "rollout_buffer/settings/resolve.h"
#include "tests/support/pipeline_game.h"

namespace comrad::learn {
namespace {

using testing::PipelineGame;

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

RunConfig game_config(const std::string& algo) {
  RunConfig config = testing::pipeline_game_config(algo);
  config.collection.rollout = 8;
  config.optimisation.batch_size = 256;
  // QPLEX' losing utilities get V_tot's gradient whole, however little their lambda lets them count, so at high
  // rates lambda shrinks and they run away (to -1e5 at 1e-3, where two of five runs ended in the wrong branch).
  config.optimisation.learning_rate = algo.starts_with("qplex") ? 2e-4 : 1e-3;
  config.optimisation.lr_schedule = RateSchedule::kLinearDecay;
  config.q_learning.epsilon_end = 1;  // uniform play: every joint action is equally likely
  config.replay.per = false;
  config.q_learning.learning_starts_decisions = 512;
  config.q_learning.replay_ratio = 4;
  config.q_learning.target_update_tau = 0.02;
  config.q_learning.dqn_batch_decisions = 32;
  config.q_learning.dqn_reward_clip = 0;
  // Where not every target can be met, Huber's loss ends nearer to their median than to their mean.
  config.q_learning.use_huber_loss = algo != "vdn" && algo != "idqn";
  EXPECT_TRUE(resolve_settings(config, 2));
  return config;
}

/// Trains through the pipeline and returns what was learned.
std::unique_ptr<QLearning> train(const RunConfig& config, const testing::GameMaker& make) {
  return std::unique_ptr<QLearning>(
      dynamic_cast<QLearning*>(testing::train_game(config, make).algorithm.release()));
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

TEST(TwoStepGame, VdnCannotSeeTheBetterBranch) { EXPECT_EQ(two_step("vdn", 42), 7); }
TEST(TwoStepGame, QmixFindsTheOptimum) { EXPECT_EQ(two_step("qmix", 42), 8); }

/// QPLEX finds it from most starts, not from all (21 of 21 on 2026-11-22, fewer at higher rates).
TEST(TwoStepGame, QplexFindsTheOptimumFromThreeOfFourStarts) {
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
TEST(PayingGame, AnEndIsAnEnd) { EXPECT_NEAR(value_of_paying_game(false), 1 / (1 - 0.72), 0.4); }

}  // namespace
}  // namespace comrad::learn
