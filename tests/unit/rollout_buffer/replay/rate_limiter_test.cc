#include "rollout_buffer/replay/rate_limiter.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <thread>

namespace comrad::replay {
namespace rate_limiter_test {

using ::testing::HasSubstr;

TEST(RateLimiter, SamplesOnlyFromTheSmallestSizeOn) {
  RateLimiter limiter({.min_size_to_sample = 100});
  limiter.inserted(99);
  EXPECT_FALSE(limiter.can_sample());
  limiter.inserted(1);
  EXPECT_TRUE(limiter.can_sample(1'000'000)) << "no ratio, no other limit";
  EXPECT_TRUE(limiter.can_insert(1'000'000));
}

TEST(RateLimiter, ReportsHowMuchOfTheSmallestSizeIsThere) {
  RateLimiter limiter({.min_size_to_sample = 100});
  EXPECT_EQ(limiter.filled(), 0);
  limiter.inserted(61);
  EXPECT_EQ(limiter.filled(), 0.61);
  limiter.inserted(500);
  EXPECT_EQ(limiter.filled(), 1);
}

// min 10, r = 4, tolerance 20: (inserted - 10) * 4 - sampled stays within -20..20.
TEST(RateLimiter, KeepsBothSidesWithinTheTolerance) {
  RateLimiter limiter({.samples_per_insert = 4, .min_size_to_sample = 10, .error_buffer = 20});
  EXPECT_TRUE(limiter.can_insert(10)) << "up to the smallest size nothing holds inserts";
  limiter.inserted(10);
  EXPECT_TRUE(limiter.can_sample(20));
  EXPECT_FALSE(limiter.can_sample(21));
  EXPECT_TRUE(limiter.can_insert(5));
  EXPECT_FALSE(limiter.can_insert(6));
  limiter.sampled(20);
  EXPECT_FALSE(limiter.can_sample(1));
  EXPECT_TRUE(limiter.can_insert(10));
  EXPECT_FALSE(limiter.can_insert(11));
  limiter.inserted(1);
  EXPECT_TRUE(limiter.can_sample(4));
  EXPECT_FALSE(limiter.can_sample(5));
}

TEST(RateLimiter, ReportsWhichInsertsWaitForTheirSamples) {
  RateLimiter limiter({.samples_per_insert = 4, .min_size_to_sample = 10, .error_buffer = 80});
  limiter.inserted(8);
  EXPECT_EQ(limiter.pending_inserts(), 0) << "the first ones are waited for";
  EXPECT_EQ(limiter.inserts_per_sample(), 0);
  limiter.inserted(12);
  EXPECT_EQ(limiter.pending_inserts(), 10);
  limiter.sampled(20);
  EXPECT_EQ(limiter.pending_inserts(), 5);
  EXPECT_EQ(limiter.inserts_per_sample(), 0.5);
  limiter.sampled(60);
  EXPECT_EQ(limiter.pending_inserts(), 0) << "samples ran ahead";
  RateLimiter without_ratio({.min_size_to_sample = 1});
  without_ratio.inserted(100);
  without_ratio.sampled(3);
  EXPECT_EQ(without_ratio.pending_inserts(), 0);
  EXPECT_EQ(without_ratio.inserts_per_sample(), 33);
}

TEST(RateLimiter, TheLongRunRatioIsTheRequestedOne) {
  RateLimiter limiter({.samples_per_insert = 0.25, .min_size_to_sample = 64, .error_buffer = 300});
  ASSERT_TRUE(validate({.samples_per_insert = 0.25, .min_size_to_sample = 64, .error_buffer = 300}, 64, 256));
  for (int i = 0; i < 20'000; ++i) {  // each side that may, goes: greedy
    const bool insert = limiter.can_insert(64), sample = limiter.can_sample(256);
    ASSERT_TRUE(insert || sample) << "they wait for each other";
    if (insert) limiter.inserted(64);
    if (sample) limiter.sampled(256);
  }
  EXPECT_NEAR(static_cast<double>(limiter.sample_count()) / static_cast<double>(limiter.insert_count()), 0.25,
              0.01);
}

TEST(RateLimiter, PiecesThatCouldWaitForEachOtherAreRefused) {
  const RateLimiterOptions options{.samples_per_insert = 4, .min_size_to_sample = 10, .error_buffer = 160};
  EXPECT_TRUE(validate(options, 64, 64).has_value());
  const Status tight = validate(options, 64, 65);
  ASSERT_FALSE(tight.has_value());
  EXPECT_EQ(tight.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(tight.error().message, HasSubstr("wait for each other"));
  EXPECT_FALSE(validate({.samples_per_insert = -1}, 1, 1).has_value());
  EXPECT_FALSE(validate({.samples_per_insert = 0.0 / 0.0}, 1, 1).has_value());
  EXPECT_FALSE(validate({.samples_per_insert = 1, .error_buffer = 0.0 / 0.0}, 1, 1).has_value());
  EXPECT_FALSE(validate({.min_size_to_sample = 0}, 1, 1).has_value());
}

TEST(RateLimiter, AWaitEndsByItsTimeOutAWakeUpOrAStop) {
  RateLimiter limiter({.samples_per_insert = 1, .min_size_to_sample = 1, .error_buffer = 1});
  EXPECT_EQ(limiter.wait_to_sample(1, 5), WaitResult::kTimeout);
  std::thread inserter([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    limiter.inserted(1);
  });
  EXPECT_EQ(limiter.wait_to_sample(1, 60'000), WaitResult::kReady);
  inserter.join();
  EXPECT_EQ(limiter.wait_to_insert(1, 0), WaitResult::kReady);
  limiter.inserted(1);
  EXPECT_EQ(limiter.wait_to_insert(1, 5), WaitResult::kTimeout);
  std::thread stopper([&] {
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
    limiter.stop();
  });
  EXPECT_EQ(limiter.wait_to_insert(1, 60'000), WaitResult::kStopped);
  stopper.join();
  EXPECT_EQ(limiter.wait_to_sample(1, 60'000), WaitResult::kStopped);
}

TEST(RateLimiter, TwoThreadsKeepTheirRatio) {
  RateLimiter limiter({.samples_per_insert = 3, .min_size_to_sample = 8, .error_buffer = 12});
  std::thread inserter([&] {
    for (int i = 0; i < 2000; ++i) {
      if (limiter.wait_to_insert(2, 60'000) != WaitResult::kReady) break;
      limiter.inserted(2);
    }
  });
  int64_t worst = 0;
  while (limiter.sample_count() < 3 * (4000 - 8)) {
    ASSERT_EQ(limiter.wait_to_sample(4, 60'000), WaitResult::kReady);
    limiter.sampled(4);
    worst = std::max(worst, std::abs(3 * (limiter.insert_count() - 8) - limiter.sample_count()));
  }
  inserter.join();
  EXPECT_LE(worst, 12);
  EXPECT_EQ(limiter.insert_count(), 4000);
}

TEST(RateLimiter, CountsOfACheckpointContinue) {
  RateLimiter limiter({.samples_per_insert = 1, .min_size_to_sample = 10, .error_buffer = 5});
  limiter.restore(100, 90);
  EXPECT_TRUE(limiter.can_sample(5));
  EXPECT_FALSE(limiter.can_sample(6));
}

}  // namespace rate_limiter_test
}  // namespace comrad::replay
