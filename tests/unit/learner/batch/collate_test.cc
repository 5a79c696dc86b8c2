#include "learner/batch/collate.h"

#include <gtest/gtest.h>

#include <limits>
#include <vector>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/slab_pool.h"
#include "tests/support/test_device.h"

namespace comrad::learn {
namespace collate_test {

using test::SlabPool;

TrajectoryShape small_shape() {
  TrajectoryShape shape;
  shape.env.num_agents = 2;
  shape.env.height = 2;
  shape.env.width = 3;
  shape.env.measurement_count = 2;
  shape.env.global_state_count = 3;
  shape.env.head_count = 2;
  shape.env.head_sizes = {3, 2};
  shape.rollout_steps = 4;
  shape.recurrent_state_count = 3;
  shape.final_capacity = 2;
  return shape;
}

TEST(Collate, CopiesEveryFieldOfEveryAgentToItsRow) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 2);
  pool.fill_with_noise(3);
  for (int i = 0; i < 2; ++i)
    for (int t = 0; t < 4; ++t)
      for (int agent = 0; agent < 2; ++agent)
        pool.view(i).policy_version(t, agent) = static_cast<uint32_t>(100 * i + 10 * t + agent);
  for (int i = 0; i < 2; ++i)
    for (int t = 0; t < 4; ++t) pool.view(i).layout_index(t) = 7 * i + t;
  RolloutBatch batch = make_rollout_batch(shape, 2);
  clear(batch);
  EXPECT_EQ(collate_slab(batch, 0, pool.view(1), 4), 0);  // order is the caller's
  EXPECT_EQ(collate_slab(batch, 1, pool.view(0), 4), 0);
  EXPECT_EQ(batch.transitions, 16);
  EXPECT_FALSE(batch.has_action_mask);
  for (int position = 0; position < 2; ++position) {
    const SlabView slab = pool.view(1 - position);
    for (int t = 0; t < 4; ++t)
      for (int k = 0; k < 3; ++k)
        EXPECT_EQ(batch.global_state[t][position][k].item<float>(), slab.global_state(t)[k]);
    for (int agent = 0; agent < 2; ++agent) {
      const int row = position * 2 + agent;
      for (int k = 0; k < 3; ++k)
        EXPECT_EQ(batch.recurrent_state[row][k].item<float>(), slab.recurrent_state(0, agent)[k]);
      for (int t = 0; t < 4; ++t) {
        const Tensor frame = batch.frame[t][row].flatten();
        for (int64_t k = 0; k < shape.env.frame_bytes(); ++k)
          ASSERT_EQ(frame[k].item<uint8_t>(), slab.frame(t, agent)[static_cast<std::size_t>(k)]);
        EXPECT_EQ(batch.measurement[t][row][1].item<float>(), slab.measurement(t, agent)[1]);
        EXPECT_EQ(batch.action[t][row][0].item<int64_t>(), slab.action(t, agent)[0]);
        EXPECT_EQ(batch.action[t][row][1].item<int64_t>(), slab.action(t, agent)[1]);
        EXPECT_EQ(batch.logits[t][row][4].item<float>(), slab.logits(t, agent)[4]);
        EXPECT_EQ(batch.log_prob[t][row].item<float>(), slab.log_prob(t, agent));
        EXPECT_EQ(batch.reward[t][row].item<float>(), slab.reward(t, agent));
        EXPECT_EQ(batch.policy_version[t][row].item<int64_t>(), slab.policy_version(t, agent));
        EXPECT_EQ(batch.layout_index[t][row].item<int>(), slab.layout_index(t));
        EXPECT_EQ(batch.valid[t][row].item<int>(), 1);
        EXPECT_EQ(batch.terminated[t][row].item<int>(), 0);
      }
      for (int t = 0; t <= 4; ++t) EXPECT_EQ(batch.value[t][row].item<float>(), slab.value(t, agent));
    }
  }
}

TEST(Collate, TakesTheFinalValueOfTheEpisodeThatWasCut) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  const SlabView slab = pool.view(0);
  slab.truncated(1) = 1;
  slab.final_index(1) = 0;
  slab.terminated(2) = 1;
  slab.final_index(2) = 1;
  slab.final_value(0, 0) = 0.25f;
  slab.final_value(0, 1) = 0.75f;
  slab.final_value(1, 0) = 9.0f;  // of a termination: not a bootstrap
  RolloutBatch batch = make_rollout_batch(shape, 1);
  clear(batch);
  EXPECT_EQ(collate_slab(batch, 0, slab, 4), 0);
  apply_lag_filter(batch, 0, 1000);
  EXPECT_EQ(batch.final_value[1][0].item<float>(), 0.25f);
  EXPECT_EQ(batch.final_value[1][1].item<float>(), 0.75f);
  EXPECT_EQ(batch.final_value[2][0].item<float>(), 0.0f);
  for (int row = 0; row < 2; ++row) {
    const int expected_reset[] = {0, 0, 1, 1};
    for (int t = 0; t < 4; ++t) EXPECT_EQ(batch.reset[t][row].item<int>(), expected_reset[t]) << "t " << t;
  }
}

TEST(Collate, PadsASlabThatWasSealedEarlyAndKeepsItsBootstrap) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 2);
  pool.fill_with_noise(5);
  RolloutBatch batch = make_rollout_batch(shape, 1);
  clear(batch);
  collate_slab(batch, 0, pool.view(0), 4);  // leaves data behind that must not show
  clear(batch);
  EXPECT_EQ(collate_slab(batch, 0, pool.view(1), 2), 0);
  EXPECT_EQ(batch.transitions, 4);
  const LagStats lag = apply_lag_filter(batch, 0, 1000);
  EXPECT_DOUBLE_EQ(lag.valid_fraction, 0.5);
  EXPECT_EQ(batch.value[2][1].item<float>(), pool.view(1).value(2, 1));
  const int expected_value_valid[] = {1, 1, 1, 0, 0};
  for (int t = 0; t <= 4; ++t)
    EXPECT_EQ(batch.value_valid[t][0].item<int>(), expected_value_valid[t]) << "t " << t;
  for (int t = 2; t < 4; ++t) {
    EXPECT_EQ(batch.valid[t][0].item<int>(), 0);
    EXPECT_EQ(batch.terminated[t][0].item<int>(), 1);
    EXPECT_EQ(batch.reward[t][0].item<float>(), 0);
    EXPECT_EQ(batch.frame[t].max().item<int>(), 0);
  }
}

TEST(Collate, RemembersWhetherAnyActionWasForbidden) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  pool.view(0).action_mask(2, 1)[0] = 0;
  RolloutBatch batch = make_rollout_batch(shape, 1);
  clear(batch);
  collate_slab(batch, 0, pool.view(0), 4);
  EXPECT_TRUE(batch.has_action_mask);
  EXPECT_EQ(batch.mask_or_undefined()[2][1][0].item<int>(), 0);
  EXPECT_EQ(batch.mask_or_undefined()[2][1][1].item<int>(), 1);
  clear(batch);
  EXPECT_FALSE(batch.mask_or_undefined().defined());
}

TEST(Collate, MasksWhatAPeerBrokeAndKeepsTheRest) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  const SlabView slab = pool.view(0);
  slab.action(0, 0)[0] = 3;
  slab.action(0, 1)[1] = -1;
  slab.reward(1, 0) = std::numeric_limits<float>::quiet_NaN();
  slab.final_index(2) = 77;
  slab.recurrent_state(0, 1)[2] = std::numeric_limits<float>::infinity();
  RolloutBatch batch = make_rollout_batch(shape, 1);
  clear(batch);
  EXPECT_EQ(collate_slab(batch, 0, slab, 0xFFFFFFFFu), 7);  // agent 1: all four steps, agent 0: steps 0, 1, 2
  EXPECT_EQ(batch.valid[3][0].item<int>(), 1);
  EXPECT_EQ(batch.valid.sum().item<int>(), 1);
  EXPECT_LT(batch.action.max().item<int64_t>(), 3);
  EXPECT_GE(batch.action.min().item<int64_t>(), 0);
  for (const Tensor& field : {batch.reward, batch.recurrent_state, batch.value, batch.final_value})
    EXPECT_TRUE(field.isfinite().all().item<bool>());
}

TEST(Collate, AStateThatIsNoNumberBreaksTheDecisionsOfAllAgents) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  const SlabView slab = pool.view(0);
  slab.global_state(2)[1] = std::numeric_limits<float>::quiet_NaN();
  RolloutBatch batch = make_rollout_batch(shape, 1);
  clear(batch);
  EXPECT_EQ(collate_slab(batch, 0, slab, 4), 2);
  for (int t = 0; t < 4; ++t)
    for (int row = 0; row < 2; ++row) EXPECT_EQ(batch.valid[t][row].item<int>(), t != 2) << t;
  EXPECT_TRUE(batch.global_state.isfinite().all().item<bool>());
}

TEST(LagFilter, MasksAtTheLimitAndKeepsOneBelow) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 1);
  for (int t = 0; t < 4; ++t)
    for (int agent = 0; agent < 2; ++agent) pool.view(0).policy_version(t, agent) = agent == 0 ? 1000 : 1001;
  pool.view(0).policy_version(3, 1) = 5000;  // of a learner that died: lag 0
  RolloutBatch batch = make_rollout_batch(shape, 1);
  clear(batch);
  collate_slab(batch, 0, pool.view(0), 4);
  const LagStats lag = apply_lag_filter(batch, 2000, 1000);
  for (int t = 0; t < 4; ++t) {
    EXPECT_EQ(batch.valid[t][0].item<int>(), 0);
    EXPECT_EQ(batch.valid[t][1].item<int>(), 1);
  }
  EXPECT_EQ(lag.dropped, 4);
  EXPECT_EQ(lag.max, 1000);
  EXPECT_EQ(lag.min, 0);
  EXPECT_DOUBLE_EQ(lag.mean, (4 * 1000 + 3 * 999) / 8.0);
  EXPECT_DOUBLE_EQ(lag.valid_fraction, 0.5);
  EXPECT_EQ(batch.reset[1][0].item<int>(), 1);  // behind an invalid step
  EXPECT_EQ(batch.reset[1][1].item<int>(), 0);
  EXPECT_EQ(batch.value_valid[4][0].item<int>(), 0);
  EXPECT_EQ(batch.value_valid[4][1].item<int>(), 1);
}

TEST(Collate, SelectsAndNarrowsWholeWorlds) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 3);
  pool.fill_with_noise(9);
  RolloutBatch batch = make_rollout_batch(shape, 3);
  clear(batch);
  for (int i = 0; i < 3; ++i) collate_slab(batch, i, pool.view(i), 4);
  const RolloutBatch selected = select_slabs(batch, {2, 0}), narrowed = narrow_rows(batch, 4, 2);
  EXPECT_EQ(selected.rows(), 4);
  EXPECT_EQ(narrowed.rows(), 2);
  EXPECT_TRUE(torch::equal(selected.frame.narrow(1, 0, 2), narrowed.frame));
  EXPECT_TRUE(torch::equal(selected.reward.narrow(1, 0, 2), narrowed.reward));
  EXPECT_TRUE(torch::equal(selected.recurrent_state.narrow(0, 0, 2), narrowed.recurrent_state));
  EXPECT_TRUE(torch::equal(selected.value.narrow(1, 2, 2), batch.value.narrow(1, 0, 2)));
  EXPECT_TRUE(torch::equal(selected.global_state.narrow(1, 0, 1), narrowed.global_state));
  EXPECT_TRUE(torch::equal(selected.global_state.narrow(1, 1, 1), batch.global_state.narrow(1, 0, 1)));
}

TEST(Collate, AnAgentsRowsAreABatchOfOneAgentAndShareTheMemory) {
  const TrajectoryShape shape = small_shape();
  const SlabPool pool(shape, 3);
  pool.fill_with_noise(9);
  RolloutBatch batch = make_rollout_batch(shape, 3);
  clear(batch);
  for (int i = 0; i < 3; ++i) collate_slab(batch, i, pool.view(i), 4);
  apply_lag_filter(batch, 0, 1000);
  const RolloutBatch second = agent_rows(batch, 1);
  ASSERT_EQ(second.rows(), 3);
  EXPECT_EQ(second.shape.env.num_agents, 1);
  for (int64_t world = 0; world < 3; ++world) {
    EXPECT_TRUE(torch::equal(second.frame.select(1, world), batch.frame.select(1, world * 2 + 1)));
    EXPECT_TRUE(torch::equal(second.value.select(1, world), batch.value.select(1, world * 2 + 1)));
    EXPECT_TRUE(torch::equal(second.recurrent_state[world], batch.recurrent_state[world * 2 + 1]));
    EXPECT_TRUE(
        torch::equal(narrow_rows(second, world, 1).reset[2], batch.reset[2].narrow(0, world * 2 + 1, 1)));
  }
  EXPECT_TRUE(torch::equal(narrow_rows(second, 1, 1).global_state, batch.global_state.narrow(1, 1, 1)));
  second.reward[2][1] = 77;
  EXPECT_EQ(batch.reward[2][3].item<float>(), 77);
}

/// On a GPU (COMRAD_TEST_DEVICE) or on its path on the CPU.
TEST(SendAhead, ThatBatchesFramesAreThereUntilItIsFilledAnew) {
  const torch::Device device = test::test_device();
  const device::OperatorPath path;
  const TrajectoryShape shape = small_shape();
  RolloutBatch batch = make_rollout_batch(shape, 2, device);
  EXPECT_EQ(batch.frame.is_pinned(), device.is_cuda());
  for (int fill = 1; fill <= 2; ++fill) {
    clear(batch);
    batch.frame.fill_(fill);
    batch.frame.select(1, 3).fill_(7);
    send_ahead(batch, device);
    const Tensor there = frames_on(batch, device);
    EXPECT_EQ(there.device().type(), device.type());
    EXPECT_TRUE(torch::equal(there.cpu(), batch.frame));
    const RolloutBatch moved = to_device(batch, device);
    EXPECT_EQ(moved.frame.data_ptr(), there.data_ptr()) << "sent once";
    const RolloutBatch part = to_device(narrow_rows(batch, 2, 2), device);
    EXPECT_TRUE(torch::equal(part.frame.cpu(), batch.frame.narrow(1, 2, 2))) << "a part has its own frames";
    EXPECT_TRUE(torch::equal(narrow_rows(moved, 2, 2).frame.cpu(), part.frame.cpu()));
    const auto fields_of = [](RolloutBatch fields) {
      std::vector<Tensor> all;
      visit_device_fields(fields, [&](Tensor& field) { all.push_back(field.cpu()); });
      return all;
    };
    const std::vector<Tensor> here = fields_of(batch), sent = fields_of(moved);
    ASSERT_EQ(here.size(), sent.size());
    for (std::size_t i = 0; i < here.size(); ++i)
      EXPECT_TRUE(here[i].dtype() == sent[i].dtype() && torch::equal(here[i], sent[i])) << "field " << i;
    hand_back(batch, device);
  }
  clear(batch);
  batch.frame.fill_(9);
  EXPECT_TRUE(torch::equal(frames_on(batch, device).cpu(), batch.frame))
      << "what was sent is of another batch";
}

TEST(SendAhead, IsNothingOnACpu) {
  RolloutBatch batch = make_rollout_batch(small_shape(), 2);
  send_ahead(batch, torch::kCPU);
  EXPECT_EQ(frames_on(batch, torch::kCPU).data_ptr(), batch.frame.data_ptr());
}

}  // namespace collate_test
}  // namespace comrad::learn
