#include "learner/algorithms/q_learning.h"

#include <gtest/gtest.h>
#include <torch/torch.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <limits>
#include <map>
#include <numeric>

#include "tests/support/noise_batch.h"

namespace comrad::learn {
namespace q_learning_test {

using test::copies;
using test::SlabPool;

constexpr int kAgents = 2, kWorlds = 5;

RunConfig q_config(const std::string& algo, bool use_rnn) {
  RunConfig config = test::small_config(algo, kAgents);
  config.collection.rollout = 6;
  config.network.use_rnn = use_rnn;
  config.mixers.mixer = algo == "vdn"       ? "vdn"
                        : algo == "qmix"    ? "qmix"
                        : algo == "qplex_d" ? "dmaq"
                        : algo == "qplex_q" ? "dmaq_qatten"
                                            : "";
  config.q_learning.team_reward = TeamReward::kSum;
  config.collection.learner_threads = 2;
  config.optimisation.learning_rate = 1e-3;
  return config;
}

/// Noise with an end, a time-out, a short trajectory, forbidden choices and an agent that is out of the game.
ReplayBatch q_batch(const RunConfig& config, uint64_t seed) {
  const TrajectoryShape shape = test::small_shape(config, kAgents);
  SlabPool pool(shape, kWorlds);
  pool.fill_with_noise(seed);
  const SlabView cut = pool.view(0), ends = pool.view(1), masked = pool.view(2);
  cut.truncated(2) = 1;
  cut.final_index(2) = 0;
  Rng rng(seed + 1);
  for (int agent = 0; agent < kAgents; ++agent)
    for (uint8_t& pixel : cut.final_frame(0, agent)) pixel = static_cast<uint8_t>(rng.next());
  ends.terminated(3) = 1;
  ends.agent_active(1, 1) = ends.agent_active(2, 1) = 0;
  for (int t = 0; t <= 6; ++t) {
    masked.action_mask(t, 0)[1] = 0;
    if (t < 6) masked.action(t, 0)[0] = 2;
  }
  auto replay = *replay::Replay::create({.store = {.shape = shape, .capacity_bytes = 1 << 24}});
  for (int i = 0; i < kWorlds; ++i) replay->insert(pool.view(i), i == 4 ? 3 : 6);

  const replay::Unit unit = config.network.use_rnn      ? replay::Unit::kSequence
                            : config.run.algo == "idqn" ? replay::Unit::kAgentStep
                                                        : replay::Unit::kJointStep;
  std::vector<replay::Draw> draws;
  for (int item = 0; item < kWorlds; ++item) {
    const int steps = config.network.use_rnn ? 1 : 3;
    for (int step = 0; step < steps; ++step)
      for (int agent = 0; agent < (unit == replay::Unit::kAgentStep ? kAgents : 1); ++agent)
        draws.push_back({.item = item,
                         .step = config.network.use_rnn ? -1 : step,
                         .agent = agent,
                         .weight = 0.5 + 0.1 * item,
                         .serial = static_cast<int64_t>(draws.size())});
  }
  const ReplayBatchOptions options{.shape = shape,
                                   .unit = unit,
                                   .world_count = static_cast<int64_t>(draws.size()),
                                   .n_step = config.q_learning.n_step.rounded_at(0),
                                   .pay = {.gamma = config.optimisation.gamma},
                                   .agents_end = config.run.algo == "idqn"};
  ReplayBatch batch = make_replay_batch(options);
  fill(batch, options, *replay, draws);
  return batch;
}

/// Q-values of a batch by one decision after the other, as a policy worker computes them.
struct Stepped {
  std::vector<Tensor> now;   ///< [T+1] of [R, A]
  std::vector<Tensor> next;  ///< [T] of [R, A]: of the true observation behind the step
};

Stepped step_through(const policy::ActorCritic& net, const ReplayBatch& batch) {
  Stepped stepped;
  Tensor state = batch.recurrent_state;
  std::vector<Tensor> states;
  for (int64_t t = 0; t <= batch.steps(); ++t) {
    if (state.size(1) > 0) state = state * batch.reset[t].eq(0).to(torch::kFloat32).unsqueeze(1);
    const policy::PolicyOutput output = net.step(batch.frame[t], {}, state);
    stepped.now.push_back(output.logits);
    states.push_back(state = output.recurrent_state);
  }
  for (int64_t t = 0; t < batch.steps(); ++t) {
    Tensor next = stepped.now[static_cast<std::size_t>(t + 1)].clone();
    // A network of many agents needs whole worlds, so the cut's rows are put among the others'.
    Tensor frame = batch.frame[t].clone();
    for (std::size_t f = 0; f < batch.final_row.size(); ++f)
      if (batch.final_step[f] == t) frame[batch.final_row[f]] = batch.final_frame[static_cast<int64_t>(f)];
    const Tensor behind = net.step(frame, {}, states[static_cast<std::size_t>(t)]).logits;
    for (std::size_t f = 0; f < batch.final_row.size(); ++f)
      if (batch.final_step[f] == t) next[batch.final_row[f]] = behind[batch.final_row[f]];
    stepped.next.push_back(next);
  }
  return stepped;
}

double huber_of(double x) { return std::abs(x) <= 1 ? 0.5 * x * x : std::abs(x) - 0.5; }

/// Best allowed choice of a head.
int64_t best_choice(const Tensor& q, const Tensor& mask, int64_t first, int64_t size) {
  int64_t best = -1;
  for (int64_t choice = first; choice < first + size; ++choice) {
    if (mask[choice].item<int>() == 0) continue;
    if (best < 0 || q[choice].item<float>() > q[best].item<float>()) best = choice;
  }
  return best - first;
}

/// The mean loss over valid samples, straight from the equations, for vdn and idqn.
double plain_loss(const RunConfig& config, const QLearning& learner, const ReplayBatch& batch) {
  const Stepped online = step_through(learner.net(), batch),
                target = step_through(learner.target_net(), batch);
  const int64_t agents = batch.shape.env.num_agents;
  const std::vector<int64_t> first = {0, 3}, size = {3, 2};
  double sum = 0, count = 0;
  for (int64_t t = config.q_learning.burn_in; t < batch.steps(); ++t)
    for (int64_t world = 0; world < batch.world_count; ++world) {
      const double weight = batch.weight[world].item<double>();
      double team_q = 0, team_next = 0, team_reward = 0;
      bool is_valid = true, ends = false;
      double bootstrap = 1;
      for (int64_t agent = 0; agent < agents; ++agent) {
        const int64_t row = world * agents + agent;
        const auto at = static_cast<std::size_t>(t);
        const bool cut = batch.truncated[t][row].item<int>() != 0;
        const Tensor mask = (batch.steps() > 1 && cut ? batch.action_mask[t] : batch.action_mask[t + 1])[row];
        const double active = batch.agent_active[t][row].item<int>();
        const double next_active =
            (batch.steps() > 1 && cut ? batch.agent_active[t] : batch.agent_active[t + 1])[row].item<int>();
        const double reward = batch.reward[t][row].item<double>();
        ends = batch.terminated[t][row].item<int>() != 0;
        bootstrap = batch.bootstrap[t][row].item<double>();
        is_valid &= batch.valid[t][row].item<int>() != 0;
        double of_heads = 0;
        for (int64_t head = 0; head < 2; ++head) {
          const auto h = static_cast<std::size_t>(head);
          const int64_t chosen = first[h] + batch.action[t][row][head].item<int64_t>();
          const int64_t best = first[h] + best_choice(online.next[at][row], mask, first[h], size[h]);
          const double q = online.now[at][row][chosen].item<double>(),
                       next = target.next[at][row][best].item<double>();
          team_q += q * active;
          team_next += next * next_active;
          of_heads += huber_of(q - (reward + config.optimisation.gamma * bootstrap * (ends ? 0 : next))) / 2;
        }
        team_reward += reward;
        if (config.run.algo == "idqn" && active != 0 && batch.valid[t][row].item<int>() != 0) {
          sum += weight * of_heads;
          ++count;
        }
      }
      if (config.run.algo == "idqn" || !is_valid) continue;
      const double y = team_reward + config.optimisation.gamma * bootstrap * (ends ? 0 : team_next);
      sum += weight * huber_of(team_q - std::clamp(y, -config.q_learning.q_value_clamp,
                                                   config.q_learning.q_value_clamp));
      ++count;
    }
  return sum / count;
}

/// Moves the targets away from the online networks.
void disturb_targets(const QLearning& learner) {
  torch::NoGradGuard no_grad;
  torch::manual_seed(3);
  for (const Tensor& parameter : learner.target_parameters())
    parameter.add_(torch::randn_like(parameter), 0.05);
}

std::unique_ptr<QLearning> q_learner(const RunConfig& config) {
  auto made = make_algorithm(config, test::small_shape(config, kAgents).env, torch::kCPU);
  EXPECT_TRUE(made) << made.error().message;
  return std::unique_ptr<QLearning>(dynamic_cast<QLearning*>(made->release()));
}

double loss_of(QLearning& learner, ReplayBatch& batch, double* regularizer = nullptr) {
  TermValues terms;
  EXPECT_TRUE(learner.accumulate_gradient(batch, {}, terms));
  if (regularizer != nullptr) *regularizer = terms["attend_mag_regs"];
  return terms["td_loss"];
}

std::vector<Tensor> gradients_of(const QLearning& learner) {
  std::vector<Tensor> result;
  for (const Tensor& parameter : learner.parameters()) {
    result.push_back(parameter.grad().defined() ? parameter.grad().clone() : torch::zeros_like(parameter));
    if (parameter.grad().defined()) parameter.mutable_grad().zero_();
  }
  return result;
}

struct Case {
  const char* algo;
  bool use_rnn;
};

/// The algorithm's loss of a batch of noise is that of the plain loops.
void expect_plain_loss(const RunConfig& config, uint64_t seed) {
  const auto learner = q_learner(config);
  disturb_targets(*learner);
  ReplayBatch batch = q_batch(config, seed);
  EXPECT_NEAR(loss_of(*learner, batch), plain_loss(config, *learner, batch), 2e-5);
}

class PlainLoop : public ::testing::TestWithParam<Case> {};

TEST_P(PlainLoop, TheLossIsThatOfTheEquations) {
  RunConfig config = q_config(GetParam().algo, GetParam().use_rnn);
  config.q_learning.q_value_clamp = 0.8;
  expect_plain_loss(config, 11);
}

/// Single agents' decisions are for one network.
class SeparateNetworks : public PlainLoop {};

TEST_P(SeparateNetworks, LearnFromTheirOwnRows) {
  RunConfig config = q_config(GetParam().algo, GetParam().use_rnn);
  config.network.share_parameters = false;
  expect_plain_loss(config, 12);
}

/// Sequences get theirs from td_targets.
class SeveralSteps : public PlainLoop {};

TEST_P(SeveralSteps, OfRewardBootstrapBehindTheLast) {
  RunConfig config = q_config(GetParam().algo, GetParam().use_rnn);
  config.q_learning.n_step = 3;
  EXPECT_LT(q_batch(config, 13).bootstrap.min().item<float>(), 0.99f);
  expect_plain_loss(config, 13);
}

std::string case_name(const ::testing::TestParamInfo<Case>& info) {
  return std::string(info.param.algo) + (info.param.use_rnn ? "_gru" : "_flat");
}
constexpr Case kVdnGru{"vdn", true}, kVdnFlat{"vdn", false}, kIdqnGru{"idqn", true}, kIdqnFlat{"idqn", false};
INSTANTIATE_TEST_SUITE_P(QLearning, PlainLoop, ::testing::Values(kVdnGru, kVdnFlat, kIdqnGru, kIdqnFlat),
                         case_name);
INSTANTIATE_TEST_SUITE_P(QLearning, SeparateNetworks, ::testing::Values(kVdnGru, kVdnFlat, kIdqnGru),
                         case_name);
INSTANTIATE_TEST_SUITE_P(QLearning, SeveralSteps, ::testing::Values(kVdnFlat, kIdqnFlat), case_name);

UpdateContext context_at(double env_frames) {
  UpdateContext context;
  context.env_frames = env_frames;
  return context;
}

TEST(QLearning, NStepOfSequencesFollowsTheEnvFrames) {
  for (const char* algo : {"idqn", "vdn", "qmix"}) {
    RunConfig config = q_config(algo, true);
    ReplayBatch batch = q_batch(config, 19);
    const auto loss_at = [&](const Schedule& n_step, double env_frames) {
      config.q_learning.n_step = n_step;
      const auto learner = q_learner(config);
      TermValues terms;
      EXPECT_TRUE(learner->accumulate_gradient(batch, context_at(env_frames), terms));
      return terms["td_loss"];
    };
    const Schedule falling = Schedule::line(5, 2, 3000);
    for (const auto& [env_frames, n_step] : {std::pair(0.0, 5), {1000.0, 4}, {2400.0, 3}, {9000.0, 2}})
      EXPECT_EQ(loss_at(falling, env_frames), loss_at(n_step, 0)) << algo << " at " << env_frames;
    EXPECT_NE(loss_at(5, 0), loss_at(2, 0)) << algo;
  }
  // One learner over the whole way, and one that resumes on it.
  RunConfig config = q_config("qmix", true);
  config.q_learning.n_step = Schedule::line(5, 1, 4000);
  const auto one = q_learner(config), other = q_learner(config);
  ReplayBatch batch = q_batch(config, 20);
  StateDict state;
  for (int i = 0; i < 4; ++i) {
    const auto stats = one->update(batch, context_at(1000.0 * i));
    EXPECT_EQ(test::values_of(*stats).at("train/n_step"), 5 - i);
    if (i == 1) one->save(state);
  }
  ASSERT_TRUE(other->load(state));
  for (int i = 2; i < 4; ++i) ASSERT_TRUE(other->update(batch, context_at(1000.0 * i)));
  EXPECT_TRUE(test::all_equal(one->parameters(), other->parameters()));
}

TEST(QLearning, StepsOfTheBurnInOnlyWarmUpTheState) {
  RunConfig config = q_config("vdn", true);
  config.q_learning.burn_in = 2;
  expect_plain_loss(config, 14);
}

TEST(QLearning, ADeadAgentsLastDecisionIsWorthItsRewardsAlone) {
  for (const bool use_rnn : {false, true}) {
    const RunConfig config = q_config("idqn", use_rnn);
    const TrajectoryShape shape = test::small_shape(config, kAgents);
    SlabPool pool(shape, 1);
    pool.fill_with_noise(16);
    for (int t = 0; t < 6; ++t) {
      pool.view(0).agent_active(t, 0) = 0;  // only agent 1 decides, at step 0
      pool.view(0).agent_active(t + 1, 1) = 0;
      pool.view(0).reward(t, 1) = t == 2 ? -0.5f : 0.0f;  // and pays for it at step 2
    }
    const replay::Unit unit = use_rnn ? replay::Unit::kSequence : replay::Unit::kAgentStep;
    const ReplayBatchOptions options{.shape = shape,
                                     .unit = unit,
                                     .world_count = 1,
                                     .pay = {.gamma = config.optimisation.gamma},
                                     .agents_end = true};
    auto replay =
        *replay::Replay::create({.store = {.shape = shape, .capacity_bytes = 1 << 24}, .unit = unit});
    replay->insert(pool.view(0), 6);
    Rng rng(uint64_t{1});
    ReplayBatch batch = make_replay_batch(options);
    fill(batch, options, *replay, replay->draw(1, 1, rng));
    const auto learner = q_learner(config);
    TermValues terms;
    ASSERT_TRUE(learner->accumulate_gradient(batch, {}, terms));
    EXPECT_NEAR(terms["target_q_tot_mean"] + terms["dqn_target_q_mean"],
                config.optimisation.gamma * config.optimisation.gamma * -0.5, 1e-6);
  }
}

TEST(QLearning, ATeamsValueDoesNotDependOnWhatADeadAgentWasAskedToDo) {
  for (const char* algo : {"vdn", "qmix", "qplex_d", "qplex_q"}) {
    const auto learner = q_learner(q_config(algo, true));
    ReplayBatch batch = q_batch(q_config(algo, true), 17);
    ASSERT_EQ(batch.agent_active[1][3].item<int>(), 0);
    const double before = loss_of(*learner, batch);
    batch.action[1][3][0] = (batch.action[1][3][0].item<int64_t>() + 1) % 3;
    EXPECT_NEAR(loss_of(*learner, batch), before, 1e-7) << algo;
    batch.action[1][2][0] = (batch.action[1][2][0].item<int64_t>() + 1) % 3;
    EXPECT_GT(std::abs(loss_of(*learner, batch) - before), 1e-7) << algo << ", of its living partner";
  }
}

TEST(QLearning, ADiscountOfZeroTrainsOnRewardsAlone) {
  for (const char* algo : {"idqn", "vdn"})
    for (const bool use_rnn : {false, true}) {
      RunConfig config = q_config(algo, use_rnn);
      config.optimisation.gamma = 0;
      expect_plain_loss(config, 18);
    }
}

TEST(QLearning, ImportanceWeightsScaleTheLossOfTheirWorld) {
  const RunConfig config = q_config("idqn", false);
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 15);
  batch.weight.fill_(1);
  const double whole = loss_of(*learner, batch);
  batch.weight.fill_(0.25);
  EXPECT_NEAR(loss_of(*learner, batch), whole / 4, 1e-6);
}

class EveryAlgorithm : public ::testing::TestWithParam<const char*> {};

TEST_P(EveryAlgorithm, TheGradientDoesNotDependOnMicroBatchesOrThreads) {
  RunConfig config = q_config(GetParam(), true);
  ReplayBatch batch = q_batch(config, 21);
  config.optimisation.micro_batch_size = 1000;
  config.collection.learner_threads = 1;
  const auto whole = q_learner(config);
  config.optimisation.micro_batch_size = 1;  // one world at a time
  config.collection.learner_threads = 2;
  const auto parts = q_learner(config);
  EXPECT_NEAR(loss_of(*whole, batch), loss_of(*parts, batch), 1e-5);
  const std::vector<Tensor> one = gradients_of(*whole), other = gradients_of(*parts);
  for (std::size_t i = 0; i < one.size(); ++i)
    EXPECT_TRUE(torch::allclose(one[i], other[i], 1e-3, 1e-6)) << i << " " << (one[i] - other[i]).abs().max();
}

TEST_P(EveryAlgorithm, TheGradientReachesEveryLayerOfTheNetwork) {
  const RunConfig config = q_config(GetParam(), true);
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 22);
  loss_of(*learner, batch);
  const std::vector<Tensor> gradients = gradients_of(*learner);
  const auto named = learner->net().named_parameters();
  for (std::size_t i = 0; i < named.size(); ++i)
    EXPECT_GT(gradients[i].abs().max().item<float>(), 0.0f) << named[i].first;
  for (const Tensor& target : learner->target_parameters()) EXPECT_FALSE(target.grad().defined());
}

TEST_P(EveryAlgorithm, TheOrderOfWorldsDoesNotMatter) {
  const RunConfig config = q_config(GetParam(), true);
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 23);
  const double loss = loss_of(*learner, batch);
  gradients_of(*learner);
  double turned = 0;
  for (const int64_t world : {3, 0, 4, 1, 2}) {
    ReplayBatch one = narrow_worlds(batch, world, 1);
    TermValues terms;
    ASSERT_TRUE(learner->accumulate_gradient(one, {}, terms));
    const auto valid = one.valid.view({one.steps(), 1, kAgents});
    const double count =
        config.run.algo == "idqn"
            ? one.valid.bitwise_and(one.agent_active.narrow(0, 0, one.steps())).sum().item<double>()
            : valid.amin(2).sum().item<double>();
    turned += terms["td_loss"] * count;
  }
  const auto all = batch.valid.view({batch.steps(), batch.world_count, kAgents});
  const double count =
      config.run.algo == "idqn"
          ? batch.valid.bitwise_and(batch.agent_active.narrow(0, 0, batch.steps())).sum().item<double>()
          : all.amin(2).sum().item<double>();
  EXPECT_NEAR(turned / count, loss, 1e-5);
}

TEST_P(EveryAlgorithm, AnUpdateLowersTheLossOfItsBatchAndMovesTheTarget) {
  RunConfig config = q_config(GetParam(), true);
  config.optimisation.learning_rate = 3e-4;  // with 1e-3 the loss of QPLEX leaps about
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 24);
  const double before = loss_of(*learner, batch);
  gradients_of(*learner);
  for (int i = 0; i < 20; ++i) {
    const std::vector<Tensor> target = copies(learner->target_parameters());
    const auto stats = learner->update(batch, {});
    ASSERT_TRUE(stats) << stats.error().message;
    EXPECT_EQ(stats->optimizer_steps, 1);
    for (std::size_t p = 0; p < target.size(); ++p)
      EXPECT_TRUE(torch::allclose(
          learner->target_parameters()[p],
          target[p] + config.q_learning.target_update_tau * (learner->parameters()[p].detach() - target[p]),
          1e-4, 1e-6));
  }
  EXPECT_EQ(learner->version(), 20u);
  EXPECT_LT(loss_of(*learner, batch), before);
}

TEST_P(EveryAlgorithm, ACheckpointContinuesExactly) {
  const RunConfig config = q_config(GetParam(), true);
  const auto one = q_learner(config);
  ReplayBatch batch = q_batch(config, 25);
  for (int i = 0; i < 3; ++i) ASSERT_TRUE(one->update(batch, {}));
  StateDict state;
  one->save(state);
  RunConfig another_seed = config;
  another_seed.run.seed = 99;
  const auto other = q_learner(another_seed);
  const Status loaded = other->load(state);
  ASSERT_TRUE(loaded) << loaded.error().message;
  EXPECT_EQ(other->version(), one->version());
  ASSERT_TRUE(one->update(batch, {}));
  ASSERT_TRUE(other->update(batch, {}));
  EXPECT_TRUE(test::all_equal(one->parameters(), other->parameters()));
  EXPECT_TRUE(test::all_equal(one->target_parameters(), other->target_parameters()));

  const auto mismatched = q_learner(q_config(config.run.algo == "vdn" ? "idqn" : "vdn", true));
  const Status refused = mismatched->load(state);
  ASSERT_FALSE(refused);
  EXPECT_NE(refused.error().message.find(config.run.algo.name()), std::string::npos);
}

TEST_P(EveryAlgorithm, ALossThatIsNoNumberMovesNoWeight) {
  const RunConfig config = q_config(GetParam(), true);
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 26);
  batch.reward[0][0] = std::numeric_limits<float>::quiet_NaN();
  const std::vector<Tensor> before = copies(learner->parameters());
  const auto stats = learner->update(batch, {});
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->skipped_steps, 1);
  EXPECT_TRUE(test::all_equal(before, learner->parameters()));
  Expected<UpdateStats> last = stats;
  for (int i = 0; i < 20 && last; ++i) last = learner->update(batch, {});
  EXPECT_FALSE(last);
}

/// A learner's results for a batch, in natural units.
std::vector<double> words_of(QLearning& learner, ReplayBatch& batch) {
  TermValues terms;
  EXPECT_TRUE(learner.accumulate_gradient(batch, {}, terms));
  gradients_of(learner);
  return learner.mixer() != nullptr
             ? std::vector{terms["q_tot_mean"], terms["q_tot_max"], terms["target_q_tot_mean"],
                           terms["target_q_max"], terms["td_error_mean"]}
             : std::vector{terms["dqn_q_mean"], terms["dqn_q_max"], terms["dqn_target_q_mean"],
                           terms["target_q_max"], terms["dqn_td_error_mean"]};
}

void expect_close(const std::vector<double>& values, const std::vector<double>& expected, const char* what) {
  for (std::size_t i = 0; i < expected.size(); ++i)
    EXPECT_NEAR(values[i], expected[i], 3e-5 * std::max(1.0, std::abs(expected[i])))
        << what << ", number " << i;
}

RunConfig scaled_config(const std::string& algo, bool everything) {
  RunConfig config = q_config(algo, true);
  config.q_learning.normalize_q_values = true;
  config.mixers.qplex_weighted_head = config.mixers.qplex_state_bias = config.mixers.qplex_nonlinear =
      everything;
  return config;
}

TEST_P(EveryAlgorithm, AChangeOfUnitLeavesEveryQValueAlsoThroughCheckpoints) {
  for (const bool everything : {false, true}) {
    const RunConfig config = scaled_config(GetParam(), everything);
    const auto learner = q_learner(config);
    disturb_targets(*learner);
    ReplayBatch batch = q_batch(config, 27);
    for (int i = 0; i < 3; ++i) ASSERT_TRUE(learner->update(batch, {}));
    EXPECT_NE(learner->q_sigma(), 1);
    const std::vector<double> words = words_of(*learner, batch);

    StateDict state;
    learner->save(state);
    const auto same = q_learner(config);
    ASSERT_TRUE(same->load(state));
    EXPECT_EQ(same->q_sigma(), learner->q_sigma());
    EXPECT_EQ(words_of(*same, batch), words);
    RunConfig plain = config;
    plain.q_learning.normalize_q_values = false;
    const auto natural = q_learner(plain);
    ASSERT_TRUE(natural->load(state));
    EXPECT_EQ(natural->q_sigma(), 1);
    expect_close(words_of(*natural, batch), words, "in natural units");

    // From natural units on, with a scale that finds its networks trained.
    StateDict unscaled;
    natural->save(unscaled);
    const auto late = q_learner(config);
    ASSERT_TRUE(late->load(unscaled));
    expect_close(words_of(*late, batch), words, "before the first scale");
    // An update with a rate of 0 moves the scale alone.
    RunConfig still = config;
    still.optimisation.learning_rate = 0;
    still.q_learning.target_update_tau = 0;
    const auto moved = q_learner(still);
    ASSERT_TRUE(moved->load(unscaled));
    ReplayBatch larger = batch;
    larger.reward = batch.reward * 30;
    ASSERT_TRUE(moved->update(larger, {}));
    EXPECT_GT(moved->q_sigma(), 5);
    expect_close(words_of(*moved, batch), words, "in another unit");
  }
}

/// Relative TD errors of `updates` updates, and the gradient's norm before the first.
std::pair<std::vector<double>, double> learning_curve(const RunConfig& config, double reward_size,
                                                      int updates) {
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 28);
  batch.reward = batch.reward * reward_size;
  std::vector<double> curve;
  double first_norm = 0;
  for (int i = 0; i < updates; ++i) {
    const auto stats = learner->update(batch, {});
    EXPECT_TRUE(stats);
    for (const auto& [name, value] : stats->values) {
      if (name == "train/td_error_mean" || name == "train/dqn_td_error_mean")
        curve.push_back(value / reward_size);
      if (name == "train/grad_norm" && i == 0) first_norm = value;
    }
  }
  return {curve, first_norm};
}

TEST_P(EveryAlgorithm, SmallRewardsAreLearnedAsLargeOnesWithAScale) {
  const RunConfig config = scaled_config(GetParam(), false);
  const auto [large, large_norm] = learning_curve(config, 1, 40);
  const auto [small, small_norm] = learning_curve(config, 0.01, 40);
  ASSERT_EQ(large.size(), 40u);
  EXPECT_NEAR(small_norm / large_norm, 1, 0.01);
  for (std::size_t i = 0; i < large.size(); ++i) EXPECT_NEAR(small[i] / large[i], 1, 0.05) << "update " << i;
  EXPECT_LT(large.back(), 0.8 * large.front());

  RunConfig plain = config;
  plain.q_learning.normalize_q_values = false;
  const std::vector<double> lost = learning_curve(plain, 0.01, 40).first;
  EXPECT_GT(lost.back(), 3 * small.back()) << "without it the first guesses drown such rewards";
}

TEST_P(EveryAlgorithm, LearnsWithLayerNormalisation) {
  RunConfig config = q_config(GetParam(), true);
  config.optimisation.learning_rate = 3e-4;
  config.network.q_layer_norm = true;
  config.network.decoder_mlp_layers = "8";
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 36);
  const double before = loss_of(*learner, batch);
  const std::vector<Tensor> gradients = gradients_of(*learner);
  const auto named = learner->net().named_parameters();
  int norms = 0;
  for (std::size_t i = 0; i < named.size(); ++i) {
    EXPECT_GT(gradients[i].abs().max().item<float>(), 0.0f) << named[i].first;
    norms += named[i].first.find("norm") != std::string::npos;
  }
  EXPECT_EQ(norms, 6) << "of the encoder's linear layer, the core and the decoder";
  for (int i = 0; i < 20; ++i) ASSERT_TRUE(learner->update(batch, {}));
  EXPECT_LT(loss_of(*learner, batch), before);
}

/// A learner whose networks were reset at its second update, and the batch that it was given.
std::unique_ptr<QLearning> after_a_reset(RunConfig config, ReplayBatch& batch, int64_t every, double share) {
  config.q_learning.q_reset_every_updates = every;
  config.q_learning.q_reset_fresh_share = share;
  auto learner = q_learner(config);
  for (int i = 0; i < 2; ++i) EXPECT_TRUE(learner->update(batch, {}));
  return learner;
}

TEST_P(EveryAlgorithm, AResetRedrawsTheLastLayersAndMovesTheOthersHalfWay) {
  RunConfig config = q_config(GetParam(), true);
  config.network.decoder_mlp_layers = "8";
  ReplayBatch batch = q_batch(config, 37);
  const auto as_trained = after_a_reset(config, batch, 0, 0.5), kept = after_a_reset(config, batch, 2, 0),
             fresh = after_a_reset(config, batch, 2, 1), half = after_a_reset(config, batch, 2, 0.5);
  StateDict state;
  half->save(state);
  const auto named = half->net().named_parameters();
  int last = 0;
  for (std::size_t i = 0; i < half->parameters().size(); ++i) {
    const bool is_last = i >= named.size() || named[i].first.find("decoder") != std::string::npos ||
                         named[i].first.find("action_head") != std::string::npos;
    last += is_last;
    for (const bool target : {false, true}) {
      SCOPED_TRACE((i < named.size() ? named[i].first : "mixer") + (target ? " of the target" : ""));
      const auto of = [&](const QLearning& learner) {
        return (target ? learner.target_parameters() : learner.parameters())[i].detach();
      };
      const bool varies = of(*fresh).numel() > 1 && of(*fresh).std().item<float>() > 0;
      if (is_last) {
        EXPECT_TRUE(torch::equal(of(*half), of(*fresh)));
        EXPECT_TRUE(torch::equal(of(*kept), of(*fresh)));
        EXPECT_TRUE(torch::equal(of(*half), half->parameters()[i])) << "both networks begin alike";
      } else {
        EXPECT_TRUE(torch::equal(of(*kept), of(*as_trained)));
        EXPECT_TRUE(torch::allclose(of(*half), (of(*as_trained) + of(*fresh)) / 2, 1e-5, 1e-7));
      }
      if (varies) {
        EXPECT_FALSE(torch::equal(of(*fresh), of(*as_trained)));
      }
    }
    char number[8];
    std::snprintf(number, sizeof(number), "%03d", static_cast<int>(i));
    const std::string key = "optimizer/" + std::string(number);
    if (!state.has(key + ".step")) continue;  // no gradient reaches it
    EXPECT_EQ(state.integer(key + ".step").value(), is_last ? 0 : 2) << key;
    EXPECT_EQ(state.tensor(key + ".exp_avg")->abs().max().item<float>() == 0, is_last) << key;
    EXPECT_EQ(state.tensor(key + ".exp_avg_sq")->abs().max().item<float>() == 0, is_last) << key;
  }
  EXPECT_GE(last, 4);
  // The next one draws others.
  const Tensor& head = named[named.size() - 2].second;  // the weight; a bias may begin as 0
  const Tensor first = head.detach().clone();
  for (int i = 0; i < 2; ++i) {
    const auto stats = half->update(batch, {});
    ASSERT_TRUE(stats);
    EXPECT_EQ(test::values_of(*stats).at("train/q_resets"), 1 + i);
  }
  EXPECT_FALSE(torch::equal(head.detach(), first));
}

TEST_P(EveryAlgorithm, AResumedRunIsResetAtTheSameStepToTheSameWeights) {
  RunConfig config = q_config(GetParam(), true);
  config.q_learning.q_reset_every_updates = 3;
  const auto one = q_learner(config);
  ReplayBatch batch = q_batch(config, 38);
  for (int saved_at = 1; saved_at <= 3; ++saved_at) {
    ASSERT_TRUE(one->update(batch, {}));
    StateDict state;
    one->save(state);
    const auto other = q_learner(config), whole = q_learner(config);
    ASSERT_TRUE(other->load(state));
    for (int i = 0; i < 3; ++i) ASSERT_TRUE(other->update(batch, {}));
    for (int i = 0; i < saved_at + 3; ++i) ASSERT_TRUE(whole->update(batch, {}));
    EXPECT_TRUE(test::all_equal(other->parameters(), whole->parameters())) << saved_at;
    EXPECT_TRUE(test::all_equal(other->target_parameters(), whole->target_parameters())) << saved_at;
  }
}

INSTANTIATE_TEST_SUITE_P(QLearning, EveryAlgorithm,
                         ::testing::Values("idqn", "vdn", "qmix", "qplex_d", "qplex_q"));

TEST(QLearning, GradientsShrinkWithTheRewardsWithoutAScale) {
  RunConfig config = q_config("vdn", false);
  config.optimisation.gamma = 0;
  const auto norm = [&](bool scaled, double size) {
    config.q_learning.normalize_q_values = scaled;
    const auto learner = q_learner(config);
    for (const auto& [name, tensor] : learner->net().named_parameters())
      if (name.find("action_head") != std::string::npos) Tensor(tensor).detach().zero_();  // every Q is 0
    ReplayBatch batch = q_batch(config, 29);
    batch.reward = batch.reward * size;
    const auto stats = learner->update(batch, {});
    for (const auto& [name, value] : stats->values)
      if (name == "train/grad_norm") return value;
    return 0.0;
  };
  EXPECT_NEAR(norm(true, 0.01) / norm(true, 1), 1, 1e-3);
  EXPECT_LT(norm(false, 0.01) / norm(false, 1), 0.02);
}

TEST(QLearning, ASequencesPriorityMixesItsLargestAndItsMeanError) {
  for (const char* algo : {"vdn", "idqn"}) {
    RunConfig config = q_config(algo, true);
    config.q_learning.burn_in = 1;
    ReplayBatch batch = q_batch(config, 33);
    config.replay.per_sequences = false;
    const auto priorities = [&](double eta) {
      config.replay.per_sequences = eta >= 0;
      config.replay.per_eta = eta;
      const auto learner = q_learner(config);
      loss_of(*learner, batch);
      return batch.abs_td.clone();
    };
    const Tensor mean = priorities(-1), largest = priorities(1), mixed = priorities(0.9);
    EXPECT_TRUE(torch::allclose(priorities(0), mean));
    EXPECT_TRUE(torch::allclose(mixed, 0.9 * largest + 0.1 * mean, 1e-5, 1e-6));
    EXPECT_GT((largest - mean).min().item<double>(), 0);
    // A world of one valid step behind the burn-in has one error for a team, which is both.
    batch.valid.fill_(0);
    batch.valid[0].fill_(1), batch.valid[2].fill_(1);
    batch.agent_active.fill_(1);
    if (std::string(algo) == "vdn") {
      EXPECT_TRUE(torch::allclose(priorities(1), priorities(-1), 1e-5, 1e-6));
    }
  }
}

TEST(QLearning, AMixersStateMayBeNormalised) {
  for (const char* algo : {"qmix", "qplex_d", "qplex_q"})
    for (const double deviation : {0.0, 0.2}) {
      RunConfig config = q_config(algo, true);
      config.mixers.mixer_state_deviation = deviation;
      const auto learner = q_learner(config);
      double rms[2];
      for (double& of_scale : rms) {
        ReplayBatch batch = q_batch(config, 35);
        const auto values = test::values_of(*learner->update(batch, {}));
        of_scale = values.at("train/mixer_state_rms");
        EXPECT_GT(values.at("train/mixer_gain"), 0) << algo;
        // An encoder whose outputs grow tenfold, or nearly so (ELU).
        torch::NoGradGuard no_grad;
        for (const auto& [name, tensor] : learner->net().named_parameters())
          if (name.find("encoder.image") != std::string::npos) tensor.mul_(10);
      }
      if (deviation > 0) {
        EXPECT_NEAR(rms[0], deviation, 1e-2 * deviation) << algo;
        EXPECT_NEAR(rms[1], deviation, 1e-2 * deviation) << algo;
      } else {
        EXPECT_GT(rms[1], 3 * rms[0]) << algo;
      }
    }
}

TEST(QLearning, ReportsWhatShareOfTargetsAndRewardsWasClipped) {
  RunConfig config = q_config("vdn", false);
  config.optimisation.gamma = 0;
  config.q_learning.q_value_clamp = 1;
  ReplayBatch batch = q_batch(config, 34);
  batch.valid.fill_(1);
  batch.reward.fill_(0.5);  // a team's 1.0 is at the clamp and stays
  for (int world = 0; world < 3; ++world) batch.reward[0][2 * world] = 3;
  const auto mixed = test::values_of(*q_learner(config)->update(batch, {}));
  EXPECT_NEAR(mixed.at("train/targets_clipped_fraction"), 3.0 / 15, 1e-6);
  EXPECT_NEAR(mixed.at("train/target_q_tot_mean"), 1, 1e-6);
  EXPECT_NEAR(mixed.at("train/target_before_clamp"), (3 * 3.5 + 12 * 1.0) / 15, 1e-6);
  config = q_config("idqn", false);
  batch = q_batch(config, 34);
  batch.valid.fill_(1);
  batch.agent_active.fill_(1);
  batch.valid[0][1] = 0;
  batch.rewards_read = 40;
  batch.rewards_clipped = 10;
  const auto alone = test::values_of(*q_learner(config)->update(batch, {}));
  EXPECT_EQ(alone.at("train/rewards_clipped_fraction"), 0.25);
  const double total = static_cast<double>(batch.valid.numel());
  EXPECT_EQ(alone.at("train/policy_lag_total"), total);
  EXPECT_EQ(alone.at("train/policy_lag_dropped"), 1);
  EXPECT_NEAR(alone.at("train/policy_lag_valid_frac"), (total - 1) / total, 1e-9);
  EXPECT_LT(alone.at("train/dqn_q_min"), alone.at("train/dqn_q_mean"));
  EXPECT_LT(alone.at("train/dqn_q_mean"), alone.at("train/dqn_q_max"));
  EXPECT_EQ(alone.at("train/dqn_num_updates"), 1);
}

TEST(QLearning, TargetsAreCopiedNowAndThenWhereTauIsOne) {
  RunConfig config = q_config("qmix", true);
  config.q_learning.target_update_tau = 1;
  config.q_learning.target_update_interval = 3;
  const auto learner = q_learner(config);
  ReplayBatch batch = q_batch(config, 31);
  for (int step = 1; step <= 6; ++step) {
    ASSERT_TRUE(learner->update(batch, {}));
    EXPECT_EQ(test::all_equal(learner->parameters(), learner->target_parameters()), step % 3 == 0) << step;
  }
}

TEST(QLearning, ReportsGradientAndStepOfEveryPart) {
  for (const auto& [algo, parts] :
       {std::pair<std::string, std::vector<std::string>>("idqn", {"encoder", "core", "heads"}),
        {"vdn", {"encoder", "core", "heads"}},
        {"qmix", {"encoder", "core", "heads", "mixer"}}}) {
    const RunConfig config = q_config(algo, true);
    const auto learner = q_learner(config);
    NamedNumbers values;
    learner->append_diagnostics(values);
    EXPECT_TRUE(values.empty()) << algo << " has taken no step";
    ReplayBatch batch = q_batch(config, 31);
    const auto stats = learner->update(batch, {});
    ASSERT_TRUE(stats);
    learner->append_diagnostics(values);
    const std::map<std::string, double> numbers(values.begin(), values.end());
    EXPECT_EQ(numbers.size(), 2 * parts.size()) << algo;
    double squares = 0;
    for (const std::string& part : parts) {
      ASSERT_TRUE(numbers.contains("train/grad_norm_" + part)) << algo << part;
      squares += std::pow(numbers.at("train/grad_norm_" + part), 2);
      EXPECT_GT(numbers.at("train/adam_gain_" + part), 0) << algo << part;
      EXPECT_LT(numbers.at("train/adam_gain_" + part), 1) << algo << part;
    }
    const double norm = test::values_of(*stats)["train/grad_norm"];
    EXPECT_NEAR(std::sqrt(squares), norm, 1e-4 * norm) << algo;

    // A report that falls into the next step, while its gradient is summed, has those of the last one.
    int reports = 0;
    const auto report = [&] {
      ++reports;
      NamedNumbers between;
      learner->append_diagnostics(between);
      EXPECT_EQ(between, values) << algo;
      return true;
    };
    ASSERT_TRUE(learner->update(batch, {.after_step = {}, .begin_step = {}, .keep_going = report}));
    EXPECT_GT(reports, 0) << algo;
  }
}

TEST(QLearning, HasTheParameterCountsOfTheSpecification) {
  EnvShape env;
  env.num_agents = 2;
  env.head_count = 5;
  env.head_sizes = {3, 3, 3, 2, 3};
  const auto count = [&](const char* algo) {
    RunConfig config = q_config(algo, std::string(algo) != "idqn");
    config.network.rnn_size = 512;
    return (*make_algorithm(config, env, torch::kCPU))->parameter_count();
  };
  EXPECT_EQ(count("vdn"), 2'876'142);
  EXPECT_EQ(count("qmix"), 2'876'142 + 203'073);
  EXPECT_EQ(count("qplex_d"), 2'876'142 + 152'184);
  EXPECT_EQ(count("qplex_q"), 2'876'142 + 389'685);
  EXPECT_EQ(count("idqn"), 1'293'024 + 512 * 14 + 14);
}

TEST(QLearning, ObservationsMoveTheStatisticsOfBothNetworks) {
  RunConfig config = q_config("vdn", true);
  config.network.normalize_input = true;
  const auto learner = q_learner(config);
  const ReplayBatch batch = q_batch(config, 32);
  const Tensor before = learner->target_net().step(batch.frame[0], {}, batch.recurrent_state).logits.clone();
  learner->observe(batch.frame[0], {}, {});
  const Tensor online = learner->net().step(batch.frame[0], {}, batch.recurrent_state).logits;
  const Tensor target = learner->target_net().step(batch.frame[0], {}, batch.recurrent_state).logits;
  EXPECT_FALSE(torch::allclose(before, target));
  EXPECT_TRUE(torch::equal(online, target));  // equal weights, the same statistics
}

}  // namespace q_learning_test
}  // namespace comrad::learn
