// The reference variants: the game that the paper's runs played, by the arithmetic of the evaluation records in the authors'
// repository (TTomilin/COMRAD, commit 43396f92, results/schelling/*.csv), which were played at frame skip 1; and what a
// variant may say.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <filesystem>
#include <map>
#include <string>
#include <vector>

#include "scenarios/spec/rewards.h"
#include "scenarios/spec/scenario_files.h"
#include "scenarios/spec/scenario_spec.h"
#include "tests/support/scratch_folder.h"

namespace comrad::scenarios {
namespace reference_variant_test {

using testing::AllOf;
using testing::ElementsAre;
using testing::HasSubstr;

ScenarioSpec load(const std::string& name) {
  Expected<ScenarioSpec> spec = load_scenario(name);
  if (!spec) ADD_FAILURE() << spec.error().message;
  return spec ? *std::move(spec) : ScenarioSpec();
}

/// What two agents receive in an episode, and what they are paid for it.
class Record {
 public:
  explicit Record(const std::string& name)
      : spec_(load(name)),
        tracker_(spec_.rewards, 2),
        value_(2 * spec_.rewards.size()),
        pays_(value_.size()) {
    set("HEALTH", 100), set("ONE", 1), set("PLAYER_NUMBER", 0, 0), set("PLAYER_NUMBER", 1, 1);
    for (const ScenarioExport& one : spec_.exports) numbers_[one.name] = "USER" + std::to_string(one.user);
    read();
    tracker_.reset(value_);
  }
  /// A variable, or an export, from now on; of an agent, or of both.
  Record& set(const std::string& name, double value, int agent = -1) {
    const auto number = numbers_.find(name);
    for (int i = 0; i < 2; ++i)
      if (agent < 0 || agent == i) now_[i][number == numbers_.end() ? name : number->second] = value;
    return *this;
  }
  Record& decide(int decisions = 1) {
    for (int i = 0; i < decisions; ++i) {
      set("FIRST", first_ ? 1 : 0);
      first_ = false;
      read();
      std::array<double, 2> reward{};
      tracker_.step(value_, reward, pays_);
      sum_[0] += reward[0], sum_[1] += reward[1];
    }
    return *this;
  }
  /// What an agent is paid in all, its share of the team's reward included.
  double paid(int agent) const {
    const double alpha = spec_.shared_reward_alpha;
    return (1 - alpha) * sum_[agent] + alpha * (sum_[0] + sum_[1]);
  }

 private:
  double variable(const std::string& name, int agent) const {
    const auto found = now_[agent].find(name);
    return found == now_[agent].end() ? 0.0 : found->second;
  }
  void read() {
    for (std::size_t term = 0; term < spec_.rewards.size(); ++term)
      for (int agent = 0; agent < 2; ++agent) {
        const RewardTerm& one = spec_.rewards[term];
        std::string name = one.variable;
        if (one.agent_stride > 0 && agent > 0)
          name = "USER" + std::to_string(std::stoi(name.substr(4)) + one.agent_stride);
        value_[2 * term + agent] = variable(name, agent);
        pays_[2 * term + agent] = (one.when.empty() || variable(one.when, agent) != 0) &&
                                  (one.unless.empty() || variable(one.unless, agent) == 0);
      }
  }

  ScenarioSpec spec_;
  RewardTracker tracker_;
  std::array<std::map<std::string, double>, 2> now_;
  std::map<std::string, std::string> numbers_;
  std::vector<double> value_;
  std::vector<uint8_t> pays_;
  std::array<double, 2> sum_{};
  bool first_ = true;
};

TEST(ReferenceVariant, HaresWereNeverPaidInStagHunt) {
  // HAPPO, episode 20: two stags and 26 dead hares; 101.4 and 105.6 were paid, of which two stags are 100.
  const auto play = [](const std::string& name) {
    return Record(name)
        .decide()
        .set("hare_kills_1", 13)
        .set("hare_kills_2", 13)
        .set("stag_kills", 2)
        .decide()
        .paid(0);
  };
  EXPECT_NEAR(play("stag_hunt_arena@reference"), 100, 1e-9);
  EXPECT_NEAR(play("stag_hunt_arena"), 100 + 13 * 3, 1e-9);
  EXPECT_NEAR(Record("stag_hunt_arena@reference").set("stag_kills", 7).decide().paid(1), 350, 1e-9)
      << "361 to 367 in the records";
}

TEST(ReferenceVariant, AKillIsPaidToBothHuntersAndShellsToNone) {
  // Dumb Enemies, IPPO, episode 20: 57 hits apart are 17.1 of reward apart; kills make no difference.
  const auto kills = [](const std::string& name, double hits, double shells) {
    Record record(name);
    record.set("AMMO3", 20)
        .decide()
        .set("KILLCOUNT", 4)
        .set("HITCOUNT", hits, 0)
        .set("AMMO3", 20 - shells)
        .decide();
    return record;
  };
  const Record dumb = kills("dumb_enemies@reference", 57, 8), smart = kills("smart_enemies@reference", 10, 8);
  EXPECT_NEAR(dumb.paid(0) - dumb.paid(1), 17.1, 1e-9);
  EXPECT_NEAR(dumb.paid(1), 20, 1e-9);
  EXPECT_NEAR(smart.paid(0), 20 + 3, 1e-9);
  EXPECT_NEAR(kills("smart_enemies", 10, 8).paid(1), 20 - 8 * 0.02, 1e-9)
      << "the published rule, with shells";
  for (const char* name : {"smart_enemies", "dumb_enemies"}) EXPECT_EQ(load(name).score, "KILLCOUNT");
}

TEST(ReferenceVariant, HealthsSurvivorOf642TicsIsPaidAsItsRecord) {
  // HAPPO, episode 23: 100 points lost, 25 gained by one kit of the team: 10 + 2.5 - 5 + 0.05 for survivors.
  Record record("coop_health_gathering@reference");
  record.decide()
      .set("HEALTH", 20)
      .decide()
      .set("HEALTH", 45)
      .set("kits_taken", 1)
      .decide()
      .set("HEALTH", 25)
      .decide();
  EXPECT_NEAR(record.paid(1), 7.55, 1e-9);
  EXPECT_NEAR(Record("coop_health_gathering").decide().paid(0), 0, 1e-9);
}

TEST(ReferenceVariant, PuzzlesFirstEpisodesArePaidAsTheirRecords) {
  const auto play = [](int zone, int pairs) {
    Record record("coop_puzzle@reference");
    return record.decide()
        .set("zones_entered", zone - 1)
        .set("pairs_done", pairs)
        .decide(1998)
        .set("TRUNCATED", 1)
        .decide()
        .paid(0);
  };
  EXPECT_NEAR(play(3, 0), -2.75, 1e-9);
  EXPECT_NEAR(play(9, 3), 4.75, 1e-9);
  EXPECT_EQ(load("coop_puzzle").decision_limit, 2000);
}

TEST(ReferenceVariant, ArmoryPaysKillsToEachAndTheCoresFallToNone) {
  const auto play = [](const std::string& name, int kills) {
    Record record(name);
    record.set("core_hp", 1000).decide();  // which is before the fall of the next line
    return record.set("KILLCOUNT", kills)
        .set("core_hp", 0)
        .set("core_destroyed", 1)
        .set("TERMINATED", 1)
        .decide()
        .paid(1);
  };
  EXPECT_NEAR(play("armory_siege@reference", 7), 11, 1e-9) << "HAPPO, episode 20: agent 1 never armed";
  EXPECT_NEAR(play("armory_siege@reference", 1), -7, 1e-9) << "HAPPO, episode 10";
  EXPECT_NEAR(play("armory_siege", 7), 11 - 7, 1e-9);
  EXPECT_THAT(load("armory_siege@reference").globals,
              ElementsAre(testing::Field(&NamedNumber::name, "USER60")));
  EXPECT_TRUE(load("armory_siege").globals.empty());
}

TEST(ReferenceVariant, RhythmsFailureCostsBothAgentsSteps) {
  // HAPPO, episode 10: -1 - 0.002 x 385 + 0.63 of shaping, paid to each (alpha 1).
  const Record record = Record("rhythm_sync@reference").decide(384).set("failed", 1).decide();
  EXPECT_NEAR(record.paid(0), -1 - 0.002 * 385, 1e-9);
  EXPECT_NEAR(Record("rhythm_sync@reference").set("progress_a", 128).set("zones_a", 1).decide().paid(1),
              0.064 + 0.05 - 0.002, 1e-9);
}

TEST(ReferenceVariant, TheDefenderIsPaidAsInItsRecordsAndTheRunnerNotForBullets) {
  const auto play = [](int kills, double hurt, bool survives) {
    Record record("ammo_carrier@reference");
    record.decide().set("KILLCOUNT", kills);
    double done = 0;
    for (; done < hurt;) record.set("DAMAGECOUNT", done = std::min(hurt, done + 100)).decide();
    record.set("picked_1", 50).decide();
    return record.set(survives ? "TRUNCATED" : "DEAD", 1).decide();
  };
  EXPECT_NEAR(play(19, 680, true).paid(0), 19.93, 1e-9);
  EXPECT_NEAR(play(7, 160, false).paid(0), 6.16, 1e-9);
  EXPECT_NEAR(play(0, 0, false).paid(1), -1, 1e-9);
}

TEST(ReferenceVariant, PlatformChainPaysLevelsAndBreaksAndNoDeath) {
  Record record("platform_chain@reference");
  record.decide().set("joint_level", 2).set("break_events", 1).set("dragged_links", 5).decide();
  record.set("dragged_links", 0).set("DEAD", 1).decide();
  EXPECT_NEAR(record.paid(0), 2 - 0.0625, 1e-9);
}

TEST(ReferenceVariant, StealthAndLavaMazeShareNothing) {
  // Stealth, IPPO, episode 10: 180 points of the team's health and the failure, half of them each.
  Record stealth("stealth_labyrinth@reference");
  stealth.set("team_health", 200).decide();
  const double before = stealth.paid(0);
  EXPECT_NEAR(stealth.set("team_health", 20).set("TERMINATED", 1).decide().paid(0) - before, -2.30, 1e-9);
  // Lava Maze, MAPPO: 131 decisions; 227 and four cells. The navigator's death and 105 points cost it 7.10 more.
  EXPECT_NEAR(Record("lava_maze@reference").decide(131).paid(1), -0.655, 1e-9);
  Record maze("lava_maze@reference");
  maze.decide(226).set("steps_made", 4).set("DEAD", 1, 0).set("HEALTH", -5, 0).decide();
  EXPECT_NEAR(maze.paid(1), 0.865, 1e-9);
  EXPECT_NEAR(maze.paid(1) - maze.paid(0), 7.10, 1e-9);
}

TEST(ReferenceVariant, ForagingPaysHarvestsCleanupsAndTheDeath) {
  Record one("foraging_commons@reference"), two("foraging_commons@reference");
  EXPECT_NEAR(one.decide().set("harvests_1", 21).set("DEAD", 1).decide().paid(0), -0.37, 1e-9);
  EXPECT_NEAR(two.decide().set("harvests_1", 22).set("cleanups_1", 1).set("DEAD", 1).decide().paid(0), -0.31,
              1e-9);
}

TEST(ReferenceVariant, EachScenarioHasOneThatDiffersInRewardsAndRulesAlone) {
  int found = 0;
  for (const std::string& name : list_scenarios()) {
    const ScenarioSpec spec = load(name);
    ASSERT_THAT(list_variants(spec.folder), ElementsAre("reference")) << name;
    const ScenarioSpec variant = load(name + "@reference");
    EXPECT_EQ(variant.name, name + "@reference");
    EXPECT_EQ(variant.maps_of, name);
    EXPECT_EQ(variant.folder, spec.folder);
    EXPECT_EQ(variant.version, spec.version);
    EXPECT_EQ(variant.score, spec.score);
    EXPECT_EQ(variant.score_unit, spec.score_unit);
    EXPECT_EQ(variant.decision_limit, spec.decision_limit);
    EXPECT_EQ(variant.heads.size(), spec.heads.size());
    EXPECT_EQ(load(name + "@default").name, name);
    ++found;
  }
  EXPECT_EQ(found, 13);
}

class OwnVariant : public testing::Test {
 protected:
  /// What is wrong with a variant of these words, of a scenario based on Lava Pit.
  std::string error_of(const std::string& toml) {
    std::filesystem::create_directories(scratch_ / "mine/variants");
    scratch_.write("mine/scenario.toml", "name = \"mine\"\nbase = \"lava_pit\"\n");
    scratch_.write("mine/variants/hard.toml", toml);
    const auto spec = load_scenario((scratch_ / "mine").string() + "@hard");
    return spec ? "no error" : spec.error().message;
  }
  test::ScratchFolder scratch_;
};

TEST_F(OwnVariant, StatesWhatItChangesAndNothingThatItIs) {
  EXPECT_EQ(error_of("decision_limit = 7\n[globals]\ngoal = 3\nUSER60 = -1\n[[rewards]]\nname = "
                     "\"stall\"\nweight = 0.0\n"),
            "no error");
  EXPECT_THAT(error_of("name = \"x\"\n"), AllOf(HasSubstr("variants/hard.toml:1:1"), HasSubstr("'name'")));
  EXPECT_THAT(error_of("decision_limt = 7\n"),
              AllOf(HasSubstr("variants/hard.toml:1:1"), HasSubstr("'decision_limt'"),
                    HasSubstr("did you mean 'decision_limit'")));
  EXPECT_THAT(error_of("\n[globals]\ngoall = 3\n"),
              AllOf(HasSubstr("variants/hard.toml:3:1"), HasSubstr("'goall'"), HasSubstr("'goal'")));
  EXPECT_THAT(error_of("[globals]\nUSER61 = 3\n"), HasSubstr("USER1 to USER60"));
  EXPECT_THAT(error_of("[globals]\ngoal = 1.5\n"), HasSubstr("must be a whole number"));
  EXPECT_THAT(error_of("score_unit = \"meters\"\n"),
              HasSubstr("known: tics, decisions, kills, share, reward, count"));
  EXPECT_THAT(error_of("version = 0\n"), HasSubstr("'version' must be in 1..1000"));
}

TEST_F(OwnVariant, AnUnknownOneIsRefusedWithThoseThereAre) {
  const auto spec = load_scenario("lava_pit@refrence");
  ASSERT_FALSE(spec);
  EXPECT_EQ(spec.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(spec.error().message, AllOf(HasSubstr("lava_pit has no variant 'refrence'"),
                                          HasSubstr("'reference'"), HasSubstr("known: default, reference")));
}

}  // namespace reference_variant_test
}  // namespace comrad::scenarios
