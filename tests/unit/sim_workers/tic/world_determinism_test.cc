// The same seed and the same buttons give the same world at every tic: alone, beside others, from a snapshot,
// in every build. And worlds cost little and do not grow.
#include <gtest/gtest.h>
#include <malloc.h>

#include <cstdlib>
#include <memory>
#include <vector>

#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace world_determinism_test {

constexpr int kTics = 10'000;

/// Fold of the hashes of all tics of run(1): the one number that gcc and clang, debug and release must agree
/// on. After a wanted change of play print it with COMRAD_SHOW_HASH=1 and put it here.
constexpr uint64_t kExpected = 0xBBB084FD6F70636D;

const std::shared_ptr<const ActorCatalog>& catalog() {
  static const auto kCatalog = std::make_shared<const ActorCatalog>();
  return kCatalog;
}

/// A hall with pillars, a ledge, a slime pool, a lift, a door, a teleporter, every kind of monster and
/// many items.
std::shared_ptr<const Level> battlefield() {
  test::LevelBuilder builder;
  const uint32_t hall = builder.sector(0, 256), ledge = builder.sector(20, 256),
                 pool = builder.sector(-16, 256), lift = builder.sector(64, 256, 7),
                 door = builder.sector(0, 0, 8), dark = builder.sector(0, 128);
  builder.sector_at(pool).special = 71;
  builder.sector_at(dark).special = 2;
  builder.room(hall, -1024, -1024, 1024, 1024);
  builder.pillar(hall, -300, -300, -236, -236)
      .pillar(hall, 236, 236, 300, 300)
      .pillar(hall, -60, 500, 60, 560);
  builder.island(ledge, hall, 500, -400, 700, -100).island(pool, hall, -700, 200, -400, 500);
  const auto with_special = [&](uint32_t first, int32_t special, std::array<int32_t, 5> args,
                                uint32_t flags) {
    for (uint32_t line = first; line < first + 4; ++line)
      builder.line(line).special = special, builder.line(line).args = args, builder.line(line).flags |= flags;
  };
  constexpr uint32_t kAgain = kLineRepeatable;
  builder.island(lift, hall, 100, -700, 260, -540);
  with_special(24, 62, {7, 32, 70, 0, 0}, kLinePlayerUseBack | kLineMonsterUse | kAgain);
  builder.island(door, hall, -800, -800, -640, -768);
  with_special(28, 12, {8, 32, 70, 0, 0}, kLinePlayerUseBack | kLineMonsterUse | kAgain);
  builder.island(dark, hall, 700, 600, 900, 800);
  with_special(32, 70, {9, 0, 0, 0, 0}, kLinePlayerCross | kLineMonsterCross | kAgain);
  builder.thing(14, -850, 850, 270, 9);
  builder.thing(1, 0, 0).thing(2, 100, 0, 180).thing(3, 0, 100, 90).thing(4, -100, 0);
  const int monsters[] = {3004, 9,    65, 3001, 3002, 58, 3006, 3005, 71,
                          69,   3003, 68, 67,   66,   64, 3004, 3001, 9};
  int place = 0;
  for (const int monster : monsters) {
    builder.thing(monster, -900 + 100 * place, place % 2 == 0 ? 900 : -900, 45 * place);
    ++place;
  }
  const int items[] = {2001, 82,   2002, 2003, 2004, 2007, 2008, 2010, 2047, 2048,
                       2049, 2046, 17,   2011, 2012, 2014, 2015, 2018, 2019, 2013,
                       2023, 2024, 2025, 8,    5,    13,   2035, 2035, 2035, 2022};
  place = 0;
  for (const int item : items) {
    builder.thing(item, -800 + 55 * place, place % 3 == 0 ? 350 : place % 3 == 1 ? -350 : 0);
    ++place;
  }
  return builder.build();
}

/// Buttons that are held for a while, from separate dice.
class RandomHands {
 public:
  RandomHands(uint64_t seed, int players)
      : rng_(RngKey(seed).split("hands")), held_(static_cast<std::size_t>(players)) {}
  const std::vector<Buttons>& next() {
    for (Buttons& hand : held_) {
      if (rng_.below(8) != 0) continue;
      hand = Buttons{};
      hand.forward = rng_.below(2) == 0, hand.backward = rng_.below(6) == 0;
      hand.left = rng_.below(5) == 0, hand.right = rng_.below(5) == 0;
      hand.turn_left = rng_.below(4) == 0, hand.turn_right = rng_.below(4) == 0;
      hand.speed = rng_.below(2) == 0, hand.attack = rng_.below(2) == 0;
      hand.use = rng_.below(4) == 0, hand.jump = rng_.below(8) == 0, hand.crouch = rng_.below(12) == 0;
      hand.yaw_delta = rng_.between(-500, 500);
      hand.select_weapon = static_cast<int8_t>(rng_.below(6) == 0 ? rng_.between(1, 7) : -1);
    }
    return held_;
  }

 private:
  Rng rng_;
  std::vector<Buttons> held_;
};

WorldOptions options_of(uint64_t seed) {
  return {.player_count = 4, .seed = seed, .skill = 4, .allow_crouch = true, .forced_respawn = true};
}

std::vector<uint64_t> run(uint64_t seed, int tics = kTics) {
  World world(battlefield(), catalog());
  reset_world(world, options_of(seed));
  RandomHands hands(seed, 4);
  std::vector<uint64_t> hashes;
  for (int tic = 0; tic < tics; ++tic) {
    run_tic(world, hands.next());
    hashes.push_back(world.hash());
  }
  return hashes;
}

const std::vector<uint64_t>& run_of_one() {
  static const std::vector<uint64_t> kRun = run(1);
  return kRun;
}

TEST(Determinism, TenThousandTicsGiveTheCommittedHashInEveryBuild) {
  uint64_t fold = kGoldenGamma;
  for (const uint64_t hash : run_of_one()) fold = mix64(fold ^ hash) + kGoldenGamma;
  if (std::getenv("COMRAD_SHOW_HASH") != nullptr)
    std::printf("kExpected = 0x%016llX\n", static_cast<unsigned long long>(fold));
  EXPECT_EQ(fold, kExpected);
}

TEST(Determinism, ABattleIsUnderWay) {
  // What the other cases compare is worth comparing.
  World world(battlefield(), catalog());
  reset_world(world, options_of(1));
  RandomHands hands(1, 4);
  for (int tic = 0; tic < kTics; ++tic) run_tic(world, hands.next());
  int deaths = 0, pickups = 0, dealt = 0;
  for (int player = 0; player < 4; ++player) {
    deaths += world.player(player).death_count, pickups += world.player(player).pickup_count;
    dealt += world.player(player).damage_dealt;
  }
  EXPECT_GT(deaths, 3);
  EXPECT_GT(pickups, 10);
  EXPECT_GT(dealt, 300);
  EXPECT_GT(world.state().kill_total, 3);
}

TEST(Determinism, SixteenWorldsInOneProcessDoNotDisturbEachOther) {
  const std::vector<uint64_t>& alone = run_of_one();
  const auto level = battlefield();
  std::vector<std::unique_ptr<World>> worlds;
  std::vector<RandomHands> hands;
  for (uint64_t i = 0; i < 16; ++i) {
    worlds.push_back(std::make_unique<World>(level, catalog()));
    const uint64_t seed = i % 4 == 0 ? 1 : i;
    reset_world(*worlds.back(), options_of(seed));
    hands.emplace_back(seed, 4);
  }
  constexpr int kTogether = 2'000;
  for (int tic = 0; tic < kTogether; ++tic) {
    for (std::size_t i = 0; i < worlds.size(); ++i) run_tic(*worlds[i], hands[i].next());
    for (std::size_t i = 0; i < worlds.size(); i += 4)
      ASSERT_EQ(worlds[i]->hash(), alone[static_cast<std::size_t>(tic)]) << "world " << i << " tic " << tic;
  }
  EXPECT_NE(worlds[2]->hash(), worlds[0]->hash());
}

TEST(Determinism, ASnapshotContinuesAsTheOriginalDid) {
  const std::vector<uint64_t>& straight = run_of_one();
  World world(battlefield(), catalog());
  reset_world(world, options_of(1));
  RandomHands hands(1, 4);
  for (int tic = 0; tic < 3'000; ++tic) run_tic(world, hands.next());
  World snapshot = world;
  const RandomHands snapshot_hands = hands;
  EXPECT_EQ(snapshot.hash(), world.hash());
  for (int tic = 3'000; tic < 4'000; ++tic) run_tic(world, hands.next());
  ASSERT_EQ(world.hash(), straight[3'999]);
  EXPECT_NE(snapshot.hash(), world.hash());
  for (int restore = 0; restore < 2; ++restore) {
    // Restored into a world that has been somewhere else.
    world = snapshot;
    hands = snapshot_hands;
    for (int tic = 3'000; tic < 4'000; ++tic) {
      run_tic(world, hands.next());
      ASSERT_EQ(world.hash(), straight[static_cast<std::size_t>(tic)]) << "tic " << tic;
    }
  }
}

TEST(Determinism, AResetForgetsThePast) {
  World world(battlefield(), catalog());
  reset_world(world, options_of(5));
  RandomHands hands(5, 4);
  for (int tic = 0; tic < 500; ++tic) run_tic(world, hands.next());
  reset_world(world, options_of(1));
  hands = RandomHands(1, 4);
  for (int tic = 0; tic < 500; ++tic) {
    run_tic(world, hands.next());
    ASSERT_EQ(world.hash(), run_of_one()[static_cast<std::size_t>(tic)]) << "tic " << tic;
  }
}

// ---------------------------------------------------------------- memory

std::size_t bytes_in_use() {
  const struct mallinfo2 info = mallinfo2();
  return info.uordblks + info.hblkhd;
}

TEST(Memory, AThousandEpisodesDoNotGrow) {
  World world(battlefield(), catalog());
  const auto play = [&](int episodes, uint64_t first_seed) {
    for (int episode = 0; episode < episodes; ++episode) {
      const uint64_t seed = first_seed + static_cast<uint64_t>(episode) % 50;
      reset_world(world, options_of(seed));
      RandomHands hands(seed, 4);
      for (int tic = 0; tic < 60; ++tic) run_tic(world, hands.next());
    }
  };
  play(100, 0);
  const std::size_t before = bytes_in_use();
  play(1'000, 0);
  const auto growth = static_cast<int64_t>(bytes_in_use()) - static_cast<int64_t>(before);
  EXPECT_LT(growth, 64 * 1024) << "the same episodes again and again";
}

TEST(Memory, AFurtherWorldOfALevelCostsLessThanFourMegabytes) {
  if (bytes_in_use() == 0) GTEST_SKIP() << "this allocator does not count";
  const auto level = battlefield();
  std::vector<std::unique_ptr<World>> worlds;
  const auto add = [&](uint64_t seed) {
    worlds.push_back(std::make_unique<World>(level, catalog()));
    reset_world(*worlds.back(), options_of(seed));
    RandomHands hands(seed, 4);
    for (int tic = 0; tic < 200; ++tic) run_tic(*worlds.back(), hands.next());
  };
  add(1);
  const std::size_t before = bytes_in_use();
  for (uint64_t i = 2; i <= 64; ++i) add(i);
  const std::size_t each = (bytes_in_use() - before) / 63;
  EXPECT_LT(each, std::size_t{4} << 20);
  EXPECT_GT(each, std::size_t{1000}) << "something must have been counted";
  RecordProperty("bytes_per_world", static_cast<int>(each));
}

}  // namespace world_determinism_test
}  // namespace comrad::doom
