#include "learner/batch/normalizer.h"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "policy_workers/device/torch_ops.h"

namespace comrad::learn {
namespace normalizer_test {

TEST(ReturnNormalizer, MatchesTheKnownAnswer) {
  ReturnNormalizer normalizer;
  const torch::Tensor samples = torch::tensor({1.0f, 2.0f, 4.0f, 7.0f});
  ASSERT_TRUE(normalizer.update(samples, {}));
  EXPECT_NEAR(normalizer.statistics().mean, 2.8, 1e-12);
  EXPECT_NEAR(normalizer.statistics().variance, 7.76, 1e-12);
  EXPECT_EQ(normalizer.statistics().count, 5);
  const torch::Tensor normalized = normalizer.normalize(samples);
  const double expected[] = {-0.646162, -0.287183, 0.430775, 1.507711};
  for (int i = 0; i < 4; ++i) EXPECT_NEAR(normalized[i].item<double>(), expected[i], 1e-6);
}

TEST(ReturnNormalizer, ReadsValidSamplesOnly) {
  ReturnNormalizer all, masked;
  all.update(torch::tensor({1.0f, 2.0f, 4.0f, 7.0f}), {});
  masked.update(torch::tensor({1.0f, 900.0f, 2.0f, 4.0f, 7.0f}),
                torch::tensor({1, 0, 1, 1, 1}, torch::kUInt8));
  EXPECT_DOUBLE_EQ(all.statistics().mean, masked.statistics().mean);
  EXPECT_DOUBLE_EQ(all.statistics().variance, masked.statistics().variance);
}

TEST(ReturnNormalizer, AHalfLifeForgetsByTheSamplesThatCame) {
  ReturnNormalizer keeps, forgets(5, 100);
  for (int batch = 0; batch < 50; ++batch)
    for (ReturnNormalizer* normalizer : {&keeps, &forgets}) {
      const float scale = batch < 25 ? 1.0f : 10.0f;
      ASSERT_TRUE(normalizer->update(scale * torch::tensor({-1.0f, 0.0f, 1.0f, 4.0f}).repeat({5}), {}));
    }
  // The plain sums: a batch weighs half as much for every 100 samples that came after it. Its mean is its scale; of its 20
  // samples the squares about that are 70 scale^2, and 20/19 of them count, as the variance is the unbiased one.
  const double fresh = std::exp2(-50 * 20 / 100.0);
  const auto sum_of = [](auto of_batch) {
    double sum = 0;
    for (int batch = 0; batch < 50; ++batch)
      sum += std::exp2(-20 * (49 - batch) / 100.0) * of_batch(batch < 25 ? 1.0 : 10.0);
    return sum;
  };
  const double count = fresh + sum_of([](double) { return 20.0; });
  const double mean = sum_of([](double scale) { return 20 * scale; }) / count;
  const double squares = fresh * (1 + mean * mean) + sum_of([mean](double scale) {
                           return 70.0 * 20 / 19 * scale * scale + 20 * (scale - mean) * (scale - mean);
                         });
  EXPECT_NEAR(forgets.statistics().count, count, 1e-9);
  EXPECT_NEAR(forgets.statistics().mean, mean, 1e-9);
  EXPECT_NEAR(forgets.statistics().variance, squares / count, 1e-6);
  EXPECT_GT(forgets.sigma(), 1.2 * keeps.sigma());
  EXPECT_EQ(keeps.statistics().count, 1001);
}

TEST(ReturnNormalizer, KeepsItsStatisticsWhenABatchHasNothingToSay) {
  ReturnNormalizer normalizer;
  EXPECT_FALSE(normalizer.update(torch::tensor({3.0f}), torch::tensor({0}, torch::kUInt8)));
  EXPECT_FALSE(normalizer.update(torch::tensor({std::numeric_limits<float>::quiet_NaN()}), {}));
  EXPECT_FALSE(normalizer.update(torch::tensor({std::numeric_limits<float>::infinity()}), {}));
  EXPECT_EQ(normalizer.statistics().mean, 0);
  EXPECT_EQ(normalizer.statistics().variance, 1);
  EXPECT_EQ(normalizer.statistics().count, 1);
}

TEST(ReturnNormalizer, ClipsAtTheBoundAndReportsHowOftenItDid) {
  const torch::Tensor values = torch::tensor({-7.0f, 0.0f, 3.0f, 100.0f});
  const torch::Tensor valid = torch::tensor({1, 1, 1, 0}, torch::kUInt8);
  ReturnNormalizer unbounded(0), three(3);
  for (ReturnNormalizer* normalizer : {&unbounded, &three}) normalizer->restore({0.0, 4.0, 1.0});
  EXPECT_NEAR(unbounded.normalize(values)[3].item<double>(), 50, 1e-3);
  EXPECT_NEAR(unbounded.denormalize(values)[3].item<double>(), 200, 1e-3);
  EXPECT_EQ(unbounded.clipped_fraction(values, valid), 0);
  EXPECT_NEAR(three.normalize(values)[3].item<double>(), 3, 1e-6);
  EXPECT_NEAR(three.denormalize(values)[0].item<double>(), -6, 1e-3);
  EXPECT_NEAR(three.clipped_fraction(values, valid), 1.0 / 3, 1e-9);
  EXPECT_NEAR(three.clipped_fraction(values, {}), 0.5, 1e-9);
  EXPECT_EQ(three.clipped_fraction(values, torch::zeros({4}, torch::kUInt8)), 0);
}

TEST(ReturnNormalizer, ClipsAtFiveDeviationsBothWays) {
  ReturnNormalizer normalizer;
  normalizer.restore({.mean = 10, .variance = 4 - 1e-5, .count = 100});
  EXPECT_NEAR(normalizer.normalize(torch::tensor(1000.0f)).item<double>(), 5, 1e-6);
  EXPECT_NEAR(normalizer.denormalize(torch::tensor(99.0f)).item<double>(), 20, 1e-5);
  EXPECT_NEAR(normalizer.denormalize(torch::tensor(-1.5f)).item<double>(), 7, 1e-5);
}

}  // namespace normalizer_test
}  // namespace comrad::learn
