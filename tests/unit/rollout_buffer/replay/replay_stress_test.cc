// Three threads at once, as in the learner: one inserts, one draws and reads, one writes priorities back,
// while the ring goes round. Every frame carries the number of its trajectory, so a byte of another one
// is noticed.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <mutex>
#include <thread>

#include "rollout_buffer/replay/rate_limiter.h"
#include "rollout_buffer/replay/replay.h"
#include "tests/support/patience.h"
#include "tests/unit/rollout_buffer/replay/replay_slabs.h"

namespace comrad::replay {
namespace replay_stress_test {

using test::SlabPool;
constexpr double kSeconds = 1;
constexpr int64_t kReads = 100, kInserts = 50, kUpdates = 100;  // fewer would show nothing

class ReplayUnderLoad : public ::testing::TestWithParam<std::tuple<Unit, Backing>> {};

TEST_P(ReplayUnderLoad, ReadersNeverSeeBytesOfAnotherTrajectory) {
  const auto& [unit, backing] = GetParam();
  const TrajectoryShape shape = small_shape();
  const test::ScratchFolder folder;
  auto created = Replay::create({.store = {.shape = shape,
                                           .capacity_bytes = 30'000,
                                           .file = backing.mapped ? folder / "ring" : "",
                                           .compress = backing.compressed},
                                 .unit = unit,
                                 .prioritized = true});
  ASSERT_TRUE(created) << created.error().message;
  Replay& replay = **created;
  RateLimiter limiter({.samples_per_insert = 1, .min_size_to_sample = 64, .error_buffer = 256});

  const double enough_s = monotonic_s() + kSeconds, end_s = test::deadline_s();
  std::atomic<int64_t> inserted{0}, updated{0}, read{0};
  const auto goes_on = [&] {
    const bool is_enough = read > kReads && inserted > kInserts && updated > kUpdates;
    return monotonic_s() < (is_enough ? enough_s : end_s);
  };
  std::mutex mutex;
  std::vector<int64_t> serials;  // for the updating thread

  std::thread inserter([&] {
    const SlabPool pool(shape, 1);
    for (uint64_t number = 0; goes_on(); ++number) {
      for (int row = 0; row <= shape.rollout_steps; ++row)
        for (int agent = 0; agent < 2; ++agent) {
          std::ranges::fill(pool.view(0).frame(row, agent), static_cast<uint8_t>(number + 16 * row + agent));
          std::ranges::fill(pool.view(0).measurement(row, agent), static_cast<float>(number));
        }
      if (limiter.wait_to_insert(16, 1000) != WaitResult::kReady) continue;
      limiter.inserted(replay.insert(pool.view(0), 1 + number % 8));
      ++inserted;
    }
    limiter.stop();
  });
  std::thread updater([&] {
    Rng rng(uint64_t{2});
    while (goes_on()) {
      std::vector<int64_t> taken;
      {
        const std::lock_guard lock(mutex);
        taken.swap(serials);
      }
      std::vector<float> errors;
      for (std::size_t i = 0; i < taken.size(); ++i) errors.push_back(static_cast<float>(rng.uniform()));
      replay.set_priorities(taken, errors);
      updated += static_cast<int64_t>(taken.size());
      std::this_thread::yield();
    }
  });
  Rng rng(uint64_t{1});
  int64_t wrong = 0, evicted = 0;
  std::vector<uint8_t> frames(static_cast<std::size_t>(2 * shape.env.frame_bytes()));
  for (WaitResult result; (result = limiter.wait_to_sample(16, 1000)) != WaitResult::kStopped;) {
    if (result == WaitResult::kTimeout) continue;
    const std::vector<Draw> draws = replay.draw(16, 0.4, rng);
    replay.prefetch(draws);
    replay.read_each(draws, [&](std::size_t index, const StoredTrajectory* item) {
      if (item == nullptr) {
        ++evicted;
        return;
      }
      ++read;
      const auto number = static_cast<uint64_t>(draws[index].item);
      wrong += item->length() != static_cast<int>(1 + number % 8);
      for (int row = 0; row <= item->length(); ++row) {
        item->copy_frames(row, frames.data());
        for (std::size_t i = 0; i < frames.size(); ++i)
          wrong += frames[i] !=
                   static_cast<uint8_t>(number + 16 * static_cast<uint64_t>(row) + i / (frames.size() / 2));
        for (const float x : item->measurement(row)) wrong += x != static_cast<float>(number);
      }
    });
    limiter.sampled(16);
    const std::lock_guard lock(mutex);
    for (const Draw& draw : draws) serials.push_back(draw.serial);
  }
  inserter.join();
  updater.join();
  EXPECT_EQ(wrong, 0);
  EXPECT_GT(read.load(), kReads);
  EXPECT_GT(inserted.load(), kInserts) << "the ring went round";
  EXPECT_GT(updated.load(), kUpdates);
  EXPECT_EQ(replay.broken_decisions(), 0);
  RecordProperty("evicted", static_cast<int>(evicted));
}

INSTANTIATE_TEST_SUITE_P(All, ReplayUnderLoad,
                         ::testing::Combine(::testing::Values(Unit::kSequence, Unit::kAgentStep),
                                            ::testing::ValuesIn(backings())),
                         [](const auto& one) {
                           return std::string(std::get<0>(one.param) == Unit::kSequence ? "Sequence"
                                                                                        : "AgentStep") +
                                  std::get<1>(one.param).name;
                         });

// A reader that comes back at once must not keep the inserting thread out.
TEST(ReplayLocks, AnEagerReaderDoesNotStarveTheInserter) {
  const TrajectoryShape shape = small_shape();
  auto replay = Replay::create({.store = {.shape = shape, .capacity_bytes = 30'000}});
  ASSERT_TRUE(replay);
  std::atomic<bool> stop{false};
  std::thread reader([&] {
    while (!stop)
      (*replay)->read(
          [](const TrajectoryStore&) { std::this_thread::sleep_for(std::chrono::microseconds(200)); });
  });
  const SlabPool pool(shape, 1);
  // Each stands behind one read or two; one that is kept out does not end.
  for (int i = 0; i < 200; ++i) ASSERT_EQ((*replay)->insert(pool.view(0), 8), 16);
  stop = true;
  reader.join();
}

}  // namespace replay_stress_test
}  // namespace comrad::replay
