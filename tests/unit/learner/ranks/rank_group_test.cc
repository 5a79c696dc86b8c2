#include "learner/ranks/rank_group.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "learner/algorithms/happo.h"
#include "learner/algorithms/mappo.h"
#include "learner/worker/layout_service.h"
#include "policy_workers/policy/torch_ops.h"
#include "tests/support/noise_batch.h"

namespace comrad::learn {
namespace {

using testing::all_equal;
using testing::copies;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

/// Calls work(ranks) in a thread of each rank.
void in_ranks(int count, const std::function<void(RankGroup&)>& work) {
  const int rendezvous = memfd_create("ranks", MFD_CLOEXEC);
  ASSERT_GE(rendezvous, 0);
  std::vector<std::thread> threads;
  for (int rank = 0; rank < count; ++rank)
    threads.emplace_back([&, rank] {
      auto ranks =
          RankGroup::join({.rank = rank, .count = count, .rendezvous = rendezvous, .join_timeout_s = 20}, {});
      ASSERT_TRUE(ranks) << ranks.error().message;
      work(**ranks);
    });
  for (std::thread& thread : threads) thread.join();
  close(rendezvous);
}

Tensor row(int rank) { return torch::full({1, 3}, 10 + rank, torch::kFloat32); }

TEST(RankGroup, ALearnerAloneGetsBackWhatItGives) {
  RankGroup alone;
  EXPECT_TRUE(alone.is_alone());
  EXPECT_TRUE(alone.is_leader());
  EXPECT_TRUE(at::equal(alone.gather(row(0), 0), row(0)));
  EXPECT_TRUE(at::equal(alone.gather_rows(row(0)), row(0)));
  EXPECT_THAT(alone.add_up(std::vector<double>{1, 2}), ElementsAre(1, 2));
  EXPECT_TRUE(alone.all(true));
  EXPECT_FALSE(alone.all(false));
  EXPECT_EQ(alone.from_leader("here"), "here");
  EXPECT_FALSE(alone.failure());
}

TEST(RankGroup, PutsTogetherInTheOrderOfTheRanks) {
  constexpr int kRanks = 3;
  in_ranks(kRanks, [](RankGroup& ranks) {
    const int rank = ranks.rank();
    EXPECT_EQ(ranks.is_leader(), rank == 0);
    EXPECT_TRUE(at::equal(ranks.gather(row(rank), 0), at::cat({row(0), row(1), row(2)})));
    EXPECT_TRUE(at::equal(ranks.gather(row(rank), 1), at::cat({row(0), row(1), row(2)}, 1)));
    // Rank 1 has no row, rank 2 has two.
    const int64_t rows = rank == 0 ? 1 : rank == 1 ? 0 : 2;
    EXPECT_TRUE(
        at::equal(ranks.gather_rows(row(rank).expand({rows, 3}).clone()), at::cat({row(0), row(2), row(2)})));
    EXPECT_THAT(ranks.add_up(std::vector<double>{1.5, static_cast<double>(rank)}), ElementsAre(4.5, 3));
    EXPECT_TRUE(ranks.all(true));
    EXPECT_FALSE(ranks.all(rank != 1));
    EXPECT_EQ(ranks.from_leader(rank == 0 ? "checkpoint/a b.pt" : "?"), "checkpoint/a b.pt");
    EXPECT_EQ(ranks.from_leader(""), "");
    EXPECT_FALSE(ranks.failure());
  });
}

TEST(RankGroup, AddsUpGradientsFromTheFirstRankToTheLastBitForBit) {
  constexpr int kRanks = 3;
  // Sums of such numbers depend on their order.
  const auto noise = [](int rank, int64_t count) {
    auto generator = at::detail::createCPUGenerator(static_cast<uint64_t>(rank + 1));
    return torch::randn({count}, generator, torch::TensorOptions()) * 1000;
  };
  const std::vector<int64_t> sizes = {5, 7, 1001};  // whose sum three does not divide
  in_ranks(kRanks, [&](RankGroup& ranks) {
    std::vector<Tensor> parameters;
    for (const int64_t size : sizes) {
      parameters.push_back(torch::zeros({size}, torch::TensorOptions().requires_grad(true)));
      parameters.back().mutable_grad() = noise(ranks.rank(), size);
    }
    parameters.push_back(torch::zeros({4}));  // without a gradient
    ranks.add_up_gradients(parameters);
    for (std::size_t i = 0; i < sizes.size(); ++i) {
      const Tensor expected = noise(0, sizes[i]) + noise(1, sizes[i]) + noise(2, sizes[i]);
      EXPECT_TRUE(at::equal(parameters[i].grad(), expected)) << i;
    }
    EXPECT_FALSE(parameters.back().grad().defined());
  });
}

TEST(RankGroup, ARendezvousThatNeverCompletesNamesWhoIsMissing) {
  const int rendezvous = memfd_create("ranks", MFD_CLOEXEC);
  const auto alone =
      RankGroup::join({.rank = 0, .count = 3, .rendezvous = rendezvous, .join_timeout_s = 0.3}, {});
  ASSERT_FALSE(alone);
  EXPECT_EQ(alone.error().code, ErrorCode::kTimeout);
  EXPECT_THAT(alone.error().message, HasSubstr("learners 1 2"));
  const auto stopped = RankGroup::join({.rank = 1, .count = 3, .rendezvous = rendezvous}, [] {
    return Status(Error{ErrorCode::kPeerLost, "learner 2 was killed"});
  });
  ASSERT_FALSE(stopped);
  EXPECT_EQ(stopped.error().message, "learner 2 was killed");
  close(rendezvous);
}

TEST(RankGroup, AllHaveMetBeforeAnyoneLeavesAgain) {
  // Their connections are made pair by pair: one rank could have all of its own while two others still wait.
  // On one core that happens every few times.
  cpu_set_t before, one;
  ASSERT_EQ(sched_getaffinity(0, sizeof before, &before), 0);
  CPU_ZERO(&one);
  CPU_SET(sched_getcpu(), &one);
  ASSERT_EQ(sched_setaffinity(0, sizeof one, &one), 0);
  constexpr int kTimes = 40;
  for (int time = 0; time < kTimes; ++time)
    in_ranks(3, [](RankGroup& ranks) { EXPECT_FALSE(ranks.failure()); });
  ASSERT_EQ(sched_setaffinity(0, sizeof before, &before), 0);
}

TEST(RankGroup, ARankThatLeavesEndsTheWaitingOfTheOthersAndEverythingAfterIt) {
  in_ranks(2, [](RankGroup& ranks) {
    EXPECT_TRUE(ranks.all(true));
    if (ranks.rank() == 1) return;  // its connections close
    const Tensor mine = row(0);
    EXPECT_TRUE(at::equal(ranks.gather(mine, 0), at::cat({mine, mine}))) << "of the shape that it would have";
    ASSERT_TRUE(ranks.failure());
    EXPECT_EQ(ranks.failure()->code, ErrorCode::kPeerLost);
    EXPECT_TRUE(at::equal(ranks.gather(mine, 1), at::cat({mine, mine}, 1)));
    EXPECT_FALSE(ranks.all(true));
    EXPECT_THAT(ranks.add_up(std::vector<double>{1}), ElementsAre(1));
  });
}

TEST(RankGroup, AWatchThatSaysNoEndsTheWaiting) {
  in_ranks(2, [](RankGroup& ranks) {
    if (ranks.rank() == 1) {
      usleep(300'000);  // it is there, and says nothing
      return;
    }
    int asked = 0;
    ranks.set_watch([&asked] {
      return ++asked < 3 ? Status() : Error{ErrorCode::kTimeout, "the run stops"};
    });
    EXPECT_FALSE(ranks.all(true));
    ASSERT_TRUE(ranks.failure());
    EXPECT_EQ(ranks.failure()->message, "the run stops");
  });
}

// Two ranks with half the worlds each, and one learner that adds the same micro-batches in the ranks' order.

struct Case {
  const char* algo;
  std::function<void(RunConfig&)> change = {};
};

std::unique_ptr<Algorithm> make(const RunConfig& config, const TrajectoryShape& shape) {
  return std::move(make_algorithm(config, shape.env, torch::kCPU)).value();
}

void expect_two_learn_as_one(const Case& with) {
  constexpr int kAgents = 2;
  RunConfig config = testing::small_config(with.algo, kAgents);
  config.collection.learner_threads = 1;
  config.optimisation.micro_batch_size = config.collection.rollout;  // as little as goes: one world
  config.optimisation.batch_size = config.collection.rollout * kAgents * 2;
  config.optimisation.num_epochs = 2;
  config.network.normalize_input = true;
  config.network.share_parameters = config.run.algo.name() != "happo";
  if (with.change) with.change(config);
  TrajectoryShape shape = testing::small_shape(config, kAgents);
  shape.env.measurement_count = 3;
  if (config.network.critic_state == CriticState::kGlobal) shape.env.global_state_count = 5;
  const auto batch_of = [&](uint64_t seed) {
    RolloutBatch batch = testing::noise_batch(shape, 2, seed);
    batch.valid[1][0] = 0;  // the worlds are not alike
    batch.valid[2][1] = 0;
    return batch;
  };
  constexpr uint64_t kUpdates = 3;

  const std::unique_ptr<Algorithm> one = make(config, shape);
  std::vector<std::map<std::string, double>> reports;
  for (uint64_t seed = 1; seed <= kUpdates; ++seed) {
    RolloutBatch batch = batch_of(seed);
    const Expected<UpdateStats> stats = dynamic_cast<OnPolicyAlgorithm&>(*one).update(batch, {});
    ASSERT_TRUE(stats);
    reports.push_back(testing::values_of(*stats));
  }
  ASSERT_GE(one->version(), kUpdates);

  in_ranks(2, [&](RankGroup& ranks) {
    const std::unique_ptr<Algorithm> half = make(config, shape);
    ASSERT_TRUE(half->learn_with(ranks));
    for (uint64_t seed = 1; seed <= kUpdates; ++seed) {
      const RolloutBatch whole = batch_of(seed);
      RolloutBatch mine = select_slabs(whole, {ranks.rank()});
      const Expected<UpdateStats> stats = dynamic_cast<OnPolicyAlgorithm&>(*half).update(mine, {});
      ASSERT_TRUE(stats);
      std::map<std::string, double> report = testing::values_of(*stats);
      for (const auto& [name, value] : reports[seed - 1])
        EXPECT_NEAR(report[name], value, 1e-5 * (1 + std::abs(value))) << name << ", update " << seed;
    }
    EXPECT_FALSE(ranks.failure());
    EXPECT_EQ(half->version(), one->version());
    EXPECT_TRUE(half->weights() == one->weights()) << "rank " << ranks.rank() << " of " << with.algo;
    StateDict state, expected;
    half->save(state);
    one->save(expected);
    EXPECT_EQ(state.number("normalizer/returns_mean").value(),
              expected.number("normalizer/returns_mean").value());
    EXPECT_EQ(state.number("normalizer/returns_variance").value(),
              expected.number("normalizer/returns_variance").value());
  });
}

TEST(TwoLearners, AreOneLearnerBitForBitWithIppo) { expect_two_learn_as_one({.algo = "ippo"}); }

TEST(TwoLearners, AreOneLearnerBitForBitWithMappoAndTheGlobalState) {
  expect_two_learn_as_one({.algo = "mappo", .change = [](RunConfig& config) {
                             config.network.critic_state = CriticState::kGlobal;
                           }});
}

TEST(TwoLearners, AreOneLearnerBitForBitWithHappo) { expect_two_learn_as_one({.algo = "happo"}); }

TEST(TwoLearners, AreOneLearnerBitForBitWhereTheKlDecides) {
  expect_two_learn_as_one({.algo = "ippo", .change = [](RunConfig& config) {
                             config.optimisation.lr_schedule = RateSchedule::kKlAdaptiveMinibatch;
                             config.on_policy.early_stop_kl = 1e-3;
                           }});
}

// Whatever the moment: the update ends, without an exception, and no step is taken.
TEST(TwoLearners, TakeNoStepWhereTheOtherLeavesInTheMidstOfIt) {
  RunConfig config = testing::small_config("ippo", 2);
  config.collection.learner_threads = 1;
  config.network.normalize_input = true;
  TrajectoryShape shape = testing::small_shape(config, 2);
  shape.env.measurement_count = 3;
  // What an update says first: how old the data is, then its measurements. 3: all but its gradient.
  for (const int said : {0, 1, 2, 3})
    in_ranks(2, [&](RankGroup& ranks) {
      if (ranks.rank() == 1 && said < 3) {
        if (said > 0) ranks.gather(torch::zeros({1, 6}, torch::kFloat64), 0);
        if (said > 1) ranks.gather(torch::zeros({config.collection.rollout, 2, 3}), 1);
        return;
      }
      const std::unique_ptr<Algorithm> learner = make(config, shape);
      ASSERT_TRUE(learner->learn_with(ranks));
      const std::vector<std::byte> before = learner->weights();
      RolloutBatch batch = testing::noise_batch(shape, 1, 1);
      UpdateContext context;
      if (ranks.rank() == 1) context.keep_going = [] { return false; };
      const Expected<UpdateStats> stats = dynamic_cast<OnPolicyAlgorithm&>(*learner).update(batch, context);
      if (ranks.rank() == 1) return;
      EXPECT_TRUE(ranks.failure()) << said;
      EXPECT_EQ(learner->version(), 0u) << said;
      if (stats) {
        EXPECT_EQ(stats->optimizer_steps, 0) << said;
      }
      const std::size_t parameters = static_cast<std::size_t>(learner->parameter_count()) * sizeof(float);
      EXPECT_TRUE(std::equal(before.begin(), before.begin() + static_cast<std::ptrdiff_t>(parameters),
                             learner->weights().begin()))
          << said;
    });
}

TEST(TwoLearners, ScoreLayoutsByWhatAllOfThemSaw) {
  in_ranks(2, [](RankGroup& ranks) {
    std::vector<LayoutSignal> mine = {{.layout_index = 3, .decisions = 30, .mean = 1, .maximum = 4}};
    if (ranks.rank() == 1)
      mine = {{.layout_index = 1, .decisions = 5, .mean = 7, .maximum = 7},
              {.layout_index = 3, .decisions = 10, .mean = 5, .maximum = 9}};
    const std::vector<LayoutSignal> all = of_all_ranks(mine, ranks);
    ASSERT_THAT(all, SizeIs(2));
    EXPECT_EQ(all[0].layout_index, 1);
    EXPECT_EQ(all[0].decisions, 5);
    EXPECT_EQ(all[1].layout_index, 3);
    EXPECT_EQ(all[1].decisions, 40);
    EXPECT_EQ(all[1].mean, 2);
    EXPECT_EQ(all[1].maximum, 9);
  });
}

TEST(TwoLearners, AreRefusedWhereAnAlgorithmLearnsAlone) {
  RunConfig config = testing::small_config("qmix", 2);
  const std::unique_ptr<Algorithm> qmix = make(config, testing::small_shape(config, 2));
  RankGroup alone;
  EXPECT_TRUE(qmix->learn_with(alone));
  in_ranks(2, [&](RankGroup& ranks) {
    const Status refused = qmix->learn_with(ranks);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kUnsupported);
  });
}

}  // namespace
}  // namespace comrad::learn
