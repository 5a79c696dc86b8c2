#include "policy_workers/device/part_pool.h"

#include <dlfcn.h>
#include <gtest/gtest.h>

#include <atomic>
#include <filesystem>
#include <set>
#include <stdexcept>
#include <string>

#include "policy_workers/device/cpu_tuning.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/patience.h"

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
  // Of OpenBLAS; other libraries follow OpenMP.
  const auto blas_threads = reinterpret_cast<int (*)()>(dlsym(RTLD_DEFAULT, "openblas_get_num_threads"));
  const auto threads_of_a_product = [&] {
    return blas_threads == nullptr ? at::get_num_threads() : blas_threads();
  };
  const int before = at::get_num_threads();
  device::set_math_threads(2);
  EXPECT_EQ(threads_of_a_product(), 2);
  PartPool pool(2);
  EXPECT_TRUE(pool.run(
      2, [&](int64_t) { EXPECT_EQ(threads_of_a_product(), 1); }, nullptr));
  EXPECT_EQ(threads_of_a_product(), 2);
  device::set_math_threads(before);
}

std::set<std::string> threads_of_this_process() {
  std::set<std::string> ids;
  for (const auto& thread : std::filesystem::directory_iterator("/proc/self/task"))
    ids.insert(thread.path().filename());
  return ids;
}

// One that was made just now waits awake for its first work.
TEST(PartPool, AJobMakesNoThread) {
  const int before = at::get_num_threads();
  device::set_math_threads(8);
  PartPool pool(2);
  const std::set<std::string> threads = threads_of_this_process();
  for (int job = 0; job < 20; ++job) {
    EXPECT_TRUE(pool.run(
        2, [](int64_t) { EXPECT_EQ(at::get_num_threads(), 1); }, nullptr));
    EXPECT_EQ(at::get_num_threads(), 8);
  }
  EXPECT_EQ(threads_of_this_process(), threads);
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
        if (test::wait_until([&] { return here == 2; })) met = true;
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
