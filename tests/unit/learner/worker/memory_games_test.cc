// A task that needs memory, through the whole pipeline: a T-maze of seven decisions. The first observation shows
// which side pays, five of corridor say nothing, and at the junction each of two agents turns left or right; the
// score is the share of agents that turned to the side that was shown. A policy without memory scores 0.5, however
// it turns, because the junction looks the same in every episode.

#include <gtest/gtest.h>

#include <cstdio>
#include <memory>
#include <ostream>
#include <string>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/settings/resolve.h"
#include "tests/support/pipeline_game.h"

namespace comrad::learn {
namespace memory_games_test {

using test::GameGoal;
using test::PipelineGame;
using test::TrainedGame;

constexpr int kDecisions = 7;
/// The mean of 400 episodes of chance has a standard deviation of 0.025 where both agents always turn alike.
constexpr GameGoal kRemembers{.score = 0.9, .episodes = 400};
/// That of 1000 has one of 0.016; the highest of many windows stays below 0.65.
constexpr GameGoal kGuesses{.episodes = 1000};
constexpr double kGuessedMax = 0.65;

class TMaze : public PipelineGame {
 public:
  void step(std::span<const int32_t> action) override {
    PipelineGame::step(action);
    summary_.score /= 2;
  }

 protected:
  void begin(uint64_t episode_seed) override {
    side_ = static_cast<int>(Rng(RngKey(episode_seed).split("side")).below(2));
  }
  void play(std::span<const int32_t> action) override {
    last_.terminated = step_ == kDecisions - 1;
    for (std::size_t agent = 0; agent < 2; ++agent)
      last_.reward[agent] = last_.terminated && action[agent] == side_ ? 1.0f : 0.0f;
  }
  /// The sides are dark and bright, the corridor is grey. The junction is grey, too: agents count the way, or
  /// turn all along.
  int visible_state() const override { return step_ == 0 ? 2 * side_ : 1; }

 private:
  int side_ = 0;
};

/// One learner of the maze.
struct Case {
  const char* name;
  const char* algo;
  const char* core = "gru";  ///< none: feed-forward
};
void PrintTo(const Case& one, std::ostream* out) { *out << one.name; }

RunConfig maze_config(const Case& one) {
  RunConfig config = test::pipeline_game_config(one.algo);
  config.network.use_rnn = std::string(one.core) != "none";
  if (config.network.use_rnn)
    config.network.rnn_type = std::string(one.core) == "lstm" ? RnnType::kLstm : RnnType::kGru;
  config.network.rnn_size = 32;
  config.collection.rollout =
      16;  // neither a multiple nor a divisor of an episode: states are carried over the seam
  config.optimisation.learning_rate = 1e-3;
  config.optimisation.adam_eps = 1e-8;
  config.optimisation.gamma = 0.95;
  config.run.train_for_env_frames = 4 * 300'000;
  // Actor-critics.
  config.optimisation.batch_size = 512;
  config.optimisation.num_epochs = 2;
  config.on_policy.exploration_loss = ExplorationLoss::kEntropy;
  config.on_policy.exploration_loss_coeff = 0.003;
  config.network.critic_hidden_sizes = "64";
  // Q-learning.
  config.q_learning.learning_starts_decisions = 4096;
  config.q_learning.replay_ratio = 2;
  config.q_learning.replay_batch_size = config.network.use_rnn ? 32 : 0;
  config.q_learning.target_update_tau = 0.02;
  config.q_learning.epsilon = Schedule::line(1, 0.02, 4 * 40'000);
  if (config.run.algo == "happo") config.environment.shared_reward_alpha = 1;  // its one value is the team's
  EXPECT_TRUE(resolve_settings(config, 2));
  return config;
}

double best_score(const Case& one, const RunConfig& config, const GameGoal& goal) {
  const TrainedGame trained = test::train_game(
      config, [] { return std::make_unique<TMaze>(); }, goal);
  std::printf(
      "t-maze, %s, seed %d: best mean of %zu episodes %.3f after %.0f decisions, %u updates, %.1f s\n",
      one.name, static_cast<int>(config.run.seed), goal.episodes, trained.best_score, trained.env_frames / 4,
      trained.algorithm->version(), trained.seconds);
  return trained.best_score;
}

class TMazeGame : public ::testing::TestWithParam<Case> {};
TEST_P(TMazeGame, ARecurrentCoreRemembersTheSide) {
  EXPECT_GE(best_score(GetParam(), maze_config(GetParam()), kRemembers), kRemembers.score);
}
const auto kName = [](const auto& one) { return std::string(one.param.name); };
INSTANTIATE_TEST_SUITE_P(Learners, TMazeGame, ::testing::Values(Case{"ippo_gru", "ippo"}), kName);
INSTANTIATE_TEST_SUITE_P(OthersLong, TMazeGame,
                         ::testing::Values(Case{"ippo_lstm", "ippo", "lstm"}, Case{"mappo", "mappo"},
                                           Case{"happo", "happo"}, Case{"vdn", "vdn"}, Case{"qmix", "qmix"},
                                           Case{"qplex_d", "qplex_d"}),
                         kName);

/// The task itself: what the others remember cannot be seen, or learned in another way.
class TMazeWithoutMemoryLong : public ::testing::TestWithParam<Case> {};
TEST_P(TMazeWithoutMemoryLong, StaysAtChance) {
  RunConfig config = maze_config(GetParam());
  config.run.train_for_env_frames = 4 * 64'000;  // the others needed 62 000 decisions at most
  const double score = best_score(GetParam(), config, kGuesses);
  EXPECT_GT(score, 0) << "no window of episodes was full";
  EXPECT_LT(score, kGuessedMax);
}
INSTANTIATE_TEST_SUITE_P(Learners, TMazeWithoutMemoryLong,
                         ::testing::Values(Case{"ippo_feed_forward", "ippo", "none"},
                                           Case{"qmix_feed_forward", "qmix", "none"}),
                         kName);

}  // namespace memory_games_test
}  // namespace comrad::learn
