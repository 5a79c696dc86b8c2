#include "rollout_buffer/replay/trajectory_store.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <deque>
#include <fstream>
#include <limits>

#include "rollout_buffer/shm/segment.h"
#include "tests/support/random_bytes.h"
#include "tests/unit/rollout_buffer/replay/replay_slabs.h"

namespace comrad::replay {
namespace trajectory_store_test {

using test::SlabPool;
using ::testing::Each;
using ::testing::HasSubstr;

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

class StoreContent : public ::testing::TestWithParam<Backing> {
 protected:
  TrajectoryStore make(const TrajectoryShape& shape, int64_t capacity_bytes,
                       int64_t capacity_transitions = 0) {
    auto store = TrajectoryStore::create({.shape = shape,
                                          .capacity_bytes = capacity_bytes,
                                          .capacity_transitions = capacity_transitions,
                                          .file = GetParam().mapped ? folder_ / "ring" : "",
                                          .compress = GetParam().compressed});
    EXPECT_TRUE(store.has_value()) << store.error().message;
    return std::move(*store);
  }
  test::ScratchFolder folder_;
};

TEST_P(StoreContent, GivesBackEveryFieldOfEveryAgent) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  for (const int length : {8, 1, 5}) {
    TrajectoryStore store = make(shape, 100'000);
    fill_slab(pool, shape, 40 + static_cast<uint64_t>(length));
    const ItemId id = store.append(pool.view(0), static_cast<uint32_t>(length));
    ASSERT_EQ(id, 0);
    expect_same(store.item(id), pool.view(0), length);
    for (int agent = 0; agent < 2; ++agent)
      EXPECT_TRUE(
          std::ranges::equal(store.item(id).recurrent_state(agent), pool.view(0).recurrent_state(0, agent)));
    EXPECT_EQ(store.transition_count(), 2 * length);
    EXPECT_EQ(store.broken_decisions(), 0);
  }
}

TEST_P(StoreContent, TheOldestLeaveAndTheOthersStayWholeAroundTheEndOfTheRing) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  TrajectoryStore store = make(shape, 5 * TrajectoryStore::item_bytes(shape, 3) + 1000);
  struct Known {
    uint64_t number;
    uint32_t length;
  };
  std::deque<Known> known;
  Rng rng(uint64_t{5});
  for (uint64_t number = 0; number < 120; ++number) {
    known.push_back({number, static_cast<uint32_t>(rng.between(1, shape.rollout_steps))});
    fill_slab(pool, shape, number);
    ASSERT_EQ(store.append(pool.view(0), known.back().length), static_cast<ItemId>(number));
    ASSERT_EQ(store.end(), static_cast<ItemId>(number) + 1);
    ASSERT_GE(store.item_count(), std::min<int64_t>(static_cast<int64_t>(number) + 1, 4));
    ASSERT_LE(store.used_bytes(), store.capacity_bytes());
    while (static_cast<int64_t>(known.size()) > store.item_count()) known.pop_front();
    ASSERT_EQ(store.oldest(), static_cast<ItemId>(known.front().number));
    EXPECT_FALSE(store.contains(store.oldest() - 1));
    EXPECT_FALSE(store.contains(store.end()));
    int64_t transitions = 0;
    for (const Known& one : known) transitions += 2 * one.length;
    ASSERT_EQ(store.transition_count(), transitions);
    if (number % 7 != 0) continue;
    for (const Known& one : known) {
      fill_slab(pool, shape, one.number);
      expect_same(store.item(static_cast<ItemId>(one.number)), pool.view(0), static_cast<int>(one.length));
      if (HasFatalFailure()) FAIL() << "item " << one.number << " after " << number;
    }
  }
  EXPECT_GT(store.oldest(), 90) << "the ring went round many times";
}

TEST_P(StoreContent, ALimitOfTransitionsEvictsAsWell) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  TrajectoryStore store = make(shape, 1'000'000, 40);
  for (int i = 0; i < 10; ++i) store.append(pool.view(0), 8);  // 16 agent decisions each
  EXPECT_EQ(store.item_count(), 2);
  EXPECT_EQ(store.transition_count(), 32);
  EXPECT_LE(store.capacity_transitions(), 40);
  for (int i = 0; i < 10; ++i) store.append(pool.view(0), 1);
  EXPECT_EQ(store.transition_count(), 36) << "one long item and ten short ones";
}

INSTANTIATE_TEST_SUITE_P(Backings, StoreContent, ::testing::ValuesIn(backings()), backing_name);

TEST(TrajectoryStore, AMappedFileHoldsTheSameBytesAsMemory) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  const test::ScratchFolder folder;
  auto ram = TrajectoryStore::create({.shape = shape, .capacity_bytes = 20'000});
  auto file = TrajectoryStore::create({.shape = shape, .capacity_bytes = 20'000, .file = folder / "ring"});
  ASSERT_TRUE(ram && file);
  for (uint64_t number = 0; number < 30; ++number) {
    fill_slab(pool, shape, number);
    ASSERT_EQ(ram->append(pool.view(0), 1 + number % 8), file->append(pool.view(0), 1 + number % 8));
  }
  ASSERT_EQ(ram->oldest(), file->oldest());
  for (ItemId id = ram->oldest(); id < ram->end(); ++id) {
    file->prefetch(id);
    EXPECT_TRUE(std::ranges::equal(ram->item(id).bytes(), file->item(id).bytes()));
  }
}

TEST(TrajectoryStore, FramesAndMasksThatAreNotNeededCostNothing) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  const SlabView slab = pool.view(0);
  auto store = TrajectoryStore::create({.shape = shape, .capacity_bytes = 100'000});
  ASSERT_TRUE(store);
  const auto bytes_of_next = [&](uint32_t length) {
    const ItemId id = store->append(slab, length);
    return static_cast<int64_t>(store->item(id).bytes().size());
  };
  const int64_t frames = 2 * shape.env.frame_bytes();
  const int64_t plain = bytes_of_next(8);
  EXPECT_LE(plain, TrajectoryStore::item_bytes(shape, 0, false));
  EXPECT_LT(bytes_of_next(3), plain - 5 * frames) << "rows behind the end are not stored";
  slab.truncated(2) = 1;
  slab.final_index(2) = 2;
  const int64_t with_final = bytes_of_next(8);
  EXPECT_GE(with_final, plain + frames);
  EXPECT_LT(with_final, plain + 2 * frames) << "only the row that was used";
  slab.terminated(5) = 1;
  slab.final_index(5) = 0;
  EXPECT_EQ(bytes_of_next(8), with_final) << "nothing bootstraps from a terminated step's last observation";
  slab.action_mask(8, 1)[6] = 0;
  const int64_t with_mask = bytes_of_next(8);
  EXPECT_GE(with_mask, with_final + 9 * 2 * 7 - 63) << "a mask that forbids is kept";
  EXPECT_LE(with_mask, with_final + 9 * 2 * 7 + 63);
}

TEST(TrajectoryStore, AMaskIsAllOnesWhereNothingWasForbidden) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  auto store = TrajectoryStore::create({.shape = shape, .capacity_bytes = 100'000});
  ASSERT_TRUE(store);
  const StoredTrajectory item = store->item(store->append(pool.view(0), 8));
  EXPECT_EQ(item.action_mask(8).size(), 2u * 7u);
  EXPECT_THAT(item.action_mask(8), Each(uint8_t{1}));
}

// What a peer that went mad may leave in a slab, one thing at a time.
TEST(TrajectoryStore, WhatPeersWroteIsChecked) {
  const TrajectoryShape shape = small_shape();
  struct Case {
    const char* what;
    void (*damage)(const SlabView&);
    int64_t broken;
    std::vector<int> invalid_steps;
  };
  const std::vector<int> every = {0, 1, 2, 3, 4, 5, 6, 7};
  const std::vector<Case> cases = {
      {"sound", [](const SlabView&) {}, 0, {}},
      {"action above its head", [](const SlabView& slab) { slab.action(3, 1)[0] = 3; }, 1, {3}},
      {"negative action", [](const SlabView& slab) { slab.action(3, 0)[1] = -1; }, 1, {3}},
      {"huge action", [](const SlabView& slab) { slab.action(3, 0)[1] = 256; }, 1, {3}},
      {"reward", [](const SlabView& slab) { slab.reward(0, 0) = kNan; }, 1, {0}},
      {"infinite reward",
       [](const SlabView& slab) { slab.reward(7, 1) = std::numeric_limits<float>::infinity(); },
       1,
       {7}},
      {"measurement, which the step before bootstraps from",
       [](const SlabView& slab) { slab.measurement(4, 1)[2] = kNan; },
       1,
       {3, 4}},
      {"measurement behind the end of an episode",
       [](const SlabView& slab) {
         slab.measurement(4, 1)[2] = kNan;
         slab.terminated(3) = 1;
       },
       1,
       {4}},
      {"measurement behind the last step",
       [](const SlabView& slab) { slab.measurement(8, 0)[0] = kNan; },
       0,
       {7}},
      {"mask that allows nothing",
       [](const SlabView& slab) {
         for (int i = 3; i < 7; ++i) slab.action_mask(2, 0)[static_cast<std::size_t>(i)] = 0;
       },
       1,
       {1, 2}},
      {"final row out of range", [](const SlabView& slab) { slab.final_index(5) = 3; }, 2, {5}},
      {"very negative final row", [](const SlabView& slab) { slab.final_index(5) = INT32_MIN; }, 2, {5}},
      {"cut without a last observation", [](const SlabView& slab) { slab.truncated(5) = 1; }, 2, {5}},
      {"last observation's measurement",
       [](const SlabView& slab) {
         slab.truncated(5) = 1;
         slab.final_index(5) = 1;
         slab.final_measurement(1, 1)[0] = kNan;
       },
       1,
       {5}},
      {"recurrent state", [](const SlabView& slab) { slab.recurrent_state(0, 1)[4] = kNan; }, 8, every},
      {"global state, which every agent's critic sees",
       [](const SlabView& slab) { slab.global_state(4)[3] = kNan; },
       2,
       {3, 4}},
      {"last observation's global state",
       [](const SlabView& slab) {
         slab.truncated(5) = 1;
         slab.final_index(5) = 2;
         slab.final_global_state(2)[0] = std::numeric_limits<float>::infinity();
       },
       2,
       {5}},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    const SlabPool pool(shape, 1);
    pool.fill_with_noise(9);
    one.damage(pool.view(0));
    auto store = TrajectoryStore::create({.shape = shape, .capacity_bytes = 100'000});
    ASSERT_TRUE(store);
    const StoredTrajectory item = store->item(store->append(pool.view(0), 8));
    EXPECT_EQ(store->broken_decisions(), one.broken);
    std::vector<int> invalid;
    for (int step = 0; step < 8; ++step)
      if (!item.valid(step)) invalid.push_back(step);
    EXPECT_EQ(invalid, one.invalid_steps);
    const auto finite = [](float x) { return std::isfinite(x); };
    for (int row = 0; row <= 8; ++row) {
      EXPECT_TRUE(std::ranges::all_of(item.measurement(row), finite));
      EXPECT_TRUE(std::ranges::all_of(item.global_state(row), finite));
      if (row == 8) break;
      EXPECT_TRUE(std::ranges::all_of(item.reward(row), finite));
      for (std::size_t i = 0; i < 4; ++i) EXPECT_LT(item.action(row)[i], shape.env.head_sizes[i % 2]);
      EXPECT_GE(item.final_row(row), -1);
      EXPECT_LT(item.final_row(row), item.final_count());
    }
    for (int agent = 0; agent < 2; ++agent)
      EXPECT_TRUE(std::ranges::all_of(item.recurrent_state(agent), finite));
    for (int row = 0; row < item.final_count(); ++row)
      EXPECT_TRUE(std::ranges::all_of(item.final_measurement(row), finite) &&
                  std::ranges::all_of(item.final_global_state(row), finite));
    for (int row = 0; row <= 8; ++row)
      for (std::size_t agent = 0; agent < 2; ++agent)
        EXPECT_TRUE(
            std::ranges::any_of(item.action_mask(row).subspan(7 * agent + 3, 4), [](auto x) { return x; }));
  }
}

TEST(TrajectoryStore, AnImpossibleLengthCountsAsTheWholeSlabAndNoLengthStoresNothing) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  auto store = TrajectoryStore::create({.shape = shape, .capacity_bytes = 100'000});
  ASSERT_TRUE(store);
  EXPECT_EQ(store->append(pool.view(0), 0), kNoItem);
  EXPECT_EQ(store->item_count(), 0);
  const ItemId id = store->append(pool.view(0), UINT32_MAX);
  EXPECT_EQ(store->item(id).length(), 8);
  EXPECT_EQ(store->commit(pool.view(0)), kNoItem) << "what was prepared is committed once";
}

TEST(TrajectoryStore, ASingleStepKeepsNoRecurrentStateOnRequest) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  auto store =
      TrajectoryStore::create({.shape = shape, .capacity_bytes = 100'000, .keep_recurrent_state = false});
  ASSERT_TRUE(store);
  EXPECT_TRUE(store->item(store->append(pool.view(0), 8)).recurrent_state(1).empty());
}

// Compressed blocks may lie in a file that others can write.
TEST(TrajectoryStore, DamagedBlocksGiveSomePictureButNeverReachOutside) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  auto store = TrajectoryStore::create({.shape = shape, .capacity_bytes = 100'000, .compress = true});
  ASSERT_TRUE(store);
  fill_slab(pool, shape, 3);
  const StoredTrajectory item = store->item(store->append(pool.view(0), 8));
  const std::vector<std::byte> sound(item.bytes().begin(), item.bytes().end());
  std::vector<uint8_t> ones(14, 1);
  Rng rng(test::fuzz_seed());
  int differing = 0;
  for (int round = 0; round < 3000; ++round) {
    std::vector<std::byte> bytes =
        sound;  // on the heap at its exact size: a sanitizer sees every step outside
    for (uint32_t i = 0; i <= rng.below(6); ++i)
      bytes[rng.below(static_cast<uint32_t>(bytes.size()))] = static_cast<std::byte>(rng.next());
    const StoredTrajectory damaged(shape, item.form(), bytes.data(), static_cast<int64_t>(bytes.size()),
                                   ones.data());
    for (int row = 0; row <= 8; ++row)
      differing += frames_of(damaged, shape, row) != frames_of(item, shape, row);
    const auto [offset, count] = damaged.frame_range(2, 3);
    EXPECT_GE(count, 0) << "seed " << test::fuzz_seed();
    (void)offset;
  }
  EXPECT_GT(differing, 100);
}

TEST(TrajectoryStore, ACapacityBelowOneTrajectoryIsRefused) {
  const auto tiny = TrajectoryStore::create({.shape = small_shape(), .capacity_bytes = 1000});
  ASSERT_FALSE(tiny);
  EXPECT_EQ(tiny.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(tiny.error().message, HasSubstr("--replay_gb"));
  const auto few = TrajectoryStore::create(
      {.shape = small_shape(), .capacity_bytes = 100'000, .capacity_transitions = 15});
  ASSERT_FALSE(few);
  EXPECT_THAT(few.error().message, HasSubstr("15 agent transitions"));
}

TEST(TrajectoryStore, MoreMemoryOrDiskThanThereIsIsRefusedWithNumbersAndFlags) {
  const test::ScratchFolder folder;
  const int64_t absurd = int64_t{1} << 55;
  const auto ram = TrajectoryStore::create({.shape = small_shape(), .capacity_bytes = absurd});
  ASSERT_FALSE(ram);
  EXPECT_EQ(ram.error().code, ErrorCode::kNoSpace);
  EXPECT_THAT(ram.error().message, HasSubstr("36028797.0 GB"));
  EXPECT_THAT(ram.error().message, HasSubstr("lower --replay_gb, or put it on a disk with --replay_file"));
  const auto disk =
      TrajectoryStore::create({.shape = small_shape(), .capacity_bytes = absurd, .file = folder / "ring"});
  ASSERT_FALSE(disk);
  EXPECT_EQ(disk.error().code, ErrorCode::kNoSpace);
  EXPECT_THAT(disk.error().message, HasSubstr("lower --replay_gb, or name another disk with --replay_file"));
  EXPECT_FALSE(std::filesystem::exists(folder / "ring")) << "nothing is left behind";
}

TEST(TrajectoryStore, AFileThatCannotBeMadeIsNamed) {
  const test::ScratchFolder folder;
  const auto create = [&](const std::string& path) {
    const auto store =
        TrajectoryStore::create({.shape = small_shape(), .capacity_bytes = 100'000, .file = path});
    return store ? Error{ErrorCode::kSystem, "it was made"} : store.error();
  };
  EXPECT_EQ(create(folder / "no/such/ring").code, ErrorCode::kNotFound);
  EXPECT_THAT(create(folder / "no/such/ring").message, HasSubstr("folder does not exist"));
  std::ofstream(folder / "precious") << "thesis";
  const Error taken = create(folder / "precious");
  EXPECT_EQ(taken.code, ErrorCode::kBadInput);
  EXPECT_THAT(taken.message, HasSubstr("precious"));
  std::string kept;
  std::ifstream(folder / "precious") >> kept;
  EXPECT_EQ(kept, "thesis") << "what was there stays as it is";
  EXPECT_EQ(create(folder / "").code, ErrorCode::kBadInput) << "a folder";
}

TEST(TrajectoryStore, AFileVanishesWithItsStore) {
  const test::ScratchFolder folder;
  auto store =
      TrajectoryStore::create({.shape = small_shape(), .capacity_bytes = 100'000, .file = folder / "ring"});
  ASSERT_TRUE(store);
  EXPECT_GE(store->descriptor(), 0);
  EXPECT_FALSE(std::filesystem::exists(folder / "ring"))
      << "the name goes at once, so that no crash leaves it";
}

/// The picture shapes of the benchmark: 3 x 72 x 128, T = 32, N = 2.
TrajectoryShape benchmark_shape() {
  TrajectoryShape shape;
  shape.env.num_agents = 2;
  shape.env.head_count = 5;
  shape.env.head_sizes = {3, 3, 3, 2, 3};
  shape.env.measurement_count = 8;
  return shape;
}

struct Capacity {
  bool with_state;
  int64_t sequences;
  int64_t transitions;
};

class GigabyteTest : public ::testing::TestWithParam<Capacity> {};

TEST_P(GigabyteTest, HoldsWhatItMust) {
  if (shm::free_memory_bytes() < int64_t{1'300'000'000})
    GTEST_SKIP() << "needs 1.3 GB of free memory, there is less";
  const TrajectoryShape shape = benchmark_shape();
  auto store = TrajectoryStore::create(
      {.shape = shape, .capacity_bytes = 1'000'000'000, .keep_recurrent_state = GetParam().with_state});
  ASSERT_TRUE(store) << store.error().message;
  const int64_t promised = store->capacity_transitions();
  const SlabPool pool(shape, 1);
  int64_t most = 0;
  for (int i = 0; i < 700; ++i) {  // well past the first round
    std::ranges::fill(pool.view(0).frame(0, 0), static_cast<uint8_t>(i));
    ASSERT_EQ(store->append(pool.view(0), 32), i);
    most = std::max(most, store->item_count());
  }
  EXPECT_GE(store->item_count(), GetParam().sequences);
  EXPECT_GE(store->transition_count(), GetParam().transitions);
  EXPECT_EQ(store->transition_count(), promised) << "what was printed at the start is what fits";
  EXPECT_EQ(store->item_count(), most);
  EXPECT_LE(store->used_bytes(), 1'000'000'000);
  for (ItemId id = store->oldest(); id < store->end(); ++id) {
    std::vector<uint8_t> frame(27648);
    store->item(id).copy_frame(0, 0, frame.data());
    ASSERT_TRUE(std::ranges::all_of(frame, [&](uint8_t x) { return x == static_cast<uint8_t>(id); })) << id;
  }
}

INSTANTIATE_TEST_SUITE_P(Units, GigabyteTest,
                         ::testing::Values(Capacity{true, 540, 34'560}, Capacity{false, 547, 35'000}),
                         [](const auto& one) {
                           return one.param.with_state ? "SequencesOfGru512" : "SingleTransitions";
                         });

}  // namespace trajectory_store_test
}  // namespace comrad::replay
