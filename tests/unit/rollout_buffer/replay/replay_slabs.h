// Slabs of chance and comparisons with what a replay gives back, for the tests of this folder.
#pragma once

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <ostream>
#include <string>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/replay/trajectory_store.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/slab_pool.h"

namespace comrad::replay {

inline TrajectoryShape small_shape() {
  TrajectoryShape shape;
  shape.env = {.num_agents = 2,
               .channels = 3,
               .height = 6,
               .width = 8,
               .measurement_count = 3,
               .global_state_count = 4,
               .head_count = 2};
  shape.env.head_sizes = {3, 4};
  shape.rollout_steps = 8;
  shape.recurrent_state_count = 5;
  shape.final_capacity = 3;
  return shape;
}

/// Where and how a store keeps its bytes; every test of content runs on all four.
struct Backing {
  const char* name;
  bool mapped;
  bool compressed;
};
inline void PrintTo(const Backing& backing, std::ostream* out) { *out << backing.name; }
inline const std::vector<Backing>& backings() {
  static const std::vector<Backing> all = {
      {"Ram", false, false}, {"RamLz4", false, true}, {"File", true, false}, {"FileLz4", true, true}};
  return all;
}
inline std::string backing_name(const ::testing::TestParamInfo<Backing>& info) { return info.param.name; }

/// Makes slab 0 of `pool` the trajectory number `number`: noise, some masks, endings and dead agents.
inline void fill_slab(const test::SlabPool& pool, const TrajectoryShape& shape, uint64_t number) {
  pool.fill_with_noise(number);
  const SlabView slab = pool.view(0);
  Rng rng(RngKey(number).split("endings"));
  int finals = 0;
  for (int row = 0; row < shape.final_capacity; ++row)
    for (int agent = 0; agent < shape.env.num_agents; ++agent) {
      for (uint8_t& pixel : slab.final_frame(row, agent)) pixel = static_cast<uint8_t>(rng.next());
      for (float& x : slab.final_measurement(row, agent)) x = static_cast<float>(rng.uniform());
    }
  for (int row = 0; row < shape.final_capacity; ++row)
    for (float& x : slab.final_global_state(row)) x = static_cast<float>(rng.uniform());
  const bool masks = rng.below(2) == 0;
  for (int row = 0; row <= shape.rollout_steps; ++row)
    for (int agent = 0; agent < shape.env.num_agents; ++agent) {
      std::ranges::fill(slab.action_mask(row, agent), uint8_t{1});
      if (masks) slab.action_mask(row, agent)[rng.below(3)] = 0;
      slab.agent_active(row, agent) = rng.below(4) != 0;
      // Smooth rows compress, noise does not: both kinds of LZ4 blocks appear.
      if (rng.below(2) == 0) std::ranges::fill(slab.frame(row, agent), static_cast<uint8_t>(rng.next()));
    }
  for (int step = 0; step < shape.rollout_steps; ++step) {
    const uint32_t kind = rng.below(6);
    slab.terminated(step) = kind == 0;
    slab.truncated(step) = kind == 1 && finals < shape.final_capacity;
    slab.final_index(step) = slab.truncated(step) != 0 ? finals++ : -1;
    slab.valid(step) = rng.below(5) != 0;
  }
}

inline std::vector<uint8_t> frames_of(const StoredTrajectory& item, const TrajectoryShape& shape, int step) {
  std::vector<uint8_t> frames(static_cast<std::size_t>(shape.env.num_agents * shape.env.frame_bytes()));
  item.copy_frames(step, frames.data());
  return frames;
}

/// Every field of `item` against the first `length` steps of a sound slab.
inline void expect_same(const StoredTrajectory& item, const SlabView& slab, int length) {
  using ::testing::ElementsAreArray;
  const TrajectoryShape& shape = slab.shape();
  const int agents = shape.env.num_agents;
  const auto frame_bytes = static_cast<std::size_t>(shape.env.frame_bytes());
  ASSERT_EQ(item.length(), length);
  std::vector<uint8_t> frame(frame_bytes);
  for (int row = 0; row <= length; ++row) {
    ASSERT_TRUE(std::ranges::equal(frames_of(item, shape, row), slab.frames(row))) << "row " << row;
    EXPECT_TRUE(std::ranges::equal(item.global_state(row), slab.global_state(row))) << "row " << row;
    for (int agent = 0; agent < agents; ++agent) {
      item.copy_frame(row, agent, frame.data());
      ASSERT_TRUE(std::ranges::equal(frame, slab.frame(row, agent)));
      const auto from = [agent](auto span, std::size_t width) {
        return span.subspan(static_cast<std::size_t>(agent) * width, width);
      };
      const auto measurements = static_cast<std::size_t>(shape.env.measurement_count);
      const auto choices = static_cast<std::size_t>(shape.env.logit_count());
      EXPECT_TRUE(
          std::ranges::equal(from(item.measurement(row), measurements), slab.measurement(row, agent)));
      EXPECT_TRUE(std::ranges::equal(from(item.action_mask(row), choices), slab.action_mask(row, agent)));
      EXPECT_EQ(item.agent_active(row)[static_cast<std::size_t>(agent)], slab.agent_active(row, agent));
      if (row == length) continue;
      EXPECT_TRUE(std::ranges::equal(from(item.action(row), static_cast<std::size_t>(shape.env.head_count)),
                                     slab.action(row, agent)));
      EXPECT_EQ(item.reward(row)[static_cast<std::size_t>(agent)], slab.reward(row, agent));
    }
  }
  for (int step = 0; step < length; ++step) {
    EXPECT_EQ(item.terminated(step), slab.terminated(step) != 0);
    EXPECT_EQ(item.truncated(step), slab.truncated(step) != 0);
    EXPECT_EQ(item.valid(step), slab.valid(step) != 0);
    if (slab.truncated(step) == 0) {
      EXPECT_EQ(item.final_row(step), -1);
      continue;
    }
    const int row = item.final_row(step);
    ASSERT_GE(row, 0);
    ASSERT_LT(row, item.final_count());
    std::vector<uint8_t> finals(frame_bytes * static_cast<std::size_t>(agents));
    item.copy_final_frames(row, finals.data());
    EXPECT_TRUE(
        std::ranges::equal(item.final_global_state(row), slab.final_global_state(slab.final_index(step))));
    for (int agent = 0; agent < agents; ++agent) {
      const auto expected = slab.final_frame(slab.final_index(step), agent);
      item.copy_final_frame(row, agent, frame.data());
      EXPECT_TRUE(std::ranges::equal(frame, expected));
      EXPECT_TRUE(std::equal(expected.begin(), expected.end(),
                             finals.begin() + static_cast<std::ptrdiff_t>(frame_bytes) * agent));
      const auto measured = slab.final_measurement(slab.final_index(step), agent);
      EXPECT_TRUE(std::ranges::equal(item.final_measurement(row).subspan(
                                         static_cast<std::size_t>(agent) * measured.size(), measured.size()),
                                     measured));
    }
  }
}

}  // namespace comrad::replay
