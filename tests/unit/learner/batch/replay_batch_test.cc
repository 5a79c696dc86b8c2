#include "learner/batch/replay_batch.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <cmath>

#include "tests/support/slab_pool.h"

namespace comrad::learn {
namespace replay_batch_test {

using replay::Draw;
using replay::Unit;
using test::SlabPool;

constexpr double kGamma = 0.9;

TrajectoryShape shape_of() {
  TrajectoryShape shape;
  shape.env.num_agents = 2;
  shape.env.height = 4;
  shape.env.width = 5;
  shape.env.measurement_count = 3;
  shape.env.global_state_count = 2;
  shape.env.head_count = 2;
  shape.env.head_sizes = {3, 2};
  shape.rollout_steps = 6;
  shape.recurrent_state_count = 4;
  return shape;
}

/// A replay of two trajectories of noise: the first with a time-out behind step 2 and an end behind step 4,
/// the second only four steps long.
class ReplayBatchTest : public ::testing::Test {
 protected:
  ReplayBatchTest() : pool_(shape_of(), 2) {
    pool_.fill_with_noise(5);
    const SlabView first = pool_.view(0);
    first.truncated(2) = 1;
    first.final_index(2) = 1;
    for (int agent = 0; agent < 2; ++agent) {
      std::ranges::fill(first.final_frame(1, agent), static_cast<uint8_t>(200 + agent));
      std::ranges::fill(first.final_measurement(1, agent), 0.5f + static_cast<float>(agent));
    }
    std::ranges::fill(first.final_global_state(1), 9.5f);
    first.terminated(4) = 1;
    first.agent_active(3, 1) = 0;
    first.action_mask(3, 0)[1] = 0;
    first.action(3, 0)[0] = 2;
  }

  std::unique_ptr<replay::Replay> replay(Unit unit, bool prioritized = false) const {
    auto made = replay::Replay::create({.store = {.shape = shape_of(), .capacity_bytes = 1 << 20},
                                        .unit = unit,
                                        .prioritized = prioritized});
    EXPECT_TRUE(made) << made.error().message;
    EXPECT_EQ((*made)->insert(pool_.view(0), 6), 12);
    EXPECT_EQ((*made)->insert(pool_.view(1), 4), 8);
    return std::move(*made);
  }
  ReplayBatch batch(const ReplayBatchOptions& options, const std::vector<Draw>& draws) const {
    ReplayBatch batch = make_replay_batch(options);
    fill(batch, options, *replay(options.unit), draws);
    return batch;
  }
  bool is_frame(const Tensor& row, std::span<const uint8_t> frame) const {
    return std::equal(frame.begin(), frame.end(), row.contiguous().data_ptr<uint8_t>());
  }

  SlabPool pool_;
};

TEST_F(ReplayBatchTest, ASequenceIsItsSlabAndItsCutsComeApart) {
  const ReplayBatch got = batch({.shape = shape_of(), .world_count = 2},
                                {Draw{.item = 0, .step = -1, .serial = 7}, Draw{.item = 1, .step = -1}});
  ASSERT_EQ(got.rows(), 4);
  const SlabView first = pool_.view(0);
  for (int t = 0; t <= 6; ++t)
    for (int agent = 0; agent < 2; ++agent) {
      EXPECT_TRUE(is_frame(got.frame[t][agent], first.frame(t, agent))) << t;
      for (int m = 0; m < 3; ++m)
        EXPECT_EQ(got.measurement[t][agent][m].item<float>(),
                  first.measurement(t, agent)[static_cast<std::size_t>(m)]);
      EXPECT_EQ(got.agent_active[t][agent].item<int>(), first.agent_active(t, agent));
      if (t == 6) continue;
      EXPECT_EQ(got.reward[t][agent].item<float>(), first.reward(t, agent));
      EXPECT_EQ(got.action[t][agent][1].item<int>(), first.action(t, agent)[1]);
      EXPECT_EQ(got.valid[t][agent].item<int>(), 1);
      EXPECT_EQ(got.terminated[t][agent].item<int>(), t == 4);
      EXPECT_EQ(got.truncated[t][agent].item<int>(), t == 2);
    }
  EXPECT_TRUE(got.has_action_mask);
  EXPECT_EQ(got.action_mask[3][0][1].item<int>(), 0);
  for (int t = 0; t <= 6; ++t) EXPECT_EQ(got.reset[t][1].item<int>(), t == 3 || t == 5) << t;
  for (int agent = 0; agent < 2; ++agent)
    for (int h = 0; h < 4; ++h)
      EXPECT_EQ(got.recurrent_state[agent][h].item<float>(),
                first.recurrent_state(0, agent)[static_cast<std::size_t>(h)]);
  EXPECT_EQ(got.serial[0], 7);

  ASSERT_EQ(got.final_row, (std::vector<int64_t>{0, 1}));
  EXPECT_EQ(got.final_step, (std::vector<int64_t>{2, 2}));
  EXPECT_EQ(got.final_frame[1].to(torch::kInt64).min().item<int64_t>(), 201);
  EXPECT_EQ(got.final_measurement[0][2].item<float>(), 0.5f);
  for (int world = 0; world < 2; ++world)
    for (int t = 0; t <= (world == 0 ? 6 : 4); ++t)
      for (int k = 0; k < 2; ++k)
        EXPECT_EQ(got.global_state[t][world][k].item<float>(),
                  pool_.view(world).global_state(t)[static_cast<std::size_t>(k)]);
  EXPECT_EQ(got.global_state[6][1].abs().sum().item<float>(), 0.0f) << "behind a short trajectory";
  ASSERT_EQ(got.final_global_state.sizes(), (std::vector<int64_t>{1, 2}));
  EXPECT_EQ(got.final_global_state.min().item<float>(), 9.5f);
}

TEST_F(ReplayBatchTest, StepsBehindAShortTrajectoryAreNotValid) {
  const ReplayBatch got = batch({.shape = shape_of(), .world_count = 1}, {Draw{.item = 1, .step = -1}});
  for (int t = 0; t < 6; ++t) EXPECT_EQ(got.valid[t][0].item<int>(), t < 4) << t;
  EXPECT_TRUE(is_frame(got.frame[4][1], pool_.view(1).frame(4, 1)));  // behind the last step
  EXPECT_EQ(got.frame[5].to(torch::kInt64).sum().item<int64_t>(), 0);
  EXPECT_TRUE(torch::isfinite(got.reward).all().item<bool>());
}

TEST_F(ReplayBatchTest, AJointDecisionHasTheTrueNextObservation) {
  const ReplayBatchOptions options{.shape = shape_of(), .unit = Unit::kJointStep, .world_count = 3};
  const ReplayBatch got = batch(options, {Draw{.item = 0, .step = 1, .weight = 0.25},
                                          Draw{.item = 0, .step = 2}, Draw{.item = 1, .step = 3}});
  ASSERT_EQ(got.steps(), 1);
  ASSERT_EQ(got.rows(), 6);
  EXPECT_TRUE(is_frame(got.frame[0][1], pool_.view(0).frame(1, 1)));
  EXPECT_TRUE(is_frame(got.frame[1][1], pool_.view(0).frame(2, 1)));
  EXPECT_FLOAT_EQ(got.weight[0].item<float>(), 0.25f);
  // Cut by time: its own last observation, not the next episode's first.
  EXPECT_EQ(got.frame[1][3].to(torch::kInt64).max().item<int64_t>(), 201);
  EXPECT_EQ(got.measurement[1][2][0].item<float>(), 0.5f);
  EXPECT_EQ(got.global_state[0][1][1].item<float>(), pool_.view(0).global_state(2)[1]);
  EXPECT_EQ(got.global_state[1][1].min().item<float>(), 9.5f);
  EXPECT_EQ(got.truncated[0][2].item<int>(), 1);
  EXPECT_TRUE(is_frame(got.frame[1][4], pool_.view(1).frame(4, 0)));
  EXPECT_TRUE(got.final_row.empty());
}

TEST_F(ReplayBatchTest, AnAgentsDecisionAddsUpRewardsUntilNOrTheEnd) {
  const ReplayBatchOptions options{.shape = shape_of(),
                                   .unit = Unit::kAgentStep,
                                   .world_count = 4,
                                   .n_step = 3,
                                   .pay = {.gamma = kGamma, .reward_clip = 0.3}};
  const ReplayBatch got =
      batch(options, {Draw{.item = 0, .step = 0, .agent = 1}, Draw{.item = 0, .step = 1, .agent = 0},
                      Draw{.item = 0, .step = 3, .agent = 0}, Draw{.item = 1, .step = 2, .agent = 1}});
  ASSERT_EQ(got.rows(), 4);
  const auto sum = [&](int slab, int agent, int first, int last) {
    double total = 0;
    for (int t = first; t <= last; ++t)
      total += std::pow(kGamma, t - first) * std::clamp(double{pool_.view(slab).reward(t, agent)}, -0.3, 0.3);
    return total;
  };
  // Steps 0 to 2 end in a time-out, 1 and 2 as well, 3 and 4 in an end, 2 and 3 with the trajectory.
  const std::vector<std::pair<double, double>> expected = {{sum(0, 1, 0, 2), kGamma * kGamma},
                                                           {sum(0, 0, 1, 2), kGamma},
                                                           {sum(0, 0, 3, 4), kGamma},
                                                           {sum(1, 1, 2, 3), kGamma}};
  for (int64_t i = 0; i < 4; ++i) {
    EXPECT_NEAR(got.reward[0][i].item<double>(), expected[static_cast<std::size_t>(i)].first, 1e-6) << i;
    EXPECT_NEAR(got.bootstrap[0][i].item<double>(), expected[static_cast<std::size_t>(i)].second, 1e-6) << i;
  }
  EXPECT_EQ(got.truncated[0][0].item<int>(), 1);
  EXPECT_EQ(got.frame[1][0].to(torch::kInt64).min().item<int64_t>(), 201);
  EXPECT_EQ(got.terminated[0][2].item<int>(), 1);
  EXPECT_TRUE(is_frame(got.frame[1][3], pool_.view(1).frame(4, 1)));
}

/// Agent 1 leaves the game behind step 1 and is paid at step 3, while the world continues to step 4.
class DeadAgentTest : public ReplayBatchTest {
 protected:
  DeadAgentTest() {
    const SlabView first = pool_.view(0);
    first.truncated(2) = 0;
    first.final_index(2) = -1;
    first.agent_active(2, 1) = 0, first.agent_active(4, 1) = 0;  // row 3 is inactive already
    for (int t = 0; t < 6; ++t) first.reward(t, 1) = 0.1f * static_cast<float>(t + 1);
    first.reward(3, 1) = -5;
  }
  ReplayBatchOptions options(Unit unit, int64_t n_step, bool agents_end = true) const {
    return {.shape = shape_of(),
            .unit = unit,
            .world_count = 1,
            .n_step = n_step,
            .pay = {.gamma = kGamma, .reward_clip = 1},
            .agents_end = agents_end};
  }
  /// Of step 1: its own reward and those of steps 2 to 4, at which the episode ends.
  const double paid_ = 0.2 + kGamma * 0.3 - kGamma * kGamma + std::pow(kGamma, 3) * 0.5;
};

TEST_F(DeadAgentTest, ItsLastDecisionIsTerminatedAndPaidWhatFollows) {
  for (const Unit unit : {Unit::kAgentStep, Unit::kJointStep}) {
    const int64_t row = unit == Unit::kJointStep ? 1 : 0;
    const ReplayBatch got = batch(options(unit, 1), {Draw{.item = 0, .step = 1, .agent = 1}});
    EXPECT_NEAR(got.reward[0][row].item<double>(), paid_, 1e-6);
    EXPECT_EQ(got.terminated[0][row].item<int>(), 1);
    EXPECT_EQ(got.rewards_clipped, 1);
  }
  const ReplayBatch before = batch(options(Unit::kAgentStep, 1), {Draw{.item = 0, .step = 0, .agent = 1}});
  EXPECT_NEAR(before.reward[0][0].item<double>(), 0.1, 1e-6);
  EXPECT_EQ(before.terminated[0][0].item<int>(), 0);
  EXPECT_EQ(before.rewards_read, 1);
}

TEST_F(DeadAgentTest, ManyStepsOfRewardEndWithItsWayAndTheOtherAgentPlaysOn) {
  const ReplayBatch got = batch(options(Unit::kJointStep, 3), {Draw{.item = 0, .step = 0}});
  EXPECT_NEAR(got.reward[0][1].item<double>(), 0.1 + kGamma * paid_, 1e-6);
  EXPECT_EQ(got.terminated[0][1].item<int>(), 1);
  double other = 0;
  for (int t = 0; t < 3; ++t) other += std::pow(kGamma, t) * double{pool_.view(0).reward(t, 0)};
  EXPECT_NEAR(got.reward[0][0].item<double>(), other, 1e-6);
  EXPECT_EQ(got.terminated[0][0].item<int>(), 0);
  EXPECT_NEAR(got.bootstrap[0][0].item<double>(), kGamma * kGamma, 1e-6);
}

TEST_F(DeadAgentTest, ASequenceEndsForItAlone) {
  const ReplayBatch got = batch(options(Unit::kSequence, 1), {Draw{.item = 0, .step = -1}});
  for (int t = 0; t < 6; ++t) {
    EXPECT_EQ(got.terminated[t][0].item<int>(), t == 4) << t;
    EXPECT_EQ(got.terminated[t][1].item<int>(), t == 1 || t == 4) << t;
    EXPECT_EQ(got.reset[t][1].item<int>(), t == 5) << "the core runs on, " << t;
  }
  EXPECT_NEAR(got.reward[1][1].item<double>(), paid_, 1e-6);
}

TEST_F(DeadAgentTest, ATeamPlaysOnWithoutIt) {
  for (const Unit unit : {Unit::kSequence, Unit::kJointStep}) {
    const int step = unit == Unit::kSequence ? -1 : 1;
    const ReplayBatch got = batch(options(unit, 1, false), {Draw{.item = 0, .step = step}});
    const int64_t t = unit == Unit::kSequence ? 1 : 0;
    EXPECT_FLOAT_EQ(got.reward[t][1].item<float>(), 0.2f);
    EXPECT_EQ(got.terminated[t][1].item<int>(), 0);
  }
}

TEST_F(ReplayBatchTest, ADiscountOfZeroLeavesTheRewardAlone) {
  for (const int64_t n_step : {1, 3}) {
    const ReplayBatch got = batch({.shape = shape_of(),
                                   .unit = Unit::kAgentStep,
                                   .world_count = 1,
                                   .n_step = n_step,
                                   .pay = {.gamma = 0}},
                                  {Draw{.item = 0, .step = 0, .agent = 0}});
    EXPECT_EQ(got.reward[0][0].item<float>(), pool_.view(0).reward(0, 0));
    EXPECT_EQ(got.bootstrap[0][0].item<float>(), n_step == 1 ? 1.0f : 0.0f);
  }
}

TEST_F(ReplayBatchTest, AnEvictedTrajectoryLeavesAWorldWithoutValidSteps) {
  const ReplayBatch got = batch({.shape = shape_of(), .world_count = 2},
                                {Draw{.item = 55, .step = -1}, Draw{.item = 1, .step = -1}});
  EXPECT_EQ(got.valid.narrow(1, 0, 2).sum().item<int64_t>(), 0);
  EXPECT_GT(got.valid.narrow(1, 2, 2).sum().item<int64_t>(), 0);
}

TEST_F(ReplayBatchTest, PartsKeepTheirOwnCuts) {
  const ReplayBatch got = batch({.shape = shape_of(), .world_count = 2},
                                {Draw{.item = 1, .step = -1}, Draw{.item = 0, .step = -1}});
  EXPECT_EQ(got.final_row, (std::vector<int64_t>{2, 3}));
  const ReplayBatch second = narrow_worlds(got, 1, 1);
  EXPECT_EQ(second.final_row, (std::vector<int64_t>{0, 1}));
  EXPECT_EQ(second.final_frame.size(0), 2);
  EXPECT_TRUE(torch::equal(second.frame, got.frame.narrow(1, 2, 2)));
  EXPECT_TRUE(narrow_worlds(got, 0, 1).final_row.empty());
  EXPECT_TRUE(torch::equal(second.global_state, got.global_state.narrow(1, 1, 1)));
  EXPECT_TRUE(torch::equal(second.final_global_state, got.final_global_state));
  EXPECT_EQ(narrow_worlds(got, 0, 1).final_global_state.size(0), 0);

  const Tensor state = torch::ones({2, 4});
  const ReplayBatch later = steps_from(second, 2, state);
  EXPECT_EQ(later.steps(), 4);
  EXPECT_EQ(later.final_step, (std::vector<int64_t>{0, 0}));
  EXPECT_TRUE(torch::equal(later.reward, second.reward.narrow(0, 2, 4)));
  EXPECT_TRUE(torch::equal(later.global_state, second.global_state.narrow(0, 2, 5)));
  EXPECT_EQ(later.final_global_state.size(0), 1);
  EXPECT_TRUE(steps_from(second, 3, state).final_step.empty());
}

}  // namespace replay_batch_test
}  // namespace comrad::learn
