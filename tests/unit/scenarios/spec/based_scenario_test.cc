// A scenario with a base: what it names is its own, everything else and the maps are the base's.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>

#include "scenarios/spec/layout_pool.h"
#include "scenarios/spec/registry.h"
#include "scenarios/spec/scenario_spec.h"
#include "tests/support/scratch_folder.h"

namespace comrad::scenarios {
namespace based_scenario_test {

using testing::AllOf;
using testing::HasSubstr;

constexpr const char* kGentle = R"(name = "gentle"
base = "coop_health_gathering"
title = "Gentle Health Gathering"
decision_limit = 500
supported_agents = [2]
ceiling = 2000
[[rewards]]
name = "own_death"
weight = -1.0
[[rewards]]
name = "alive"
variable = "ONE"
kind = "value"
weight = 0.01
[render]
crosshair = false
[training.small.ippo]
gamma = 0.9
)";

class BasedScenario : public testing::Test {
 protected:
  std::string folder(const std::string& name) {
    std::filesystem::create_directories(scratch_ / name);
    return (scratch_ / name).string();
  }
  std::string write(const std::string& name, const std::string& toml) {
    folder(name);
    scratch_.write(name + "/scenario.toml", toml);
    return (scratch_ / name).string();
  }
  std::string error_of(const std::string& name, const std::string& toml) {
    const auto spec = load_scenario(write(name, toml));
    return spec ? "no error" : spec.error().message;
  }
  test::ScratchFolder scratch_;
};

const RewardTerm& term(const ScenarioSpec& spec, const std::string& name) {
  const auto found = std::ranges::find(spec.rewards, name, &RewardTerm::name);
  if (found == spec.rewards.end()) ADD_FAILURE() << "no term " << name;
  return *found;
}

TEST_F(BasedScenario, OverridesWhatItNamesAndInheritsTheRest) {
  const auto base = load_scenario("coop_health_gathering");
  const auto spec = load_scenario(write("gentle", kGentle));
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->name, "gentle");
  EXPECT_EQ(spec->maps_of, "coop_health_gathering");
  EXPECT_EQ(spec->folder, base->folder);
  EXPECT_EQ(spec->decision_limit, 500);
  EXPECT_EQ(spec->summary, base->summary);
  EXPECT_THAT(spec->supported_agents, testing::ElementsAre(2));
  EXPECT_FALSE(spec->crosshair);
  EXPECT_TRUE(spec->hud);
  EXPECT_EQ(spec->heads.size(), base->heads.size());
  EXPECT_EQ(spec->exports.size(), base->exports.size());
  ASSERT_EQ(spec->rewards.size(), base->rewards.size() + 1);
  EXPECT_EQ(term(*spec, "own_death").weight, -1.0);
  EXPECT_EQ(term(*spec, "own_death").kind, "event") << "the base's";
  EXPECT_EQ(term(*spec, "kit_taken").variable, term(*base, "kit_taken").variable);
  EXPECT_EQ(term(*spec, "alive").weight, 0.01);
  EXPECT_EQ(spec->training.values.back(), (std::pair<std::string, std::string>{"small.ippo.gamma", "0.9"}));
}

TEST_F(BasedScenario, PlaysTheBasesMapsByteForByte) {
  const std::string gentle = write("gentle", kGentle);
  const auto own = generate_layout(gentle, {.seed = 5, .num_agents = 2});
  ASSERT_TRUE(own) << own.error().message;
  EXPECT_EQ(own->wad, generate_layout("coop_health_gathering", {.seed = 5, .num_agents = 2})->wad);
  EXPECT_EQ(layout_parameters(gentle)->size(), layout_parameters("coop_health_gathering")->size());

  const auto ceilings = default_ceilings(*load_scenario(gentle));
  ASSERT_TRUE(ceilings) << ceilings.error().message;
  EXPECT_EQ(ceilings->at(2), 2000) << "its own, whatever the map contains";

  PoolRequest request;
  request.count = 2;
  const std::string pool = folder("pool");
  ASSERT_TRUE(make_pool("coop_health_gathering", request, pool, {}, nullptr));
  const auto list = check_pool(pool, {.scenario = gentle, .num_agents = 2});
  ASSERT_TRUE(list) << list.error().message;
  EXPECT_EQ(list->layouts[0].ceiling, 2000);
  EXPECT_FALSE(check_pool(pool, {.scenario = "lava_pit", .num_agents = 2}));
}

TEST_F(BasedScenario, ABaseMayHaveABaseAndLieBesideIt) {
  write("gentle", kGentle);
  const std::string path = write(
      "gentler", "name = \"gentler\"\nbase = \"../gentle\"\n[[rewards]]\nname = \"alive\"\nweight = 1\n");
  const auto spec = load_scenario(path);
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->maps_of, "coop_health_gathering");
  EXPECT_EQ(term(*spec, "alive").weight, 1);
  EXPECT_EQ(term(*spec, "alive").variable, "ONE");
  EXPECT_EQ(term(*spec, "own_death").weight, -1);
  EXPECT_EQ(spec->ceiling, 2000);
  EXPECT_EQ(generate_layout(path, {})->wad, generate_layout("coop_health_gathering", {})->wad);
}

TEST_F(BasedScenario, MistakesSayWhereAndWhat) {
  const std::string head = "name = \"mine\"\nbase = \"coop_health_gathering\"\n";
  EXPECT_THAT(error_of("mine", "name = \"mine\"\nbase = \"coop_heath_gathering\"\n"),
              AllOf(HasSubstr("scenario.toml:2:"), HasSubstr("did you mean 'coop_health_gathering'")));
  EXPECT_THAT(error_of("mine", "name = \"mine\"\nbase = 3\n"), HasSubstr("'base' must be the name"));
  EXPECT_THAT(error_of("mine", "name = \"mine\"\nbase = \"../mine\"\n"), HasSubstr("in a circle"));
  EXPECT_THAT(error_of("mine", "base = \"coop_health_gathering\"\n"),
              HasSubstr("the name of the folder, 'mine'"));
  EXPECT_THAT(error_of("mine", head + "decision_limt = 5\n"), HasSubstr("did you mean 'decision_limit'"));
  EXPECT_THAT(error_of("mine", head + "wad = \"my.wad\"\n"),
              HasSubstr("'wad' must be left out beside 'base'"));
  EXPECT_THAT(error_of("mine", head + "[exports]\nmine = 3\n"), HasSubstr("'exports' must be left out"));
  EXPECT_THAT(error_of("mine", head + "[[rewards]]\nname = \"own_deth\"\nweight = -1\n"),
              HasSubstr("'variable' is missing"))
      << "a new term needs all of its keys";
  EXPECT_THAT(error_of("mine", "name = \"mine\"\nbase = \"lava_maze\"\n[[heads]]\nbuttons = [\"USE\"]\n"),
              HasSubstr("[[masks]]"));
}

TEST_F(BasedScenario, OtherRewardsOfAScoreThatIsTheReturnNeedACeiling) {
  const auto siege = load_scenario("armory_siege");
  ASSERT_EQ(siege->score, "return");
  const std::string toml = "name = \"mine\"\nbase = \"armory_siege\"\n[[rewards]]\nname = \"" +
                           siege->rewards[0].name + "\"\nweight = 3\n";
  EXPECT_THAT(error_of("mine", toml), HasSubstr("given with a 'ceiling'"));
  EXPECT_EQ(error_of("mine", "ceiling = 0\n" + toml), "no error");
}

}  // namespace based_scenario_test
}  // namespace comrad::scenarios
