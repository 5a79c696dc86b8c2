#include "scenarios/spec/vizdoom_scenario.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/recipes.h"
#include "scenarios/spec/action_heads.h"
#include "scenarios/spec/game_names.h"
#include "scenarios/spec/registry.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/vizdoom_room.h"

namespace comrad::scenarios {
namespace vizdoom_scenario_test {

using ::testing::AllOf;
using ::testing::ElementsAre;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::SizeIs;
using ::testing::StartsWith;

constexpr const char* kPlain =
    "doom_scenario_path = room.wad\n"
    "doom_map = map01\n"
    "available_buttons = { MOVE_LEFT MOVE_RIGHT ATTACK }\n";

class VizdoomScenario : public testing::Test {
 protected:
  VizdoomScenario() { scratch_.write("room.wad", test::room_wad({"MAP01"}, 2)); }
  Expected<ScenarioSpec> load(const std::string& text) const {
    return load_scenario(scratch_.write("room.cfg", text));
  }
  /// What is said of a cfg that is refused.
  std::string refusal(const std::string& text) const {
    const auto spec = load(text);
    return spec ? "no error" : spec.error().message;
  }
  const test::ScratchFolder scratch_;
};

TEST_F(VizdoomScenario, ButtonsThatExcludeEachOtherShareAHead) {
  const auto heads =
      heads_of_buttons({"MOVE_LEFT", "ATTACK", "MOVE_RIGHT", "MOVE_FORWARD", "TURN_LEFT_RIGHT_DELTA",
                        "TURN_LEFT", "SPEED", "SELECT_WEAPON2", "SELECT_NEXT_WEAPON"});
  ASSERT_THAT(heads, SizeIs(6));
  EXPECT_THAT(heads[0].buttons, ElementsAre("MOVE_LEFT", "MOVE_RIGHT"));
  EXPECT_THAT(heads[1].buttons, ElementsAre("ATTACK"));
  EXPECT_THAT(heads[2].buttons, ElementsAre("MOVE_FORWARD"));
  EXPECT_THAT(heads[3].buttons,
              ElementsAre("TURN_LEFT_RIGHT_DELTA=-10", "TURN_LEFT_RIGHT_DELTA=-3", "TURN_LEFT_RIGHT_DELTA=3",
                          "TURN_LEFT_RIGHT_DELTA=10", "TURN_LEFT"));
  EXPECT_THAT(heads[4].buttons, ElementsAre("SPEED"));
  EXPECT_THAT(heads[5].buttons, ElementsAre("SELECT_WEAPON2", "SELECT_NEXT_WEAPON"));
}

TEST_F(VizdoomScenario, EveryButtonFindsAHeadThatCanBePressed) {
  for (const std::string& name : button_names()) {
    const auto heads = heads_of_buttons({name});
    ASSERT_THAT(heads, SizeIs(1)) << name;
    for (const std::string& choice : heads[0].buttons) EXPECT_TRUE(parse_press(choice)) << choice;
  }
}

TEST_F(VizdoomScenario, HeadsCanBeChosen) {
  auto spec = load(
      "doom_scenario_path = room.wad\navailable_buttons = { MOVE_LEFT MOVE_RIGHT ATTACK "
      "TURN_LEFT_RIGHT_DELTA }\n");
  ASSERT_TRUE(spec) << spec.error().message;
  ASSERT_TRUE(change_heads(*spec, " ATTACK, MOVE_LEFT;TURN_LEFT_RIGHT_DELTA=-5 "));
  ASSERT_THAT(spec->heads, SizeIs(2));
  EXPECT_THAT(spec->heads[0].buttons, ElementsAre("ATTACK", "MOVE_LEFT"));
  EXPECT_THAT(spec->heads[1].buttons, ElementsAre("TURN_LEFT_RIGHT_DELTA=-5"));
  ASSERT_TRUE(change_heads(*spec, ""));
  EXPECT_THAT(spec->heads, SizeIs(2));
  const std::pair<const char*, const char*> wrong[] = {{"ATACK", "ATTACK"},
                                                       {"USE", "does not give the agent USE"},
                                                       {"ATTACK,,MOVE_LEFT", "a name is missing"},
                                                       {"ATTACK;", "a name is missing"},
                                                       {"ATTACK,ATTACK", "twice"},
                                                       {"TURN_LEFT_RIGHT_DELTA", "takes a number"}};
  for (const auto& [text, what] : wrong)
    EXPECT_THAT(change_heads(*spec, text).error().message, AllOf(HasSubstr(text), HasSubstr(what)));
  auto masked = load_scenario("armory_siege");
  ASSERT_TRUE(masked) << masked.error().message;
  masked->masks.push_back({0, 0, {"none"}});
  EXPECT_THAT(change_heads(*masked, "ATTACK").error().message, HasSubstr("[[masks]]"));
}

TEST_F(VizdoomScenario, MoreHeadsThanAnAgentHasRequireAChoice) {
  auto spec = load(
      "doom_scenario_path = room.wad\navailable_buttons = { ATTACK ALTATTACK USE SPEED MOVE_LEFT TURN_LEFT "
      "MOVE_FORWARD JUMP SELECT_WEAPON1 }\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_THAT(change_heads(*spec, "").error().message,
              AllOf(HasSubstr("9 action heads"), HasSubstr("--heads")));
  EXPECT_TRUE(change_heads(*spec, "ATTACK;USE;TURN_LEFT"));
}

TEST_F(VizdoomScenario, PresetSmallGivesTheNetworkTheVariablesThatTheFileLists) {
  const auto without = load(kPlain);
  ASSERT_TRUE(without) << without.error().message;
  EXPECT_THAT(without->training.values, IsEmpty());
  const auto with = load(std::string(kPlain) + "available_game_variables = { HEALTH }\n");
  ASSERT_TRUE(with) << with.error().message;
  for (const char* algorithm : {"ippo", "idqn", "qplex_q"}) {
    RunConfig config;
    EXPECT_TRUE(apply_layer(config, scenario_settings(with->training, Preset::kSmall, algorithm)));
    EXPECT_TRUE(config.environment.use_additional_input) << algorithm;
  }
  EXPECT_THAT(scenario_settings(with->training, Preset::kPaper, "ippo").values, IsEmpty());
}

TEST_F(VizdoomScenario, KeysOfTheFileBecomeTermsAndLimits) {
  const auto spec =
      load(std::string(kPlain) +
           "doom_skill = 5\nepisode_start_time = 14\nepisode_timeout = 300\nrender_hud = true\n"
           "render_weapon = false\nliving_reward = -1\ndeath_penalty = 100\nkill_reward = 2.5\n"
           "available_game_variables = { HEALTH AMMO2 }\ngame_args += +sv_noautoaim 1 -nomonsters\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->name, "room");
  EXPECT_EQ(spec->map, "MAP01");
  EXPECT_EQ(spec->wad, "room.wad");
  EXPECT_EQ(spec->folder, scratch_.string());
  EXPECT_EQ(spec->limit_tics(), 314);
  EXPECT_EQ(spec->decision_limit, 79);
  EXPECT_EQ(spec->rules.skill, 5);
  EXPECT_TRUE(spec->rules.no_monsters && !spec->rules.autoaim && spec->rules.free_look);
  EXPECT_TRUE(spec->hud && !spec->weapon);
  EXPECT_EQ(spec->default_agents, 1);
  EXPECT_THAT(spec->supported_agents, ElementsAre(1, 2));
  EXPECT_EQ(spec->score, "return");
  std::vector<std::string> terms, measured;
  for (const RewardTerm& term : spec->rewards)
    terms.push_back(term.name + " " + term.variable + " " + term.kind + " " +
                    std::to_string(term.weight.last()));
  EXPECT_THAT(
      terms,
      ElementsAre("map_reward MAP_REWARD delta 1.000000", "living_reward MAP_TICS delta -1.000000",
                  "death_penalty DEATHCOUNT event -100.000000", "kill_reward KILLCOUNT delta 2.500000"));
  for (const MeasurementTerm& term : spec->measurements) measured.push_back(term.variable);
  EXPECT_THAT(measured, ElementsAre("HEALTH", "AMMO2"));
  EXPECT_THAT(spec->warnings, IsEmpty());
}

TEST_F(VizdoomScenario, WithoutATimeoutAnEpisodeEndsAfterTenMinutes) {
  const auto spec = load(std::string(kPlain) + "episode_start_time = 10\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->limit_tics(), kEngineLimitTics + 10);
}

TEST_F(VizdoomScenario, AHostSetsHowManyPlay) {
  const auto spec = load(std::string(kPlain) + "game_args = -host 2 -deathmatch +viz_respawn_delay 2\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->default_agents, 2);
  EXPECT_TRUE(spec->rules.deathmatch);
  EXPECT_EQ(spec->respawn_delay_tics, 70);
  EXPECT_THAT(refusal(std::string(kPlain) + "game_args = -host 3\n"),
              AllOf(HasSubstr("-host 3"), HasSubstr("has starts for 2")));
  EXPECT_THAT(refusal(std::string(kPlain) + "game_args = -host many\n"),
              HasSubstr("room.cfg:4: game_args: -host"));
}

TEST_F(VizdoomScenario, AHostOfOneIsANetworkGameThatDeathDoesNotEnd) {
  const auto spec =
      load(std::string(kPlain) + "death_penalty = 10\ngame_args = -host 1 -deathmatch +sv_forcerespawn 1\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->default_agents, 1);
  EXPECT_TRUE(spec->rules.network_game && spec->respawn);
  EXPECT_EQ(spec->respawn_delay_tics, 35);
  EXPECT_EQ(spec->rewards.back().variable + " " + spec->rewards.back().kind, "DEAD value");
  const auto at_once = load(std::string(kPlain) + "game_args = -host 1 +viz_respawn_delay 0\n");
  ASSERT_TRUE(at_once) << at_once.error().message;
  EXPECT_FALSE(at_once->respawn);
  EXPECT_EQ(at_once->respawn_delay_tics, 1);
  const auto alone =
      load(std::string(kPlain) + "death_penalty = 10\ngame_args = -deathmatch +sv_forcerespawn 1\n");
  ASSERT_TRUE(alone) << alone.error().message;
  EXPECT_FALSE(alone->rules.network_game);
  EXPECT_EQ(alone->rewards.back().variable + " " + alone->rewards.back().kind, "DEATHCOUNT event");
}

TEST_F(VizdoomScenario, ANumberSignInAPathIsNoComment) {
  scratch_.write("runs #3/room.wad", test::room_wad({"MAP01"}, 1));
  const auto spec = load(
      "# a comment\n  # another\ndoom_scenario_path = runs #3/room.wad\nliving_reward = -2 # per tic\n"
      "available_buttons = { ATTACK # USE\n JUMP }\ngame_args = +cl_run 0 #1 +sv_nojump 1\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->folder, scratch_ / "runs #3");
  EXPECT_EQ(spec->rewards.back().weight, -2);
  EXPECT_THAT(spec->heads, SizeIs(2));
  EXPECT_FALSE(spec->rules.allow_jump);
  EXPECT_THAT(spec->warnings, ElementsAre(HasSubstr("#1 is not known")));
}

TEST_F(VizdoomScenario, TheSelectedItemIsAlsoUsedByTheNameThatVizdoomsFilesHave) {
  const auto config = parse_vizdoom_config(
      "available_buttons = { ACTIVATE_SELECTED_WEAPON ATTACK ACTIVATE_SELECTED_ITEM }\n", "item.cfg");
  ASSERT_TRUE(config) << config.error().message;
  EXPECT_THAT(config->button_names, ElementsAre("ACTIVATE_SELECTED_ITEM", "ATTACK"));
}

TEST_F(VizdoomScenario, ClRunMakesPlayersRun) {
  for (const auto& [argument, runs] : {std::pair{"+cl_run 1", true}, {"+cl_run 0", false}, {"", false}}) {
    const auto spec = load(std::string(kPlain) + "game_args = " + argument + "\n");
    ASSERT_TRUE(spec) << spec.error().message;
    EXPECT_EQ(spec->rules.always_run, runs);
    EXPECT_THAT(spec->warnings, IsEmpty());
  }
}

TEST_F(VizdoomScenario, FlagsOfAGameHaveNamesAndNumbers) {
  using enum wad::GameFlag;
  const auto flags = [&](const std::string& arguments) {
    const auto spec = load(std::string(kPlain) + "game_args = " + arguments + "\n");
    EXPECT_TRUE(spec) << spec.error().message;
    EXPECT_THAT(spec->warnings, IsEmpty()) << arguments;
    return spec->rules.flags;
  };
  for (const wad::GameFlagName& known : wad::kGameFlagNames) {
    const std::string name(known.variable);
    EXPECT_EQ(flags("+" + name + " 1").bits, static_cast<uint64_t>(known.flag)) << name;
    EXPECT_EQ(flags("+" + name + " 1 +" + name + " 0").bits, 0u) << name;
  }
  // What ViZDoom's scripts read of the same arguments: GetCVar("dmflags"), GetCVar("dmflags2").
  EXPECT_EQ(flags("+sv_itemrespawn 1 +sv_weaponstay 1 +sv_forcerespawn 1").bits, 16644u);
  EXPECT_EQ(flags("+sv_respawnprotect 1").bits, uint64_t{1024} << 32);
  EXPECT_TRUE(flags("+dmflags 16644").has(kItemsReturn));
  EXPECT_TRUE(flags("+dmflags2 1024 +dmflags 4").has(kRespawnProtection));
  EXPECT_TRUE(flags("+dmflags -1").has(kHalveAmmo));
}

TEST_F(VizdoomScenario, FlagsThatTheRulesHaveFieldsForSetThem) {
  const auto spec =
      load(std::string(kPlain) +
           "game_args = -host 1 +dmflags 4196352 +sv_nofreelook 1 +sv_noautoaim 1 +sv_nojump 1 "
           "+sv_forcerespawn 1 +sv_nomonsters 1 +sv_gravity 400 +sv_aircontrol 0.5 +fraglimit 3\n");
  ASSERT_TRUE(spec) << spec.error().message;
  const GameRules& rules = spec->rules;
  EXPECT_TRUE(rules.infinite_ammo && rules.no_monsters && spec->respawn);
  EXPECT_FALSE(rules.allow_crouch || rules.allow_jump || rules.free_look || rules.autoaim);
  EXPECT_EQ(rules.gravity, 0.5);
  EXPECT_EQ(rules.air_control, 0.5);
  EXPECT_EQ(rules.frag_limit, 3);
  const auto never = load(std::string(kPlain) + "game_args = -host 1 +sv_forcerespawn 1 +sv_norespawn 1\n");
  ASSERT_TRUE(never) << never.error().message;
  EXPECT_FALSE(never->respawn);
}

// 0.05 minutes are 105 tics of the map; the first of them passes before the first decision.
TEST_F(VizdoomScenario, ATimeLimitIsATimeout) {
  const auto alone = load(std::string(kPlain) + "game_args = +timelimit 0.05\n");
  ASSERT_TRUE(alone) << alone.error().message;
  EXPECT_EQ(alone->rules.timeout_tics, 104);
  const auto sooner = load(std::string(kPlain) + "episode_timeout = 50\ngame_args = +timelimit 0.05\n");
  ASSERT_TRUE(sooner) << sooner.error().message;
  EXPECT_EQ(sooner->rules.timeout_tics, 50);
}

TEST_F(VizdoomScenario, ArgumentsThatOnlyShowAreSilentAndOthersAreNamed) {
  const auto spec = load(
      std::string(kPlain) +
      "game_args = +name AI +colorset 0 +viz_nocheat 1 +viz_am_center 1 +vid_forcesurface 1 +sv_cheats 1 "
      "+sv_losefrag 1 +viz_bots_path ./bots.cfg\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_THAT(spec->warnings,
              ElementsAre(HasSubstr("+sv_losefrag is not known"), HasSubstr("+viz_bots_path")));
  EXPECT_THAT(refusal(std::string(kPlain) + "game_args = +timelimit soon\n"),
              AllOf(HasSubstr("+timelimit soon"), HasSubstr("must be a number")));
}

TEST_F(VizdoomScenario, GrayPicturesAreAWarningWhereTheyAreNotServed) {
  const auto gray = load(std::string(kPlain) + "screen_format = GRAY8\n");
  ASSERT_TRUE(gray) << gray.error().message;
  EXPECT_THAT(gray->warnings, ElementsAre(AllOf(HasSubstr("room.cfg:4: screen_format = GRAY8"),
                                                HasSubstr("comrad.gym_env alone"))));
  const auto coloured = load(std::string(kPlain) + "screen_format = crcgcb\n");
  ASSERT_TRUE(coloured) << coloured.error().message;
  EXPECT_THAT(coloured->warnings, IsEmpty());
  EXPECT_THAT(refusal(std::string(kPlain) + "screen_format = GREY8\n"),
              AllOf(HasSubstr("room.cfg:4: screen_format = GREY8"), HasSubstr("RGB24"), HasSubstr("GRAY8")));
}

TEST_F(VizdoomScenario, TheMapIsTheFileThatIsNamedInWhateverCase) {
  const std::string path =
      scratch_.write("deeper/game.cfg", "doom_scenario_path = ../ROOM.WAD\navailable_buttons = { ATTACK }\n");
  const auto spec = load_scenario(path);
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_EQ(spec->folder + "/" + spec->wad, scratch_ / "room.wad");
  const auto layout = generate_layout(path, {.num_agents = 1});
  ASSERT_TRUE(layout) << layout.error().message;
  EXPECT_EQ(layout->wad, test::room_wad({"MAP01"}, 2));
}

TEST_F(VizdoomScenario, OfSeveralMapsTheNamedOneIsPlayed) {
  scratch_.write("room.wad", test::room_wad({"MAP01", "MAP07"}, 1));
  const std::string buttons = "available_buttons = { ATTACK }\n", wad = "doom_scenario_path = room.wad\n";
  const auto named = load(wad + "doom_map = map07\n" + buttons);
  ASSERT_TRUE(named) << named.error().message;
  EXPECT_EQ(named->map, "MAP07");
  EXPECT_THAT(named->warnings, IsEmpty());
  const auto unnamed = load(wad + buttons);
  ASSERT_TRUE(unnamed) << unnamed.error().message;
  EXPECT_EQ(unnamed->map, "MAP01");
  EXPECT_THAT(unnamed->warnings, ElementsAre(AllOf(HasSubstr("MAP01, MAP07"), HasSubstr("doom_map"),
                                                   HasSubstr("--layout_pool"))));
  EXPECT_THAT(refusal(wad + "doom_map = map02\n" + buttons),
              AllOf(HasSubstr("room.cfg:2: doom_map = MAP02"), HasSubstr("MAP01, MAP07")));
}

TEST_F(VizdoomScenario, WhatIsWrongIsNamedWithItsLine) {
  EXPECT_THAT(refusal("available_buttons = { ATTACK }\ndoom_scenario_path = rome.wad\n"),
              AllOf(HasSubstr("room.cfg:2: doom_scenario_path"), HasSubstr("rome.wad"),
                    HasSubstr("correct the line")));
  EXPECT_THAT(refusal("doom_scenario_path = room.wad\n"), HasSubstr("available_buttons = {"));
  EXPECT_THAT(refusal("doom_scenario_path = room.cfg\navailable_buttons = { ATTACK }\n"),
              HasSubstr("room.cfg:1: "));
  EXPECT_THAT(refusal("available_buttons = { ATACK }\n"),
              AllOf(HasSubstr("room.cfg:1: 'ATACK'"), HasSubstr("ATTACK")));
  scratch_.write("room.wad", test::room_wad({"MAP01"}, 0));
  EXPECT_THAT(refusal(kPlain), HasSubstr("has no start"));
  EXPECT_THAT(load_scenario(scratch_ / "none.cfg").error().message, HasSubstr("none.cfg"));
}

TEST_F(VizdoomScenario, AnUnknownKeyIsAWarningWithItsLine) {
  const auto spec = load(std::string(kPlain) + "livin_reward = 1\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_THAT(spec->warnings, ElementsAre(AllOf(HasSubstr("room.cfg:4: "), HasSubstr("living_reward"))));
}

TEST_F(VizdoomScenario, BuffersThatPythonAloneServesAreAWarningEach) {
  const auto spec = load(std::string(kPlain) +
                         "labels_buffer_enabled = true\nautomap_buffer_enabled = true\n"
                         "depth_buffer_enabled = false\nautomap_mode = whole\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_THAT(spec->warnings, ElementsAre(AllOf(HasSubstr("room.cfg:4: labels_buffer_enabled"),
                                                HasSubstr("comrad.gym_env alone")),
                                          HasSubstr("room.cfg:5: automap_buffer_enabled")));
  EXPECT_THAT(refusal(std::string(kPlain) + "automap_mode = ALL\n"),
              AllOf(HasSubstr("room.cfg:4: automap_mode = ALL"), HasSubstr("OBJECTS_WITH_SIZE")));
}

TEST_F(VizdoomScenario, WithoutAWadTheIwadsMapIsPlayed) {
  const auto spec = load("doom_game_path = nowhere.wad\navailable_buttons = { ATTACK }\n");
  ASSERT_TRUE(spec) << spec.error().message;
  EXPECT_THAT(spec->wad, EndsWith(".wad"));
  EXPECT_EQ(spec->map, "MAP01");
  EXPECT_THAT(spec->warnings,
              ElementsAre(AllOf(StartsWith(scratch_.string()), HasSubstr("room.cfg:1: doom_game_path"))));
}

}  // namespace vizdoom_scenario_test
}  // namespace comrad::scenarios
