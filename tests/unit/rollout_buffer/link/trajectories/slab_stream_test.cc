#include "rollout_buffer/link/trajectories/slab_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstring>
#include <limits>
#include <optional>

#include "rollout_buffer/core/checksum.h"
#include "tests/support/random_bytes.h"
#include "tests/support/slab_pool.h"

namespace comrad::link {
namespace slab_stream_test {

using ::testing::HasSubstr;

TrajectoryShape shape_of_test() {
  TrajectoryShape shape;
  shape.env = {
      .num_agents = 2, .channels = 3, .height = 36, .width = 64, .measurement_count = 2, .head_count = 2};
  shape.env.head_sizes = {3, 4};
  shape.rollout_steps = 16;
  shape.recurrent_state_count = 5;
  shape.final_capacity = 4;
  return shape;
}

/// A fragment that owns its payload.
struct Kept {
  dds::TrajectoryFragment fragment;
  std::vector<std::byte> payload;
  dds::TrajectoryFragment get() const {
    dds::TrajectoryFragment with_payload = fragment;
    with_payload.payload = payload;
    return with_payload;
  }
};

class SlabStream : public ::testing::Test {
 protected:
  SlabStream() {
    source_.fill_with_noise(3);
    header_.env_index = 5;
    header_.length = 16;
    header_.rollout_index = 9;
    header_.layout_id = 77;
    header_.first_episode = {.episode_id = 4, .episode_seed = 1234};
  }

  std::vector<Kept> cut() {
    SlabCutter cutter(offsets_);
    cutter.begin(source_.view(0), header_, {.peer_id = 42, .send_index = 8, .epoch = 2});
    std::vector<Kept> kept;
    for (uint32_t i = 0; i < cutter.fragment_count(); ++i) {
      const dds::TrajectoryFragment fragment = cutter.cut(i);
      kept.push_back({fragment, {fragment.payload.begin(), fragment.payload.end()}});
    }
    return kept;
  }

  /// "" where the slab came whole, "..." where fragments are missing, else the error.
  std::string put_together(const std::vector<Kept>& fragments) {
    SlabAssembler assembler(offsets_);
    assembler.begin(target_.view(0));
    for (const Kept& kept : fragments) {
      const Expected<bool> taken = assembler.take(kept.get());
      if (!taken) return taken.error().message;
      if (*taken) return "";
    }
    return "...";
  }
  std::span<const std::byte> bytes(const test::SlabPool& pool, int64_t begin, int64_t end) const {
    return {pool.view(0).at<std::byte>(begin), static_cast<std::size_t>(end - begin)};
  }

  const SlabOffsets offsets_{shape_of_test()};
  test::SlabPool source_{shape_of_test(), 1}, target_{shape_of_test(), 1};
  shm::SlabHeader header_{};
};

TEST_F(SlabStream, ASlabArrivesByteForByteWithItsName) {
  source_.view(0).final_index(3) = 0;
  source_.view(0).truncated(3) = 1;
  std::memset(source_.view(0).final_frame(0, 0).data(), 7, 2 * 3 * 36 * 64);
  const std::vector<Kept> fragments = cut();
  ASSERT_GT(fragments.size(), 1u);
  EXPECT_EQ(fragments[1].fragment.peer_id, 42u);
  EXPECT_EQ(fragments[1].fragment.epoch, 2u);
  EXPECT_EQ(fragments[1].fragment.send_index, 8u);
  EXPECT_EQ(fragments[1].fragment.env_index, 5u);
  EXPECT_EQ(fragments[1].fragment.length, 16u);
  EXPECT_EQ(fragments[1].fragment.rollout_index, 9u);
  EXPECT_EQ(fragments[1].fragment.layout_id, 77u);
  EXPECT_EQ(fragments[1].fragment.first_episode_id, 4u);
  EXPECT_EQ(fragments[1].fragment.first_episode_seed, 1234u);
  EXPECT_EQ(put_together(fragments), "");
  const Hole hole = hole_of(offsets_, 1);
  EXPECT_TRUE(std::ranges::equal(bytes(source_, 0, hole.begin), bytes(target_, 0, hole.begin)));
  EXPECT_TRUE(std::ranges::equal(bytes(source_, hole.end, offsets_.slab_bytes),
                                 bytes(target_, hole.end, offsets_.slab_bytes)));
}

TEST_F(SlabStream, FinalObservationsWithoutAUseAreNotSentAndNothingOldShowsInTheirPlace) {
  const Hole all = hole_of(offsets_, 0);
  std::memset(source_.view(0).at<std::byte>(all.begin), 0x55, static_cast<std::size_t>(all.end - all.begin));
  std::memset(target_.view(0).at<std::byte>(all.begin), 0x66, static_cast<std::size_t>(all.end - all.begin));
  EXPECT_EQ(put_together(cut()), "");
  const auto arrived = bytes(target_, all.begin, all.end);
  EXPECT_TRUE(std::ranges::all_of(arrived, [](std::byte byte) { return byte == std::byte{0}; }));
}

TEST_F(SlabStream, FlatPicturesCompress) {
  std::memset(source_.view(0).frames(0).data(), 9, static_cast<std::size_t>(17 * 2 * 3 * 36 * 64));
  std::size_t payload = 0;
  for (const Kept& kept : cut()) payload += kept.payload.size();
  EXPECT_LT(payload, static_cast<std::size_t>(offsets_.slab_bytes) / 20);
}

TEST_F(SlabStream, AFragmentThatIsMissingDoubledOrOfAnotherSlabIsSeen) {
  std::vector<Kept> fragments = cut();
  ASSERT_GE(fragments.size(), 2u);
  EXPECT_THAT(put_together({fragments[1]}), HasSubstr("was due"));
  EXPECT_THAT(put_together({fragments[0], fragments[0]}), HasSubstr("was due"));
  std::vector<Kept> shortened = fragments;
  shortened.pop_back();
  EXPECT_EQ(put_together(shortened), "...");
  for (Kept& kept : shortened) kept.fragment.fragment_count = static_cast<uint32_t>(shortened.size());
  EXPECT_THAT(put_together(shortened), HasSubstr("are missing"));
}

TEST_F(SlabStream, AFragmentThatReachesOutsideOfTheSlabWritesNothing) {
  const std::vector<Kept> whole = cut();
  const auto bent = [&](const std::function<void(Kept&)>& bend) {
    std::vector<Kept> fragments = whole;
    bend(fragments[0]);
    return put_together(fragments);
  };
  const auto slab_bytes = static_cast<uint64_t>(offsets_.slab_bytes);
  EXPECT_THAT(bent([&](Kept& one) { one.fragment.offset_bytes = slab_bytes; }), HasSubstr("outside"));
  EXPECT_THAT(bent([&](Kept& one) { one.fragment.offset_bytes = ~uint64_t{0} - 4; }), HasSubstr("outside"));
  EXPECT_THAT(bent([&](Kept& one) { one.fragment.raw_bytes = ~uint32_t{0}; }), HasSubstr("outside"));
  EXPECT_THAT(bent([&](Kept& one) { one.fragment.raw_bytes = 0; }), HasSubstr("outside"));
  EXPECT_THAT(bent([&](Kept& one) { one.fragment.offset_bytes = 64; }), HasSubstr("was due"));
  EXPECT_THAT(bent([&](Kept& one) { one.fragment.raw_bytes -= 1; }), HasSubstr("decompress"));
  EXPECT_THAT(bent([&](Kept& one) { one.payload[20] ^= std::byte{1}; }),
              ::testing::AnyOf(HasSubstr("checksum"), HasSubstr("decompress")));
  EXPECT_THAT(bent([&](Kept& one) { one.fragment.checksum ^= 1; }), HasSubstr("checksum"));
}

TEST_F(SlabStream, WhatCouldNotHaveBeenPlayedIsRefused) {
  const auto refusal = [&](const std::function<void(const SlabView&)>& bend) {
    test::SlabPool intact = source_;
    bend(source_.view(0));
    const std::string said = put_together(cut());
    source_ = intact;
    return said;
  };
  EXPECT_EQ(refusal([](const SlabView&) {}), "");
  EXPECT_THAT(refusal([](const SlabView& slab) { slab.action(2, 1)[0] = 3; }), HasSubstr("step 2: agent 1"));
  EXPECT_THAT(refusal([](const SlabView& slab) { slab.action(2, 1)[1] = -1; }), HasSubstr("no head has"));
  EXPECT_THAT(
      refusal([](const SlabView& slab) { slab.reward(5, 0) = std::numeric_limits<float>::quiet_NaN(); }),
      HasSubstr("reward"));
  EXPECT_THAT(refusal([](const SlabView& slab) { slab.truncated(4) = 1; }), HasSubstr("step 4 ends"));
  EXPECT_THAT(refusal([](const SlabView& slab) { slab.final_index(4) = 4; }), HasSubstr("did not come"));
  header_.length = 17;
  EXPECT_THAT(put_together(cut()), HasSubstr("17 decisions"));
  header_.length = 0;
  EXPECT_THAT(put_together(cut()), HasSubstr("0 decisions"));
}

TEST_F(SlabStream, StepsBehindTheEndAreNotValidWhateverTheSenderClaims) {
  header_.length = 6;
  EXPECT_EQ(put_together(cut()), "");
  EXPECT_EQ(target_.view(0).valid(5), 1);
  EXPECT_EQ(target_.view(0).valid(6), 0);
  EXPECT_EQ(target_.view(0).valid(15), 0);
}

TEST_F(SlabStream, BentFragmentsNeverWriteOutsideOfTheSlab) {
  // The target is the middle one of three; the outer ones must stay as they are.
  test::SlabPool guarded(shape_of_test(), 3);
  const std::vector<std::byte> before(guarded.view(0).at<std::byte>(0),
                                      guarded.view(0).at<std::byte>(3 * offsets_.slab_bytes));
  const std::vector<Kept> whole = cut();
  const uint64_t seed = test::fuzz_seed();
  Rng rng(seed);
  SlabAssembler assembler(offsets_);
  for (int round = 0; round < 2000; ++round) {
    assembler.begin(guarded.view(1));
    for (Kept kept : whole) {
      if (rng.below(2) == 0) {
        uint64_t* const numbers[] = {&kept.fragment.offset_bytes, &kept.fragment.checksum,
                                     &kept.fragment.rollout_index};
        uint32_t* const counts[] = {&kept.fragment.raw_bytes, &kept.fragment.fragment_index,
                                    &kept.fragment.fragment_count, &kept.fragment.length};
        *numbers[rng.below(3)] += rng.next() >> rng.below(64);
        *counts[rng.below(4)] += static_cast<uint32_t>(rng.next() >> rng.below(64));
        if (rng.below(2) == 0 && kept.payload.size() < 4096) kept.payload = test::mutated(rng, kept.payload);
      }
      if (!assembler.take(kept.get())) break;
    }
  }
  for (const int outer : {0, 2})
    EXPECT_EQ(std::memcmp(guarded.view(outer).at<std::byte>(0), before.data() + outer * offsets_.slab_bytes,
                          static_cast<std::size_t>(offsets_.slab_bytes)),
              0)
        << "seed " << seed;
}

}  // namespace slab_stream_test
}  // namespace comrad::link
