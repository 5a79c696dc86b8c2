#include "policy_workers/batching/batcher.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <csignal>
#include <thread>
#include <tuple>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/shm/step_slots.h"
#include "tests/unit/policy_workers/fake_simulators.h"

namespace comrad::policy {
namespace batcher_test {

using shm::RequestKind;
using shm::SlotState;

Batcher make_batcher(const shm::Arena& arena, BatcherOptions options = {},
                     const Clock& clock = kMachineClock) {
  options.seed = 42;
  auto batcher = Batcher::create(arena, options, clock);
  EXPECT_TRUE(batcher);
  return std::move(batcher).value();
}

ActorCritic make_net(const NetworkOptions& options) { return ActorCritic::create(options, 3, torch::kCPU); }

/// gather > forward > scatter. Returns how many requests were answered.
size_t answer_once(Batcher& batcher, const ActorCritic& net, PolicyVersion version = 9,
                   int64_t timeout_us = 0) {
  const Batch& batch = batcher.gather(timeout_us);
  if (!batch.is_empty())
    batcher.scatter(batch, net.step_rows(batch.frames, batch.measurement, batch.recurrent_state), version);
  return batch.requests.size();
}

/// Everything an answer to row `step` consists of.
struct Answer {
  std::vector<int32_t> action;
  std::vector<float> numbers;  // log_prob, value, logits, snapshot, next state
  std::vector<uint32_t> versions;
  bool operator==(const Answer&) const = default;
};

Answer answer_of(const shm::Arena& arena, const FakeEnv& env, int env_index, int step) {
  Answer answer;
  const SlabView slab = env.slab();
  for (int agent = 0; agent < slab.shape().env.num_agents; ++agent) {
    for (int32_t a : slab.action(step, agent)) answer.action.push_back(a);
    answer.numbers.push_back(slab.log_prob(step, agent));
    answer.numbers.push_back(slab.value(step, agent));
    for (float x : slab.logits(step, agent)) answer.numbers.push_back(x);
    for (float x : slab.recurrent_state(0, agent)) answer.numbers.push_back(x);
    answer.versions.push_back(slab.policy_version(step, agent));
  }
  for (float x : arena.step_slots().recurrent(env_index, env.step_id() + 1)) answer.numbers.push_back(x);
  return answer;
}

TEST(Batcher, AnswersAnActionRequestWithWhatTheNetworkComputes) {
  const NetworkOptions options = small_network("lstm");
  const shm::Arena arena = make_arena(options, {});
  const ActorCritic net = make_net(options);
  Batcher batcher = make_batcher(arena);
  FakeSplit split(arena, 0, 0);
  for (FakeEnv& env : split.envs)
    for (float& x : arena.step_slots().recurrent(&env == &split.envs[0] ? 0 : 1, 0)) x = 0.25f;
  split.commit_act();
  ASSERT_EQ(answer_once(batcher, net), 2u);
  for (int index = 0; index < 2; ++index) {
    const FakeEnv& env = split.envs[static_cast<size_t>(index)];
    ASSERT_TRUE(env.has_answer());
    const SlabView slab = env.slab();
    for (int agent = 0; agent < 2; ++agent) {
      const Tensor frame = torch::from_blob(slab.frame(0, agent).data(), {1, 3, 40, 44}, torch::kUInt8);
      const Tensor measurement = torch::full({1, 3}, static_cast<float>(index + agent));
      const PolicyOutput expected = net.step(frame, measurement, torch::full({1, 32}, 0.25));
      EXPECT_NEAR(slab.value(0, agent), expected.value.item<float>(), 1e-5);
      for (int64_t k = 0; k < 5; ++k)
        EXPECT_NEAR(slab.logits(0, agent)[static_cast<size_t>(k)], expected.logits[0][k].item<float>(), 1e-5);
      for (size_t k = 0; k < 32; ++k) {
        EXPECT_EQ(slab.recurrent_state(0, agent)[k], 0.25f) << "row 0 keeps the input state";
        EXPECT_NEAR(arena.step_slots().recurrent(index, 1)[static_cast<size_t>(agent) * 32 + k],
                    expected.recurrent_state[0][static_cast<int64_t>(k)].item<float>(), 1e-5);
        EXPECT_EQ(arena.step_slots().recurrent(index, 0)[static_cast<size_t>(agent) * 32 + k], 0.25f)
            << "the input stays";
      }
      EXPECT_LE(slab.log_prob(0, agent), 0.0f);
      EXPECT_EQ(slab.policy_version(0, agent), 9u);
      EXPECT_LT(slab.action(0, agent)[0], 3);
      EXPECT_LT(slab.action(0, agent)[1], 2);
    }
  }
}

TEST(Batcher, AnEvaluationsDrawsHangOnTheEpisodeAndNotOnItsEnvironment) {
  // Both environments play the same number of an episode with equal logits.
  for (const bool is_evaluation : {true, false}) {
    const shm::Arena arena = make_arena(small_network("none"), {.envs_per_worker = 2, .splits = 1});
    Batcher batcher = make_batcher(arena, {.is_evaluation = is_evaluation});
    FakeSplit split(arena, 0, 0);
    int differing = 0;
    for (int round = 0; round < 30; ++round) {
      split.commit_act();
      const Batch& batch = batcher.gather(0);
      ASSERT_EQ(batch.requests.size(), 2u);
      batcher.scatter_random(batch);
      const auto drawn = [&](size_t env, int agent) {
        const auto action = split.envs[env].slab().action(split.envs[env].step(), agent);
        return std::vector<int32_t>(action.begin(), action.end());
      };
      for (int agent = 0; agent < 2; ++agent) differing += drawn(0, agent) != drawn(1, agent);
      split.take_act();
    }
    if (is_evaluation) {
      EXPECT_EQ(differing, 0);
    } else {
      EXPECT_GT(differing, 20);
    }
  }
}

TEST(Batcher, EverySeatChoosesByItsOwnRule) {
  const NetworkOptions options = small_network("none");
  const shm::Arena arena = make_arena(options, {.envs_per_worker = 1, .splits = 1});
  FakeSplit split(arena, 0, 0);
  PolicyOutput output{
      .logits = torch::zeros({2, 5}), .value = torch::zeros({2}), .recurrent_state = torch::zeros({2, 0})};
  output.logits[0][2] = output.logits[0][4] = output.logits[1][2] = output.logits[1][4] = 0.5;
  using Choice = SeatRule::Choice;
  const auto counts = [&](bool is_greedy, SeatRule first, SeatRule second) {
    Batcher batcher = make_batcher(arena, {.is_greedy = is_greedy});
    batcher.seat({first, second});
    std::array<int, 2> best{};
    std::array<int, 2> none{};
    for (int round = 0; round < 200; ++round) {
      split.commit_act();
      const Batch& batch = batcher.gather(0);
      batcher.scatter(batch, output, 1);
      for (int agent = 0; agent < 2; ++agent) {
        const auto action = split.envs[0].slab().action(split.envs[0].step(), agent);
        best[static_cast<size_t>(agent)] += action[0] == 2;
        none[static_cast<size_t>(agent)] += action[0] == 0 && action[1] == 0;
      }
      split.take_act();
    }
    return std::pair{best, none};
  };
  // Greedily: a network's best, and nothing; chance stays chance.
  auto [best, none] = counts(true, {.choice = Choice::kByPolicy}, {.choice = Choice::kNothing});
  EXPECT_EQ(best[0], 200);
  EXPECT_EQ(none[1], 200);
  std::tie(best, none) =
      counts(true, {.choice = Choice::kByQValues, .epsilon = 1}, {.choice = Choice::kDrawn});
  EXPECT_EQ(best[0], 200) << "no epsilon in greedy play";
  EXPECT_THAT(best[1], ::testing::AllOf(::testing::Gt(50), ::testing::Lt(130)));
  // Not greedily: by the policy's chances, and by an epsilon that is this seat's own.
  std::tie(best, none) =
      counts(false, {.choice = Choice::kByPolicy}, {.choice = Choice::kByQValues, .epsilon = 0});
  EXPECT_THAT(best[0], ::testing::AllOf(::testing::Gt(50), ::testing::Lt(130)));
  EXPECT_EQ(best[1], 200);
}

TEST(Batcher, AFirstDecisionStartsFromTheZeroState) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {.envs_per_worker = 1, .splits = 1});
  Batcher batcher = make_batcher(arena);
  FakeSplit split(arena, 0, 0);
  for (float& x : arena.step_slots().recurrent(0, 0)) x = 5.0f;
  split.envs[0].slab().recurrent_state(0, 0)[0] = 7.0f;
  split.commit_act(/*reset_state=*/true);
  const Batch& batch = batcher.gather(0);
  ASSERT_EQ(batch.requests.size(), 1u);
  EXPECT_EQ(batch.recurrent_state.abs().max().item<float>(), 0.0f);
  batcher.scatter(batch, make_net(options).step_rows(batch.frames, batch.measurement, batch.recurrent_state),
                  1);
  EXPECT_EQ(split.envs[0].slab().recurrent_state(0, 0)[0], 0.0f);
}

TEST(Batcher, TheOutputStateOfOneStepIsTheInputOfTheNext) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {.envs_per_worker = 1, .splits = 1, .recurrent_snapshots = 5});
  const ActorCritic net = make_net(options);
  Batcher batcher = make_batcher(arena);
  FakeSplit split(arena, 0, 0);
  std::vector<float> after;
  for (int step = 0; step < 4; ++step) {
    split.commit_act(step == 0);
    ASSERT_EQ(answer_once(batcher, net), 1u);
    for (size_t k = 0; step > 0 && k < 16; ++k)
      EXPECT_EQ(split.envs[0].slab().recurrent_state(step, 1)[k], after[16 + k])
          << "snapshot of step " << step;
    const auto state = arena.step_slots().recurrent(0, static_cast<uint64_t>(step) + 1);
    after.assign(state.begin(), state.end());
    split.take_act();
  }
}

TEST(Batcher, ValueAndFinalRequestsLeaveTheStateAndTheActionsAlone) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {.envs_per_worker = 2, .splits = 1});
  const ActorCritic net = make_net(options);
  Batcher batcher = make_batcher(arena);
  FakeSplit split(arena, 0, 0);
  FakeEnv &full = split.envs[0], &truncated = split.envs[1];
  for (int env = 0; env < 2; ++env) {
    for (float& x : arena.step_slots().recurrent(env, 0)) x = 0.5f;
    for (float& x : arena.step_slots().recurrent(env, 1)) x = -1.0f;
  }
  const int last = arena.shape().trajectory.rollout_steps;
  for (int agent = 0; agent < 2; ++agent) {
    full.slab().value(last, agent) = 99.0f;
    full.slab().recurrent_state(0, agent)[0] = 3.0f;
    truncated.slab().final_value(2, agent) = 99.0f;
    truncated.slab().value(0, agent) = 99.0f;
    truncated.slab().action(0, agent)[0] = -5;
  }
  split.announce(2);
  full.commit(RequestKind::kValue, last, 0, false);
  truncated.commit_final(2);
  split.ring();
  ASSERT_EQ(answer_once(batcher, net), 2u);
  for (int agent = 0; agent < 2; ++agent) {
    EXPECT_NE(full.slab().value(last, agent), 99.0f);
    EXPECT_EQ(full.slab().recurrent_state(0, agent)[0], 3.0f);
    EXPECT_NE(truncated.slab().final_value(2, agent), 99.0f);
    EXPECT_EQ(truncated.slab().value(0, agent), 99.0f);
    EXPECT_EQ(truncated.slab().action(0, agent)[0], -5);
    const Tensor frame =
        torch::from_blob(truncated.slab().final_frame(2, agent).data(), {1, 3, 40, 44}, torch::kUInt8);
    const Tensor measurement =
        torch::from_blob(truncated.slab().final_measurement(2, agent).data(), {1, 3}, torch::kFloat32);
    EXPECT_NEAR(truncated.slab().final_value(2, agent),
                net.step(frame, measurement, torch::full({1, 16}, 0.5)).value.item<float>(), 1e-5);
  }
  for (int env = 0; env < 2; ++env) {
    for (float x : arena.step_slots().recurrent(env, 0)) EXPECT_EQ(x, 0.5f);
    for (float x : arena.step_slots().recurrent(env, 1)) EXPECT_EQ(x, -1.0f);
  }
}

TEST(Batcher, ACentralCriticIsShownTheStateOfEachWorldAndOfACutEpisodesEnd) {
  NetworkOptions options = small_network("none");
  options.critic = CriticKind::kCentral;
  options.critic_widths = {8};
  options.env.global_state_count = 3;
  options.global_state_count = 3;
  const shm::Arena arena = make_arena(options, {.envs_per_worker = 2, .splits = 1});
  const ActorCritic net = make_net(options);
  Batcher batcher = make_batcher(arena);
  FakeSplit split(arena, 0, 0);
  FakeEnv &acting = split.envs[0], &truncated = split.envs[1];
  std::ranges::copy(std::array{0.5f, -1.0f, 2.0f}, acting.slab().global_state(0).begin());
  std::ranges::copy(std::array{3.0f, 1.0f, 0.0f}, truncated.slab().final_global_state(2).begin());
  std::ranges::fill(truncated.slab().global_state(0), 77.0f);  // not what was asked about
  split.announce(2);
  acting.commit_act(true);
  truncated.commit_final(2);
  split.ring();
  const Batch& batch = batcher.gather(0);
  ASSERT_EQ(batch.requests.size(), 2u);
  const Tensor expected = torch::tensor({{0.5f, -1.0f, 2.0f}, {3.0f, 1.0f, 0.0f}});
  ASSERT_TRUE(torch::equal(batch.global_state, expected));
  const PolicyOutput output =
      net.step_rows(batch.frames, batch.measurement, batch.recurrent_state, batch.global_state);
  batcher.scatter(batch, output, 9);
  for (int agent = 0; agent < 2; ++agent) {
    EXPECT_EQ(acting.slab().value(0, agent), output.value[agent].item<float>());
    EXPECT_EQ(truncated.slab().final_value(2, agent), output.value[2 + agent].item<float>());
  }
}

TEST(Batcher, InLockStepABatchIsExactlyOneCompleteSplitInEnvironmentOrder) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {.sim_workers = 2, .envs_per_worker = 6});
  Batcher batcher = make_batcher(arena, {.min_batch = 1, .max_batch = 1, .is_deterministic = true});
  FakeSplit late(arena, 0, 1), first(arena, 1, 0);
  late.announce(3);
  late.envs[0].commit_act();
  late.envs[2].commit_act();
  late.ring();
  EXPECT_TRUE(batcher.gather(20'000).is_empty()) << "a split of three with two requests is not complete";
  first.commit_act();
  {
    const Batch& batch = batcher.gather(0);
    ASSERT_EQ(batch.requests.size(), 3u);
    for (int index = 0; index < 3; ++index)
      EXPECT_EQ(batch.requests[static_cast<size_t>(index)].env_index, 6 + index);
    batcher.scatter_random(batch);
  }
  late.envs[1].commit_act();
  late.ring();
  const Batch& batch = batcher.gather(0);
  ASSERT_EQ(batch.requests.size(), 3u);
  for (int index = 0; index < 3; ++index)
    EXPECT_EQ(batch.requests[static_cast<size_t>(index)].env_index, 3 + index);
  batcher.scatter_random(batch);
  EXPECT_TRUE(batcher.gather(0).is_empty());
}

TEST(Batcher, WaitsForTheMinimumButNotLongerThanTheLimit) {
  const shm::Arena arena = make_arena(small_network(), {.sim_workers = 2, .envs_per_worker = 4});
  ManualClock clock;
  Batcher batcher = make_batcher(arena, {.min_batch = 4, .max_batch = 8, .max_wait_us = 60'000}, clock);
  FakeSplit one(arena, 0, 0), two(arena, 1, 1);
  one.commit_act();
  EXPECT_TRUE(batcher.gather(0).is_empty()) << "it gives a second split time to come";
  clock.advance_ns(59'999'999);
  EXPECT_TRUE(batcher.gather(0).is_empty());
  clock.advance_ns(1);
  const Batch& overdue = batcher.gather(0);
  EXPECT_EQ(overdue.requests.size(), 2u);
  batcher.scatter_random(overdue);
  one.take_act();
  one.commit_act();
  two.commit_act();
  // Enough requests are taken at once: one that waited here would wait for an hour.
  Batcher patient = make_batcher(arena, {.min_batch = 4, .max_batch = 8, .max_wait_us = 3'600'000'000});
  EXPECT_EQ(patient.gather(3'600'000'000).requests.size(), 4u);
}

TEST(Batcher, NeverExceedsTheMaximumAndServesEverySplitInTurn) {
  const shm::Arena arena = make_arena(small_network(), {.sim_workers = 3, .envs_per_worker = 4});
  Batcher batcher = make_batcher(arena, {.min_batch = 1, .max_batch = 5, .max_wait_us = 0});
  std::vector<FakeSplit> splits;
  for (int sim_worker = 0; sim_worker < 3; ++sim_worker)
    for (int split = 0; split < 2; ++split) splits.emplace_back(arena, sim_worker, split).commit_act();
  size_t answered = 0;
  for (int round = 0; round < 3; ++round) {
    const Batch& batch = batcher.gather(0);
    EXPECT_EQ(batch.requests.size(), 4u) << "two whole splits of two fit into five";
    answered += batch.requests.size();
    batcher.scatter_random(batch);
  }
  EXPECT_EQ(answered, 12u);
  for (FakeSplit& split : splits)
    for (FakeEnv& env : split.envs) EXPECT_TRUE(env.has_answer());
}

TEST(Batcher, CutsASplitThatIsLargerThanTheMaximum) {
  const shm::Arena arena = make_arena(small_network(), {.envs_per_worker = 7, .splits = 1});
  Batcher batcher = make_batcher(arena, {.min_batch = 1, .max_batch = 3, .max_wait_us = 0});
  FakeSplit split(arena, 0, 0);
  split.commit_act();
  for (const size_t expected : {3u, 3u, 1u}) {
    const Batch& batch = batcher.gather(0);
    EXPECT_EQ(batch.requests.size(), expected);
    batcher.scatter_random(batch);
  }
  EXPECT_TRUE(split.await());
}

TEST(Batcher, ServesOnlyItsOwnSplits) {
  const shm::Arena arena = make_arena(small_network(), {.sim_workers = 2, .policy_workers = 3});
  std::vector<FakeSplit> splits;
  for (int sim_worker = 0; sim_worker < 2; ++sim_worker)
    for (int split = 0; split < 2; ++split) splits.emplace_back(arena, sim_worker, split).commit_act();
  int64_t served = 0;
  for (int worker = 0; worker < 3; ++worker) {
    Batcher batcher = make_batcher(arena, {.policy_worker = worker, .min_batch = 1, .max_wait_us = 0});
    served += batcher.env_count();
    const Batch& batch = batcher.gather(0);
    for (const Request& request : batch.requests)
      EXPECT_EQ(arena.shape().policy_worker_of(request.sim_worker, request.split), worker);
    EXPECT_EQ(static_cast<int64_t>(batch.requests.size()), batcher.env_count());
  }
  EXPECT_EQ(served, 8);
  const auto refused = Batcher::create(arena, {.policy_worker = 3});
  ASSERT_FALSE(refused);
  EXPECT_EQ(refused.error().code, ErrorCode::kBadInput);
}

TEST(Batcher, LimitsStayWithinWhatIsServed) {
  const shm::Arena arena = make_arena(small_network(), {.sim_workers = 6, .envs_per_worker = 4});
  EXPECT_EQ(make_batcher(arena).max_batch(), 24);
  EXPECT_EQ(make_batcher(arena, {.min_batch = 100}).min_batch(), 24) << "more would never be there";
  EXPECT_EQ(make_batcher(arena, {.min_batch = 0}).min_batch(), 1);
  EXPECT_EQ(make_batcher(arena, {.min_batch = 8, .max_batch = 4}).max_batch(), 8);
}

TEST(Batcher, RefusesIndicesOutOfRange) {
  const shm::Arena arena = make_arena(small_network(), {.envs_per_worker = 4, .splits = 1});
  Batcher batcher = make_batcher(arena, {.min_batch = 1, .max_wait_us = 0});
  FakeSplit split(arena, 0, 0);
  split.commit_act();
  arena.step_slots().slot(0).slab_index = 1u << 30;
  arena.step_slots().slot(1).step = 4;  // T: a row without an action
  arena.step_slots().slot(2).kind = static_cast<RequestKind>(77);
  const Batch& batch = batcher.gather(0);
  ASSERT_EQ(batch.requests.size(), 1u);
  EXPECT_EQ(batch.requests[0].env_index, 3);
  EXPECT_EQ(batcher.refused_count(), 3u);
  batcher.scatter_random(batch);
  EXPECT_TRUE(split.await()) << "no worker hangs";
}

TEST(Batcher, ASlotTakenAwayMeanwhileIsNotAnswered) {
  const shm::Arena arena = make_arena(small_network(), {.envs_per_worker = 2, .splits = 1});
  Batcher batcher = make_batcher(arena, {.min_batch = 1, .max_wait_us = 0});
  FakeSplit split(arena, 0, 0);
  split.commit_act();
  const Batch& batch = batcher.gather(0);
  ASSERT_EQ(batch.requests.size(), 2u);
  split.envs[0].slab().value(0, 0) = 99.0f;
  arena.step_slots().slot(0).state.store(SlotState::kIdle);  // the supervisor idled a dead simulator's slot
  batcher.scatter_random(batch);
  EXPECT_EQ(arena.step_slots().slot(0).state.load(), SlotState::kIdle);
  EXPECT_EQ(split.envs[0].slab().value(0, 0), 99.0f);
  EXPECT_TRUE(split.envs[1].has_answer());
}

TEST(Batcher, MaskedChoicesAreNeverAnswered) {
  const shm::Arena arena =
      make_arena(small_network(), {.envs_per_worker = 2, .splits = 1, .rollout_steps = 8});
  Batcher batcher = make_batcher(arena, {.min_batch = 1, .max_wait_us = 0});
  FakeSplit split(arena, 0, 0);
  for (int step = 0; step < 200; ++step) {
    split.announce(2);
    for (FakeEnv& env : split.envs) env.commit_act();
    for (FakeEnv& env : split.envs) {
      const auto mask = env.slab().action_mask(env.step(), 0);
      mask[0] = mask[4] = 0;
    }
    batcher.scatter_random(batcher.gather(0));
    for (FakeEnv& env : split.envs) {
      EXPECT_NE(env.slab().action(env.step(), 0)[0], 0);
      EXPECT_EQ(env.slab().action(env.step(), 0)[1], 0);
      EXPECT_NEAR(env.slab().log_prob(env.step(), 0), std::log(0.5), 1e-6);
      EXPECT_NEAR(env.slab().log_prob(env.step(), 1), std::log(1.0 / 6), 1e-6);
    }
    split.take_act();
  }
}

TEST(Batcher, QValuesAreFollowedUpToTheEpsilonOfTheRunsEnvFrames) {
  NetworkOptions options = small_network();
  options.critic = CriticKind::kNone;
  const ActorCritic net = make_net(options);
  for (const auto& [epsilon, exploration] : {std::pair(0.0f, Exploration::kPerHead),
                                             {0.5f, Exploration::kPerHead},
                                             {1.0f, Exploration::kPerHead},
                                             {0.5f, Exploration::kAllHeads}}) {
    for (const bool greedy : {false, true}) {
      const shm::Arena arena = make_arena(options, {.envs_per_worker = 8, .splits = 1, .rollout_steps = 40});
      arena.control().schedule_env_frames = 3000;
      Batcher batcher = make_batcher(arena, {.min_batch = 1,
                                             .max_wait_us = 0,
                                             .is_greedy = greedy,
                                             .is_epsilon_greedy = true,
                                             .epsilon = Schedule::line(0, 2 * epsilon, 6000),
                                             .exploration = exploration});
      FakeSplit split(arena, 0, 0);
      int best = 0, all = 0;
      for (int step = 0; step < 40; ++step) {
        split.announce(8);
        for (FakeEnv& env : split.envs) env.commit_act();
        ASSERT_EQ(answer_once(batcher, net), 8u);
        for (FakeEnv& env : split.envs)
          for (int agent = 0; agent < 2; ++agent) {
            const SlabView slab = env.slab();
            const auto q = slab.logits(env.step(), agent);
            const auto largest = [&](int first, int size) {
              return static_cast<int>(std::max_element(q.begin() + first, q.begin() + first + size) -
                                      q.begin()) -
                     first;
            };
            const auto action = slab.action(env.step(), agent);
            best += action[0] == largest(0, 3) && action[1] == largest(3, 2);
            ++all;
            EXPECT_NEAR(
                slab.value(env.step(), agent),
                q[static_cast<std::size_t>(largest(0, 3))] + q[static_cast<std::size_t>(3 + largest(3, 2))],
                1e-5);
          }
        split.take_act();
      }
      const double e =
          double{epsilon};  // a greedy action comes up by chance, too: of six, or of three and two
      const double expected = greedy                                  ? 1.0
                              : exploration == Exploration::kAllHeads ? 1.0 - e * 5 / 6
                                                                      : (1.0 - e * 2 / 3) * (1.0 - e / 2);
      EXPECT_NEAR(best / double(all), expected, 4 * std::sqrt(expected * (1 - expected) / all) + 1e-9)
          << epsilon << greedy;
    }
  }
}

TEST(Batcher, RandomAnswersAreUniform) {
  const shm::Arena arena = make_arena(small_network(), {.envs_per_worker = 8, .splits = 1});
  Batcher batcher = make_batcher(arena, {.min_batch = 1, .max_wait_us = 0});
  FakeSplit split(arena, 0, 0);
  int counts[3] = {}, draws = 0;
  for (int step = 0; step < 1500; ++step) {
    split.announce(8);
    for (FakeEnv& env : split.envs) env.commit(RequestKind::kAct, env.step(), 0, false);
    batcher.scatter_random(batcher.gather(0));
    for (FakeEnv& env : split.envs)
      for (int agent = 0; agent < 2; ++agent, ++draws) ++counts[env.slab().action(env.step(), agent)[0]];
    split.take_act();
  }
  for (int count : counts) EXPECT_NEAR(count / static_cast<double>(draws), 1.0 / 3, 0.015);
}

TEST(Batcher, ActionsDoNotDependOnHowRequestsAreBatched) {
  const NetworkOptions options = small_network();
  const ActorCritic net = make_net(options);
  std::vector<std::vector<int32_t>> actions;
  std::vector<std::vector<float>> values;
  for (const bool deterministic : {true, false}) {
    const shm::Arena arena =
        make_arena(options, {.sim_workers = 3, .envs_per_worker = 4, .rollout_steps = 32});
    Batcher batcher =
        make_batcher(arena, {.min_batch = 12, .max_wait_us = 0, .is_deterministic = deterministic});
    std::vector<FakeSplit> splits;
    for (int sim_worker = 0; sim_worker < 3; ++sim_worker)
      for (int split = 0; split < 2; ++split) splits.emplace_back(arena, sim_worker, split);
    size_t forwards = 0;
    for (int step = 0; step < 24; ++step) {
      for (FakeSplit& split : splits) split.commit_act(step % 10 == 0);
      while (answer_once(batcher, net) > 0) ++forwards;
      for (FakeSplit& split : splits) split.take_act();
    }
    EXPECT_EQ(forwards, deterministic ? 24u * 6 : 24u);
    actions.emplace_back();
    values.emplace_back();
    for (FakeSplit& split : splits)
      for (FakeEnv& env : split.envs)
        for (int step = 0; step < 24; ++step)
          for (int agent = 0; agent < 2; ++agent) {
            for (int32_t a : env.slab().action(step, agent)) actions.back().push_back(a);
            values.back().push_back(env.slab().value(step, agent));
          }
  }
  EXPECT_EQ(actions[0], actions[1]);
  for (size_t index = 0; index < values[0].size(); ++index)
    ASSERT_NEAR(values[0][index], values[1][index], 1e-5);
}

TEST(Batcher, ASuccessorAnswersWhatAKilledWorkerHadGatheredWithTheSameResult) {
  at::set_num_threads(1);  // no thread pool must exist when the process forks
  const NetworkOptions options = small_network("lstm");
  const ActorCritic net = make_net(options);
  std::vector<std::vector<Answer>> answers;
  for (const bool killed : {false, true}) {
    const shm::Arena arena = make_arena(options, {.envs_per_worker = 4, .splits = 1});
    FakeSplit split(arena, 0, 0);
    for (int env = 0; env < 4; ++env)
      for (float& x : arena.step_slots().recurrent(env, 0)) x = 0.1f * static_cast<float>(env);
    split.commit_act();
    if (killed) {
      const pid_t child = fork();
      ASSERT_GE(child, 0);
      if (child == 0) {
        Batcher batcher = make_batcher(arena);
        const Batch& batch = batcher.gather(0);
        if (batch.requests.size() != 4) _exit(1);
        // Half an answer: everything but the hand-over of the slots, and garbage where rows were not
        // reached yet.
        for (FakeEnv& env : split.envs) {
          std::ranges::fill(env.slab().action(0, 0), 12345);
          env.slab().log_prob(0, 1) = -77.0f;
        }
        std::ranges::fill(arena.step_slots().recurrent(2, 1), 1e9f);
        raise(SIGKILL);
      }
      int status = 0;
      ASSERT_EQ(waitpid(child, &status, 0), child);
      ASSERT_TRUE(WIFSIGNALED(status));
      for (int env = 0; env < 4; ++env)
        ASSERT_EQ(arena.step_slots().slot(env).state.load(), SlotState::kInBatch);
    }
    Batcher successor = make_batcher(arena);
    EXPECT_EQ(successor.adopt_orphans(), killed ? 4 : 0);
    ASSERT_EQ(answer_once(successor, net), 4u);
    EXPECT_TRUE(split.await());
    answers.emplace_back();
    for (int env = 0; env < 4; ++env)
      answers.back().push_back(answer_of(arena, split.envs[static_cast<size_t>(env)], env, 0));
  }
  EXPECT_EQ(answers[0], answers[1]);
}

TEST(Batcher, ARoundThatAKilledWorkerHandedBackInPartIsFinishedInLockStep) {
  const shm::Arena arena = make_arena(small_network(), {.envs_per_worker = 3, .splits = 1});
  FakeSplit split(arena, 0, 0);
  split.commit_act();
  {
    Batcher dead = make_batcher(arena, {.is_deterministic = true});
    ASSERT_EQ(dead.gather(0).requests.size(), 3u);
    arena.step_slots().slot(0).state.store(SlotState::kActed);  // one slot was handed back, then it died
  }
  Batcher successor = make_batcher(arena, {.is_deterministic = true});
  EXPECT_EQ(successor.adopt_orphans(), 2);
  const Batch& batch = successor.gather(0);
  ASSERT_EQ(batch.requests.size(), 2u);
  successor.scatter_random(batch);
  EXPECT_TRUE(split.await());
}

TEST(Batcher, SimulatorsInThreadsGetEveryAnswer) {
  const NetworkOptions options = small_network();
  const shm::Arena arena = make_arena(options, {.sim_workers = 3, .envs_per_worker = 4, .rollout_steps = 16});
  const ActorCritic net = make_net(options);
  constexpr int kRounds = 150;
  std::atomic<int> unanswered{0}, wrong{0}, running{3};
  std::vector<std::thread> simulators;
  for (int sim_worker = 0; sim_worker < 3; ++sim_worker)
    simulators.emplace_back([&, sim_worker] {
      FakeSplit splits[] = {{arena, sim_worker, 0}, {arena, sim_worker, 1}};
      for (int round = 0; round < kRounds; ++round)
        for (FakeSplit& split : splits) {
          if (round > 0) {
            if (!split.await()) ++unanswered;
            for (FakeEnv& env : split.envs) wrong += env.slab().policy_version(env.step(), 0) != 9;
            split.take_act();
          }
          split.commit_act(round % 40 == 0);
        }
      for (FakeSplit& split : splits) unanswered += !split.await();
      --running;
    });
  Batcher batcher = make_batcher(arena, {.max_wait_us = 500});
  size_t answered = 0;
  while (running > 0) answered += answer_once(batcher, net, 9, 20'000);
  for (std::thread& simulator : simulators) simulator.join();
  EXPECT_EQ(unanswered, 0);
  EXPECT_EQ(wrong, 0);
  EXPECT_EQ(answered, 12u * kRounds);
}

}  // namespace batcher_test
}  // namespace comrad::policy
