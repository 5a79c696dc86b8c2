// The files of rollout_buffer/replay/samplers: the sum tree, the prioritized and the uniform sampler.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <vector>

#include "rollout_buffer/replay/samplers/prioritized_sampler.h"
#include "rollout_buffer/replay/samplers/sum_tree.h"
#include "rollout_buffer/replay/samplers/uniform_sampler.h"

namespace comrad::replay {
namespace samplers_test {

std::vector<Pick> draw(const Sampler& sampler, int64_t count, double beta, uint64_t seed) {
  Rng rng(seed);
  std::vector<Pick> picks;
  sampler.draw(count, beta, rng, picks);
  return picks;
}

TEST(SumTree, TotalAndSmallestEqualAPlainLoopAfterManyChanges) {
  SumTree tree(100);
  EXPECT_EQ(tree.capacity(), 128);
  EXPECT_EQ(tree.total(), 0);
  EXPECT_EQ(tree.min_positive(), std::numeric_limits<double>::infinity());
  std::vector<double> plain(128, 0.0);
  Rng rng(uint64_t{11});
  for (int i = 0; i < 20'000; ++i) {
    const auto leaf = rng.below(128);
    plain[leaf] = rng.below(4) == 0 ? 0 : std::pow(10.0, 12 * rng.uniform() - 6);
    tree.set(leaf, plain[leaf]);
    if (i % 97 != 0) continue;
    const double total = std::accumulate(plain.begin(), plain.end(), 0.0);
    ASSERT_NEAR(tree.total(), total, 1e-12 * total);
    double smallest = std::numeric_limits<double>::infinity();
    for (const double weight : plain)
      if (weight > 0) smallest = std::min(smallest, weight);
    ASSERT_EQ(tree.min_positive(), smallest);
  }
}

TEST(SumTree, FindsTheLeafInWhichTheRunningSumPasses) {
  SumTree tree(8);
  const std::vector<double> weights = {0, 2, 0, 0, 1, 0, 3, 0};
  for (std::size_t i = 0; i < weights.size(); ++i) tree.set(static_cast<int64_t>(i), weights[i]);
  EXPECT_EQ(tree.find(0), 1);
  EXPECT_EQ(tree.find(1.999), 1);
  EXPECT_EQ(tree.find(2), 4);
  EXPECT_EQ(tree.find(3), 6);
  EXPECT_EQ(tree.find(5.999), 6);
  EXPECT_EQ(tree.find(6.001), 6) << "rounding past the end stays on a leaf that has weight";
  EXPECT_EQ(SumTree(1).capacity(), 1);
}

// Spec 6.4: frequencies over a million draws within 1 % of P.
TEST(SumTree, DrawsFollowTheWeights) {
  const std::vector<double> weights = {5, 1, 0, 8, 2, 0.5, 3, 4, 6, 7, 1.5};
  const double total = std::accumulate(weights.begin(), weights.end(), 0.0);
  SumTree tree(static_cast<int64_t>(weights.size()));
  for (std::size_t i = 0; i < weights.size(); ++i) tree.set(static_cast<int64_t>(i), weights[i]);
  std::vector<int> counts(weights.size());
  Rng rng(uint64_t{3});
  constexpr int kDraws = 1'000'000;
  for (int i = 0; i < kDraws; ++i)
    ++counts[static_cast<std::size_t>(tree.find(rng.uniform() * tree.total()))];
  for (std::size_t i = 0; i < weights.size(); ++i)
    EXPECT_NEAR(static_cast<double>(counts[i]) / kDraws, weights[i] / total,
                0.01 * std::max(0.05, weights[i] / total));
  EXPECT_EQ(counts[2], 0);
}

// Spec 6.4, |TD| = (0.5, 1, 2, 0.1), omega 0.6, beta 0.4.
TEST(PrioritizedSampler, ReproducesTheKnownAnswer) {
  PrioritizedSampler sampler(0.6);
  sampler.push(4);
  sampler.set_priorities(std::vector<int64_t>{0, 1, 2, 3}, std::vector<float>{0.5f, 1, 2, 0.1f});
  const std::vector<double> probabilities = {0.192536, 0.291829, 0.442330, 0.073305};
  const std::vector<double> weights = {0.679592, 0.575441, 0.487252, 1};
  for (int i = 0; i < 4; ++i)
    EXPECT_NEAR(sampler.priority(i) / sampler.total(), probabilities[static_cast<std::size_t>(i)], 1e-6);
  std::vector<int> counts(4);
  Rng rng(uint64_t{1});
  std::vector<Pick> picks;
  for (int round = 0; round < 10'000; ++round) sampler.draw(100, 0.4, rng, picks);
  for (const Pick& pick : picks) {
    ++counts[static_cast<std::size_t>(pick.serial)];
    ASSERT_NEAR(pick.weight, weights[static_cast<std::size_t>(pick.serial)], 1e-6);
  }
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(counts[i] / 1e6, probabilities[i], 0.01 * probabilities[i]);
}

TEST(PrioritizedSampler, UpdatesKeepTheTotalOfAPlainSum) {
  PrioritizedSampler sampler(0.6);
  sampler.push(5000);  // grows past the first leaves
  std::vector<double> plain(5000, 1.0);
  Rng rng(uint64_t{8});
  for (int round = 0; round < 200; ++round) {
    std::vector<int64_t> serials;
    std::vector<float> errors;
    for (int i = 0; i < 64; ++i) {
      serials.push_back(rng.below(5000));
      errors.push_back(static_cast<float>(rng.uniform() * 10));
      plain[static_cast<std::size_t>(serials.back())] =
          std::pow(static_cast<double>(errors.back()) + 1e-6, 0.6);
    }
    sampler.set_priorities(serials, errors);
  }
  const double total = std::accumulate(plain.begin(), plain.end(), 0.0);
  EXPECT_NEAR(sampler.total(), total, 1e-12 * total);
}

TEST(PrioritizedSampler, TakesOneUnitOfEachSegmentOfTheMass) {
  PrioritizedSampler sampler(1);
  sampler.push(8);
  const std::vector<Pick> picks = draw(sampler, 8, 1, 4);  // eight units of the same mass, eight segments
  for (int64_t i = 0; i < 8; ++i) {
    EXPECT_EQ(picks[static_cast<std::size_t>(i)].serial, i);
    EXPECT_EQ(picks[static_cast<std::size_t>(i)].weight, 1);
  }
}

TEST(PrioritizedSampler, NewUnitsGetTheLargestPrioritySoFar) {
  PrioritizedSampler sampler(0.6);
  sampler.push(2);
  EXPECT_EQ(sampler.priority(1), 1);
  sampler.set_priorities(std::vector<int64_t>{0}, std::vector<float>{-32});
  EXPECT_NEAR(sampler.max_priority(), 8, 1e-6) << "32^0.6, and a sign does not matter";
  sampler.set_priorities(std::vector<int64_t>{0}, std::vector<float>{0});
  EXPECT_GT(sampler.priority(0), 0) << "nothing is out of reach for good";
  sampler.push(1);
  EXPECT_EQ(sampler.priority(2), sampler.max_priority()) << "the largest ever, not the largest now";
}

TEST(PrioritizedSampler, UnitsThatLeftAndErrorsThatAreNotFiniteArePassedOver) {
  PrioritizedSampler sampler(0.6);
  sampler.push(4);
  sampler.pop(2);
  const double before = sampler.total();
  EXPECT_EQ(before, 2);
  sampler.set_priorities(std::vector<int64_t>{0, 1, -7, 4, 2, 3},
                         std::vector<float>{9, 9, 9, 9, std::numeric_limits<float>::quiet_NaN(),
                                            std::numeric_limits<float>::infinity()});
  EXPECT_EQ(sampler.total(), before);
  for (const Pick& pick : draw(sampler, 100, 1, 2)) EXPECT_GE(pick.serial, 2);
}

TEST(PrioritizedSampler, ALongRowOfComingAndGoingDrawsOnlyWhatIsThere) {
  PrioritizedSampler sampler(0.6);
  Rng rng(uint64_t{21});
  std::vector<Pick> picks;
  for (int round = 0; round < 3000; ++round) {
    sampler.push(rng.below(9));
    if (sampler.size() > 700) sampler.pop(rng.below(20));
    picks.clear();
    sampler.draw(8, 0.4, rng, picks);
    std::vector<int64_t> serials;
    std::vector<float> errors;
    for (const Pick& pick : picks) {
      ASSERT_TRUE(sampler.contains(pick.serial));
      ASSERT_GT(pick.weight, 0);
      ASSERT_LE(pick.weight, 1);
      serials.push_back(pick.serial);
      errors.push_back(static_cast<float>(rng.uniform()));
    }
    sampler.set_priorities(serials, errors);
  }
  EXPECT_GT(sampler.first(), 2000) << "serials went round the leaves";
}

TEST(PrioritizedSampler, ARestoredStateDrawsTheSame) {
  PrioritizedSampler sampler(0.6), other(0.6);
  Rng rng(uint64_t{2});
  sampler.push(3000);
  for (int64_t i = 0; i < 3000; ++i)
    sampler.set_priorities(std::vector<int64_t>{i}, std::vector<float>{static_cast<float>(rng.uniform())});
  sampler.pop(1100);
  sampler.push(50);
  other.restore(sampler.state(), sampler.size());
  EXPECT_EQ(other.total(), sampler.total());
  const std::vector<Pick> mine = draw(sampler, 512, 0.7, 6), theirs = draw(other, 512, 0.7, 6);
  for (std::size_t i = 0; i < mine.size(); ++i) {
    ASSERT_EQ(mine[i].serial, theirs[i].serial);
    ASSERT_EQ(mine[i].weight, theirs[i].weight);
  }
  other.push(1);
  EXPECT_EQ(other.priority(other.end() - 1), sampler.max_priority());
}

// Spec 6.7: chi-square. 49 degrees of freedom; 85.35 is exceeded with probability 0.001.
/// What several learners' weights are made of (learner/algorithms/q_learning.h): each draws equally many units of its replay.
TEST(PrioritizedSampler, SharesOfDrawsWithTheSmallestProbabilityOfAllHaveTheWeightsOfWhatIsReallyDrawn) {
  const std::vector<std::vector<float>> errors = {{0.1f, 2.0f, 0.5f}, {1.0f, 3.0f, 0.2f, 0.7f, 5.0f}};
  for (const double beta : {0.4, 1.0}) {
    std::vector<PrioritizedSampler> shards(errors.size(), PrioritizedSampler(0.6));
    double least = 1;
    for (std::size_t k = 0; k < shards.size(); ++k) {
      std::vector<int64_t> serials(errors[k].size());
      std::iota(serials.begin(), serials.end(), 0);
      shards[k].push(static_cast<int64_t>(serials.size()));
      shards[k].set_priorities(serials, errors[k]);
      least = std::min(least, shards[k].least_probability());
    }
    for (const PrioritizedSampler& shard : shards) {
      const double factor = std::pow(least / shard.least_probability(), beta);
      for (const Pick& pick : draw(shard, 100, beta, 1)) {
        const double probability = shard.priority(pick.serial) / shard.total();
        EXPECT_NEAR(pick.weight * factor, std::pow(least / probability, beta), 1e-12);
      }
    }
  }
  EXPECT_EQ(PrioritizedSampler(0.6).least_probability(), 0);
}

TEST(UniformSampler, PassesAChiSquareTest) {
  UniformSampler sampler;
  sampler.push(80);
  sampler.pop(30);
  std::vector<int> counts(80);
  constexpr int kDraws = 100'000;
  for (const Pick& pick : draw(sampler, kDraws, 0, 12)) {
    ASSERT_GE(pick.serial, 30);
    ASSERT_LT(pick.serial, 80);
    ASSERT_EQ(pick.weight, 1);
    ++counts[static_cast<std::size_t>(pick.serial)];
  }
  const double expected = kDraws / 50.0;
  double chi_square = 0;
  for (std::size_t i = 30; i < 80; ++i)
    chi_square += (counts[i] - expected) * (counts[i] - expected) / expected;
  EXPECT_LT(chi_square, 85.35);
  EXPECT_GT(chi_square, 20) << "and it is chance, not a round";
}

TEST(UniformSampler, DrawsNothingFromNothing) {
  EXPECT_EQ(UniformSampler().least_probability(), 0);
  EXPECT_TRUE(draw(UniformSampler(), 5, 0, 1).empty());
  EXPECT_TRUE(draw(PrioritizedSampler(0.6), 5, 0, 1).empty());
}

}  // namespace samplers_test
}  // namespace comrad::replay
