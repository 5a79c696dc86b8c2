#include "deploy/evaluation/team.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace team_test {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Words = std::vector<std::string>;

/// The message of what check_teams(), or make_teams() of two agents, refuses; empty where they take it.
std::string refusal(const EvaluationRequest& request) {
  if (const Status checked = check_teams(request); !checked) return checked.error().message;
  const auto teams = make_teams(request, 2);
  return teams ? "" : teams.error().message;
}

TEST(Teams, EveryPolicyPlaysAllSeatsOrThoseThatAreNotNamed) {
  const auto whole = make_teams({.policies = {"A", "random"}}, 3);
  ASSERT_TRUE(whole);
  ASSERT_EQ(whole->size(), 2u);
  EXPECT_EQ((*whole)[0].name, "A");
  EXPECT_TRUE((*whole)[0].is_uniform());
  EXPECT_THAT((*whole)[1].players, ElementsAre("random", "random", "random"));

  const auto mixed = make_teams({.policies = {"A", "B"}, .seats = {"1=oracle"}}, 3);
  ASSERT_TRUE(mixed);
  ASSERT_EQ(mixed->size(), 2u);
  EXPECT_THAT((*mixed)[1].players, ElementsAre("B", "oracle", "B"));
  EXPECT_EQ((*mixed)[1].name, "0=B,1=oracle,2=B");
  EXPECT_FALSE((*mixed)[1].is_uniform());

  const auto named = make_teams({.seats = {"1=A", "0=A"}}, 2);
  ASSERT_TRUE(named);
  EXPECT_EQ((*named)[0].name, "A") << "one player has all seats";
}

TEST(Teams, OfACrossPlayAreTheMatrixRowByRow) {
  const auto teams = make_teams({.cross_play = {"A", "B"}}, 3);
  ASSERT_TRUE(teams);
  std::vector<Words> players;
  for (const Team& team : *teams) players.push_back(team.players);
  EXPECT_THAT(players, ElementsAre(Words{"A", "A", "A"}, Words{"A", "B", "B"}, Words{"B", "A", "A"},
                                   Words{"B", "B", "B"}));
}

TEST(Teams, AreRefusedByName) {
  for (const auto& [request, message] : std::vector<std::pair<EvaluationRequest, std::string>>{
           {{}, "--policy is missing"},
           {{.seats = {"0=A"}}, "seat 1 of 2 has no player; add --seat 1=PLAYER"},
           {{.seats = {"0=A", "0=B", "1=A"}}, "--seat=0=B: seat 0 was named before"},
           {{.seats = {"0=A", "2=B"}}, "--seat=2=B: the team has 2 agents, 0 to 1"},
           {{.seats = {"zero=A"}}, "--seat=zero=A: write AGENT=PLAYER"},
           {{.seats = {"-1=A"}}, "--seat=-1=A: write AGENT=PLAYER"},
           {{.seats = {"1="}}, "--seat=1=: write AGENT=PLAYER"},
           {{.seats = {"A"}}, "--seat=A: write AGENT=PLAYER"},
           {{.policies = {"C"}, .seats = {"0=A", "1=B"}}, "--policy has none to play"},
           {{.cross_play = {"A"}}, "at least two players meet"},
           {{.cross_play = {"A", "B", "A"}}, "a player is named twice"},
           {{.policies = {"C"}, .cross_play = {"A", "B"}}, "leave --policy and --seat out"},
           {{.policies = {"A", "B"}, .checkpoint = "x.pt"}, "--checkpoint is that of one --policy"},
           {{.cross_play = {"A", "B"}, .checkpoint = "x.pt"}, "--checkpoint is that of one --policy"}})
    EXPECT_THAT(refusal(request), HasSubstr(message));
  EXPECT_EQ(refusal({.policies = {"A"}, .seats = {"1=B"}, .checkpoint = "x.pt"}), "");
  const auto alone = make_teams({.cross_play = {"A", "B"}}, 1);
  ASSERT_FALSE(alone);
  EXPECT_THAT(alone.error().message, HasSubstr("one agent"));
}

TEST(Teams, PlayersAreFoundOnce) {
  EXPECT_THAT(player_names({.policies = {"B", "A"}, .seats = {"1=oracle", "2=A"}}),
              ElementsAre("B", "A", "oracle"));
}

}  // namespace team_test
}  // namespace comrad::deploy
