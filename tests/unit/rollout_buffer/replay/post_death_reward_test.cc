#include "rollout_buffer/replay/post_death_reward.h"

#include <gtest/gtest.h>

#include <cmath>

#include "tests/unit/rollout_buffer/replay/replay_slabs.h"

namespace comrad::replay {
namespace post_death_reward_test {

using test::SlabPool;

constexpr int kAgents = 2;
constexpr PostDeathReward kPay{.gamma = 0.9, .reward_clip = 0.7};

/// What happened in one environment, row after row: agents die, come back, are paid; episodes end.
struct History {
  struct Row {
    float reward[kAgents] = {};
    bool active[kAgents] = {true, true};
    bool terminated = false, truncated = false, valid = true;
    bool is_over() const { return terminated || truncated; }
  };
  std::vector<Row> rows;
  std::vector<int> lengths;  ///< of the slabs it is cut into

  static History random(uint64_t seed, int slabs, int rollout) {
    History history;
    Rng rng(seed);
    for (int slab = 0; slab < slabs; ++slab) {
      history.lengths.push_back(rng.below(4) == 0 ? 1 + static_cast<int>(rng.below(3)) : rollout);
      for (int i = 0; i < history.lengths.back(); ++i) {
        Row row;
        const bool fresh = history.rows.empty() || history.rows.back().is_over();
        for (int agent = 0; agent < kAgents; ++agent) {
          row.reward[agent] = static_cast<float>(rng.uniform() * 2 - 1);
          const bool was = fresh || history.rows.back().active[agent];
          // Long times out of the game, so that some of them span whole slabs.
          row.active[agent] = fresh || (was ? rng.below(5) != 0 : rng.below(12) == 0);
        }
        row.terminated = rng.below(18) == 0;
        row.truncated = !row.terminated && rng.below(25) == 0;
        row.valid = rng.below(20) != 0;
        history.rows.push_back(row);
      }
    }
    history.rows.emplace_back();  // the row behind the last slab
    return history;
  }

  int begin_of(int slab) const {
    int begin = 0;
    for (int i = 0; i < slab; ++i) begin += lengths[static_cast<std::size_t>(i)];
    return begin;
  }
  uint64_t episode_of(int row) const {
    uint64_t episode = 3;
    for (int i = 0; i < row; ++i) episode += rows[static_cast<std::size_t>(i)].is_over();
    return episode;
  }
  void write(const SlabView& slab, int index) const {
    const int begin = begin_of(index), length = lengths[static_cast<std::size_t>(index)];
    int finals = 0;
    for (int t = 0; t <= length; ++t) {
      const Row& row = rows[static_cast<std::size_t>(begin + t)];
      for (int agent = 0; agent < kAgents; ++agent) slab.agent_active(t, agent) = row.active[agent];
      if (t == length) return;
      for (int agent = 0; agent < kAgents; ++agent) slab.reward(t, agent) = row.reward[agent];
      slab.terminated(t) = row.terminated;
      slab.truncated(t) = row.truncated;
      slab.final_index(t) = row.truncated ? finals++ : -1;
      slab.valid(t) = row.valid;
    }
  }

  /// The rule, straight over the rows of the environment that are known so far.
  double paid(int row, int agent, int known_rows) const {
    double sum = 0, discount = 1;
    for (int i = row; i < known_rows; ++i) {
      const Row& now = rows[static_cast<std::size_t>(i)];
      if (i > row && (now.active[agent] || !now.valid)) break;
      sum += discount * std::clamp(double{now.reward[agent]}, -0.7, 0.7);
      discount *= 0.9;
      if (now.is_over()) break;
    }
    return sum;
  }
};

TrajectoryShape shape_of() {
  TrajectoryShape shape = small_shape();
  shape.final_capacity = shape.rollout_steps;
  return shape;
}

StoreOptions options_of(const Backing& backing, const std::string& file) {
  return {.shape = shape_of(),
          .capacity_bytes = 400'000,
          .file = backing.mapped ? file : "",
          .compress = backing.compressed,
          .post_death_reward = kPay};
}

class PostDeathRewardOn : public ::testing::TestWithParam<Backing> {};

TEST_P(PostDeathRewardOn, NothingPaidLaterIsLostOverSlabsEnvironmentsAndSnapshots) {
  const test::ScratchFolder folder;
  constexpr int kEnvs = 3, kSlabs = 12;
  auto store = *TrajectoryStore::create(options_of(GetParam(), folder / "ring"));
  const SlabPool pool(shape_of(), 1);
  std::vector<History> histories;
  for (uint64_t env = 0; env < kEnvs; ++env) histories.push_back(History::random(70 + env, kSlabs, 8));
  std::vector<std::pair<int, int>> places;  // environment and slab of every item
  for (int slab = 0; slab < kSlabs; ++slab)
    for (int env = 0; env < kEnvs; ++env) {
      const History& history = histories[static_cast<std::size_t>(env)];
      pool.fill_with_noise(static_cast<uint64_t>(env * 100 + slab));
      history.write(pool.view(0), slab);
      ASSERT_NE(
          store.append(pool.view(0), static_cast<uint32_t>(history.lengths[static_cast<std::size_t>(slab)]),
                       {.env_index = env,
                        .rollout_index = 40 + static_cast<uint64_t>(slab),
                        .first_episode_id = history.episode_of(history.begin_of(slab))}),
          kNoItem);
      places.emplace_back(env, slab);
      if (slab == 5 && env == 1) {  // half way, with deaths open
        ASSERT_TRUE(store.save(folder / "snapshot"));
        store = *TrajectoryStore::create(options_of(GetParam(), folder / "ring2"));
        const Status loaded = store.load(folder / "snapshot");
        ASSERT_TRUE(loaded) << loaded.error().message;
      }
    }

  int last_decisions = 0, later_items = 0;
  for (ItemId id = 0; id < store.end(); ++id) {
    const auto [env, slab] = places[static_cast<std::size_t>(id)];
    const History& history = histories[static_cast<std::size_t>(env)];
    const int begin = history.begin_of(slab);
    for (int step = 0; step < store.item(id).length(); ++step)
      for (int agent = 0; agent < kAgents; ++agent) {
        const History::Row& row = history.rows[static_cast<std::size_t>(begin + step)];
        if (!row.active[agent]) continue;
        const History::Row& next = history.rows[static_cast<std::size_t>(begin + step + 1)];
        const bool is_last = !row.is_over() && !next.active[agent];
        ASSERT_EQ(is_last_decision(store.item(id), step, agent), is_last);
        const double expected =
            is_last ? history.paid(begin + step, agent, static_cast<int>(history.rows.size()) - 1)
                    : std::clamp(double{row.reward[agent]}, -0.7, 0.7);
        ASSERT_NEAR(paid_decision(store.item(id), step, agent, kPay).reward, expected, 1e-5)
            << "environment " << env << ", row " << begin + step << ", agent " << agent;
        last_decisions += is_last;
        later_items += is_last && store.item(id).post_death_reward(agent) != 0;
      }
  }
  EXPECT_GT(last_decisions, 20);
  EXPECT_GT(later_items, 5) << "deaths that are paid for in a later slab";
}

INSTANTIATE_TEST_SUITE_P(Every, PostDeathRewardOn, ::testing::ValuesIn(backings()), backing_name);

/// A death at the end of the first of two slabs, and a penalty of -0.5 in the second row of the next.
double paid_across(const SlabOrigin& second, bool known = true) {
  auto store = *TrajectoryStore::create(
      {.shape = shape_of(), .capacity_bytes = 100'000, .post_death_reward = PostDeathReward{.gamma = 0.5}});
  const SlabPool pool(shape_of(), 2);
  pool.view(0).agent_active(8, 1) = 0;
  for (int t = 0; t <= 8; ++t) pool.view(1).agent_active(t, 1) = 0;
  pool.view(1).reward(1, 1) = -0.5f;
  store.append(pool.view(0), 8,
               known ? SlabOrigin{.env_index = 2, .rollout_index = 7, .first_episode_id = 9} : SlabOrigin{});
  store.append(pool.view(1), 8, second);
  return paid_decision(store.item(0), 7, 1, {.gamma = 0.5}).reward;
}

TEST(PostDeathReward, OnlyTheNextSlabOfTheSameWorldPays) {
  EXPECT_DOUBLE_EQ(paid_across({.env_index = 2, .rollout_index = 8, .first_episode_id = 9}), 0.25 * -0.5);
  EXPECT_EQ(paid_across({.env_index = 3, .rollout_index = 8, .first_episode_id = 9}), 0);
  EXPECT_EQ(paid_across({.env_index = 2, .rollout_index = 9, .first_episode_id = 9}), 0)
      << "a slab is missing";
  EXPECT_EQ(paid_across({.env_index = 2, .rollout_index = 8, .first_episode_id = 10}), 0) << "a new world";
  EXPECT_EQ(paid_across({.env_index = 2, .rollout_index = 8, .first_episode_id = 9}, false), 0);
}

TEST(PostDeathReward, ALedgerFromADamagedSnapshotIsRefused) {
  PostDeathLedger ledger;
  EXPECT_TRUE(ledger.restore({}, 2));
  EXPECT_FALSE(ledger.restore(std::vector<std::byte>(17), 2));
  std::vector<std::byte> bytes(24 + kMaxAgents * 16, std::byte{0xFF});
  EXPECT_FALSE(ledger.restore(bytes, 2)) << "an environment below 0, discounts that are no numbers";
  std::fill_n(bytes.begin(), 24, std::byte{0});
  std::fill(bytes.begin() + 24 + kMaxAgents * 8, bytes.end(), std::byte{0});
  EXPECT_TRUE(ledger.restore(bytes, 2));
  std::fill_n(bytes.begin() + 24 + 2 * 8, 8, std::byte{0});  // a debt to an agent that does not exist
  EXPECT_FALSE(ledger.restore(bytes, 2));
  EXPECT_TRUE(ledger.bytes().empty());
}

}  // namespace post_death_reward_test
}  // namespace comrad::replay
