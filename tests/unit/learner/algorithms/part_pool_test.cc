#include "learner/algorithms/part_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <stdexcept>

#include "policy_workers/policy/torch_ops.h"

namespace comrad::learn {
namespace {

TEST(PartPool, DoesEveryPartOnceWithOneComputingThreadEach) {
  const int before = at::get_num_threads();
  for (const int threads : {1, 2, 5}) {
    PartPool pool(threads);
    EXPECT_EQ(pool.threads(), threads);
    for (const int64_t parts : {0, 1, 2, 17}) {
      std::vector<std::atomic<int>> times(static_cast<std::size_t>(parts));
      std::atomic<int> with_more = 0;
      EXPECT_TRUE(pool.run(
          parts,
          [&](int64_t part) {
            ++times[static_cast<std::size_t>(part)];
            if (threads > 1 && parts > 1 && at::get_num_threads() != 1) ++with_more;
          },
          nullptr));
      for (const auto& count : times) EXPECT_EQ(count, 1);
      EXPECT_EQ(with_more, 0);
    }
  }
  EXPECT_EQ(at::get_num_threads(), before);
}

TEST(PartPool, TwoThreadsWorkAtTheSameTime) {
  PartPool pool(2);
  std::atomic<int> here = 0;
  std::atomic<bool> met = false;
  (void)pool.run(
      2,
      [&](int64_t) {
        ++here;
        const auto deadline = std::chrono::steady_clock::now() + std::chrono::seconds(20);
        while (here < 2 && std::chrono::steady_clock::now() < deadline) std::this_thread::yield();
        if (here == 2) met = true;
      },
      nullptr);
  EXPECT_TRUE(met);
}

TEST(PartPool, ARefusalBeginsNoFurtherPart) {
  for (const int threads : {1, 3}) {
    PartPool pool(threads);
    std::atomic<int> done = 0;
    EXPECT_FALSE(pool.run(
        1000000, [&](int64_t) { ++done; }, [] { return false; }));
    EXPECT_LT(done, 1000000);
    EXPECT_TRUE(pool.run(
        3, [&](int64_t) {}, [] { return true; }))
        << "the next job begins anew";
  }
}

TEST(PartPool, AFailureEndsTheJobAndIsThrownAgain) {
  for (const int threads : {1, 3}) {
    PartPool pool(threads);
    EXPECT_THROW((void)pool.run(
                     100,
                     [](int64_t part) {
                       if (part == 5) throw std::runtime_error("part 5");
                     },
                     nullptr),
                 std::runtime_error);
    EXPECT_TRUE(pool.run(
        3, [](int64_t) {}, nullptr));
  }
}

}  // namespace
}  // namespace comrad::learn
