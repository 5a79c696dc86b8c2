#include "sim_workers/oracle/oracle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace oracle_test {

using testing::Contains;
using testing::HasSubstr;

std::shared_ptr<const DoomGame> game_of(const std::string& scenario, uint64_t layout_seed = 42,
                                        int num_agents = 2) {
  const auto layout = scenarios::generate_layout(scenario, {.seed = layout_seed, .num_agents = num_agents});
  if (!layout) return nullptr;
  const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, scenario);
  if (!wad) return nullptr;
  EnvironmentOptions options;
  options.scenario = scenario;
  options.num_agents = num_agents;
  const auto game = load_doom_game(options, *wad);
  return game ? *game : nullptr;
}

TEST(Oracle, IsFoundByTheScenariosName) {
  EXPECT_THAT(list_oracles(), Contains("coop_health_gathering"));
  const auto game = game_of("coop_health_gathering");
  ASSERT_NE(game, nullptr);
  EXPECT_TRUE(make_oracle(*game));
  DoomGame unknown = *game;
  unknown.spec.name = unknown.spec.maps_of = "unheard_of";
  const auto none = make_oracle(unknown);
  ASSERT_FALSE(none);
  EXPECT_EQ(none.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(none.error().message, HasSubstr("coop_health_gathering"));
}

TEST(Oracle, PlaysTheSameEpisodeFromTheSameSeed) {
  const auto game = game_of("coop_health_gathering");
  ASSERT_NE(game, nullptr);
  const auto first = play_oracle_episode(game, 7), again = play_oracle_episode(game, 7);
  ASSERT_TRUE(first && again);
  EXPECT_EQ(first->score, again->score);
  EXPECT_EQ(first->agent_return, again->agent_return);
}

TEST(Oracle, OutlivesRandomPlayByFarInCoopHealthGathering) {
  const auto game = game_of("coop_health_gathering");
  ASSERT_NE(game, nullptr);
  double sum = 0;
  for (uint64_t seed = 0; seed < 3; ++seed) {
    const auto summary = play_oracle_episode(game, seed);
    ASSERT_TRUE(summary);
    sum += summary->score;
  }
  EXPECT_GT(sum / 3, 4000) << "random play lasts 649 tics, the limit is 8400";
}

/// A team of a size that a scenario is for, and the share of the ceiling that its scripted one must get, on
/// average of some episodes where chance decides much.
struct Team {
  const char* scenario;
  int num_agents;
  double share;
  int episodes = 1;
};

class EveryTeam : public testing::TestWithParam<Team> {};

TEST_P(EveryTeam, PlaysTheDefaultMapAndStaysBelowItsCeiling) {
  const auto game = game_of(GetParam().scenario, 42, GetParam().num_agents);
  ASSERT_NE(game, nullptr);
  double share = 0;
  for (int episode = 0; episode < GetParam().episodes; ++episode) {
    const auto summary = play_oracle_episode(game, 1 + static_cast<uint64_t>(episode));
    ASSERT_TRUE(summary) << summary.error().message;
    EXPECT_EQ(summary->agent_count, static_cast<uint32_t>(GetParam().num_agents));
    ASSERT_GT(summary->ceiling, 0);
    EXPECT_LE(summary->score, summary->ceiling);
    share += summary->score / summary->ceiling / GetParam().episodes;
  }
  EXPECT_GE(share, GetParam().share);
}

INSTANTIATE_TEST_SUITE_P(
    Sizes, EveryTeam,
    testing::Values(Team{"foraging_commons", 3, 0.9}, Team{"foraging_commons", 4, 0.9},
                    Team{"stag_hunt_arena", 2, 0.6}, Team{"stag_hunt_arena", 4, 0.7},
                    Team{"smart_enemies", 2, 0.92, 2}, Team{"smart_enemies", 3, 0.9},
                    Team{"smart_enemies", 4, 0.8, 2}, Team{"dumb_enemies", 3, 0.95},
                    Team{"dumb_enemies", 4, 0.95}, Team{"armory_siege", 2, 0.1}, Team{"armory_siege", 8, 0.1},
                    Team{"coop_health_gathering", 3, 1.0}, Team{"coop_health_gathering", 4, 0.3, 5},
                    Team{"platform_chain", 2, 0.05}, Team{"lava_pit", 2, 1.0}, Team{"coop_puzzle", 2, 1.0},
                    Team{"lava_maze", 2, 1.0}, Team{"rhythm_sync", 2, 1.0}, Team{"stealth_labyrinth", 2, 1.0},
                    Team{"ammo_carrier", 2, 0.3}),
    [](const auto& one) {
      return std::string(one.param.scenario) + "_" + std::to_string(one.param.num_agents);
    });

class WithAPartner : public testing::TestWithParam<std::string> {};

/// A scripted team plans for all of its agents; here every one but one does something else.
TEST_P(WithAPartner, OneSeatIsPlayedWhateverTheOthersDo) {
  const auto game = game_of(GetParam());
  ASSERT_NE(game, nullptr);
  const std::size_t heads = static_cast<std::size_t>(game->actions.head_count());
  for (const bool does_nothing : {true, false}) {
    auto player = OraclePlayer::create(*game);
    ASSERT_TRUE(player) << player.error().message;
    DoomEnvironment environment(game);
    player->reset(environment, 5);
    const std::vector<int> seats = {does_nothing ? 0 : 1};
    Rng chance(9);
    std::vector<int32_t> action(2 * heads, 0);
    int decisions = 0;
    for (; !environment.last_step().episode_over() && decisions < 700; ++decisions) {
      for (int32_t& choice : action) choice = does_nothing ? 0 : static_cast<int32_t>(chance.below(3));
      player->step(environment, seats, action);
    }
    EXPECT_GT(decisions, 0);
  }
}

INSTANTIATE_TEST_SUITE_P(Scenarios, WithAPartner, testing::ValuesIn(list_oracles()),
                         [](const auto& one) { return one.param; });

TEST(Oracle, LeavesTheOtherSeatsToTheirOwnActions) {
  const auto game = game_of("coop_health_gathering");
  ASSERT_NE(game, nullptr);
  const std::vector<int32_t> still(2 * static_cast<std::size_t>(game->actions.head_count()), 0);
  auto player = OraclePlayer::create(*game);
  ASSERT_TRUE(player);
  DoomEnvironment environment(game);
  player->reset(environment, 3);
  const auto place = [&](int agent) {
    const Place here = place_of(environment.world().body(agent));
    return std::pair{here.x, here.y};
  };
  const auto first = place(0), second = place(1);
  const std::vector<int> seats = {1};
  for (int decision = 0; decision < 40; ++decision) player->step(environment, seats, still);
  EXPECT_EQ(place(0), first) << "its player presses nothing";
  EXPECT_NE(place(1), second);
}

TEST(ActionMapChoose, IsTheWayBackFromButtons) {
  const auto game = game_of("coop_health_gathering");
  ASSERT_NE(game, nullptr);
  for (int32_t move = 0; move < 3; ++move)
    for (int32_t strafe = 0; strafe < 3; ++strafe)
      for (int32_t turn = 0; turn < 3; ++turn) {
        const std::array<int32_t, 3> choice = {move, strafe, turn};
        std::array<int32_t, 3> back{};
        game->actions.choose(game->actions.buttons(choice), back);
        EXPECT_EQ(back, choice);
      }
  doom::Buttons foreign;
  foreign.attack = true;
  std::array<int32_t, 3> choice = {9, 9, 9};
  game->actions.choose(foreign, choice);
  EXPECT_THAT(choice, testing::Each(0));
}

}  // namespace oracle_test
}  // namespace comrad::sim
