#include "learner/sources/collate_slabs.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <memory>
#include <string>
#include <vector>

#include "policy_workers/batching/staged_forward.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/slab_pool.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/test_device.h"
#include "tests/unit/policy_workers/fake_simulators.h"

namespace comrad::learn {
namespace collate_slabs_test {

using policy::ActorCritic;
using policy::Batch;
using policy::Batcher;
using policy::FakeSplit;
using policy::NetworkOptions;
using policy::SlabFrames;
using policy::StagedForward;

/// Both splits of an arena of four environments, and a policy worker that reads frames where they lie.
class Played {
 public:
  explicit Played(const NetworkOptions& options, bool keeps_frames = true)
      : arena(policy::make_arena(options, {})),
        frames(*SlabFrames::create(arena, test::test_device(), keeps_frames)),
        plain_(ActorCritic::create(options, 3, torch::kCPU)),
        there_(ActorCritic::create(options, 3, test::test_device())),
        batcher_(*Batcher::create(arena, {.seed = 42})),
        staged_(there_, arena.shape(), 1, frames.get()) {
    for (int split = 0; split < 2; ++split) splits.push_back(std::make_unique<FakeSplit>(arena, 0, split));
    for (int slab = 0; slab < kSlabs; ++slab) {
      shm::SlabHeader& header = arena.slabs().header(slab);
      header.env_index = static_cast<uint32_t>(slab);
      header.rollout_index = 7;
      header.length = 4;
    }
  }

  /// The whole rollout: every decision, the end of an episode in between, and the bootstrap.
  void play() {
    for (int step = 0; step < 4; ++step) {
      for (const auto& split : splits) {
        split->commit_act(step == 0);
        answer(split->envs.size());
        split->take_act();
        if (step != 2) continue;
        split->announce(1);
        split->envs[1].commit_final(0);
        split->ring();
        answer(1);
        split->envs[1].take_other();
      }
    }
  }

  /// The answer is that of a plain pass over the same frames.
  void answer(std::size_t requests) {
    const Batch& batch = batcher_.gather(0);
    ASSERT_EQ(batch.requests.size(), requests);
    const policy::PolicyOutput plain =
        plain_.step_rows(batch.frames, batch.measurement, batch.recurrent_state);
    const policy::PolicyOutput output = staged_.step(batch);
    ASSERT_LT((output.logits - plain.logits).abs().max().item<double>(), 1e-4);
    batcher_.scatter(batch, output, 9);
  }

  /// The four slabs in another order, frames from the slabs or from the device.
  Tensor drained(bool from_device) const {
    const torch::Device device = from_device ? test::test_device() : torch::kCPU;
    RolloutBatch batch = make_rollout_batch(arena.shape().trajectory, kSlabs, device, from_device);
    clear(batch);
    std::vector<PlacedSlab> slabs;
    for (uint32_t slab = 0; slab < kSlabs; ++slab)
      slabs.push_back({.slab_index = slab, .position = kSlabs - 1 - slab});
    EXPECT_EQ(collate_slabs(batch, slabs, arena, from_device ? frames.get() : nullptr, device), 0);
    EXPECT_EQ(batch.frame.defined(), !from_device);
    return frames_on(batch, device).cpu();
  }

  void scribble() const {
    for (int slab = 0; slab < kSlabs; ++slab)
      for (int step = 0; step < 4; ++step)
        std::ranges::fill(arena.slabs().view(slab).frames(step), uint8_t{200});
  }

  static constexpr int kSlabs = 4;
  const test::FullPrecision full;
  const shm::Arena arena;
  const std::unique_ptr<SlabFrames> frames;
  std::vector<std::unique_ptr<FakeSplit>> splits;

 private:
  const ActorCritic plain_, there_;
  Batcher batcher_;
  StagedForward staged_;
};

class FramesOfEverySize : public ::testing::TestWithParam<int> {};

TEST_P(FramesOfEverySize, ABatchOfWhatWentUpIsTheOneOfTheSlabsByteForByte) {
  NetworkOptions options = policy::small_network();
  options.env.height = 37;
  options.env.width = GetParam();
  Played played(options);
  played.play();
  const Tensor of_slabs = played.drained(/*from_device=*/false);
  EXPECT_GT(of_slabs.to(torch::kFloat32).std().item<double>(), 50) << "they have pictures";
  played.scribble();
  EXPECT_TRUE(torch::equal(played.drained(/*from_device=*/true), of_slabs));
}

// 3 x 37 x W bytes: multiples of eight, four, two, and none of them.
INSTANTIATE_TEST_SUITE_P(Widths, FramesOfEverySize, ::testing::Values(40, 44, 42, 41),
                         [](const auto& of) { return "W" + std::to_string(of.param); });

TEST(CollateSlabs, WhatIsNotThereComesFromTheSlab) {
  Played played(policy::small_network());
  played.play();
  played.scribble();
  const Tensor went_up = played.drained(/*from_device=*/true);
  // Another rollout than the one that was acted on here: its learner died, or another host played it.
  played.arena.slabs().header(2).rollout_index = 8;
  const Tensor batch = played.drained(/*from_device=*/true);
  const auto rows_of = [](const Tensor& frame, int slab) { return frame.narrow(1, (3 - slab) * 2, 2); };
  EXPECT_TRUE(torch::equal(rows_of(batch, 2), torch::full_like(rows_of(batch, 2), 200)));
  for (const int slab : {0, 1, 3})
    EXPECT_TRUE(torch::equal(rows_of(batch, slab), rows_of(went_up, slab))) << slab;
}

TEST(CollateSlabs, BehindTheEndOfASlabThatWasSealedEarlyThereIsNoPicture) {
  Played played(policy::small_network());
  played.play();
  played.arena.slabs().header(1).length = 2;
  const Tensor of_slabs = played.drained(/*from_device=*/false);
  const Tensor went_up = played.drained(/*from_device=*/true);
  EXPECT_TRUE(torch::equal(went_up, of_slabs));
  EXPECT_EQ(went_up[2][(3 - 1) * 2].max().item<int>(), 0);
}

TEST(CollateSlabs, OfValueMethodsFramesAreReadFromTheArenaAndNotKept) {
  Played played(policy::small_network(), /*keeps_frames=*/false);
  played.play();  // every answer is compared
}

TEST(CollateSlabs, FramesTakeAQuarterOfADeviceAtMost) {
  const shm::ArenaShape shape = policy::make_arena(policy::small_network(), {}).shape();
  const int64_t needed = SlabFrames::bytes_of(shape);
  EXPECT_EQ(needed, 8 * 4 * 2 * 3 * 40 * 44) << "slabs, steps, agents, frames";
  EXPECT_TRUE(SlabFrames::check_room(shape, 4 * needed));
  const Status status = SlabFrames::check_room(shape, 4 * needed - 4);
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kNoSpace);
  EXPECT_NE(status.error().message.find("--trajectory_slabs"), std::string::npos) << status.error().message;
}

TEST(CollateSlabs, TheHostCopiesNoFrame) {
  const test::ScratchFolder folder;
  ASSERT_TRUE(share_stages(folder.string(), "counters"));
  const auto copied = [&] { return read_stages(folder.string()).at(0).copied_bytes; };
  Played played(policy::small_network());
  const auto of_frames =
      static_cast<uint64_t>(SlabFrames::bytes_of(played.arena.shape()) / 2);  // half its slabs are played
  played.play();
  EXPECT_LT(copied(), of_frames / 20) << "small fields alone";
  (void)played.drained(/*from_device=*/true);
  EXPECT_LT(copied(), of_frames / 20);
  (void)played.drained(/*from_device=*/false);
  EXPECT_GE(copied(), of_frames);
}

}  // namespace collate_slabs_test
}  // namespace comrad::learn
