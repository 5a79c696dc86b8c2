// A fourteenth scenario: a folder with a WAD and a scenario.toml, no C++.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cctype>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {
namespace own_scenario_test {

using testing::Contains;
using testing::HasSubstr;
namespace fs = std::filesystem;

constexpr const char* kToml = R"(name = "my_scenario"
title = "My Scenario"
summary = "Two agents in a user's room."
difficulty = 1
default_agents = 2
supported_agents = [2]
decision_limit = 100
score = "USER1"
score_scale = 0.5
score_divisor = "USER2"
ceiling = 1
wad = "my.wad"
[[heads]]
buttons = ["MOVE_FORWARD"]
[[heads]]
buttons = ["ATTACK", "USE"]
[[masks]]
agent = 1
head = 1
allowed = ["none", "USE"]
[[measurements]]
variable = "USER10"
agent_stride = 2
low = 0
high = 3.5
[[rewards]]
name = "own_find"
variable = "USER20"
agent_stride = 1
kind = "rise"
weight = 1.0
[[rewards]]
name = "alive_at_limit"
variable = "ONE"
kind = "value"
weight = 2.0
when = "TRUNCATED"
unless = "DEAD"
)";

class OwnScenario : public testing::Test {
 protected:
  void SetUp() override {
    root_ = fs::path(testing::TempDir()) / ("comrad_own_" + std::to_string(getpid()));
    folder_ = root_ / "my_scenario";
    fs::create_directories(folder_);
    write("scenario.toml", kToml);
    doomgen::MapPlan plan;
    plan.add_area({.name = "room"}, doomgen::Box{{0, 0}, {512, 512}});
    plan.add_start(1, {100, 100}, 0);
    plan.add_start(2, {200, 100}, 0);
    doomgen::WadWriter wad;
    ASSERT_TRUE(wad.add_udmf_map("MAP01", doomgen::write_udmf(*plan.build())));
    bytes_ = *wad.bytes();
    write("my.wad", bytes_);
  }
  void TearDown() override {
    unsetenv("COMRAD_SCENARIO_PATH");
    fs::remove_all(root_);
  }
  void write(const char* name, const std::string& text) {
    std::ofstream(folder_ / name, std::ios::binary) << text;
  }
  std::string with(const std::string& old_text, const std::string& new_text) {
    std::string text = kToml;
    const std::size_t at = text.find(old_text);
    EXPECT_NE(at, std::string::npos);
    return text.replace(at, old_text.size(), new_text);
  }
  std::string load_error(const std::string& toml) {
    write("scenario.toml", toml);
    const auto spec = load_scenario(folder_.string());
    return spec ? "no error" : spec.error().message;
  }
  fs::path root_, folder_;
  std::string bytes_;
};

TEST_F(OwnScenario, IsNamedByItsPath) {
  for (const std::string& path : {folder_.string(), folder_.string() + "/"}) {
    const auto spec = load_scenario(path);
    ASSERT_TRUE(spec) << spec.error().message;
    EXPECT_EQ(spec->name, "my_scenario");
    EXPECT_EQ(spec->score_divisor, "USER2");
    EXPECT_EQ(spec->score_scale, 0.5);
    ASSERT_EQ(spec->masks.size(), 1u);
    EXPECT_THAT(spec->masks[0].allowed, testing::ElementsAre("none", "USE"));
    EXPECT_EQ(spec->measurements[0].agent_stride, 2);
    EXPECT_EQ(spec->measurements[0].high, 3.5);
    EXPECT_EQ(spec->rewards[1].when, "TRUNCATED");
    EXPECT_EQ(spec->rewards[1].unless, "DEAD");
    const auto layout = generate_layout(path, {.seed = 3, .num_agents = 2});
    ASSERT_TRUE(layout) << layout.error().message;
    EXPECT_EQ(layout->wad, bytes_);
    EXPECT_EQ(layout->info.scenario, "my_scenario");
  }
}

TEST_F(OwnScenario, IsFoundThroughTheSearchPath) {
  EXPECT_FALSE(load_scenario("my_scenario"));
  setenv("COMRAD_SCENARIO_PATH", ("/nowhere:" + root_.string()).c_str(), 1);
  ASSERT_TRUE(load_scenario("my_scenario"));
  EXPECT_THAT(list_scenarios(), Contains("my_scenario"));
  EXPECT_THAT(list_scenarios(), Contains("coop_health_gathering"));
  EXPECT_EQ(generate_layout("my_scenario", {})->wad, bytes_);
}

TEST_F(OwnScenario, MistakesSayWhereAndWhat) {
  EXPECT_THAT(load_scenario((root_ / "no" / "such").string()).error().message, HasSubstr("scenario.toml"));
  EXPECT_THAT(load_error(with("agent_stride = 2", "agent_stride = 55")),
              AllOf(HasSubstr("scenario.toml:23"), HasSubstr("USER60")));
  EXPECT_THAT(load_error(with("agent_stride = 1\nkind", "agent_stride = 1\nkin")), HasSubstr("kin"));
  EXPECT_THAT(load_error(with("variable = \"USER20\"", "variable = \"HEALTH\"")),
              HasSubstr("no USER global"));
  EXPECT_THAT(load_error(with("\"none\", \"USE\"", "\"none\", \"JUMP\"")), HasSubstr("JUMP"));
  EXPECT_THAT(load_error(with("head = 1", "head = 2")), HasSubstr("[[heads]]"));
  EXPECT_THAT(load_error(with("when = \"TRUNCATED\"", "when = \"TRUNCATE\"")),
              HasSubstr("did you mean 'TRUNCATED'"));
  EXPECT_THAT(load_error(with("low = 0", "low = 9")), HasSubstr("at most 'high'"));
  EXPECT_THAT(load_error(with("wad = \"my.wad\"", "wad = \"../my.wad\"")),
              HasSubstr("in the scenario's folder"));
  EXPECT_THAT(load_error(with("name = \"my_scenario\"", "name = \"other\"")), HasSubstr("my_scenario"));
}

TEST_F(OwnScenario, AMutatedFileLoadsOrNamesFileAndLine) {
  const std::string good = kToml;
  Rng rng(uint64_t{17});
  int refused = 0;
  for (int i = 0; i < 1000; ++i) {
    std::string text = good;
    const int changes = rng.between(1, 3);
    for (int k = 0; k < changes; ++k) {
      const std::size_t place = rng.below(static_cast<uint32_t>(text.size()));
      if (rng.below(3) == 0)
        text.erase(place, rng.below(12));
      else if (rng.below(2) == 0)
        text.insert(place, 1, static_cast<char>(rng.below(256)));
      else
        text[place] = static_cast<char>(rng.below(256));
    }
    write("scenario.toml", text);
    const auto spec = load_scenario(folder_.string());
    if (spec) continue;
    ++refused;
    const std::string start = (folder_ / "scenario.toml").string() + ":";
    ASSERT_TRUE(spec.error().message.starts_with(start)) << i << ": " << spec.error().message;
    ASSERT_TRUE(std::isdigit(static_cast<unsigned char>(spec.error().message[start.size()])))
        << i << ": " << spec.error().message;
  }
  EXPECT_GT(refused, 500);
}

TEST_F(OwnScenario, AMapOfAnotherScenarioIsRefusedWithWaysOut) {
  write("my.wad", generate_layout("lava_pit", {})->wad);
  const auto refused = generate_layout(folder_.string(), {});
  ASSERT_FALSE(refused);
  const std::string file = (folder_ / "my.wad").string();
  EXPECT_THAT(refused.error().message,
              AllOf(HasSubstr(file + " is a map of scenario lava_pit, not of my_scenario"),
                    HasSubstr("--scenario lava_pit"),
                    HasSubstr("comrad doomgen lava_pit --as my_scenario -o " + file)));
  const auto drawn = generate_layout("lava_pit", {.as = "my_scenario"});
  ASSERT_TRUE(drawn);
  EXPECT_TRUE(drawn->info.ceiling.empty()) << "scenario.toml has the ceiling";
  write("my.wad", drawn->wad);
  const auto accepted = generate_layout(folder_.string(), {});
  ASSERT_TRUE(accepted) << accepted.error().message;
  EXPECT_EQ(accepted->wad, drawn->wad);
  EXPECT_EQ(accepted->file, file);
  EXPECT_THAT(generate_layout(folder_.string(), {.as = "third"}).error().message, HasSubstr("--as"));
}

TEST_F(OwnScenario, AMapThatIsMissingOrNoneIsAnError) {
  write("my.wad", "hello");
  EXPECT_THAT(generate_layout(folder_.string(), {}).error().message, HasSubstr("no WAD"));
  fs::remove(folder_ / "my.wad");
  EXPECT_THAT(generate_layout(folder_.string(), {}).error().message, HasSubstr("my.wad"));
  write("scenario.toml", with("wad = \"my.wad\"\n", ""));
  EXPECT_THAT(generate_layout(folder_.string(), {}).error().message, HasSubstr("neither"));
  write("scenario.toml", std::string(kToml) + "[layout]\nradius = 900\n");
  write("my.wad", bytes_);
  EXPECT_THAT(default_ceilings(*load_scenario(folder_.string())).error().message,
              HasSubstr("leave it out beside wad"));
  write("scenario.toml", kToml);
  EXPECT_THAT(generate_layout(folder_.string(), {.parameters = {{"side", "3"}}}).error().message,
              HasSubstr("side"));
}

}  // namespace own_scenario_test
}  // namespace comrad::scenarios
