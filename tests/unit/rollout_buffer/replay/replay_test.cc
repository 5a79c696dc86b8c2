#include "rollout_buffer/replay/replay.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>

#include "tests/unit/rollout_buffer/replay/replay_slabs.h"

namespace comrad::replay {
namespace replay_test {

using test::SlabPool;
using ::testing::HasSubstr;

std::unique_ptr<Replay> make(Unit unit, bool prioritized, const StoreOptions& store) {
  auto replay = Replay::create({.store = store, .unit = unit, .prioritized = prioritized});
  EXPECT_TRUE(replay.has_value()) << replay.error().message;
  return std::move(*replay);
}

std::unique_ptr<Replay> make(Unit unit, bool prioritized = false, int64_t capacity_bytes = 100'000) {
  return make(unit, prioritized, {.shape = small_shape(), .capacity_bytes = capacity_bytes});
}

int64_t insert(Replay& replay, uint64_t number, uint32_t length = 8) {
  const SlabPool pool(small_shape(), 1);
  fill_slab(pool, small_shape(), number);
  return replay.insert(pool.view(0), length);
}

/// Units of the slab `number`, by the rule and not by the code.
std::set<std::tuple<ItemId, int, int>> expected_units(Unit unit, uint64_t number, int length) {
  const SlabPool pool(small_shape(), 1);
  fill_slab(pool, small_shape(), number);
  const SlabView slab = pool.view(0);
  std::set<std::tuple<ItemId, int, int>> units;
  const auto item = static_cast<ItemId>(number);
  for (int step = 0; step < length; ++step) {
    if (slab.valid(step) == 0) continue;
    if (unit == Unit::kSequence) units.insert({item, -1, -1});
    if (unit == Unit::kJointStep) units.insert({item, step, -1});
    for (int agent = 0; agent < 2 && unit == Unit::kAgentStep; ++agent)
      if (slab.agent_active(step, agent) != 0) units.insert({item, step, agent});
  }
  return units;
}

class EveryUnit : public ::testing::TestWithParam<std::tuple<Unit, bool>> {};

TEST_P(EveryUnit, DrawsEveryValidUnitThatIsThereAndNoOther) {
  const Unit unit = std::get<0>(GetParam());
  const auto replay = make(unit, std::get<1>(GetParam()), 20'000);
  Rng rng(uint64_t{4});
  EXPECT_TRUE(replay->draw(3, 1, rng).empty()) << "nothing there yet";
  for (uint64_t number = 0; number < 20; ++number)
    ASSERT_EQ(insert(*replay, number, 1 + number % 8), 2 * (1 + number % 8));
  std::set<std::tuple<ItemId, int, int>> expected, drawn;
  replay->read([&](const TrajectoryStore& store) {
    ASSERT_GT(store.oldest(), 5) << "some were evicted";
    for (ItemId id = store.oldest(); id < store.end(); ++id)
      expected.merge(expected_units(unit, static_cast<uint64_t>(id), store.item(id).length()));
  });
  EXPECT_EQ(replay->unit_count(), static_cast<int64_t>(expected.size()));
  for (const Draw& draw : replay->draw(200 * static_cast<int64_t>(expected.size()), 1, rng)) {
    drawn.insert({draw.item, draw.step, draw.agent});
    ASSERT_EQ(draw.weight, 1);
  }
  EXPECT_EQ(drawn, expected);
}

INSTANTIATE_TEST_SUITE_P(Units, EveryUnit,
                         ::testing::Combine(::testing::Values(Unit::kSequence, Unit::kJointStep,
                                                              Unit::kAgentStep),
                                            ::testing::Bool()));

// Spec 6.7. One degree of freedom less than there are units; bound at p = 0.001 by Wilson and Hilferty.
TEST(Replay, UniformDrawsPassAChiSquareTestAfterTheRingWentRound) {
  const auto replay = make(Unit::kAgentStep, false, 20'000);
  for (uint64_t number = 0; number < 50; ++number) insert(*replay, number);
  Rng rng(uint64_t{77});
  std::map<int64_t, int> counts;
  constexpr int kDraws = 200'000;
  for (const Draw& draw : replay->draw(kDraws, 1, rng)) ++counts[draw.serial];
  const auto units = static_cast<double>(replay->unit_count());
  ASSERT_EQ(static_cast<double>(counts.size()), units);
  double chi_square = 0;
  for (const auto& [serial, count] : counts)
    chi_square += (count - kDraws / units) * (count - kDraws / units) / (kDraws / units);
  const double freedom = units - 1, spread = 2 / (9 * freedom);
  EXPECT_LT(chi_square, freedom * std::pow(1 - spread + 3.09 * std::sqrt(spread), 3));
}

TEST(Replay, AJointStepHasTheAgentsOfOneWorldAndMoment) {
  TrajectoryShape shape = small_shape();
  shape.env.num_agents = 3;
  const auto replay = make(Unit::kJointStep, false, {.shape = shape, .capacity_bytes = 200'000});
  // Every frame contains its origin; worlds come in mixed order.
  const SlabPool pool(shape, 1);
  const std::vector<int> worlds = {4, 1, 3, 0, 2, 5, 3, 1};
  for (const int world : worlds) {
    for (int row = 0; row <= shape.rollout_steps; ++row)
      for (int agent = 0; agent < 3; ++agent) {
        std::ranges::fill(pool.view(0).frame(row, agent), static_cast<uint8_t>(40 * world + row));
        pool.view(0).measurement(row, agent)[0] = static_cast<float>(100 * world + 10 * row + agent);
      }
    ASSERT_EQ(replay->insert(pool.view(0), 8), 24);
  }
  Rng rng(uint64_t{6});
  const std::vector<Draw> draws = replay->draw(500, 1, rng);
  std::size_t read = 0;
  replay->read_each(draws, [&](std::size_t index, const StoredTrajectory* item) {
    ASSERT_NE(item, nullptr);
    const Draw& draw = draws[index];
    EXPECT_EQ(draw.agent, -1);
    const int world = worlds[static_cast<std::size_t>(draw.item)];
    for (const int step : {draw.step, draw.step + 1}) {
      EXPECT_THAT(frames_of(*item, shape, step), ::testing::Each(static_cast<uint8_t>(40 * world + step)));
      for (int agent = 0; agent < 3; ++agent)
        EXPECT_EQ(item->measurement(step)[static_cast<std::size_t>(3 * agent)],
                  static_cast<float>(100 * world + 10 * step + agent));
    }
    ++read;
  });
  EXPECT_EQ(read, 500u);
}

TEST(Replay, OnlySequencesKeepTheRecurrentState) {
  for (const Unit unit : {Unit::kSequence, Unit::kJointStep, Unit::kAgentStep}) {
    const auto replay = make(unit);
    insert(*replay, 1);
    replay->read([&](const TrajectoryStore& store) {
      EXPECT_EQ(store.item(0).recurrent_state(1).size(), unit == Unit::kSequence ? 5u : 0u);
    });
  }
}

TEST(Replay, PrioritiesDecideWhatIsDrawnAndHowItIsWeighed) {
  const auto replay = make(Unit::kSequence, true);
  std::vector<int64_t> numbers;
  for (uint64_t number = 0; number < 4; ++number) insert(*replay, number);
  ASSERT_EQ(replay->unit_count(), 4);
  replay->set_priorities(std::vector<int64_t>{0, 1, 2, 3}, std::vector<float>{0.5f, 1, 2, 0.1f});
  const std::vector<double> probabilities = {0.192536, 0.291829, 0.442330, 0.073305};
  const std::vector<double> weights = {0.679592, 0.575441, 0.487252, 1};
  std::vector<int> counts(4);
  Rng rng(uint64_t{5});
  for (int round = 0; round < 2000; ++round)
    for (const Draw& draw : replay->draw(100, 0.4, rng)) {
      ASSERT_EQ(draw.serial, draw.item);
      ASSERT_NEAR(draw.weight, weights[static_cast<std::size_t>(draw.item)], 1e-6);
      ++counts[static_cast<std::size_t>(draw.item)];
    }
  for (std::size_t i = 0; i < 4; ++i) EXPECT_NEAR(counts[i] / 2e5, probabilities[i], 0.01 * probabilities[i]);
}

TEST(Replay, ADrawnItemThatLeftBeforeItWasReadIsNoticed) {
  const auto replay = make(Unit::kJointStep, true, 20'000);
  for (uint64_t number = 0; number < 10; ++number) insert(*replay, number);
  Rng rng(uint64_t{5});
  const std::vector<Draw> draws = replay->draw(20, 1, rng);
  for (uint64_t number = 10; number < 13; ++number) insert(*replay, number);
  ItemId oldest = 0;
  replay->read([&](const TrajectoryStore& store) { oldest = store.oldest(); });
  int gone = 0;
  replay->prefetch(draws);
  replay->read_each(draws, [&](std::size_t index, const StoredTrajectory* item) {
    EXPECT_EQ(item == nullptr, draws[index].item < oldest);
    gone += item == nullptr;
  });
  EXPECT_GT(gone, 0);
  EXPECT_LT(gone, 20);
  std::vector<int64_t> serials;
  for (const Draw& draw : draws) serials.push_back(draw.serial);
  replay->set_priorities(serials, std::vector<float>(20, 1e6f));  // of units that are no more, too
  for (const Draw& draw : replay->draw(200, 1, rng)) EXPECT_GE(draw.item, oldest);
}

TEST(Replay, ASlabWithoutAValidStepIsKeptButNeverDrawn) {
  const SlabPool pool(small_shape(), 1);
  for (int step = 0; step < 8; ++step) pool.view(0).valid(step) = 0;
  const auto replay = make(Unit::kSequence);
  EXPECT_EQ(replay->insert(pool.view(0), 8), 16);
  EXPECT_EQ(replay->unit_count(), 0);
  EXPECT_EQ(replay->transition_count(), 16);
  EXPECT_EQ(replay->insert(pool.view(0), 0), 0);
  EXPECT_EQ(replay->item_count(), 1);
}

TEST(Replay, ExponentsOutsideTheirRangeAreRefused) {
  const StoreOptions store{.shape = small_shape(), .capacity_bytes = 100'000};
  for (const double bad : {-0.1, 1.1, 0.0 / 0.0}) {
    EXPECT_FALSE(Replay::create({.store = store, .omega = bad}));
  }
}

class ReplaySnapshot : public ::testing::TestWithParam<std::tuple<Unit, bool, Backing>> {
 protected:
  std::unique_ptr<Replay> make_one(const std::string& file) {
    const auto& [unit, prioritized, backing] = GetParam();
    return make(unit, prioritized,
                {.shape = small_shape(),
                 .capacity_bytes = 20'000,
                 .file = backing.mapped ? folder_ / file : "",
                 .compress = backing.compressed});
  }
  test::ScratchFolder folder_;
};

TEST_P(ReplaySnapshot, ARestoredReplayDrawsOnAsTheSavedOneWouldHave) {
  const auto saved = make_one("a"), loaded = make_one("b");
  Rng rng(uint64_t{9});
  const auto work = [&](Replay& replay, Rng& chance, uint64_t number) {
    insert(replay, number, 1 + number % 8);
    std::vector<int64_t> serials;
    std::vector<float> errors;
    std::vector<std::tuple<ItemId, int, int, double, int64_t>> seen;
    for (const Draw& draw : replay.draw(16, 0.5, chance)) {
      serials.push_back(draw.serial);
      errors.push_back(static_cast<float>(chance.uniform()));
      seen.push_back({draw.item, draw.step, draw.agent, draw.weight, draw.serial});
    }
    replay.set_priorities(serials, errors);
    return seen;
  };
  for (uint64_t number = 0; number < 33; ++number) work(*saved, rng, number);
  ASSERT_TRUE(saved->save(folder_ / "replay").has_value());
  insert(*loaded, 500);
  const Status status = loaded->load(folder_ / "replay");
  ASSERT_TRUE(status.has_value()) << status.error().message;
  EXPECT_EQ(loaded->unit_count(), saved->unit_count());
  Rng same = Rng::restore(rng.state());
  for (uint64_t number = 33; number < 80; ++number)
    ASSERT_EQ(work(*saved, rng, number), work(*loaded, same, number)) << "at " << number;
}

INSTANTIATE_TEST_SUITE_P(All, ReplaySnapshot,
                         ::testing::Combine(::testing::Values(Unit::kSequence, Unit::kAgentStep),
                                            ::testing::Bool(), ::testing::ValuesIn(backings())),
                         [](const auto& one) {
                           return std::string(std::get<0>(one.param) == Unit::kSequence ? "Sequence"
                                                                                        : "AgentStep") +
                                  (std::get<1>(one.param) ? "Prioritized" : "Uniform") +
                                  std::get<2>(one.param).name;
                         });

TEST(ReplaySnapshot, OfAnotherKindOfUnitKeepsContentAndForgetsPriorities) {
  const test::ScratchFolder folder;
  const auto saved = make(Unit::kJointStep, true), loaded = make(Unit::kAgentStep, true);
  insert(*saved, 1);
  insert(*saved, 2);
  saved->set_priorities(std::vector<int64_t>{0}, std::vector<float>{100});
  ASSERT_TRUE(saved->save(folder / "replay").has_value());
  ASSERT_TRUE(loaded->load(folder / "replay").has_value());
  EXPECT_EQ(loaded->transition_count(), 32);
  Rng rng(uint64_t{3});
  for (const Draw& draw : loaded->draw(50, 1, rng)) EXPECT_EQ(draw.weight, 1);
}

TEST(ReplaySnapshot, DamagedPrioritiesLeaveAnEmptyReplayThatWorks) {
  const test::ScratchFolder folder;
  const auto saved = make(Unit::kAgentStep, true), loaded = make(Unit::kAgentStep, true);
  for (uint64_t number = 0; number < 5; ++number) insert(*saved, number);
  ASSERT_TRUE(saved->save(folder / "replay").has_value());
  auto reader = SnapshotReader::open(folder / "replay");
  std::vector<std::pair<SectionHeader, std::vector<std::byte>>> sections;
  for (std::vector<std::byte> bytes;;) {
    const auto header = reader->next(bytes);
    ASSERT_TRUE(header);
    if (header->tag == static_cast<uint32_t>(SectionTag::kEnd)) break;
    sections.emplace_back(*header, bytes);
  }
  ASSERT_EQ(sections.back().first.tag, static_cast<uint32_t>(SectionTag::kSampler));
  const auto load_with = [&](auto&& change) {
    auto changed = sections;
    change(changed.back().second);
    auto writer = SnapshotWriter::create(folder / "made", 0);
    for (const auto& [header, bytes] : changed) EXPECT_TRUE(writer->write(header, bytes).has_value());
    EXPECT_TRUE(writer->finish().has_value());
    return loaded->load(folder / "made");
  };
  ASSERT_TRUE(load_with([](auto&) {}).has_value());
  const auto set = [](std::size_t word, auto value) {
    return [=](std::vector<std::byte>& bytes) { std::memcpy(bytes.data() + 8 * word, &value, 8); };
  };
  // Claims to be uniform (no priorities), and requires a tree that no memory holds.
  const auto endless = [&](std::vector<std::byte>& bytes) {
    bytes.resize(8 * 6);
    set(1, INT64_MAX / 64)(bytes), set(3, INT64_MAX / 64)(bytes), set(4, int64_t{0})(bytes);
  };
  EXPECT_EQ(loaded->item_count(), 5);
  for (const auto& status :
       {load_with(set(6, -1.0)), load_with(set(7, 0.0 / 0.0)), load_with(set(5, 0.0)),
        load_with(set(5, 1.0 / 0.0)), load_with(set(4, int64_t{1} << 60)),
        load_with(set(3, int64_t{1} << 60)), load_with(set(3, int64_t{-1})), load_with(set(2, INT64_MAX)),
        load_with(set(1, int64_t{-5})), load_with(set(1, INT64_MAX)), load_with(endless),
        load_with([](auto& bytes) { bytes.resize(20); }), load_with([](auto& bytes) { bytes.clear(); })}) {
    ASSERT_FALSE(status.has_value());
    EXPECT_THAT(status.error().message, HasSubstr("priorities do not fit"));
    EXPECT_EQ(loaded->item_count(), 0);
    EXPECT_EQ(loaded->unit_count(), 0);
  }
  insert(*loaded, 9);
  Rng rng(uint64_t{3});
  EXPECT_EQ(loaded->draw(4, 1, rng).size(), 4u);
}

}  // namespace replay_test
}  // namespace comrad::replay
