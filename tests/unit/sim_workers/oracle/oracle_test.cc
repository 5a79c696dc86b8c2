#include "sim_workers/oracle/oracle.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scenarios/spec/registry.h"

namespace comrad::sim {
namespace {

using testing::Contains;
using testing::HasSubstr;

std::shared_ptr<const DoomGame> game_of(const std::string& scenario, uint64_t layout_seed = 42) {
  const auto layout = scenarios::generate_layout(scenario, {.seed = layout_seed});
  if (!layout) return nullptr;
  const auto wad = wad::WadFile::from_bytes({layout->wad.begin(), layout->wad.end()}, scenario);
  if (!wad) return nullptr;
  EnvironmentOptions options;
  options.scenario = scenario;
  const auto game = load_doom_game(options, *wad);
  return game ? *game : nullptr;
}

TEST(Oracle, IsFoundByTheScenariosName) {
  EXPECT_THAT(list_oracles(), Contains("coop_health_gathering"));
  const auto game = game_of("coop_health_gathering");
  ASSERT_NE(game, nullptr);
  EXPECT_TRUE(make_oracle(*game));
  DoomGame stranger = *game;
  stranger.spec.name = "unheard_of";
  const auto none = make_oracle(stranger);
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

}  // namespace
}  // namespace comrad::sim
