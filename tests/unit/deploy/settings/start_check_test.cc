#include "deploy/settings/start_check.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace start_check_test {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

Expected<NetworkSize> a_network(const RunConfig&, const EnvShape&) {
  return NetworkSize{.weights_bytes = 1'000'000, .recurrent_state_count = 512};
}

TEST(CheckStart, RefusesFilesThatAreNotThereAndNetworksThatCannotBeMade) {
  RunConfig config;
  config.run.algo = "ippo";
  const auto refusal = [&](const DescribeNetwork& network = a_network) {
    const Expected<StartCheck> check = check_start(config, EnvShape(), "", network);
    return check ? "accepted" : check.error().message;
  };
  EXPECT_EQ(refusal(), "accepted");
  EXPECT_EQ(refusal([](const RunConfig&, const EnvShape&) -> Expected<NetworkSize> {
              return Error{ErrorCode::kBadInput, "unknown encoder 'mynet'"};
            }),
            "unknown encoder 'mynet'");
  config.curriculum.interestingness_graph_path = "/nowhere/graph.json";
  EXPECT_THAT(refusal(), HasSubstr("interestingness_graph_path is /nowhere/graph.json"));
  config.curriculum.interestingness_graph_path.clear();
  config.environment.layout_pool = "train:0";
  EXPECT_THAT(refusal(), HasSubstr("train:0"));
  config.environment.layout_pool.clear();
  config.environment.wad = "/nowhere/a.wad";
  EXPECT_THAT(refusal(), HasSubstr("/nowhere/a.wad"));
}

TEST(LearningBegins, BeforeTheRunEndsOrTheStartIsRefusedWithBothNumbers) {
  RunConfig config;
  config.run.algo = "vdn";
  config.environment.env_frameskip = 4;
  config.q_learning.learning_starts_decisions = 50'000;
  config.run.train_for_env_frames = 60'000;
  replay::ReplayPlan replay{.decisions_before_training = 17'500};
  const Status refused = check_learning_begins(config, replay);
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kBadInput);
  EXPECT_THAT(
      refused.error().message,
      AllOf(HasSubstr("learning begins at 70000 env frames"), HasSubstr("half of what the replay holds"),
            HasSubstr("the run ends at 60000"), HasSubstr("--allow_no_update")));
  config.run.train_for_env_frames = 70'001;
  EXPECT_TRUE(check_learning_begins(config, replay));
  config.q_learning.learning_starts_decisions = 17'500;
  config.run.train_for_env_frames = 70'000;
  const Status by_the_setting = check_learning_begins(config, replay);
  ASSERT_FALSE(by_the_setting);
  EXPECT_THAT(by_the_setting.error().message, Not(HasSubstr("half")));
}

TEST(ChosenReplay, IsThereForQLearningAlone) {
  RunConfig config;
  config.environment.num_agents = 2;
  EnvShape env;
  env.num_agents = 2;
  env.head_count = 1;
  env.head_sizes = {4};
  const NetworkSize network{.weights_bytes = 1'000'000, .recurrent_state_count = 512};
  config.run.algo = "ippo";
  const auto none = chosen_replay(config, env, network, "");
  ASSERT_TRUE(none) << none.error().message;
  EXPECT_FALSE(none->has_value());
  config.run.algo = "qmix";
  config.replay.replay_gb = 0.1;
  const auto some = chosen_replay(config, env, network, "");
  ASSERT_TRUE(some) << some.error().message;
  ASSERT_TRUE(some->has_value());
  EXPECT_GT((*some)->fitting_decisions, 1000);
}

}  // namespace start_check_test
}  // namespace comrad::deploy
