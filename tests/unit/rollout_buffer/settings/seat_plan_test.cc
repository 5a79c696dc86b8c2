// What evaluations of several players read: seats, the game of a checkpoint, scores to compare with.

#include "rollout_buffer/settings/seat_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/reference_scores.h"
#include "rollout_buffer/settings/trained_game.h"

namespace comrad {
namespace seat_plan_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::IsEmpty;

TEST(SeatPlan, ReadsBackWhatItWrites) {
  SeatPlan plan;
  plan.networks = {{"/run/a \"b\".toml", "/run/1.pt"}, {"/run/b.toml", "/run/2.pt"}};
  plan.seats = {{SeatPlayer::kNetwork, 1}, {SeatPlayer::kOracle},     {SeatPlayer::kNetwork, 0},
                {SeatPlayer::kNoop},       {SeatPlayer::kNetwork, 1}, {SeatPlayer::kRandom}};
  const Expected<SeatPlan> read = parse_seat_plan(seat_plan_text(plan), "seats.toml");
  ASSERT_TRUE(read) << read.error().message;
  ASSERT_EQ(read->networks.size(), 2u);
  EXPECT_EQ(read->networks[0].settings, plan.networks[0].settings);
  EXPECT_EQ(read->networks[1].checkpoint, "/run/2.pt");
  ASSERT_EQ(read->seats.size(), 6u);
  EXPECT_THAT(read->seats_of_network(1), ElementsAre(0, 4));
  EXPECT_THAT(read->seats_of_network(0), ElementsAre(2));
  EXPECT_THAT(read->seats_of(SeatPlayer::kOracle), ElementsAre(1));
  EXPECT_THAT(read->seats_of(SeatPlayer::kNoop), ElementsAre(3));
  EXPECT_THAT(read->seats_of(SeatPlayer::kRandom), ElementsAre(5));
}

TEST(SeatPlan, RefusesWhatNoPlayerCanPlay) {
  for (const auto& [text, message] : std::vector<std::pair<std::string, std::string>>{
           {"", "lists no seats"},
           {"seat = 3", "lists no seats"},
           {"[[seat]]\nplayer = 'god'", "seat 0: there is no player 'god'"},
           {"[[seat]]\nwho = 'oracle'", "seat 0 needs the text 'player'"},
           {"[[seat]]\nplayer = 'network'\nnetwork = 0", "seat 0: it has no network of the 0 listed"},
           {"[[network]]\nsettings = 'a'\n[[seat]]\nplayer = 'noop'", "network 0 needs"},
           {"[[seat", "seats:1"}}) {
    const Expected<SeatPlan> plan = parse_seat_plan(text, "seats");
    ASSERT_FALSE(plan) << text;
    EXPECT_EQ(plan.error().code, ErrorCode::kBadFormat);
    EXPECT_THAT(plan.error().message, HasSubstr(message));
  }
}

TEST(TrainedGame, NamesWhatANetworkCannotPlay) {
  RunConfig trained;
  trained.environment.num_agents = 2;
  RunConfig played = trained;
  played.network.rnn_size = 7;
  played.run.algo = "qmix";
  played.environment.layout_seed = 9;
  EXPECT_THAT(game_difference(trained, played), IsEmpty()) << "each network is its own, and maps differ";
  played.environment.num_agents = 3;
  EXPECT_EQ(game_difference(trained, played), "num_agents is 2 there and 3 here");
  played = trained;
  played.environment.heads = "ATTACK";
  EXPECT_EQ(game_difference(trained, played), "heads is the scenario's own there and ATTACK here");
  played = trained;
  played.run.scenario = "lava_pit";
  EXPECT_EQ(game_difference(trained, played), "scenario is coop_health_gathering there and lava_pit here");
  played.run.scenario = "coop_health_gathering@reference";
  played.environment.scenario_version = 2;
  EXPECT_THAT(game_difference(trained, played), IsEmpty()) << "other rules, the same sights and actions";
}

TEST(TrainedGame, ReadsACheckpointsSettingsAndPassesOverUnknownOnes) {
  RunConfig config;
  config.run.scenario = "lava_pit";
  config.environment.num_agents = 4;
  const Expected<RunConfig> read =
      settings_of_checkpoint("a_setting_of_tomorrow = 3\n" + settings_to_toml(config), "x.pt");
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->run.scenario, "lava_pit");
  EXPECT_EQ(read->environment.num_agents, 4);
  const Expected<RunConfig> damaged = settings_of_checkpoint("scenario = [", "x.pt");
  ASSERT_FALSE(damaged);
  EXPECT_THAT(damaged.error().message, HasSubstr("x.pt:1"));
}

TEST(ReferenceScores, AreThoseOfTheScenarioAndItsTeam) {
  const std::string text =
      "[pit]\nnum_agents = 2\nrandom = 10\nscripted = 30\n[bad]\nnum_agents = 2\nrandom = 1\nscripted = 1";
  const auto found = find_reference_scores(text, "scores", "pit", 2);
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_TRUE(found->has_value());
  EXPECT_EQ((*found)->normalised(10), 0);
  EXPECT_EQ((*found)->normalised(20), 0.5);
  EXPECT_EQ((*found)->normalised(40), 1.5);
  for (const auto& [scenario, agents] : {std::pair{"pit", 3}, {"maze", 2}}) {
    const auto none = find_reference_scores(text, "scores", scenario, agents);
    ASSERT_TRUE(none);
    EXPECT_FALSE(none->has_value()) << scenario;
  }
  const auto level = find_reference_scores(text, "scores", "bad", 2);
  ASSERT_FALSE(level);
  EXPECT_THAT(level.error().message, HasSubstr("scores: bad needs"));
}

TEST(ReferenceScores, OfTheRepositoryAreFound) {
  const auto found = read_reference_scores("coop_puzzle", 2);
  ASSERT_TRUE(found) << found.error().message;
  ASSERT_TRUE(found->has_value());
  EXPECT_EQ((*found)->scripted, 5);
}

}  // namespace seat_plan_test
}  // namespace comrad
