#include "rollout_buffer/shm/futex.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <sys/wait.h>
#include <unistd.h>

#include <new>
#include <thread>

#include "rollout_buffer/core/clock.h"

namespace comrad::shm {
namespace futex_test {

constexpr int64_t kLong_us = 3'600'000'000;  // one that is not woken does not end

TEST(Doorbell, ARingBetweenListenAndWaitIsNotMissed) {
  Doorbell bell{};
  const uint32_t heard = listen(bell);
  ring(bell);
  EXPECT_TRUE(wait(bell, heard, 10'000'000));
}

TEST(Doorbell, WaitEndsWithItsTimeOut) {
  Doorbell bell{};
  const int64_t began_ns = monotonic_ns();
  EXPECT_FALSE(wait(bell, listen(bell), 30'000));
  EXPECT_GE(monotonic_ns() - began_ns, 30'000'000);
  EXPECT_EQ(bell.sleepers.load(), 0u);
  EXPECT_FALSE(wait(bell, listen(bell), 0));
}

TEST(Doorbell, WakesEverySleeperOfThisProcess) {
  Doorbell bell{};
  const uint32_t heard = listen(bell);
  std::atomic<int> woken{0};
  std::vector<std::thread> sleepers;
  for (int index = 0; index < 3; ++index)
    sleepers.emplace_back([&] { woken += wait(bell, heard, kLong_us); });
  while (bell.sleepers.load() < 3) std::this_thread::yield();
  ring(bell);
  for (std::thread& sleeper : sleepers) sleeper.join();
  EXPECT_EQ(woken.load(), 3);
}

TEST(Doorbell, WakesASleeperInAnotherProcess) {
  void* memory = mmap(nullptr, sizeof(Doorbell), PROT_READ | PROT_WRITE, MAP_SHARED | MAP_ANONYMOUS, -1, 0);
  ASSERT_NE(memory, MAP_FAILED);
  auto* bell = new (memory) Doorbell{};
  const uint32_t heard = listen(*bell);
  const pid_t child = fork();
  if (child == 0) _exit(wait(*bell, heard, kLong_us) ? 0 : 1);
  while (bell->sleepers.load() == 0) usleep(100);
  ring(*bell);
  int status = -1;
  ASSERT_EQ(waitpid(child, &status, 0), child);
  EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) == 0);
  munmap(memory, sizeof(Doorbell));
}

}  // namespace futex_test
}  // namespace comrad::shm
