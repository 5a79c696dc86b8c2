// Games whose best answers are known: what an algorithm can and cannot learn, with the real losses
// and networks.

#include <gtest/gtest.h>

#include <cstdio>

#include "learner/algorithms/happo.h"
#include "learner/algorithms/ippo.h"
#include "learner/algorithms/mappo.h"
#include "policy_workers/device/cpu_tuning.h"
#include "tests/support/matrix_game.h"

namespace comrad::learn {
namespace matrix_games_test {

using test::matrix_game_config;
using test::MatrixGame;
using test::PayoffTable;

/// Kuba et al. 2022, proposition 1, for two agents: paid only for playing different actions.
const PayoffTable kHeterogeneity = {{0, 1}, {1, 0}};
const PayoffTable kClimbing = {{11, -30, 0}, {-30, 7, 6}, {0, 0, 5}};
constexpr uint64_t kSeeds[] = {42, 68, 81, 97, 154};
constexpr uint64_t kFewSeeds[] = {42, 68};
constexpr int kUpdates = 50;

template <typename Learner>
double learn_heterogeneity(const char* algo, uint64_t seed, bool share_parameters) {
  RunConfig config = matrix_game_config(algo, seed);
  config.network.share_parameters = share_parameters;
  device::tune_math(1);  // threads would only wait for each other over such small layers
  MatrixGame<Learner> game(config, kHeterogeneity, 16);
  game.bias_to(0, 0.9);
  EXPECT_NEAR(game.expected_return(), 0.18, 1e-4);
  for (int update = 0; update < kUpdates; ++update) EXPECT_TRUE(game.update());
  const double result = game.expected_return();
  std::printf("heterogeneity %s %s seed %d: %.3f\n", algo, share_parameters ? "shared" : "separate",
              static_cast<int>(seed), result);
  return result;
}

TEST(HeterogeneityGame, SharedParametersEndAtOneHalfAndSeparateOnesFindTheOptimum) {
  EXPECT_NEAR(learn_heterogeneity<Ippo>("ippo", kSeeds[0], true), 0.5, 0.05);
  EXPECT_GE(learn_heterogeneity<Ippo>("ippo", kSeeds[0], false), 0.95);
  EXPECT_GE(learn_heterogeneity<Happo>("happo", kSeeds[0], false), 0.95);
}

TEST(HeterogeneityGameLong, SharedParametersEndAtOneHalf) {
  for (const uint64_t seed : kSeeds) {
    EXPECT_NEAR(learn_heterogeneity<Ippo>("ippo", seed, true), 0.5, 0.05) << seed;
  }
  for (const uint64_t seed : kFewSeeds) {
    EXPECT_NEAR(learn_heterogeneity<Mappo>("mappo", seed, true), 0.5, 0.05) << seed;
  }
}

TEST(HeterogeneityGameLong, TheSameCodeWithoutSharingFindsTheOptimum) {
  for (const uint64_t seed : kSeeds) {
    EXPECT_GE(learn_heterogeneity<Ippo>("ippo", seed, false), 0.95) << seed;
  }
  for (const uint64_t seed : kFewSeeds) {
    EXPECT_GE(learn_heterogeneity<Mappo>("mappo", seed, false), 0.95) << seed;
  }
}

TEST(HeterogeneityGameLong, HappoFindsTheOptimum) {
  for (const uint64_t seed : kSeeds)
    EXPECT_GE(learn_heterogeneity<Happo>("happo", seed, false), 0.95) << seed;
}

template <typename Learner>
void expect_climbing(const char* algo, uint64_t seed) {
  device::tune_math(1);
  MatrixGame<Learner> game(matrix_game_config(algo, seed), kClimbing, 16);
  for (int update = 0; update < kUpdates; ++update) ASSERT_TRUE(game.update());
  std::printf("climbing %s seed %d: greedy %.1f expected %.2f\n", algo, static_cast<int>(seed),
              game.greedy_return(), game.expected_return());
  EXPECT_GE(game.greedy_return(), 5) << algo << " " << seed;
  EXPECT_NEAR(game.expected_return(), game.greedy_return(), 1.0) << algo << " " << seed;
}

TEST(ClimbingGameLong, IppoMappoAndHappoEndAtTheSafeAnswerOrABetterOne) {
  for (const uint64_t seed : kFewSeeds) {
    expect_climbing<Ippo>("ippo", seed);
    expect_climbing<Mappo>("mappo", seed);
    expect_climbing<Happo>("happo", seed);
  }
}

}  // namespace matrix_games_test
}  // namespace comrad::learn
