// A .cfg as a scenario, as agents play it and as `comrad trace` does: files of ViZDoom's package where it is installed, and a
// room made by hand everywhere. Rewards, tic by tic, are compared with ViZDoom's own by tests/parity/vizdoom_parity.py.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>

#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/action_heads.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/trace/trace_game.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/vizdoom_python.h"
#include "tests/support/vizdoom_room.h"

namespace comrad::sim {
namespace vizdoom_play_test {

using ::testing::HasSubstr;

Expected<std::shared_ptr<const DoomGame>> load(const std::string& cfg, int num_agents, int frame_skip) {
  COMRAD_TRY_ASSIGN(const scenarios::ScenarioSpec spec, scenarios::load_scenario(cfg));
  EnvironmentOptions options;
  options.scenario = cfg;
  options.wad_path = spec.folder + "/" + spec.wad;
  options.num_agents = num_agents;
  options.frame_skip = frame_skip;
  return load_doom_game(options);
}

/// Plays `decisions` random choices of one player. Returns how many were rewarded.
int play(const std::string& cfg, int decisions, uint64_t seed) {
  const auto game = load(cfg, 1, 4);
  if (!game) {
    ADD_FAILURE() << game.error().message;
    return 0;
  }
  DoomEnvironment environment(*game);
  environment.reset(seed);
  const EnvShape& shape = environment.shape();
  std::vector<int32_t> action(static_cast<std::size_t>(shape.head_count));
  Rng rng(seed);
  int rewarded = 0;
  for (int i = 0; i < decisions; ++i) {
    for (int head = 0; head < shape.head_count; ++head)
      action[static_cast<std::size_t>(head)] =
          static_cast<int32_t>(rng.below(static_cast<uint32_t>(shape.head_sizes[head])));
    environment.step(action);
    rewarded += environment.last_step().reward[0] != 0;
    if (environment.last_step().episode_over()) environment.reset(++seed);
  }
  return rewarded;
}

TEST(VizdoomPlay, EveryCfgOfThePackagePlaysAndPays) {
  const Expected<std::string> folder = test::vizdoom_scenario_folder();
  if (!folder) GTEST_SKIP() << folder.error().message;
  int count = 0, paying = 0;
  for (const auto& entry : std::filesystem::directory_iterator(*folder)) {
    const std::string name = entry.path().stem().string();
    if (entry.path().extension() != ".cfg") continue;
    SCOPED_TRACE(name);
    ++count;
    auto spec = scenarios::load_scenario(entry.path().string());
    ASSERT_TRUE(spec) << spec.error().message;
    const Status heads = scenarios::change_heads(*spec, "");
    EXPECT_TRUE(heads) << heads.error().message;
    if (spec->wad.starts_with("freedoom") || spec->wad.starts_with("doom"))
      continue;  // no map of the package's
    paying += play(entry.path().string(), 200, 7) > 0 ? 1 : 0;
  }
  EXPECT_GE(count, 20);
  EXPECT_GE(paying, 8);
}

class VizdoomRoom : public testing::Test {
 protected:
  VizdoomRoom() { scratch_.write("room.wad", test::room_wad({"MAP01"}, 2)); }
  std::string cfg(const std::string& more) const {
    return scratch_.write(
        "room.cfg",
        "doom_scenario_path = room.wad\nliving_reward = -0.5\ndeath_penalty = 7\nitem_reward = 3\n"
        "episode_start_time = 5\nepisode_timeout = 100\n"
        "available_buttons = { MOVE_FORWARD MOVE_BACKWARD TURN_LEFT_RIGHT_DELTA }\n" +
            more);
  }
  const test::ScratchFolder scratch_;
};

TEST_F(VizdoomRoom, TimeoutTruncatesAndLivingPaysEachTic) {
  const auto game = load(cfg(""), 1, 8);
  ASSERT_TRUE(game) << game.error().message;
  DoomEnvironment environment(*game);
  environment.reset(1);
  EXPECT_EQ(environment.world().tic_count(), 5u);
  const std::vector<int32_t> nothing(2, 0);
  double sum = 0;
  while (!environment.last_step().episode_over()) {
    environment.step(nothing);
    sum += environment.last_step().reward[0];
  }
  EXPECT_TRUE(environment.last_step().truncated);
  EXPECT_EQ(environment.world().tic_count(), 105u);
  EXPECT_DOUBLE_EQ(sum, -50.0);
  EXPECT_FLOAT_EQ(environment.summary().score, -50.0f);
}

TEST_F(VizdoomRoom, ATraceIsPaidInDoublesAndNeedsNeitherButtonsNorATimeout) {
  scratch_.write(
      "trace.cfg",
      "doom_scenario_path = room.wad\nliving_reward = 0.1\ndeath_penalty = 7\nepisode_timeout = 100\n");
  for (const bool no_timeout : {false, true}) {
    trace::GameOptions options;
    options.target = scratch_ / "trace.cfg";
    options.no_timeout = no_timeout;
    const auto game = trace::open_trace_game(options);
    ASSERT_TRUE(game) << game.error().message;
    EXPECT_THAT((*game)->buttons, testing::IsEmpty());
    (*game)->reset(1);
    double sum = 0;
    for (int tic = 0; tic < 99; ++tic) sum += (*game)->step({});
    EXPECT_FALSE((*game)->finished());
    sum += (*game)->step({});
    EXPECT_EQ((*game)->finished(), !no_timeout);
    EXPECT_NEAR(sum, 10, 1e-12) << "0.1 of a float is 1.5e-9 more";
  }
}

TEST_F(VizdoomRoom, ATraceHasTheHealthOfADeadBody) {
  trace::GameOptions options;
  options.target = cfg("");
  const auto game = trace::open_trace_game(options);
  ASSERT_TRUE(game) << game.error().message;
  (*game)->reset(1);
  doom::damage_player((*game)->world(), 0, 1000);
  EXPECT_FLOAT_EQ(static_cast<float>((*game)->step({})), -7.5f);
  EXPECT_TRUE((*game)->finished());
  EXPECT_LT((*game)->variable(scenarios::find_variable("HEALTH").value()), 0);
}

TEST_F(VizdoomRoom, ALonePlayersDeathEndsTheEpisodeAndOneOfSeveralComesBack) {
  for (const int agents : {1, 2}) {
    const auto game = load(cfg(""), agents, 4);
    ASSERT_TRUE(game) << game.error().message;
    DoomEnvironment environment(*game);
    environment.reset(1);
    doom::damage_player(environment.world(), 0, 1000);
    environment.step(std::vector<int32_t>(static_cast<std::size_t>(2 * agents), 0));
    EXPECT_FLOAT_EQ(environment.last_step().reward[0], agents == 1 ? -7.5f : -9.0f);
    EXPECT_EQ(environment.last_step().terminated, agents == 1);
    EXPECT_EQ((*game)->spec.respawn, agents == 2);
  }
}

TEST_F(VizdoomRoom, TheDeadOfANetworkGameOfOneComeBackByForceOrByUse) {
  struct Case {
    const char* arguments;
    bool uses;
    int back_after_tics;  // 0: never
  };
  for (const auto& [arguments, uses, back_after_tics] :
       {Case{"-host 1 -deathmatch +sv_forcerespawn 1", false, 36}, Case{"-host 1", true, 36},
        Case{"-host 1", false, 0}, Case{"-host 1 +sv_forcerespawn 1 +viz_respawn_delay 2", false, 71},
        Case{"-host 1 +sv_forcerespawn 1 +viz_respawn_delay 0", false, 2}}) {
    SCOPED_TRACE(arguments);
    const auto game = load(cfg(std::string("game_args = ") + arguments + "\n"), 1, 1);
    ASSERT_TRUE(game) << game.error().message;
    DoomEnvironment environment(*game);
    environment.reset(1);
    doom::damage_player(environment.world(), 0, 1000);
    std::vector<doom::Buttons> pressed(1);
    pressed[0].use = uses;
    int tics = 0, back = 0;
    double sum = 0;
    while (!environment.last_step().episode_over()) {
      environment.press(pressed);
      sum += environment.last_step().reward[0];
      if (back == 0 && environment.world().player(0).alive) back = tics + 1;
      ++tics;
    }
    EXPECT_TRUE(environment.last_step().truncated);
    EXPECT_EQ(tics, 100);
    EXPECT_EQ(back, back_after_tics);
    const int dead_tics = back == 0 ? tics : back - 1;
    EXPECT_DOUBLE_EQ(sum, -0.5 * tics - 7.0 * dead_tics) << "each decision of the dead is paid for";
  }
}

TEST_F(VizdoomRoom, ClRunTurnsSpeedRound) {
  const auto walked = [&](const char* argument, bool speed) {
    const auto game = load(cfg(std::string("game_args = ") + argument + "\n"), 1, 1);
    EXPECT_TRUE(game) << game.error().message;
    DoomEnvironment environment(*game);
    environment.reset(1);
    const double begin = doom::to_double(environment.world().body(0).y);
    std::vector<doom::Buttons> pressed(1);
    pressed[0].forward = true, pressed[0].speed = speed;
    for (int tic = 0; tic < 10; ++tic) environment.press(pressed);
    return doom::to_double(environment.world().body(0).y) - begin;
  };
  EXPECT_GT(walked("+cl_run 1", false), 1.5 * walked("+cl_run 0", false));
  EXPECT_EQ(walked("+cl_run 1", false), walked("", true));
  EXPECT_EQ(walked("+cl_run 1", true), walked("", false));
}

TEST_F(VizdoomRoom, ATracePlaysTheFirstMapWhereNoneIsNamed) {
  scratch_.write("room.wad", test::room_wad({"MAP00"}, 1));
  trace::GameOptions options;
  options.target = cfg("");
  const auto game = trace::open_trace_game(options);
  ASSERT_TRUE(game) << game.error().message;
  EXPECT_THAT((*game)->title, HasSubstr("MAP00"));
}

TEST_F(VizdoomRoom, TheOnlyMapOfALayoutIsPlayedWhateverItsName) {
  EnvironmentOptions options;
  options.scenario = cfg("doom_map = MAP01\n");
  options.wad_path = scratch_.write("other.wad", test::room_wad({"MAP31"}, 1));
  options.num_agents = 1;
  options.frame_skip = 1;
  const auto game = load_doom_game(options);
  ASSERT_TRUE(game) << game.error().message;
  EXPECT_EQ((*game)->level->name, "MAP31");
}

TEST_F(VizdoomRoom, AThirdPlayerFindsNoStart) {
  const auto game = load(cfg(""), 3, 4);
  ASSERT_FALSE(game);
  EXPECT_THAT(game.error().message, HasSubstr("1, 2"));
}

}  // namespace vizdoom_play_test
}  // namespace comrad::sim
