#include "sim_workers/watch/recorded_play.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>

#include "tests/support/scratch_folder.h"

namespace comrad::sim {
namespace recorded_play_test {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;

json head() {
  return {{"format", "comrad-episode"}, {"version", 1},    {"scenario", "lava_pit"}, {"heads", ""},
          {"map", "maps/a.wad"},        {"num_agents", 2}, {"frame_skip", 4},        {"episode_seed", 7},
          {"head_sizes", {3, 2}},       {"decisions", 2}};
}

class RecordedPlay : public ::testing::Test {
 protected:
  void write(const std::string& name, const json& head, const std::string& choices) {
    std::ofstream(path(name), std::ios::binary) << head.dump() << "\n" << choices;
  }
  std::string path(const std::string& name) const { return scratch_.string() + "/" + name; }
  std::string error_of(const json& head, const std::string& choices = std::string("\2\1\0\0\0\0\1\1", 8)) {
    write("one.comrad", head, choices);
    const Expected<RecordedEpisode> episode = read_recorded_episode(path("one.comrad"));
    return episode ? "" : episode.error().message;
  }
  test::ScratchFolder scratch_;
};

TEST_F(RecordedPlay, ReadsWhatWasChosen) {
  ASSERT_EQ(error_of(head()), "");
  const Expected<RecordedEpisode> episode = read_recorded_episode(path("one.comrad"));
  ASSERT_TRUE(episode);
  EXPECT_THAT(episode->choices, ElementsAre(2, 1, 0, 0, 0, 0, 1, 1));
  EXPECT_EQ(episode->wad, path("maps/a.wad"));
  EXPECT_EQ(episode->seed, 7u);
}

TEST_F(RecordedPlay, RefusesWhatIsNoEpisodeWithTheReason) {
  const auto with = [](const char* key, const json& value) {
    json changed = head();
    changed[key] = value;
    return changed;
  };
  EXPECT_THAT(error_of(with("format", "other")), HasSubstr("it is no episode"));
  EXPECT_THAT(error_of(with("version", 2)), HasSubstr("format version"));
  EXPECT_THAT(error_of(head(), "\1"), HasSubstr("it is cut off"));
  EXPECT_THAT(error_of(head(), std::string("\3\1\0\0\0\0\1\1", 8)), HasSubstr("outside its head"));
  EXPECT_THAT(error_of(with("map", "/etc/passwd")), HasSubstr("outside its folder"));
  EXPECT_THAT(error_of(with("map", "maps/../../x.wad")), HasSubstr("outside its folder"));
  EXPECT_THAT(error_of(with("num_agents", 0), ""), HasSubstr("cannot be played"));
  EXPECT_THAT(error_of(with("num_agents", -2)), HasSubstr("cannot be played"));
  EXPECT_THAT(error_of(with("head_sizes", json::array()), ""), HasSubstr("cannot be played"));
  for (const char* key :
       {"scenario", "heads", "map", "num_agents", "episode_seed", "decisions", "head_sizes"}) {
    EXPECT_THAT(error_of(with(key, json::object())), HasSubstr("one.comrad: its first line")) << key;
    json lacking = head();
    lacking.erase(key);
    EXPECT_THAT(error_of(lacking), HasSubstr("one.comrad: its first line")) << key;
  }
  std::ofstream(path("one.comrad")) << "\xff\xfe{";
  EXPECT_FALSE(read_recorded_episode(path("one.comrad")));
  EXPECT_FALSE(read_recorded_episode(path("none.comrad")));
}

TEST_F(RecordedPlay, AFolderHoldsEpisodesOfOneGame) {
  EXPECT_EQ(read_recorded_episodes(path("nowhere")).error().code, ErrorCode::kNotFound);
  EXPECT_THAT(read_recorded_episodes(scratch_.string()).error().message, HasSubstr("no episodes"));
  const std::string choices(8, '\0');
  write("b.comrad", head(), choices);
  json other = head();
  other["map"] = "maps/b.wad";
  write("a.comrad", other, choices);
  const auto both = read_recorded_episodes(scratch_.string());
  ASSERT_TRUE(both);
  EXPECT_THAT(options_of(*both).layouts, ElementsAre(path("maps/b.wad"), path("maps/a.wad")));
  other["frame_skip"] = 1;
  write("c.comrad", other, choices);
  EXPECT_THAT(read_recorded_episodes(scratch_.string()).error().message, HasSubstr("another game or team"));
}

}  // namespace recorded_play_test
}  // namespace comrad::sim
