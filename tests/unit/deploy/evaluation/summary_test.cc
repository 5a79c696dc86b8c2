#include "deploy/evaluation/summary.h"

#include <gtest/gtest.h>

#include <fstream>

#include "deploy/settings/content_hash.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace summary_test {

/// Two agents, the second played by a network; episodes in turn on two maps.
EvaluationGame made_game() {
  EvaluationGame game;
  game.merged.config.environment.num_agents = 2;
  game.layout = "pool p";
  game.pool.layouts = {{.id = "first", .path = "/1.wad"}, {.id = "second", .path = "/2.wad"}};
  game.map_hashes = {"xxh3:1", "xxh3:2"};
  const auto add = [&game](const std::string& name, SeatPlayer kind) {
    Player player;
    player.name = name;
    player.kind = kind;
    if (player.is_network())
      player.config_hash = "xxh3:c", player.checkpoint_hash = "xxh3:k", player.checkpoint = "/k.pt";
    game.players.push_back(std::move(player));
    game.teams.push_back({name, {name, name}});
  };
  add("random", SeatPlayer::kRandom);
  add("oracle", SeatPlayer::kOracle);
  add("run", SeatPlayer::kNetwork);
  game.teams.push_back({"0=oracle,1=run", {"oracle", "run"}});
  return game;
}

PlayedTeam played(const EvaluationGame& game, std::size_t team, std::vector<double> scores) {
  PlayedTeam one{&game.teams[team], {}};
  for (const double score : scores) {
    EpisodeRecord episode;
    episode.episode_id = one.episodes.size();
    episode.episode_seed = 18'000'000'000'000'000'000u;
    episode.score = static_cast<float>(score);
    episode.ceiling = 40;
    episode.agent_count = 2;
    episode.agent_score = {episode.score / 2, episode.score / 2};
    episode.agent_return = {1, 3};
    one.episodes.push_back(episode);
  }
  return one;
}

TEST(Summary, NormalisesBetweenTheTeamsOfTheEvaluationWhereItHasThem) {
  EvaluationGame game = made_game();
  game.references = ReferenceScores{.random = 0, .scripted = 100};
  std::vector<PlayedTeam> teams = {played(game, 2, {20, 30})};
  ScoreScale scale = scale_of(game, teams);
  EXPECT_EQ(summarise(game, teams[0], scale, true, false)["J_normalised"], 0.25);
  EXPECT_EQ(scale.source, "scenarios/reference_scores.toml");
  teams.push_back(played(game, 0, {10, 10}));
  EXPECT_EQ(scale_of(game, teams).references->scripted, 100) << "random play alone is no scale";
  teams.push_back(played(game, 1, {30, 30}));
  scale = scale_of(game, teams);
  const auto summary = summarise(game, teams[0], scale, true, false);
  EXPECT_EQ(summary["J_normalised"], 0.75);
  EXPECT_EQ(summary["references"]["random"], 10);
  game.references.reset();
  teams.resize(1);
  EXPECT_TRUE(summarise(game, teams[0], scale_of(game, teams), true, false)["J_normalised"].is_null());
}

TEST(Summary, RecordsWhatWasPlayedAndThePlayers) {
  const EvaluationGame game = made_game();
  const PlayedTeam team = played(game, 3, {20, 30, 40});
  const auto summary = summarise(game, team, {}, true, true);
  EXPECT_EQ(summary["policy"], "0=oracle,1=run");
  EXPECT_EQ(summary["seats"], (nlohmann::ordered_json{"oracle", "run"}));
  EXPECT_EQ(summary["config_hash"], "- xxh3:c");
  EXPECT_EQ(summary["checkpoint_hash"], "- xxh3:k");
  EXPECT_EQ(summary["map_hashes"]["second"], "xxh3:2");
  EXPECT_EQ(summary["J_by_layout"]["first"], 30);
  EXPECT_EQ(summary["each"].size(), 3u);

  const auto rows = episode_rows(game, team, {});
  ASSERT_EQ(rows.size(), 3u);
  EXPECT_EQ(rows[1]["layout"], "second");
  EXPECT_EQ(rows[1]["map_hash"], "xxh3:2");
  EXPECT_EQ(rows[1]["J_share"], 0.75);
  EXPECT_EQ(rows[1]["return"], 2);
  EXPECT_EQ(rows[1]["seed"], 18'000'000'000'000'000'000u);
  EXPECT_TRUE(rows[1]["J_normalised"].is_null());
  const auto scripted = summarise(game, played(game, 1, {1}), {}, false, false);
  EXPECT_TRUE(scripted["config_hash"].is_null());
  EXPECT_EQ(scripted["checkpoint"], "");
}

TEST(ContentHash, IsThatOfXxhsum) {
  const test::ScratchFolder scratch;
  std::ofstream(scratch / "abc") << "abc";
  const auto hash = content_hash(scratch / "abc");
  ASSERT_TRUE(hash);
  EXPECT_EQ(*hash, "xxh3:78af5f94892f3950");  // printf abc | xxhsum -H3
  EXPECT_FALSE(content_hash(scratch / "none"));
}

}  // namespace summary_test
}  // namespace comrad::deploy
