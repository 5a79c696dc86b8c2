#include "scenarios/spec/layout_info.h"

#include <gtest/gtest.h>

#include "rollout_buffer/core/rng.h"

namespace comrad::scenarios {
namespace layout_info_test {

TEST(LayoutInfo, ComesBackAsItWasWritten) {
  const LayoutInfo info{"coop_health_gathering", UINT64_MAX - 3, 2, 7, {{"radius", 2000}, {"offset", -5}}};
  const auto again = parse_layout_info(write_layout_info(info));
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->scenario, info.scenario);
  EXPECT_EQ(again->seed, info.seed);
  EXPECT_EQ(again->version, 2);
  EXPECT_EQ(again->attempt, info.attempt);
  EXPECT_EQ(again->parameters, info.parameters);
  EXPECT_EQ(again->parameter("radius", 1), 2000);
  EXPECT_EQ(again->parameter("absent", 1), 1);
  EXPECT_TRUE(again->ceiling.empty());
}

TEST(LayoutInfo, KeepsTheCeilingOfEachTeamSize) {
  const LayoutInfo info{"armory_siege", 1, 1, 0, {}, {{2, 674.97}, {8, 177.47}}};
  const auto again = parse_layout_info(write_layout_info(info));
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->ceiling, info.ceiling);
  for (const char* wrong : {"two = 1", "0 = 1", "2 = 0", "2 = -1", "2 = nan", "2 = \"x\""}) {
    const std::string text =
        std::string("format = 1\nscenario = \"x\"\nseed = 1\nattempt = 0\n[ceiling]\n") + wrong;
    EXPECT_FALSE(parse_layout_info(text)) << wrong;
  }
}

TEST(LayoutInfo, RefusesWhatItDoesNotKnow) {
  for (const char* text :
       {"", "format = 2\nscenario = \"x\"\nseed = 1\nattempt = 0", "format = 1\nseed = 1\nattempt = 0",
        "format = 1\nscenario = \"x\"\nseed = 1\nattempt = -1", "format = [",
        "format = 1\nscenario = \"x\"\nversion = 0\nseed = 1\nattempt = 0",
        "format = 1\nscenario = \"x\"\nseed = 1\nattempt = 0\n[parameters]\na = 1.5"})
    EXPECT_FALSE(parse_layout_info(text)) << text;
  EXPECT_FALSE(parse_layout_info(std::string(100'000, '#')));
}

TEST(LayoutInfo, SurvivesRandomBytes) {
  const std::string good = write_layout_info({"x", 1, 1, 0, {{"a", 1}}});
  for (uint64_t seed = 0; seed < 2000; ++seed) {
    SCOPED_TRACE(seed);
    Rng rng(seed);
    std::string text = good;
    for (int i = 0; i < 4; ++i)
      text[rng.below(static_cast<uint32_t>(text.size()))] = static_cast<char>(rng.below(256));
    (void)parse_layout_info(text);
  }
}

}  // namespace layout_info_test
}  // namespace comrad::scenarios
