#include "learner/ranks/rank_group.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <atomic>
#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "learner/algorithms/happo.h"
#include "learner/algorithms/mappo.h"
#include "learner/algorithms/value_decomposition.h"
#include "learner/sources/layout_service.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/in_ranks.h"
#include "tests/support/noise_batch.h"
#include "tests/support/patience.h"
#include "tests/support/same_value.h"

namespace comrad::learn {
namespace rank_group_test {

using test::all_equal;
using test::copies;
using test::in_ranks;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::SizeIs;

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

TEST(RankGroup, ARendezvousThatNeverCompletesNamesTheMissingRank) {
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

TEST(RankGroup, AllHaveMetBeforeAnyLeavesAgain) {
  // Their connections are made pair by pair: one rank could have all its connections while two others still wait.
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

TEST(RankGroup, AWatchThatReturnsFalseEndsTheWaiting) {
  std::atomic<bool> has_ended{false};
  in_ranks(2, [&has_ended](RankGroup& ranks) {
    if (ranks.rank() == 1) {
      // It exists, and is empty.
      (void)test::wait_until([&] { return has_ended.load(); });
      return;
    }
    int asked = 0;
    ranks.set_watch([&asked] {
      return ++asked < 3 ? Status() : Error{ErrorCode::kTimeout, "the run stops"};
    });
    EXPECT_FALSE(ranks.all(true));
    has_ended = true;
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
  RunConfig config = test::small_config(with.algo, kAgents);
  config.collection.learner_threads = 1;
  config.optimisation.micro_batch_size = config.collection.rollout;  // as little as goes: one world
  config.optimisation.batch_size = config.collection.rollout * kAgents * 2;
  config.optimisation.num_epochs = 2;
  config.network.normalize_input = true;
  config.network.share_parameters = config.run.algo.name() != "happo";
  if (with.change) with.change(config);
  TrajectoryShape shape = test::small_shape(config, kAgents);
  shape.env.measurement_count = 3;
  if (config.network.critic_state == CriticState::kGlobal) shape.env.global_state_count = 5;
  const auto batch_of = [&](uint64_t seed) {
    RolloutBatch batch = test::noise_batch(shape, 2, seed);
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
    reports.push_back(test::values_of(*stats));
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
      std::map<std::string, double> report = test::values_of(*stats);
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

// The same of Q-learning: a batch of one learner, and its halves.

/// Two worlds of noise, in which an episode is cut, one ends, an agent is out of the game and a trajectory is short; or
/// three decisions of each.
ReplayBatch drawn_batch_of(const RunConfig& config, const TrajectoryShape& shape, uint64_t seed) {
  const int steps = shape.rollout_steps, agents = shape.env.num_agents;
  test::SlabPool pool(shape, 2);
  pool.fill_with_noise(seed);
  pool.view(0).truncated(1) = 1;
  pool.view(0).final_index(1) = 0;
  pool.view(1).terminated(2) = 1;
  pool.view(1).agent_active(1, 1) = pool.view(1).agent_active(2, 1) = 0;
  auto replay = *replay::Replay::create({.store = {.shape = shape, .capacity_bytes = 1 << 24}});
  replay->insert(pool.view(0), static_cast<uint32_t>(steps));
  replay->insert(pool.view(1), static_cast<uint32_t>(steps - 1));
  std::vector<replay::Draw> draws;
  const bool are_sequences = config.network.use_rnn,
             of_one = config.run.algo->learns_alone() && !are_sequences;
  for (int item = 0; item < 2; ++item)
    for (int step = 0; step < (are_sequences ? 1 : 3); ++step)
      draws.push_back({.item = item,
                       .step = are_sequences ? -1 : step,
                       .agent = of_one ? step % agents : -1,
                       .weight = 0.5 + 0.1 * static_cast<double>(draws.size()),
                       .serial = static_cast<int64_t>(draws.size())});
  const ReplayBatchOptions options{.shape = shape,
                                   .unit = are_sequences ? replay::Unit::kSequence
                                           : of_one      ? replay::Unit::kAgentStep
                                                         : replay::Unit::kJointStep,
                                   .world_count = static_cast<int64_t>(draws.size()),
                                   .pay = {.gamma = config.optimisation.gamma},
                                   .agents_end = config.run.algo->learns_alone()};
  ReplayBatch batch = make_replay_batch(options);
  fill(batch, options, *replay, draws);
  return batch;
}

void expect_two_draw_as_one(const Case& with) {
  constexpr int kAgents = 2;
  RunConfig config = test::small_config(with.algo, kAgents);
  config.collection.learner_threads = 1;
  config.mixers.mixer = config.run.algo->mixer_name;
  config.network.normalize_input = true;
  config.q_learning.team_reward = TeamReward::kSum;
  config.optimisation.learning_rate = 1e-3;
  if (with.change) with.change(config);
  TrajectoryShape shape = test::small_shape(config, kAgents);
  shape.env.measurement_count = 3;
  if (config.network.critic_state == CriticState::kGlobal) shape.env.global_state_count = 5;
  const ReplayBatch like = drawn_batch_of(config, shape, 1);  // a half is a micro-batch
  config.optimisation.micro_batch_size = like.rows() / 2 * (like.steps() + 1);
  constexpr uint64_t kUpdates = 3;
  // The second half comes from a replay whose rarest unit is drawn twice as often as that of the first.
  constexpr double kFirst = 0.01, kSecond = 0.02, kExponent = 0.5;
  const auto half_of = [](const ReplayBatch& whole, int rank) {
    const int64_t worlds = whole.world_count / 2;
    ReplayBatch half = narrow_worlds(whole, rank * worlds, worlds);
    half.weight = half.weight.clone();
    half.least_probability = rank == 0 ? kFirst : kSecond;
    half.weight_exponent = kExponent;
    return half;
  };
  // In the first look one of the learners has nothing new.
  const auto observe = [&](OffPolicyAlgorithm& learner, const ReplayBatch& whole, int64_t first,
                           int64_t end) {
    learner.observe(whole.frame[0].slice(0, first, end), whole.measurement[0].slice(0, first, end),
                    whole.global_state.defined()
                        ? whole.global_state[0].slice(0, first / kAgents, end / kAgents)
                        : Tensor());
  };

  const std::unique_ptr<Algorithm> made = make(config, shape);
  auto& one = dynamic_cast<OffPolicyAlgorithm&>(*made);
  std::vector<std::map<std::string, double>> reports;
  std::vector<Tensor> errors;
  for (uint64_t seed = 1; seed <= kUpdates; ++seed) {
    ReplayBatch batch = drawn_batch_of(config, shape, seed);
    const int64_t worlds = batch.world_count / 2;
    observe(one, batch, 0, batch.rows());
    batch.weight.narrow(0, worlds, worlds).mul_(std::pow(kFirst / kSecond, kExponent));
    const Expected<UpdateStats> stats = one.update(batch, {});
    ASSERT_TRUE(stats);
    ASSERT_EQ(stats->optimizer_steps, 1);
    reports.push_back(test::values_of(*stats));
    errors.push_back(batch.abs_td);
  }

  in_ranks(2, [&](RankGroup& ranks) {
    const std::unique_ptr<Algorithm> part = make(config, shape);
    auto& half = dynamic_cast<OffPolicyAlgorithm&>(*part);
    ASSERT_TRUE(half.learn_with(ranks));
    for (uint64_t seed = 1; seed <= kUpdates; ++seed) {
      const ReplayBatch whole = drawn_batch_of(config, shape, seed);
      const int64_t mine = seed == 1 ? whole.rows() * (1 - ranks.rank()) : whole.rows() / 2;
      observe(half, whole, ranks.rank() == 0 ? 0 : whole.rows() - mine,
              ranks.rank() == 0 ? mine : whole.rows());
      ReplayBatch batch = half_of(whole, ranks.rank());
      const Expected<UpdateStats> stats = half.update(batch, {});
      ASSERT_TRUE(stats);
      std::map<std::string, double> report = test::values_of(*stats);
      for (const auto& [name, value] : reports[seed - 1])
        EXPECT_NEAR(report[name], value, 1e-5 * (1 + std::abs(value))) << name << ", update " << seed;
      EXPECT_TRUE(at::equal(batch.abs_td,
                            errors[seed - 1].narrow(0, ranks.rank() * batch.world_count, batch.world_count)));
    }
    EXPECT_FALSE(ranks.failure());
    StateDict state, expected;
    half.save(state);
    one.save(expected);
    EXPECT_EQ(state.values().size(), expected.values().size());
    for (const auto& [key, value] : expected.values())
      EXPECT_TRUE(test::same_value(value, state.values().at(key)))
          << key << ", rank " << ranks.rank() << " of " << with.algo;
  });
}

TEST(TwoLearners, AreOneLearnerBitForBitWithIdqn) {
  expect_two_draw_as_one({.algo = "idqn"});
  expect_two_draw_as_one({.algo = "idqn", .change = [](RunConfig& config) {
                            config.network.use_rnn = false;
                            config.q_learning.normalize_q_values = true;
                          }});
}

TEST(TwoLearners, AreOneLearnerBitForBitWithVdnAndABurnIn) {
  expect_two_draw_as_one({.algo = "vdn", .change = [](RunConfig& config) { config.q_learning.burn_in = 1; }});
}

TEST(TwoLearners, AreOneLearnerBitForBitWithQmixAndTheGlobalState) {
  expect_two_draw_as_one({.algo = "qmix", .change = [](RunConfig& config) {
                            config.network.critic_state = CriticState::kGlobal;
                            config.q_learning.normalize_q_values = true;
                          }});
}

TEST(TwoLearners, AreOneLearnerBitForBitWithBothQplex) {
  expect_two_draw_as_one({.algo = "qplex_d"});
  expect_two_draw_as_one({.algo = "qplex_q", .change = [](RunConfig& config) {
                            config.network.use_rnn = false;
                            config.q_learning.target_update_tau = 1;
                            config.q_learning.target_update_interval = 2;
                          }});
}

// Whatever the moment: the update ends, without an exception, and no step is taken.
TEST(TwoLearners, TakeNoStepWhereTheOtherLeavesInTheMidstOfIt) {
  RunConfig config = test::small_config("ippo", 2);
  config.collection.learner_threads = 1;
  config.network.normalize_input = true;
  TrajectoryShape shape = test::small_shape(config, 2);
  shape.env.measurement_count = 3;
  // An update's first numbers: how old the data is, then its measurements. 3: all but its gradient.
  for (const int said : {0, 1, 2, 3})
    in_ranks(2, [&](RankGroup& ranks) {
      if (ranks.rank() == 1 && said < 3) {
        if (said > 0) ranks.gather(torch::zeros({1, 7}, torch::kFloat64), 0);
        if (said > 1) ranks.gather(torch::zeros({config.collection.rollout, 2, 3}), 1);
        return;
      }
      const std::unique_ptr<Algorithm> learner = make(config, shape);
      ASSERT_TRUE(learner->learn_with(ranks));
      const std::vector<std::byte> before = learner->weights();
      RolloutBatch batch = test::noise_batch(shape, 1, 1);
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

TEST(TwoLearners, TakeNoStepOfQlearningWhereTheOtherLeavesInTheMidstOfIt) {
  RunConfig config = test::small_config("idqn", 2);
  config.collection.learner_threads = 1;
  const TrajectoryShape shape = test::small_shape(config, 2);
  // An update's first numbers: what is valid of its batch. 1: all but its gradient.
  for (const int said : {0, 1})
    in_ranks(2, [&](RankGroup& ranks) {
      if (ranks.rank() == 1 && said == 0) return;
      const std::unique_ptr<Algorithm> made = make(config, shape);
      auto& learner = dynamic_cast<OffPolicyAlgorithm&>(*made);
      ASSERT_TRUE(learner.learn_with(ranks));
      const std::vector<std::byte> before = learner.weights();
      const ReplayBatch whole = drawn_batch_of(config, shape, 1);
      ReplayBatch batch = narrow_worlds(whole, ranks.rank(), 1);
      UpdateContext context;
      if (ranks.rank() == 1) context.keep_going = [] { return false; };
      const Expected<UpdateStats> stats = learner.update(batch, context);
      ASSERT_TRUE(stats);
      EXPECT_TRUE(stats->abandoned) << said;
      EXPECT_EQ(learner.version(), 0u) << said;
      EXPECT_TRUE(learner.weights() == before) << said;
      if (ranks.rank() == 0) {
        EXPECT_TRUE(ranks.failure()) << said;
      }
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

/// A user's algorithm that does not define what several learners add up.
class LearnsAlone : public ValueDecomposition {
 public:
  explicit LearnsAlone(const RunConfig& config)
      : ValueDecomposition(config, test::small_shape(config, 2).env, torch::kCPU) {}
  Status learn_with(RankGroup& ranks) override { return Algorithm::learn_with(ranks); }
};

TEST(TwoLearners, AreRefusedWhereAnAlgorithmLearnsAlone) {
  RunConfig config = test::small_config("vdn", 2);
  config.mixers.mixer = "vdn";
  in_ranks(2, [&](RankGroup& ranks) {
    const Status refused = LearnsAlone(config).learn_with(ranks);
    ASSERT_FALSE(refused);
    EXPECT_EQ(refused.error().code, ErrorCode::kUnsupported);
  });
}

}  // namespace rank_group_test
}  // namespace comrad::learn
