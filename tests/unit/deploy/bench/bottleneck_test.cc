#include "deploy/bench/bottleneck.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace bottleneck_test {

using ::testing::AllOf;
using ::testing::EndsWith;
using ::testing::HasSubstr;
using ::testing::Not;
using ::testing::StartsWith;

/// Two cores, half idle, no component saturated.
PipelineNumbers calm() {
  return {.cores = 2,
          .cores_busy = 0.5,
          .others_busy = 0,
          .sim_busy = 0.3,
          .policy_busy = 0.3,
          .learner_busy = 0.3,
          .stage_cpu_s = {1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1},
          .num_workers = 2,
          .num_envs_per_worker = 8,
          .policy_workers = 1,
          .learner_threads = 1,
          .is_fp32 = true,
          .is_on_gpu = false};
}

TEST(Bottleneck, OfBusyCoresIsTheStageThatTakesMost) {
  PipelineNumbers numbers = calm();
  numbers.cores_busy = 0.97;
  numbers.learner_busy = 1;
  numbers.stage_cpu_s = {2, 10, 0.5, 0.2, 0, 0, 8, 0.3, 1, 27, 1, 0};
  EXPECT_EQ(bottleneck_text(numbers),
            "all cores are busy (97 %) and the learner's forward and backward pass takes 54 % of the run's "
            "processor time; "
            "--precision bf16 may make it cheaper, more cores will.");
  numbers.is_fp32 = false;
  EXPECT_THAT(bottleneck_text(numbers),
              AllOf(EndsWith("; only more cores make it faster."), Not(HasSubstr("bf16"))));
  numbers.stage_cpu_s[static_cast<std::size_t>(Stage::kRender)] = 100;
  EXPECT_THAT(bottleneck_text(numbers), AllOf(HasSubstr("drawing takes"), HasSubstr("more cores")));
}

TEST(Bottleneck, EveryStageHasWordsAndAdvice) {
  for (std::size_t i = 0; i < kStageCount; ++i) {
    PipelineNumbers numbers = calm();
    numbers.cores_busy = 1;
    numbers.stage_cpu_s = {};
    numbers.stage_cpu_s[i] = 1;
    const std::string text = bottleneck_text(numbers);
    EXPECT_THAT(text, HasSubstr(" takes 100 % of")) << name_of(static_cast<Stage>(i));
    EXPECT_THAT(text, Not(HasSubstr("and  takes"))) << name_of(static_cast<Stage>(i));
  }
}

TEST(Bottleneck, OfIdleCoresIsTheComponentThatNeverWaits) {
  PipelineNumbers numbers = calm();
  numbers.learner_busy = 0.98;
  EXPECT_EQ(
      bottleneck_text(numbers),
      "the learner never waits (busy 98 %), and 50 % of the cores' time is idle; set --learner_threads 2.");
  numbers.learner_threads = 2;
  EXPECT_THAT(bottleneck_text(numbers), EndsWith("set a larger --micro_batch_size."));
  numbers.is_on_gpu = true;
  EXPECT_THAT(bottleneck_text(numbers), EndsWith("set a larger --batch_size."));
  numbers = calm();
  numbers.policy_busy = 0.9;
  EXPECT_THAT(bottleneck_text(numbers),
              AllOf(StartsWith("the policy workers"), EndsWith("set --policy_workers 2.")));
  numbers.is_on_gpu = true;
  EXPECT_THAT(bottleneck_text(numbers), HasSubstr("set --num_envs_per_worker 16: policy workers take turns"));
  numbers = calm();
  numbers.sim_busy = 0.9;
  EXPECT_THAT(bottleneck_text(numbers),
              AllOf(StartsWith("the simulators"), EndsWith("set --num_workers 3.")));
}

TEST(Bottleneck, WhereAllWaitItIsTheHandOvers) {
  EXPECT_THAT(bottleneck_text(calm()),
              AllOf(StartsWith("no component is saturated"), EndsWith("set --num_envs_per_worker 16.")));
}

TEST(Bottleneck, OtherProgramsAreNamedWhereTheyMatter) {
  PipelineNumbers numbers = calm();
  numbers.others_busy = 0.05;
  EXPECT_THAT(bottleneck_text(numbers), StartsWith("no component"));
  numbers.others_busy = 0.4;
  EXPECT_THAT(bottleneck_text(numbers),
              StartsWith("Beside other programs, which took 40 % of the cores: no component"));
}

TEST(Bottleneck, NothingMeasuredIsNoStage) {
  PipelineNumbers numbers = calm();
  numbers.cores_busy = 1;
  numbers.stage_cpu_s = {};
  EXPECT_EQ(bottleneck_text(numbers), "all cores are busy (100 %), only more cores make it faster.");
}

}  // namespace bottleneck_test
}  // namespace comrad::deploy
