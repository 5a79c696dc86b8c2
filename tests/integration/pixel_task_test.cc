// A task that is learned from pixels, by real processes: `comrad train` in one room of the engine with a target of
// one colour (target_room/). Turning blindly, to one side, at random or not at all, faces the post in an eighth of
// all decisions: 5 of 40. An agent that turns until it sees the post and stops there scores about 30.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>

#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/picture.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"
#include "rollout_buffer/core/files.h"
#include "scenarios/spec/scenario_spec.h"
#include "scenarios/spec/script_build.h"
#include "tests/integration/running_program.h"

namespace comrad::test {
namespace pixel_task_test {

constexpr int kPostX = 0, kPostY = 192;
constexpr double kBlindScore = 5;
constexpr double kScore =
    18;  ///< of a hundred episodes; more than ten standard deviations above a blind policy's mean
constexpr const char* kEnvFrames = "1500000";  ///< by which it is reached

/// Copies the scenario and draws its map; the folder's path.
std::string make_scenario(const ScratchFolder& scratch) {
  const std::string folder = scratch / "target_room", source = data_dir() + "/tests/integration/target_room";
  std::filesystem::copy(source, folder);
  doomgen::MapPlan plan;
  plan.add_area({.name = "room",
                 .floor_texture = "FLAT19",
                 .ceiling_texture = "FLAT19",
                 .wall_texture = "GRAYWALL",
                 .light = 224},
                doomgen::Box::around({0, 0}, 512, 512));
  plan.add_pillar(doomgen::Box::around({kPostX, kPostY}, 64, 64), "REDPOST");
  plan.add_start(1, {-96, -96}, 0);
  plan.add_start(2, {96, -96}, 0);
  const auto map = plan.build();
  EXPECT_TRUE(map) << map.error().message;
  const auto spec = scenarios::load_scenario(folder);
  EXPECT_TRUE(spec) << spec.error().message;
  const auto script = scenarios::build_script(*spec, "#define POST_X " + std::to_string(kPostX) +
                                                         "\n#define POST_Y " + std::to_string(kPostY) + "\n");
  EXPECT_TRUE(script) << script.error().message;
  doomgen::WadWriter wad;
  EXPECT_TRUE(wad.add("TX_START", {}));
  EXPECT_TRUE(wad.add("REDPOST", doomgen::encode_png(doomgen::Picture(64, 64, {220, 0, 0, 255}))));
  EXPECT_TRUE(wad.add("GRAYWALL", doomgen::encode_png(doomgen::Picture(64, 64, {96, 96, 96, 255}))));
  EXPECT_TRUE(wad.add("TX_END", {}));
  EXPECT_TRUE(wad.add_udmf_map("MAP01", doomgen::write_udmf(*map), script->behavior, script->source));
  scratch.write("target_room/room.wad", *wad.bytes());
  return folder;
}

/// A run's command; `link` selects how simulators reach the policy.
std::vector<std::string> command(const ScratchFolder& scratch, const std::string& link) {
  std::vector<std::string> words = {program("comrad"), "train"};
  for (const auto& [flag, value] :
       std::vector<std::pair<std::string, std::string>>{{"--scenario", "target_room"},
                                                        {"--link", link},
                                                        {"--algo", "ippo"},
                                                        {"--train_dir", scratch.string()},
                                                        {"--experiment", "run"},
                                                        {"--device", "cpu"},
                                                        {"--num_workers", "1"},
                                                        {"--num_envs_per_worker", "16"},
                                                        {"--rollout", "20"},
                                                        {"--batch_size", "640"},
                                                        {"--num_epochs", "2"},
                                                        {"--use_rnn", "False"},
                                                        {"--encoder", "impala"},
                                                        {"--learning_rate", "5e-4"},
                                                        {"--gamma", "0.95"},
                                                        {"--exploration_loss", "entropy"},
                                                        {"--exploration_loss_coeff", "0.003"},
                                                        {"--stats_avg", "100"},
                                                        {"--progress_interval", "1"},
                                                        {"--experiment_summaries_interval", "1"},
                                                        {"--train_for_env_frames", kEnvFrames}})
    words.insert(words.end(), {flag, value});
  return words;
}

class PixelTask : public ::testing::TestWithParam<const char*> {};

TEST_P(PixelTask, TwoAgentsLearnToFaceARedPost) {
  const ScratchFolder scratch;
  const std::string scenario = make_scenario(scratch);
  const Ending random = comrad(
      {"eval", "--policy", "random", "--scenario", scenario, "--episodes", "200", "--seed", "1", "--json"});
  ASSERT_EQ(random.exit_code, 0) << random.err;
  const double random_score = nlohmann::json::parse(random.out).value("J_mean", 1e9);
  EXPECT_LT(random_score, 2 * kBlindScore);

  RunningProgram training(command(scratch, GetParam()), {{"COMRAD_SCENARIO_PATH", scratch.string()}});
  const auto score = [&] {  // of the last hundred episodes
    const nlohmann::json status = read_json(scratch / "run/status.json");
    return status.is_object() && status["J_mean"].is_number() ? status["J_mean"].get<double>() : -1.0;
  };
  const double began_s = now_s();
  const bool learned =
      wait_until([&] { return score() >= kScore || !training.running(); }, 3 * kPatienceSeconds);
  std::printf("red post over %s: J %.1f at random, %.1f after %.0f s and %.0f env frames\n", GetParam(),
              random_score, score(), now_s() - began_s, env_frames(scratch / "run"));
  EXPECT_TRUE(learned && training.running()) << "J is " << score();
  training.signal(SIGTERM);
  const Ending ending = training.wait();
  EXPECT_EQ(ending.exit_code, 0) << ending.err;
}

const auto kName = [](const auto& link) { return std::string(link.param); };
INSTANTIATE_TEST_SUITE_P(Links, PixelTask, ::testing::Values("shm"), kName);
INSTANTIATE_TEST_SUITE_P(LinksLong, PixelTask, ::testing::Values("dds"), kName);

}  // namespace pixel_task_test
}  // namespace comrad::test
