#include "learner/algorithms/happo.h"

#include <gtest/gtest.h>

#include <set>
#include <string>
#include <vector>

#include "learner/algorithms/ippo.h"
#include "learner/losses/ppo_loss.h"
#include "policy_workers/device/torch_ops.h"
#include "tests/support/noise_batch.h"

namespace comrad::learn {
namespace happo_test {

using test::all_equal;
using test::copies;
using test::values_of;

RunConfig small_config() {
  RunConfig config = test::small_config("happo", 3);
  config.network.share_parameters = false;
  config.network.rnn_size = 12;
  config.network.critic_hidden_sizes = "16,8";
  config.optimisation.learning_rate = 1e-3;
  return config;
}

TrajectoryShape small_shape(const RunConfig& config, int agents = 3) {
  return test::small_shape(config, agents);
}

/// Noise with team rewards: all agents of a world are paid alike.
RolloutBatch noise_batch(const TrajectoryShape& shape, int slab_count, uint64_t seed) {
  RolloutBatch batch = test::noise_batch(shape, slab_count, seed);
  const Tensor reward = batch.reward.view({batch.steps(), slab_count, shape.env.num_agents});
  reward.copy_(reward.select(2, 0).unsqueeze(2).expand_as(reward).clone());
  return batch;
}

TEST(HappoFactor, MatchesTheKnownAnswer) {
  const Tensor valid = torch::ones({3}, torch::kUInt8), old_log_prob = torch::tensor({-0.3f, -1.0f, -2.0f});
  const Tensor ratios = torch::tensor({1.2f, 0.8f, 1.5f}), advantage = torch::tensor({1.0f, -0.5f, 2.0f});
  const Tensor m = advantage * happo_ratio(old_log_prob + ratios.log(), old_log_prob, valid, 0);
  EXPECT_TRUE(torch::allclose(m, torch::tensor({1.2f, -0.4f, 3.0f}), 1e-5, 1e-6));
  const Tensor second = torch::tensor({0.9f, 1.3f, 1.0f});
  const ClipInterval clip = ClipInterval::of(torch::tensor(0.1, torch::kFloat64));
  const Tensor objective = clipped_objective(second, m, clip);
  EXPECT_TRUE(torch::allclose(objective, torch::tensor({1.08f, -0.52f, 3.0f}), 1e-5, 1e-6));
  EXPECT_NEAR(-objective.mean().item<double>(), -1.186667, 1e-6);
  EXPECT_NEAR(-clipped_objective(second, advantage, clip).mean().item<double>(), -0.75, 1e-6);
  // The authors' form: the factor outside of the min.
  EXPECT_NEAR(-(ratios * clipped_objective(second, advantage, clip)).mean().item<double>(), -1.186667, 1e-6);
}

TEST(HappoFactor, IsOneWhereInvalidAndClampedOnRequest) {
  const Tensor old_log_prob = torch::zeros({4}), new_log_prob = torch::tensor({3.0f, 0.2f, 1.5f, 7.0f}).log();
  const Tensor valid = torch::tensor({1, 1, 1, 0}, torch::kUInt8);
  EXPECT_TRUE(torch::allclose(happo_ratio(new_log_prob, old_log_prob, valid, 2),
                              torch::tensor({2.0f, 0.5f, 1.5f, 1.0f})));
  EXPECT_TRUE(torch::allclose(happo_ratio(new_log_prob, old_log_prob, valid, 0),
                              torch::tensor({3.0f, 0.2f, 1.5f, 1.0f})));
}

TEST(Happo, OneAgentLearnsAsPpoDoes) {
  // Without a value loss IPPO's network has the same actor, seed and gradient.
  RunConfig config = small_config();
  config.optimisation.num_epochs = 3;
  const TrajectoryShape shape = small_shape(config, 1);
  Happo happo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 1);
  RunConfig ppo_config = config;
  ppo_config.run.algo = "ippo";
  ppo_config.on_policy.value_loss_coeff = 0;
  const TrajectoryShape ppo_shape = small_shape(ppo_config, 1);
  Ippo ppo(ppo_config, ppo_shape.env, torch::kCPU);
  RolloutBatch ppo_batch = batch;
  ppo_batch.shape = ppo_shape;
  ppo_batch.recurrent_state = batch.recurrent_state.slice(1, 0, 12);
  for (Tensor* field : {&ppo_batch.valid, &ppo_batch.value_valid, &ppo_batch.reset}) *field = field->clone();
  ASSERT_EQ(happo.net().actor_parameters(0).size() + 2, ppo.net().parameters().size());
  const auto actor_of_ppo = [&] {
    std::vector<Tensor> parameters = ppo.net().parameters();
    parameters.resize(parameters.size() - 2);  // without the value head
    return parameters;
  };
  ASSERT_TRUE(all_equal(happo.net().actor_parameters(0), actor_of_ppo()));
  const std::vector<Tensor> before = copies(happo.net().actor_parameters(0));
  const Expected<UpdateStats> stats = happo.update(batch, {}), ppo_stats = ppo.update(ppo_batch, {});
  ASSERT_TRUE(stats);
  ASSERT_TRUE(ppo_stats);
  EXPECT_EQ(values_of(*stats)["train/policy_loss"], values_of(*ppo_stats)["train/policy_loss"]);
  EXPECT_TRUE(all_equal(happo.net().actor_parameters(0), actor_of_ppo()));
  EXPECT_FALSE(all_equal(happo.net().actor_parameters(0), before));
}

TEST(Happo, OnlyTheNetworkInTrainingChanges) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Happo happo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 2);
  apply_lag_filter(batch, 0, 1000);
  happo.prepare_targets(batch);
  batch.advantage = standardize(batch.advantage, batch.valid);
  UpdateStats stats;
  for (int64_t part = 0; part <= 3; ++part) {
    std::vector<std::vector<Tensor>> before;
    for (int64_t agent = 0; agent < 3; ++agent) before.push_back(copies(happo.net().actor_parameters(agent)));
    before.push_back(copies(happo.net().joint_critic_parameters()));
    TermValues terms;
    bool goes_on = true;
    if (part < 3) {
      ASSERT_TRUE(happo.train_agent(batch, part, {}, stats, terms, goes_on));
    } else {
      ASSERT_TRUE(happo.train_critic(batch, {}, stats, terms));
    }
    for (int64_t agent = 0; agent < 3; ++agent)
      EXPECT_EQ(all_equal(before[static_cast<std::size_t>(agent)], happo.net().actor_parameters(agent)),
                agent != part);
    EXPECT_EQ(all_equal(before[3], happo.net().joint_critic_parameters()), part != 3);
  }
  EXPECT_EQ(happo.version(), 4u);
}

TEST(Happo, TheFactorCarriesWhatEarlierAgentsBecame) {
  // The whole update against its pieces in the same order, with the factor computed outside.
  RunConfig config = small_config();
  config.on_policy.happo_agent_order = AgentOrder::kFixed;
  const TrajectoryShape shape = small_shape(config);
  Happo whole(config, shape.env, torch::kCPU), pieces(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 3);
  batch.valid[1][4] = 0;  // agent 1 of world 1: its ratio counts as 1
  RolloutBatch other = noise_batch(shape, 4, 3);
  other.valid[1][4] = 0;
  ASSERT_TRUE(whole.update(batch, {}));

  apply_lag_filter(other, 0, 1000);
  pieces.prepare_targets(other);
  other.advantage = standardize(other.advantage, other.valid);
  UpdateStats stats;
  TermValues terms;
  bool goes_on = true;
  const auto log_prob_of = [&](int64_t agent) {
    torch::NoGradGuard no_grad;
    const RolloutBatch rows = agent_rows(other, agent);
    const Tensor log_probs =
        torch::cat({torch::log_softmax(pieces.net()
                                           .actor_sequence(agent, {.frame = rows.frame,
                                                                   .measurement = {},
                                                                   .recurrent_state = rows.recurrent_state,
                                                                   .reset = rows.reset})
                                           .slice(2, 0, 3),
                                       2)},
                   2);
    const Tensor second =
        torch::log_softmax(pieces.net()
                               .actor_sequence(agent, {.frame = rows.frame,
                                                       .measurement = {},
                                                       .recurrent_state = rows.recurrent_state,
                                                       .reset = rows.reset})
                               .slice(2, 3, 5),
                           2);
    return log_probs.gather(2, rows.action.select(2, 0).unsqueeze(2)).squeeze(2) +
           second.gather(2, rows.action.select(2, 1).unsqueeze(2)).squeeze(2);
  };
  for (int64_t agent = 0; agent < 3; ++agent) {
    const Tensor before = log_prob_of(agent);
    const Expected<Tensor> reported = pieces.train_agent(other, agent, {}, stats, terms, goes_on);
    ASSERT_TRUE(reported);
    EXPECT_TRUE(torch::allclose(*reported, before, 1e-4, 1e-5)) << agent;
    const Tensor after = log_prob_of(agent);
    for (int64_t t = 0; t < other.steps(); ++t)
      for (int64_t world = 0; world < other.slab_count; ++world) {
        const float ratio = other.valid[t][world * 3 + agent].item<int>() == 0
                                ? 1.0f
                                : std::exp((after - before)[t][world].item<float>());
        if (t == 1 && world == 1 && agent == 1) {
          EXPECT_EQ(ratio, 1.0f);
        }
        for (int64_t row = world * 3; row < world * 3 + 3; ++row) other.advantage[t][row] *= ratio;
      }
  }
  ASSERT_TRUE(pieces.train_critic(other, {}, stats, terms));
  // M of the update leaves the last agent's ratio out, since no agent is left that needs it.
  const std::vector<Tensor> a = whole.net().parameters(), b = pieces.net().parameters();
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(torch::allclose(a[i], b[i], 1e-4, 2e-6)) << i;
  EXPECT_EQ(whole.version(), pieces.version());
}

TEST(Happo, WithoutALearningRateTheFactorStaysOne) {
  RunConfig config = small_config();
  config.optimisation.learning_rate = 0;
  const TrajectoryShape shape = small_shape(config);
  Happo happo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 4);
  auto values = values_of(*happo.update(batch, {}));
  EXPECT_NEAR(values.at("happo/factor_m_mean"), 1, 1e-6);
  EXPECT_NEAR(values.at("happo/factor_m_max"), 1, 1e-5);
  config.optimisation.learning_rate = 1e-2;
  Happo moving(config, shape.env, torch::kCPU);
  RolloutBatch again = noise_batch(shape, 4, 4);
  EXPECT_GT(values_of(*moving.update(again, {})).at("happo/factor_m_max"), 1.001);
}

TEST(Happo, TheOrderIsAPermutationKeyedByTheVersion) {
  RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config, 5);
  Happo happo(config, shape.env, torch::kCPU), twin(config, shape.env, torch::kCPU);
  std::set<std::vector<int64_t>> seen;
  for (int update = 0; update < 8; ++update) {
    std::vector<int64_t> order = happo.agent_order();
    EXPECT_EQ(order, twin.agent_order());
    seen.insert(order);
    std::sort(order.begin(), order.end());
    EXPECT_EQ(order, (std::vector<int64_t>{0, 1, 2, 3, 4}));
    RolloutBatch batch = noise_batch(shape, 1, 5), same_batch = noise_batch(shape, 1, 5);
    ASSERT_TRUE(happo.update(batch, {}));
    ASSERT_TRUE(twin.update(same_batch, {}));
  }
  EXPECT_GT(seen.size(), 3u);
  EXPECT_TRUE(happo.weights() == twin.weights());
  config.on_policy.happo_agent_order = AgentOrder::kFixed;
  Happo fixed(config, shape.env, torch::kCPU);
  EXPECT_EQ(fixed.agent_order(), (std::vector<int64_t>{0, 1, 2, 3, 4}));
}

TEST(Happo, TheOrderOfTheAgentsMatters) {
  RunConfig config = small_config();
  config.optimisation.learning_rate = 1e-2;
  const TrajectoryShape shape = small_shape(config, 2);
  std::vector<std::vector<std::byte>> results;
  for (const AgentOrder order : {AgentOrder::kFixed, AgentOrder::kRandom}) {
    config.on_policy.happo_agent_order = order;
    for (config.run.seed = 42; config.on_policy.happo_agent_order == AgentOrder::kRandom; ++config.run.seed)
      if (Happo(config, shape.env, torch::kCPU).agent_order().front() == 1) break;
    Happo happo(config, shape.env, torch::kCPU);
    RunConfig first = config;  // the same weights for both
    first.run.seed = 42;
    const Happo origin(first, shape.env, torch::kCPU);
    ASSERT_TRUE(happo.net().read_weights(origin.weights()));
    RolloutBatch batch = noise_batch(shape, 4, 6);
    ASSERT_TRUE(happo.update(batch, {}));
    results.push_back(happo.weights());
  }
  EXPECT_FALSE(results[0] == results[1]);
}

TEST(Happo, MakesAVersionPerAgentAndCriticAndReportsEachOne) {
  RunConfig config = small_config();
  config.optimisation.num_epochs = 2;
  config.optimisation.num_batches_per_epoch = 2;
  config.optimisation.shuffle_minibatches = true;
  const TrajectoryShape shape = small_shape(config);
  Happo happo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 7);
  std::vector<PolicyVersion> told;
  UpdateContext context;
  context.after_step = [&] { told.push_back(happo.version()); };
  const Expected<UpdateStats> stats = happo.update(batch, context);
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->optimizer_steps, 2 * 2 * (3 + 1));
  ASSERT_EQ(told.size(), 16u);
  for (std::size_t i = 0; i < told.size(); ++i) EXPECT_EQ(told[i], i + 1);
}

TEST(Happo, EveryVersionChangesExactlyOneNetwork) {
  // What policy workers read after each sub-update: the weights of all networks, one of them new.
  RunConfig config = small_config();
  config.network.normalize_input = true;
  const TrajectoryShape shape = small_shape(config);
  Happo happo(config, shape.env, torch::kCPU);
  const policy::ActorCritic worker =
      policy::ActorCritic::create(policy::NetworkOptions::from(config, shape.env), 9, torch::kCPU);
  const auto networks_of = [&](const policy::ActorCritic& net) {
    std::vector<std::vector<Tensor>> networks;
    for (int64_t agent = 0; agent < 3; ++agent) networks.push_back(copies(net.actor_parameters(agent)));
    networks.push_back(copies(net.joint_critic_parameters()));
    return networks;
  };
  std::vector<std::vector<Tensor>> before = networks_of(happo.net());
  std::vector<std::size_t> changed;
  const std::vector<int64_t> order = happo.agent_order();
  UpdateContext context;
  context.after_step = [&] {
    ASSERT_TRUE(worker.read_weights(happo.weights()));
    const std::vector<std::vector<Tensor>> after = networks_of(worker);
    for (std::size_t i = 0; i < 4; ++i)
      if (!all_equal(before[i], after[i])) changed.push_back(i);
    before = after;
  };
  RolloutBatch batch = noise_batch(shape, 4, 12);
  ASSERT_TRUE(happo.update(batch, context));
  ASSERT_EQ(changed.size(), 4u);
  for (std::size_t i = 0; i < 3; ++i) EXPECT_EQ(changed[i], static_cast<std::size_t>(order[i]));
  EXPECT_EQ(changed[3], 3u);
}

TEST(Happo, MicroBatchesChangeNothing) {
  std::vector<std::vector<Tensor>> results;
  for (const int64_t micro_batch_size : {4096, 12}) {
    RunConfig config = small_config();
    config.optimisation.micro_batch_size = micro_batch_size;
    config.optimisation.learning_rate = 1e-4;
    const TrajectoryShape shape = small_shape(config);
    Happo happo(config, shape.env, torch::kCPU);
    RolloutBatch batch = noise_batch(shape, 5, 8);
    ASSERT_TRUE(happo.update(batch, {}));
    results.push_back(copies(happo.net().parameters()));
  }
  for (std::size_t i = 0; i < results[0].size(); ++i)
    EXPECT_TRUE(torch::allclose(results[0][i], results[1][i], 1e-4, 2e-5)) << i;
}

TEST(Happo, AnAgentWithoutValidSamplesIsLeftAlone) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Happo happo(config, shape.env, torch::kCPU);
  const std::vector<Tensor> before = copies(happo.net().actor_parameters(1));
  RolloutBatch batch = noise_batch(shape, 4, 9);
  batch.valid.slice(1, 1, c10::nullopt, 3).zero_();
  const Expected<UpdateStats> stats = happo.update(batch, {});
  ASSERT_TRUE(stats);
  EXPECT_EQ(stats->optimizer_steps, 3);
  EXPECT_TRUE(all_equal(before, happo.net().actor_parameters(1)));
}

TEST(Happo, AnAgentThatIsDeadAllAlongIsLeftAloneAndLeavesTheFactorAlone) {
  RunConfig config = small_config();
  config.optimisation.num_epochs = 2;
  const TrajectoryShape shape = small_shape(config);
  Happo happo(config, shape.env, torch::kCPU);
  const auto update = [&](int64_t dead) {
    RolloutBatch batch = noise_batch(shape, 4, 9);
    if (dead >= 0) batch.agent_active.slice(1, dead, c10::nullopt, 3).zero_();
    return *happo.update(batch, {});
  };
  (void)update(-1);  // so that Adam has a momentum
  const std::vector<Tensor> dead = copies(happo.net().actor_parameters(1)),
                            alive = copies(happo.net().actor_parameters(0)),
                            critic = copies(happo.net().joint_critic_parameters());
  const UpdateStats stats = update(1);
  EXPECT_EQ(stats.optimizer_steps, 6);  // two agents and the critic, two epochs
  EXPECT_EQ(stats.skipped_steps, 0);
  EXPECT_TRUE(all_equal(dead, happo.net().actor_parameters(1)));
  EXPECT_FALSE(all_equal(alive, happo.net().actor_parameters(0)));
  EXPECT_FALSE(all_equal(critic, happo.net().joint_critic_parameters()));
  EXPECT_FALSE(values_of(stats).contains("happo/agent_1_post_ratio_mean"));
  EXPECT_TRUE(std::isfinite(values_of(stats)["train/loss"]));
}

TEST(Happo, AStoppedUpdateEndsBetweenTwoSteps) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Happo happo(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 10);
  int asked = 0;
  UpdateContext context;
  context.begin_step = [&] { return ++asked < 2; };
  const Expected<UpdateStats> stats = happo.update(batch, context);
  ASSERT_TRUE(stats);
  EXPECT_FALSE(stats->abandoned);
  EXPECT_EQ(stats->optimizer_steps, 2);
  EXPECT_EQ(happo.version(), 2u);
  EXPECT_TRUE(stats->values.empty());  // the other agent's and the critic's are missing
}

TEST(Happo, AReloadedRunContinuesBitForBit) {
  RunConfig config = small_config();
  config.network.normalize_input = true;
  config.network.rnn_type = RnnType::kLstm;
  config.optimisation.num_epochs = 2;
  config.optimisation.lr_schedule = RateSchedule::kLinearDecay;
  config.run.train_for_env_frames = 100;
  const TrajectoryShape shape = small_shape(config);
  const auto train = [&](Happo& happo, uint64_t first, uint64_t last) {
    for (uint64_t seed = first; seed < last; ++seed) {
      RolloutBatch batch = noise_batch(shape, 3, seed);
      UpdateContext context;
      context.env_frames = static_cast<double>(seed);
      ASSERT_TRUE(happo.update(batch, context));
    }
  };
  Happo whole(config, shape.env, torch::kCPU);
  train(whole, 20, 24);
  Happo first_half(config, shape.env, torch::kCPU);
  train(first_half, 20, 22);
  StateDict state;
  first_half.save(state);
  EXPECT_TRUE(state.has("optimizer/agent2.000.exp_avg"));
  EXPECT_TRUE(state.has("optimizer/critic.000.exp_avg"));
  Happo second_half(config, shape.env, torch::kCPU);
  ASSERT_TRUE(second_half.load(state));
  train(second_half, 22, 24);
  EXPECT_EQ(second_half.version(), whole.version());
  EXPECT_TRUE(whole.weights() == second_half.weights());
}

TEST(Happo, TheOrderOfWorldsInABatchChangesNothing) {
  const RunConfig config = small_config();
  const TrajectoryShape shape = small_shape(config);
  Happo straight(config, shape.env, torch::kCPU), shuffled(config, shape.env, torch::kCPU);
  RolloutBatch batch = noise_batch(shape, 4, 11);
  RolloutBatch other = select_slabs(batch, {2, 0, 3, 1});
  ASSERT_TRUE(straight.update(batch, {}));
  ASSERT_TRUE(shuffled.update(other, {}));
  const std::vector<Tensor> a = straight.net().parameters(), b = shuffled.net().parameters();
  for (std::size_t i = 0; i < a.size(); ++i) EXPECT_TRUE(torch::allclose(a[i], b[i], 1e-3, 2e-5)) << i;
}

}  // namespace happo_test
}  // namespace comrad::learn
