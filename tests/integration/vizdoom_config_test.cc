// `comrad` with a ViZDoom .cfg in place of a scenario: real processes train, resume and evaluate it, and what is wrong with
// it is said before any of them starts.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "tests/integration/running_program.h"
#include "tests/support/vizdoom_room.h"

namespace comrad::test {
namespace vizdoom_config_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::SizeIs;
namespace fs = std::filesystem;

class VizdoomConfig : public ::testing::Test {
 protected:
  VizdoomConfig() : began_in_(fs::current_path()) {
    scratch_.write("games/room.wad", test::room_wad({"MAP01"}, 2));
    scratch_.write(
        "games/room.cfg",
        "doom_scenario_path = room.wad\nliving_reward = -1\nitem_reward = 50\nepisode_timeout = 120\n"
        "available_buttons = { MOVE_LEFT MOVE_RIGHT MOVE_FORWARD }\nno_such_key = 1\n"
        "available_game_variables = { HEALTH }\n");
    fs::current_path(scratch_ / "games");
  }
  ~VizdoomConfig() override { fs::current_path(began_in_); }

  Ending train(const std::string& experiment, double env_steps, const std::vector<std::string>& more) const {
    RunningProgram training(small_training(scratch_, experiment, env_steps, more));
    return training.wait();
  }
  const ScratchFolder scratch_;
  const fs::path began_in_;
};

TEST_F(VizdoomConfig, OneAgentTrainsAndTheRunContinuesFromAnotherFolder) {
  const Ending first = train("room", 4096, {"--scenario", "room.cfg"});
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_THAT(first.err, HasSubstr("room.cfg:6: unknown key no_such_key"));
  EXPECT_THAT(read_text(scratch_ / "room/config.toml"),
              AllOf(HasSubstr((scratch_ / "games/room.cfg").string()), HasSubstr("num_agents = 1\n")));
  EXPECT_THAT(files(scratch_ / "room/layouts", "room_42.wad"), SizeIs(1));
  const double frames = env_frames(scratch_ / "room");
  EXPECT_GE(frames, 4096);

  fs::current_path(scratch_.string());
  const Ending second = train("room", 2 * frames, {"--scenario", "games/room.cfg"});
  ASSERT_EQ(second.exit_code, 0) << second.err;
  EXPECT_THAT(second.err, HasSubstr("Resuming the run"));
  EXPECT_GE(env_frames(scratch_ / "room"), 2 * frames);

  const Ending evaluated = comrad({"eval", "--policy", scratch_ / "room", "--episodes", "4", "--json"});
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.err;
  const nlohmann::json summary = nlohmann::json::parse(evaluated.out);
  EXPECT_EQ(summary["num_agents"], 1);
  EXPECT_GE(summary["J_mean"], -120);
  EXPECT_EQ(summary["J_mean"], summary["return_mean"]);
}

TEST_F(VizdoomConfig, EveryMapOfAWadIsTrainedOnAndEvaluated) {
  scratch_.write("games/many.wad", test::room_wad({"MAP01", "MAP02", "MAP31"}, 1));
  const std::vector<std::string> more = {"--scenario",          "room.cfg", "--layout_pool", "many.wad",
                                         "--layout_swap_every", "1"};
  const Ending first = train("many", 4096, more);
  ASSERT_EQ(first.exit_code, 0) << first.err;
  EXPECT_THAT(files(scratch_ / "many/layouts/many_maps", "many_MAP", ".wad"), SizeIs(3));
  const nlohmann::json state = read_json(scratch_ / "many/curriculum_state.json");
  EXPECT_THAT(state["tasks"], SizeIs(3));
  for (const auto& count : state["counts"]) EXPECT_GT(count.get<int>(), 0);

  fs::remove(scratch_ / "games/many.wad");  // the run keeps its maps
  const Ending second = train("many", 8192, {"--scenario", "room.cfg"});
  ASSERT_EQ(second.exit_code, 0) << second.err;
  const Ending evaluated = comrad({"eval", "--policy", scratch_ / "many", "--episodes", "6", "--json"});
  ASSERT_EQ(evaluated.exit_code, 0) << evaluated.err;
  EXPECT_THAT(nlohmann::json::parse(evaluated.out)["J_by_layout"], SizeIs(3));
}

TEST_F(VizdoomConfig, HeadsAreChosenOnceForARun) {
  const Ending first =
      train("heads", 2048, {"--scenario", "room.cfg", "--heads", "MOVE_LEFT,MOVE_FORWARD;MOVE_RIGHT"});
  ASSERT_EQ(first.exit_code, 0) << first.err;
  const Ending second = train("heads", 8192, {"--scenario", "room.cfg", "--heads", "MOVE_LEFT"});
  EXPECT_EQ(second.exit_code, 2);
  EXPECT_THAT(second.err, HasSubstr("--heads=MOVE_LEFT"));
}

using VizdoomConfigLong = VizdoomConfig;
TEST_F(VizdoomConfigLong, AlgorithmsTrainOneAgent) {
  for (const char* algorithm : {"mappo", "happo", "idqn"}) {
    const Ending ending =
        train(algorithm, 2048, {"--scenario", "room.cfg", "--algo", algorithm, "--learning_starts", "256"});
    EXPECT_EQ(ending.exit_code, 0) << algorithm << ": " << ending.err;
  }
}

TEST_F(VizdoomConfig, AlgorithmsThatMixValuesSayWhyTheyDoNotTrainOneAgent) {
  for (const char* algorithm : {"vdn", "qmix", "qplex_d"}) {
    const Ending ending = train(algorithm, 2048, {"--scenario", "room.cfg", "--algo", algorithm});
    EXPECT_EQ(ending.exit_code, 2) << algorithm;
    EXPECT_THAT(ending.err, HasSubstr("mixes the values of at least 2 agents, use idqn for one"))
        << algorithm;
  }
}

TEST_F(VizdoomConfig, IsDescribedAndMeasured) {
  const Ending described = comrad({"scenarios", "describe", "room.cfg"});
  EXPECT_EQ(described.exit_code, 0) << described.err;
  EXPECT_THAT(described.out, AllOf(HasSubstr("MOVE_LEFT, MOVE_RIGHT"), HasSubstr("living_reward"),
                                   HasSubstr("no_such_key"), HasSubstr("room.wad")));
  const Ending measured = comrad({"bench", "sim", "--seconds", "0.5", "--scenario", "room.cfg",
                                  "--num_agents", "2", "--use_additional_input", "True", "--json"});
  ASSERT_EQ(measured.exit_code, 0) << measured.err;
  EXPECT_GT(nlohmann::json::parse(measured.out)["decisions_per_s"], 0);
}

TEST_F(VizdoomConfig, WhatIsWrongIsSaidBeforeAnythingStarts) {
  const auto refusal = [&](const std::vector<std::string>& more) {
    const Ending ending = train("refused", 4096, more);
    EXPECT_EQ(ending.exit_code, 2) << ending.err;
    EXPECT_FALSE(fs::exists(scratch_ / "refused"));
    return ending.err;
  };
  EXPECT_THAT(refusal({"--scenario", "rome.cfg"}), HasSubstr("rome.cfg"));
  EXPECT_THAT(refusal({"--scenario", "room.cfg", "--num_agents", "3"}), HasSubstr("supports 1, 2 agents"));
  EXPECT_THAT(refusal({"--scenario", "room.cfg", "--layout_pool", "lost.wad"}),
              HasSubstr("lost.wad: no such WAD"));
  scratch_.write("games/lost.cfg", "\ndoom_scenario_path = lost.wad\navailable_buttons = { ATTACK }\n");
  EXPECT_THAT(refusal({"--scenario", "lost.cfg"}), AllOf(HasSubstr("lost.cfg:2: doom_scenario_path"),
                                                         HasSubstr("lost.wad"), Not(HasSubstr("rebuild"))));
}

}  // namespace vizdoom_config_test
}  // namespace comrad::test
