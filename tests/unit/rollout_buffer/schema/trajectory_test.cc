#include "rollout_buffer/schema/trajectory.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstring>
#include <vector>

#include "rollout_buffer/schema/version.h"

namespace comrad {
namespace trajectory_test {

TrajectoryShape shape_of(int agents, int steps, int measurements) {
  TrajectoryShape shape;
  shape.env = {.num_agents = agents,
               .channels = 3,
               .height = 5,
               .width = 7,
               .measurement_count = measurements,
               .global_state_count = 2 * measurements,
               .head_count = 3};
  shape.env.head_sizes = {3, 2, 4};
  shape.rollout_steps = steps;
  shape.recurrent_state_count = 11;
  shape.recurrent_snapshots = 2;
  shape.final_capacity = 3;
  return shape;
}

struct Field {
  const char* name;
  int64_t offset, bytes;
};

std::vector<Field> fields_of(const SlabOffsets& offsets) {
  const int64_t T = offsets.shape.rollout_steps, N = offsets.shape.env.num_agents,
                K = offsets.shape.final_capacity;
  const int64_t F = offsets.shape.env.frame_bytes(), M = offsets.shape.env.measurement_count;
  const int64_t S = offsets.shape.env.global_state_count;
  const int64_t A = offsets.shape.env.logit_count(), H = offsets.shape.recurrent_state_count;
  return {{"frame", offsets.frame, (T + 1) * N * F},
          {"final_frame", offsets.final_frame, K * N * F},
          {"measurement", offsets.measurement, (T + 1) * N * M * 4},
          {"final_measurement", offsets.final_measurement, K * N * M * 4},
          {"global_state", offsets.global_state, (T + 1) * S * 4},
          {"final_global_state", offsets.final_global_state, K * S * 4},
          {"action_mask", offsets.action_mask, (T + 1) * N * A},
          {"agent_active", offsets.agent_active, (T + 1) * N},
          {"reward", offsets.reward, T * N * 4},
          {"terminated", offsets.terminated, T},
          {"truncated", offsets.truncated, T},
          {"final_index", offsets.final_index, T * 4},
          {"layout_index", offsets.layout_index, T * 4},
          {"recurrent_state", offsets.recurrent_state, offsets.shape.recurrent_snapshots * N * H * 4},
          {"action", offsets.action, T * N * offsets.shape.env.head_count * 4},
          {"log_prob", offsets.log_prob, T * N * 4},
          {"value", offsets.value, (T + 1) * N * 4},
          {"final_value", offsets.final_value, K * N * 4},
          {"logits", offsets.logits, T * N * A * 4},
          {"policy_version", offsets.policy_version, T * N * 4},
          {"valid", offsets.valid, T}};
}

TEST(SlabOffsets, FieldsStartOnCacheLinesAndDoNotOverlap) {
  for (const TrajectoryShape& shape : {shape_of(2, 8, 5), shape_of(1, 1, 0), shape_of(8, 33, 1)}) {
    const SlabOffsets offsets(shape);
    std::vector<Field> fields = fields_of(offsets);
    std::sort(fields.begin(), fields.end(), [](const Field& a, const Field& b) {
      return a.offset != b.offset ? a.offset < b.offset : a.bytes < b.bytes;
    });
    int64_t end = 0;
    for (const Field& field : fields) {
      EXPECT_EQ(field.offset % static_cast<int64_t>(kCacheLineBytes), 0) << field.name;
      EXPECT_GE(field.offset, end) << field.name << " overlaps the field before it";
      end = field.offset + field.bytes;
    }
    EXPECT_GE(offsets.slab_bytes, end);
    EXPECT_EQ(offsets.slab_bytes % 4096, 0);
  }
}

TEST(SlabView, EveryElementHasItsOwnBytes) {
  const TrajectoryShape shape = shape_of(3, 4, 2);
  const SlabOffsets offsets(shape);
  std::vector<std::byte> memory(static_cast<std::size_t>(offsets.slab_bytes), std::byte{0});
  const SlabView slab(offsets, memory.data());
  int64_t written = 0;
  // Every byte of a span must still be zero when it is handed out for the first time.
  const auto mark = [&](void* data, std::size_t bytes) {
    auto* first = static_cast<uint8_t*>(data);
    ASSERT_GE(static_cast<void*>(first), static_cast<void*>(memory.data()));
    ASSERT_LE(first + bytes, reinterpret_cast<uint8_t*>(memory.data() + memory.size()));
    for (std::size_t index = 0; index < bytes; ++index) ASSERT_EQ(first[index], 0);
    std::memset(first, 0xAB, bytes);
    written += static_cast<int64_t>(bytes);
  };
  const auto mark_span = [&](auto span) { mark(span.data(), span.size_bytes()); };
  for (int agent = 0; agent < 3; ++agent) {
    for (int step = 0; step <= 4; ++step) {
      mark_span(slab.frame(step, agent));
      mark_span(slab.measurement(step, agent));
      mark_span(slab.action_mask(step, agent));
      mark(&slab.agent_active(step, agent), 1);
      mark(&slab.value(step, agent), 4);
    }
    for (int step = 0; step < 4; ++step) {
      mark(&slab.reward(step, agent), 4);
      mark_span(slab.action(step, agent));
      mark(&slab.log_prob(step, agent), 4);
      mark_span(slab.logits(step, agent));
      mark(&slab.policy_version(step, agent), 4);
    }
    for (int row = 0; row < 3; ++row) {
      mark_span(slab.final_frame(row, agent));
      mark_span(slab.final_measurement(row, agent));
      mark(&slab.final_value(row, agent), 4);
    }
    for (int snapshot = 0; snapshot < 2; ++snapshot) mark_span(slab.recurrent_state(snapshot, agent));
  }
  for (int step = 0; step <= 4; ++step) mark_span(slab.global_state(step));
  for (int row = 0; row < 3; ++row) mark_span(slab.final_global_state(row));
  for (int step = 0; step < 4; ++step) {
    mark(&slab.terminated(step), 1);
    mark(&slab.truncated(step), 1);
    mark(&slab.final_index(step), 4);
    mark(&slab.layout_index(step), 4);
    mark(&slab.valid(step), 1);
  }
  int64_t expected = 0;
  for (const Field& field : fields_of(offsets)) expected += field.bytes;
  EXPECT_EQ(written, expected) << "the accessors reach every byte of every field";
}

TEST(SlabView, FramesOfAStepAreTheAgentsFramesInOrder) {
  const SlabOffsets offsets(shape_of(3, 4, 0));
  std::vector<std::byte> memory(static_cast<std::size_t>(offsets.slab_bytes));
  const SlabView slab(offsets, memory.data());
  EXPECT_EQ(slab.frames(2).data(), slab.frame(2, 0).data());
  EXPECT_EQ(slab.frames(2).data() + slab.frame(2, 0).size(), slab.frame(2, 1).data());
  EXPECT_EQ(slab.frames(2).data() + slab.frames(2).size(), slab.frame(3, 0).data());
}

TEST(SlabView, ClearLeavesAnEmptyStep) {
  const SlabOffsets offsets(shape_of(2, 4, 1));
  std::vector<std::byte> memory(static_cast<std::size_t>(offsets.slab_bytes), std::byte{0x5A});
  const SlabView slab(offsets, memory.data());
  slab.clear();
  for (int step = 0; step < 4; ++step) {
    for (int agent = 0; agent < 2; ++agent) EXPECT_EQ(slab.reward(step, agent), 0.0f);
    EXPECT_EQ(slab.terminated(step) + slab.truncated(step) + slab.valid(step), 0);
    EXPECT_EQ(slab.final_index(step), -1);
    EXPECT_EQ(slab.layout_index(step), 0);
  }
}

TEST(SlabView, PadRepeatsTheLastRowsAndTouchesNothingElse) {
  const int agents = 3, steps = 6;
  for (const int measurements : {0, 2}) {
    const SlabOffsets offsets(shape_of(agents, steps, measurements));
    for (const int length : {1, 4, steps}) {
      std::vector<std::byte> memory(static_cast<std::size_t>(offsets.slab_bytes));
      uint32_t random = 1;
      for (std::byte& byte : memory)
        byte = static_cast<std::byte>((random = random * 1664525 + 1013904223) >> 24);
      std::vector<std::byte> wanted = memory;
      // Row by row, as the slab's table has it: T+1 rows of what is seen, T rows of what is decided.
      const SlabView slab(offsets, wanted.data());
      const auto copy = [](auto from, auto to) { std::ranges::copy(from, to.data()); };
      for (int step = length; step < steps; ++step) {
        for (int agent = 0; agent < agents; ++agent) {
          copy(slab.frame(length, agent), slab.frame(step + 1, agent));
          copy(slab.measurement(length, agent), slab.measurement(step + 1, agent));
          copy(slab.action_mask(length, agent), slab.action_mask(step + 1, agent));
          slab.agent_active(step + 1, agent) = slab.agent_active(length, agent);
          slab.value(step + 1, agent) = slab.value(length, agent);
          copy(slab.action(length - 1, agent), slab.action(step, agent));
          copy(slab.logits(length - 1, agent), slab.logits(step, agent));
          slab.log_prob(step, agent) = slab.log_prob(length - 1, agent);
          slab.policy_version(step, agent) = slab.policy_version(length - 1, agent);
        }
        copy(slab.global_state(length), slab.global_state(step + 1));
        slab.layout_index(step) = slab.layout_index(length - 1);
      }
      SlabView(offsets, memory.data()).pad(length);
      EXPECT_TRUE(memory == wanted) << measurements << " measurements, length " << length;
    }
  }
}

TEST(Validate, RefusesShapesOutsideTheirRanges) {
  EXPECT_TRUE(validate(shape_of(2, 8, 5)));
  const auto expect_refusal = [](auto spoil, const char* field) {
    TrajectoryShape shape = shape_of(2, 8, 5);
    spoil(shape);
    const Status status = validate(shape);
    ASSERT_FALSE(status) << field;
    EXPECT_THAT(status.error().message, ::testing::HasSubstr(field));
  };
  expect_refusal([](TrajectoryShape& s) { s.env.num_agents = 0; }, "num_agents is 0");
  expect_refusal([](TrajectoryShape& s) { s.env.num_agents = 9; }, "num_agents is 9");
  expect_refusal([](TrajectoryShape& s) { s.env.width = -1; }, "frame width");
  expect_refusal([](TrajectoryShape& s) { s.env.head_count = 9; }, "action head count");
  expect_refusal([](TrajectoryShape& s) { s.env.head_sizes[1] = 1; }, "action head size");
  expect_refusal([](TrajectoryShape& s) { s.env.measurement_count = -4; }, "measurement count");
  expect_refusal([](TrajectoryShape& s) { s.rollout_steps = 0; }, "rollout");
  expect_refusal([](TrajectoryShape& s) { s.recurrent_snapshots = 10; }, "recurrent snapshots");
  expect_refusal([](TrajectoryShape& s) { s.final_capacity = 0; }, "final observations");
}

TEST(EnvShape, CountsLogitsAndJointActions) {
  EnvShape shape;
  shape.head_count = 5;
  shape.head_sizes = {3, 3, 3, 2, 3};
  EXPECT_EQ(shape.logit_count(), 14);
  EXPECT_EQ(shape.joint_action_count(), 162);
  EXPECT_EQ(shape.frame_bytes(), 3 * 72 * 128);
}

}  // namespace trajectory_test
}  // namespace comrad
