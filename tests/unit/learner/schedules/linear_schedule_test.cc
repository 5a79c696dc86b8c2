#include "learner/schedules/linear_schedule.h"

#include <gtest/gtest.h>

#include <cmath>

namespace comrad::learn {
namespace linear_schedule_test {

/// `made` after a resume at `env_frames` from a checkpoint of `saved`.
LinearSchedule resumed(const LinearSchedule& saved, LinearSchedule made, double env_frames) {
  StateDict state;
  saved.save(state, "replay/beta");
  EXPECT_TRUE(made.load(state, "replay/beta", env_frames));
  return made;
}

TEST(LinearSchedule, IsALineBetweenItsEndsAndFlatOutside) {
  const LinearSchedule line(0.4, 1.0, 1000);
  EXPECT_DOUBLE_EQ(line.at(0), 0.4);
  EXPECT_DOUBLE_EQ(line.at(500), 0.7);
  EXPECT_DOUBLE_EQ(line.at(1000), 1.0);
  EXPECT_DOUBLE_EQ(line.at(5000), 1.0);
  EXPECT_DOUBLE_EQ(LinearSchedule(0.4, 1.0, 0).at(0), 1.0);
}

TEST(LinearSchedule, ContinuesFromWhereItWasWhenTheRunIsMadeLonger) {
  const LinearSchedule line = resumed({0.4, 1.0, 1000}, {0.4, 1.0, 3000}, 500);
  EXPECT_DOUBLE_EQ(line.at(500), 0.7);  // a line from 0 to 3000 would stand at 0.5
  EXPECT_DOUBLE_EQ(line.at(1750), 0.85);
  EXPECT_DOUBLE_EQ(line.at(3000), 1.0);
  EXPECT_DOUBLE_EQ(line.at(100), 0.7) << "frames before the anchor";
  // A second extension begins where the first one led to.
  const LinearSchedule again = resumed(line, {0.4, 1.0, 6000}, 1750);
  EXPECT_DOUBLE_EQ(again.at(1750), 0.85);
  EXPECT_DOUBLE_EQ(again.at(6000), 1.0);
  // A falling line, cut shorter.
  const LinearSchedule rate = resumed({1e-3, 0, 1000}, {1e-3, 0, 600}, 400);
  EXPECT_DOUBLE_EQ(rate.at(400), 6e-4);
  EXPECT_DOUBLE_EQ(rate.at(500), 3e-4);
  EXPECT_DOUBLE_EQ(rate.at(600), 0);
}

TEST(LinearSchedule, ResumesTheSameLineToTheLastBit) {
  const LinearSchedule line = resumed({0.4, 1.0, 1000}, {0.4, 1.0, 3000}, 457);
  const LinearSchedule same = resumed(line, {0.4, 1.0, 3000}, 1111);
  for (double frames = 0; frames < 3500; frames += 37) EXPECT_EQ(same.at(frames), line.at(frames));
}

TEST(LinearSchedule, TakesNewEndsOverFromTheSettings) {
  const LinearSchedule line = resumed({0.4, 1.0, 1000}, {0.6, 1.0, 1000}, 500);
  EXPECT_DOUBLE_EQ(line.at(500), 0.8);
}

TEST(LinearSchedule, ReadsOlderCheckpointsAndRefusesBrokenOnes) {
  LinearSchedule line(0.4, 1.0, 1000);
  StateDict state;
  EXPECT_TRUE(line.load(state, "replay/beta", 500));
  EXPECT_DOUBLE_EQ(line.at(500), 0.7);
  line.save(state, "replay/beta");
  state.put("replay/beta_anchor_value", std::nan(""));
  EXPECT_EQ(line.load(state, "replay/beta", 500).error().code, ErrorCode::kBadFormat);
  state.put("replay/beta_anchor_value", std::string("much"));
  EXPECT_EQ(line.load(state, "replay/beta", 500).error().code, ErrorCode::kBadFormat);
}

}  // namespace linear_schedule_test
}  // namespace comrad::learn
