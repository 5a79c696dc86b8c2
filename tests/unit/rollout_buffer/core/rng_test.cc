#include "rollout_buffer/core/rng.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <set>

namespace comrad {
namespace rng_test {

TEST(Rng, IsSplitMix64) {
  // First outputs of the published generator from state 0.
  Rng rng = Rng::restore(0);
  EXPECT_EQ(rng.next(), 0xE220A8397B1DCDAFull);
  EXPECT_EQ(rng.next(), 0x6E789E6AA1B965F4ull);
  EXPECT_EQ(rng.next(), 0x06C45D188009454Full);
}

TEST(RngKey, KnownValuesHoldForEver) {
  // Worked out apart from this program; episodes recorded with them must replay.
  EXPECT_EQ(RngKey(42).bits(), 0x57e1faba65107204ull);
  EXPECT_EQ(RngKey(42).split(uint64_t{3}).bits(), 0xfc7cd0c5c795298bull);
  EXPECT_EQ(RngKey(42).split("episode").split(uint64_t{5}).split(uint64_t{7}).bits(), 0x9d102d508ae3c1e4ull);
}

TEST(RngKey, ChildrenDiffer) {
  std::set<uint64_t> seen;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    const RngKey run(seed);
    for (uint64_t child = 0; child < 200; ++child) seen.insert(run.split(child).bits());
    for (const char* purpose : {"action", "episode", "evaluation", "weights"})
      seen.insert(run.split(purpose).bits());
  }
  EXPECT_EQ(seen.size(), 20u * 204u);
}

TEST(RngKey, UniformStaysBelowOne) {
  for (uint64_t seed = 0; seed < 100000; ++seed) {
    const float draw = RngKey(seed).uniform();
    ASSERT_GE(draw, 0.0f);
    ASSERT_LT(draw, 1.0f);
  }
}

TEST(Rng, BelowIsUniform) {
  constexpr int kDraws = 300000;
  constexpr std::array<uint32_t, 3> kBounds = {3, 7, 27};
  for (const uint32_t bound : kBounds) {
    Rng rng(uint64_t{bound});
    std::array<int, 27> count{};
    for (int draw = 0; draw < kDraws; ++draw) ++count[rng.below(bound)];
    double chi_square = 0;
    const double expected = static_cast<double>(kDraws) / bound;
    for (uint32_t value = 0; value < bound; ++value)
      chi_square += (count[value] - expected) * (count[value] - expected) / expected;
    // Mean bound-1, deviation sqrt(2(bound-1)); six deviations never happen by chance.
    EXPECT_LT(chi_square, (bound - 1) + 6 * std::sqrt(2.0 * (bound - 1))) << "bound " << bound;
  }
}

TEST(Rng, BetweenIncludesBothEnds) {
  Rng rng(uint64_t{1});
  std::set<int32_t> seen;
  for (int draw = 0; draw < 1000; ++draw) seen.insert(rng.between(-2, 2));
  EXPECT_EQ(seen, (std::set<int32_t>{-2, -1, 0, 1, 2}));
}

TEST(Rng, RestoreContinuesTheSameStream) {
  Rng rng(uint64_t{9});
  rng.next();
  Rng copy = Rng::restore(rng.state());
  for (int draw = 0; draw < 10; ++draw) EXPECT_EQ(copy.next(), rng.next());
}

}  // namespace rng_test
}  // namespace comrad
