#include "policy_workers/device/part_pool.h"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <stdexcept>
#include <thread>

#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/clock.h"

namespace comrad::device {
namespace part_pool_test {

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

// Threads of the BLAS's own would spin on the cores that the parts compute on.
TEST(PartPool, MatrixProductsOfAPartStayInItsThread) {
  const int before = at::get_num_threads();
  device::set_math_threads(2);
  // Threads that were made just now wait awake at first.
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  PartPool pool(2);
  const torch::Tensor factor = torch::ones({256, 256});
  std::mutex mutex;
  double of_parts = 0;
  const double begin = process_cpu_s();
  EXPECT_TRUE(pool.run(
      2,
      [&](int64_t) {
        const double part_begin = thread_cpu_s();
        for (int i = 0; i < 200; ++i) (void)at::mm(factor, factor);
        const double used = thread_cpu_s() - part_begin;
        const std::lock_guard lock(mutex);
        of_parts += used;
      },
      nullptr));
  EXPECT_LT(process_cpu_s() - begin, 1.2 * of_parts + 0.005);
  EXPECT_EQ(at::get_num_threads(), 2);
  device::set_math_threads(before);
}

TEST(PartPool, AJobLeavesNoThreadAwake) {
  const int before = at::get_num_threads();
  device::set_math_threads(8);
  PartPool pool(2);
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const double begin = process_cpu_s();
  for (int job = 0; job < 20; ++job) {
    EXPECT_TRUE(pool.run(
        2, [](int64_t) { EXPECT_EQ(at::get_num_threads(), 1); }, nullptr));
    EXPECT_EQ(at::get_num_threads(), 8);
    std::this_thread::sleep_for(std::chrono::milliseconds(30));
  }
  EXPECT_LT(process_cpu_s() - begin, 0.1);
  device::set_math_threads(before);
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

}  // namespace part_pool_test
}  // namespace comrad::device
