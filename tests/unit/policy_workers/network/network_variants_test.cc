// The networks beside the shared IPPO one that actor_critic_test.cc looks at: towers per agent, an agent index,
// central and joint critics, the other encoders, decoders, and products in bfloat16.

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <set>

#include "policy_workers/device/torch_ops.h"
#include "policy_workers/network/actor_critic.h"
#include "tests/unit/policy_workers/network/made_encoder.h"

namespace comrad::policy {
namespace network_variants_test {

NetworkOptions small_options() {
  NetworkOptions options;
  options.env.num_agents = 3;
  options.env.height = 40;
  options.env.width = 44;
  options.env.measurement_count = 2;
  options.env.head_count = 2;
  options.env.head_sizes = {3, 2};
  options.rnn_size = 12;
  options.critic_widths = {10, 6};
  return options;
}

/// The networks by name: the words say what differs from a shared GRU with its own values.
NetworkOptions variant(const std::string& name) {
  NetworkOptions options = small_options();
  const auto has = [&name](const char* word) { return name.find(word) != std::string::npos; };
  if (has("lstm")) options.rnn_type = RnnType::kLstm;
  if (has("feedforward")) options.use_rnn = false;
  if (has("deep")) options.rnn_num_layers = 2;
  if (has("decoder")) options.decoder_widths = {9, 7};
  if (has("separate")) options.separate_agents = true;
  if (has("id")) options.agent_id_input = true;
  if (has("central")) options.critic = CriticKind::kCentral;
  if (has("position")) options.critic_view = CriticView::kPosition;
  if (has("joint")) options.critic = CriticKind::kJoint, options.separate_agents = true;
  if (has("plain")) options.critic_rnn = false;
  if (has("global")) options.global_state_count = 4;
  if (has("impala")) options.encoder = "impala";
  if (has("resnet")) options.encoder = "resnet";
  if (has("atari")) options.encoder = "atari";
  if (has("norm")) options.layer_norm = true;
  if (has("bf16")) options.precision = Precision::kBf16;
  return options;
}

struct Rows {
  Tensor frame, measurement, state, reset;
  Tensor global_state = {};
  /// Of step `t`, for step().
  Tensor global(int64_t t) const { return global_state.defined() ? global_state[t] : Tensor(); }
};

Rows random_rows(const NetworkOptions& options, int64_t steps, int64_t worlds) {
  const int64_t rows = worlds * options.env.num_agents;
  return {torch::randint(0, 256, {steps, rows, 3, options.env.height, options.env.width}, torch::kUInt8),
          torch::randn({steps, rows, options.env.measurement_count}),
          torch::randn({rows, options.recurrent_state_count()}).clamp(-1, 1),
          torch::rand({steps, rows}).gt(0.6).to(torch::kUInt8),
          options.global_state_count > 0 ? 1000 * torch::randn({steps, worlds, options.global_state_count})
                                         : Tensor()};
}

SequenceInput input_of(const Rows& rows) {
  return {.frame = rows.frame,
          .measurement = rows.measurement,
          .recurrent_state = rows.state,
          .reset = rows.reset,
          .global_state = rows.global_state};
}

double largest_difference(const Tensor& a, const Tensor& b) { return (a - b).abs().max().item<double>(); }

class Variants : public testing::TestWithParam<const char*> {
 protected:
  void SetUp() override {
    torch::manual_seed(17);
    options_ = variant(GetParam());
    net_ = ActorCritic::create(options_, 3, torch::kCPU);
    rows_ = random_rows(options_, 5, 2);
    net_.update_input_statistics(rows_.frame.flatten(0, 1), rows_.measurement.flatten(0, 1));
    if (rows_.global_state.defined()) net_.update_state_statistics(rows_.global_state);
  }

  NetworkOptions options_;
  ActorCritic net_;
  Rows rows_;
};

TEST_P(Variants, SequenceEqualsRepeatedStepsWithResets) {
  torch::NoGradGuard no_grad;
  const SequenceOutput sequence = net_.sequence(input_of(rows_));
  const double tolerance = options_.precision == Precision::kBf16 ? 2e-2 : 1e-5;
  Tensor state = rows_.state;
  for (int64_t t = 0; t < 5; ++t) {
    state = state * rows_.reset[t].eq(0).to(torch::kFloat32).unsqueeze(-1);
    const PolicyOutput output = net_.step(rows_.frame[t], rows_.measurement[t], state, rows_.global(t));
    EXPECT_LT(largest_difference(sequence.logits[t], output.logits), tolerance) << "step " << t;
    EXPECT_LT(largest_difference(sequence.value[t], output.value), tolerance) << "step " << t;
    ASSERT_EQ(output.recurrent_state.sizes(), rows_.state.sizes());
    state = output.recurrent_state;
  }
}

TEST_P(Variants, FramesMayLieAnywhere) {
  std::vector<const uint8_t*> pointers;
  for (int64_t row = 0; row < rows_.frame.size(1); ++row)
    pointers.push_back(rows_.frame[0][row].data_ptr<uint8_t>());
  const PolicyOutput dense = net_.step(rows_.frame[0], rows_.measurement[0], rows_.state, rows_.global(0));
  const PolicyOutput scattered = net_.step_rows(pointers, rows_.measurement[0], rows_.state, rows_.global(0));
  EXPECT_LT(largest_difference(dense.logits, scattered.logits), 1e-5);
  EXPECT_LT(largest_difference(dense.value, scattered.value), 1e-5);
  if (options_.recurrent_state_count() > 0) {
    EXPECT_LT(largest_difference(dense.recurrent_state, scattered.recurrent_state), 1e-5);
  }
}

TEST_P(Variants, SomeAgentsAloneActAsAmongAll) {
  std::vector<const uint8_t*> all;
  for (int64_t row = 0; row < rows_.frame.size(1); ++row)
    all.push_back(rows_.frame[0][row].data_ptr<uint8_t>());
  const PolicyOutput whole = net_.step_rows(all, rows_.measurement[0], rows_.state, rows_.global(0));
  const std::vector<int> agents = {0, 2};
  std::vector<int64_t> rows;
  std::vector<const uint8_t*> frames;
  for (int64_t world = 0; world < 2; ++world)
    for (const int agent : agents) {
      rows.push_back(world * options_.env.num_agents + agent);
      frames.push_back(all[static_cast<size_t>(rows.back())]);
    }
  const Tensor index = torch::tensor(rows, torch::kInt64), state = rows_.state.index_select(0, index);
  const PolicyOutput some =
      net_.step_agents(frames, rows_.measurement[0].index_select(0, index), state, agents);
  const double tolerance = options_.precision == Precision::kBf16 ? 2e-2 : 1e-5;
  EXPECT_LT(largest_difference(some.logits, whole.logits.index_select(0, index)), tolerance);
  ASSERT_EQ(some.recurrent_state.sizes(), state.sizes());
  const int64_t actors = options_.core_state_count();
  if (actors > 0) {
    EXPECT_LT(largest_difference(some.recurrent_state.slice(1, 0, actors),
                                 whole.recurrent_state.index_select(0, index).slice(1, 0, actors)),
              tolerance);
  }
  if (options_.recurrent_state_count() > actors) {
    EXPECT_TRUE(some.recurrent_state.slice(1, actors).equal(state.slice(1, actors))) << "the critic's";
  }
}

TEST_P(Variants, GradientsReachEveryParameter) {
  const SequenceOutput output = net_.sequence(input_of(rows_));
  (output.logits.square().mean() + output.value.square().mean()).backward();
  std::set<std::string> names;
  for (auto& [name, tensor] : net_.named_state()) {
    EXPECT_TRUE(names.insert(name).second) << name << " is there twice";
    if (!tensor.requires_grad()) continue;
    ASSERT_TRUE(tensor.grad().defined()) << name;
    EXPECT_GT(tensor.grad().abs().sum().item<double>(), 0.0) << name;
    EXPECT_TRUE(torch::isfinite(tensor.grad()).all().item<bool>()) << name;
  }
}

TEST_P(Variants, WeightsTravelAsBytes) {
  const ActorCritic worker = ActorCritic::create(options_, 4, torch::kCPU);
  ASSERT_TRUE(worker.read_weights(net_.weights()));
  const PolicyOutput here = net_.step(rows_.frame[0], rows_.measurement[0], rows_.state, rows_.global(0)),
                     there = worker.step(rows_.frame[0], rows_.measurement[0], rows_.state, rows_.global(0));
  EXPECT_TRUE(torch::equal(here.logits, there.logits));
  EXPECT_TRUE(torch::equal(here.value, there.value));
}

INSTANTIATE_TEST_SUITE_P(
    ActorCritic, Variants,
    testing::Values("separate", "separate_lstm", "id", "id_feedforward", "central_id", "central_separate",
                    "central_position_id", "central_position_separate", "central_global",
                    "central_position_global", "joint_global", "bf16_central", "joint", "joint_lstm_deep",
                    "joint_plain", "joint_feedforward", "decoder", "joint_decoder", "atari", "impala",
                    "resnet_impala", "bf16", "bf16_lstm", "bf16_joint", "bf16_resnet_impala", "norm",
                    "norm_feedforward_decoder", "norm_separate_lstm_decoder", "bf16_norm_decoder"));

TEST(ActorCritic, LayerNormalisationStandsBeforeActivationsAndBehindTheCore) {
  NetworkOptions options = variant("norm_decoder");
  options.normalize_input = false;
  const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
  torch::NoGradGuard no_grad;
  std::map<std::string, Tensor> p;
  for (const auto& [name, tensor] : net.named_parameters()) {
    if (name.find("norm") != std::string::npos) tensor.add_(torch::randn_like(tensor), 0.3);
    p[name] = tensor;
  }
  const Rows rows = random_rows(options, 1, 2);
  const auto linear = [&p](const Tensor& x, const std::string& name) {
    return at::linear(x, p.at(name + ".weight"), p.at(name + ".bias"));
  };
  // Written out: (x - mean) / sqrt(variance + 1e-5), the variance divided by the number of elements.
  const auto norm = [&p](const Tensor& x, const std::string& name) {
    const Tensor centred = x - x.mean(1, true);
    return centred / (centred.square().mean(1, true) + 1e-5).sqrt() * p.at(name + ".weight") +
           p.at(name + ".bias");
  };
  Tensor x = rows.frame[0].to(torch::kFloat32) / 255;
  for (const auto& [name, stride] :
       {std::pair("encoder.conv1", 4), {"encoder.conv2", 2}, {"encoder.conv3", 2}})
    x = at::elu(
        at::conv2d(x, p.at(std::string(name) + ".weight"), p.at(std::string(name) + ".bias"), stride));
  x = at::elu(norm(linear(x.flatten(1), "encoder.image"), "encoder.norm1"));
  Tensor m = rows.measurement[0];
  for (const std::string name : {"encoder.measurement1", "encoder.measurement2"})
    m = at::elu(norm(linear(m, name), name + "_norm"));
  const Tensor state =
      at::gru_cell(at::cat({x, m}, 1), rows.state, p.at("core.weight_ih_l0"), p.at("core.weight_hh_l0"),
                   p.at("core.bias_ih_l0"), p.at("core.bias_hh_l0"));
  x = norm(state, "core_norm");
  for (const std::string index : {"0", "1"})
    x = at::elu(norm(linear(x, "decoder." + index), "decoder_norm." + index));
  const PolicyOutput output = net.step(rows.frame[0], rows.measurement[0], rows.state);
  EXPECT_LT(largest_difference(output.logits, linear(x, "action_head")), 1e-4);
  EXPECT_LT(largest_difference(output.recurrent_state, state), 1e-4) << "the state itself stays as it is";
}

TEST(ActorCritic, HappoHasTheParameterCountOfTheSpecification) {
  RunConfig config;
  config.run.algo = "happo";
  EnvShape env;
  env.head_count = 5;
  env.head_sizes = {3, 3, 3, 2, 3};
  const NetworkOptions options = NetworkOptions::from(config, env);
  const ActorCritic net = ActorCritic::create(options, 1, torch::kCPU);
  EXPECT_EQ(net.parameter_count(), 12'146'589);
  EXPECT_EQ(options.recurrent_state_count(), 2 * 512);
  int64_t critic_mlp = 0, critic = 0;
  for (auto& [name, tensor] : net.named_state())
    if (name.starts_with("critic.") && !name.starts_with("critic.agent")) critic_mlp += tensor.numel();
  EXPECT_EQ(critic_mlp, 656'385);
  for (const Tensor& tensor : net.joint_critic_parameters()) critic += tensor.numel();
  int64_t actors = 0;
  for (const int64_t agent : {0, 1})
    for (const Tensor& tensor : net.actor_parameters(agent)) actors += tensor.numel();
  EXPECT_EQ(actors + critic, net.parameter_count());
}

TEST(ActorCritic, ASharedNetworkDistinguishesAgentsOnlyByTheirIndex) {
  for (const auto& [name, differs] :
       {std::pair("shared", false), {"id", true}, {"id_feedforward", true}, {"separate", true}}) {
    const NetworkOptions options = variant(name);
    const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
    const Tensor frame = torch::randint(0, 256, {1, 3, options.env.height, options.env.width}, torch::kUInt8)
                             .repeat({3, 1, 1, 1});
    const PolicyOutput output =
        net.step(frame, torch::zeros({3, 2}), torch::zeros({3, options.recurrent_state_count()}));
    EXPECT_EQ(largest_difference(output.logits[0], output.logits[1]) > 1e-4, differs) << name;
    EXPECT_EQ(largest_difference(output.logits[1], output.logits[2]) > 1e-4, differs) << name;
  }
}

TEST(ActorCritic, OnlyCriticsOfAllAgentsSeeAnotherAgentsFrame) {
  for (const auto& [name, value_changes] : {std::pair("separate", false),
                                            {"id", false},
                                            {"central", true},
                                            {"central_position", true},
                                            {"joint", true}}) {
    const NetworkOptions options = variant(name);
    const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
    const Rows rows = random_rows(options, 1, 2);
    const PolicyOutput before = net.step(rows.frame[0], rows.measurement[0], rows.state);
    Tensor frame = rows.frame[0].clone();
    frame[4] = 255 - frame[4];  // agent 1 of world 1
    const PolicyOutput after = net.step(frame, rows.measurement[0], rows.state);
    for (int64_t row = 0; row < 6; ++row) {
      EXPECT_EQ(largest_difference(before.logits[row], after.logits[row]) > 1e-5, row == 4) << name << row;
      EXPECT_EQ(largest_difference(before.value[row], after.value[row]) > 1e-6,
                row == 4 || (value_changes && row >= 3))
          << name << row;
    }
  }
}

TEST(ActorCritic, OnlyTheTeamsCriticSeesTheGlobalStateAndOnlyOfItsWorld) {
  for (const char* name : {"central_global", "central_position_global", "joint_global"}) {
    const NetworkOptions options = variant(name);
    const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
    const Rows rows = random_rows(options, 1, 2);
    net.update_state_statistics(rows.global_state);
    const PolicyOutput before = net.step(rows.frame[0], rows.measurement[0], rows.state, rows.global(0));
    Tensor state = rows.global(0).clone();
    state[1][2] += 500;
    const PolicyOutput after = net.step(rows.frame[0], rows.measurement[0], rows.state, state);
    EXPECT_TRUE(torch::equal(before.logits, after.logits)) << name;
    EXPECT_TRUE(torch::equal(before.recurrent_state, after.recurrent_state)) << name;
    for (int64_t row = 0; row < 6; ++row)
      EXPECT_EQ(largest_difference(before.value[row], after.value[row]) > 1e-6, row >= 3) << name << row;
  }
}

TEST(ActorCritic, TheGlobalStateIsNormalisedAlsoWhereInputsAreNot) {
  NetworkOptions options = variant("central_global");
  options.normalize_input = false;
  const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
  const Tensor states =
      torch::tensor({{-3000.0f, 0.0f, 1.0f, 7.0f}, {3000.0f, 0.0f, 3.0f, 7.0f}}).repeat({500, 1});
  net.update_state_statistics(states);
  const Tensor seen = net.normalized_state(states);
  EXPECT_NEAR(seen[1][0].item<double>(), 1, 0.01);
  EXPECT_NEAR(seen[0][2].item<double>(), -1, 0.01);
  EXPECT_LE(seen.abs().max().item<double>(), 5);
  std::set<std::string> names;
  for (const auto& [key, tensor] : net.named_state()) names.insert(key);
  EXPECT_TRUE(names.contains("normalizer.global_state.mean"));
  EXPECT_FALSE(names.contains("normalizer.frame.mean"));
}

TEST(ActorCritic, AnActorsPassIsItsColumnOfTheWholeAndTouchesNoOtherNetwork) {
  const NetworkOptions options = variant("joint");
  const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
  const Rows rows = random_rows(options, 4, 2);
  const SequenceOutput whole = net.sequence(input_of(rows));
  const auto of_agent = [](const Tensor& tensor, int64_t axis) {
    return tensor.slice(axis, 1, c10::nullopt, 3);
  };
  const SequenceInput input{.frame = of_agent(rows.frame, 1),
                            .measurement = of_agent(rows.measurement, 1),
                            .recurrent_state = of_agent(rows.state, 0),
                            .reset = of_agent(rows.reset, 1)};
  const Tensor logits = net.actor_sequence(1, input);
  EXPECT_LT(largest_difference(logits, of_agent(whole.logits, 1)), 1e-6);
  logits.square().sum().backward();
  const auto touched = [](const std::vector<Tensor>& parameters) {
    double sum = 0;
    for (const Tensor& parameter : parameters)
      if (parameter.grad().defined()) sum += parameter.grad().abs().sum().item<double>();
    return sum > 0;
  };
  EXPECT_TRUE(touched(net.actor_parameters(1)));
  EXPECT_FALSE(touched(net.actor_parameters(0)));
  EXPECT_FALSE(touched(net.actor_parameters(2)));
  EXPECT_FALSE(touched(net.joint_critic_parameters()));
  net.joint_value_sequence(input_of(rows)).square().sum().backward();
  EXPECT_TRUE(touched(net.joint_critic_parameters()));
  EXPECT_FALSE(touched(net.actor_parameters(0)));
}

TEST(ActorCritic, TheJointValueIsTheSameForAllAgentsOfAWorld) {
  const NetworkOptions options = variant("joint");
  const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
  const Rows rows = random_rows(options, 1, 2);
  const Tensor value = net.step(rows.frame[0], rows.measurement[0], rows.state).value.view({2, 3});
  for (int64_t world = 0; world < 2; ++world)
    for (int64_t agent = 1; agent < 3; ++agent)
      EXPECT_EQ(value[world][agent].item<float>(), value[world][0].item<float>());
  EXPECT_NE(value[0][0].item<float>(), value[1][0].item<float>());
}

TEST(ActorCritic, ALinearCentralCriticOfOneAgentIsIppoBitForBit) {
  for (const char* name : {"central", "central_position"}) {
    NetworkOptions own = small_options();
    own.env.num_agents = 1;
    NetworkOptions central = variant(name);
    central.env.num_agents = 1;
    central.critic_widths = {};
    const ActorCritic ippo = ActorCritic::create(own, 3, torch::kCPU),
                      mappo = ActorCritic::create(central, 3, torch::kCPU);
    const Rows rows = random_rows(own, 3, 2);
    const SequenceOutput a = ippo.sequence(input_of(rows)), b = mappo.sequence(input_of(rows));
    EXPECT_TRUE(torch::equal(a.logits, b.logits));
    EXPECT_TRUE(torch::equal(a.value, b.value));
    (a.logits.square().sum() + a.value.square().sum()).backward();
    (b.logits.square().sum() + b.value.square().sum()).backward();
    const auto p = ippo.parameters(), q = mappo.parameters();
    ASSERT_EQ(p.size(), q.size());
    for (size_t i = 0; i < p.size(); ++i) EXPECT_TRUE(torch::equal(p[i].grad(), q[i].grad())) << name << i;
  }
}

/// The rows of every world in another order of its agents.
Rows permuted(const Rows& rows, const std::vector<int64_t>& order) {
  const int64_t agents = static_cast<int64_t>(order.size()), worlds = rows.state.size(0) / agents;
  std::vector<int64_t> index;
  for (int64_t world = 0; world < worlds; ++world)
    for (const int64_t agent : order) index.push_back(world * agents + agent);
  const Tensor at = torch::tensor(index, torch::kInt64);
  return {rows.frame.index_select(1, at), rows.measurement.index_select(1, at),
          rows.state.index_select(0, at), rows.reset.index_select(1, at)};
}

TEST(ActorCritic, ExchangingAgentsExchangesTheirValues) {
  for (const std::vector<int64_t>& order : {std::vector<int64_t>{1, 0}, {2, 0, 1}, {3, 2, 0, 4, 1}})
    for (const char* name : {"central", "central_position"}) {
      NetworkOptions options = variant(name);
      options.env.num_agents = static_cast<int32_t>(order.size());
      const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
      const Rows rows = random_rows(options, 3, 2), other = permuted(rows, order);
      torch::NoGradGuard no_grad;
      const Tensor value = net.sequence(input_of(rows)).value, of_other = net.sequence(input_of(other)).value;
      const Tensor step = net.step(rows.frame[0], rows.measurement[0], rows.state).value,
                   other_step = net.step(other.frame[0], other.measurement[0], other.state).value;
      double difference = 0, step_difference = 0;
      for (int64_t world = 0; world < 2; ++world)
        for (size_t place = 0; place < order.size(); ++place) {
          const int64_t first = world * static_cast<int64_t>(order.size());
          const int64_t from = first + order[place], to = first + static_cast<int64_t>(place);
          difference =
              std::max(difference, largest_difference(value.select(1, from), of_other.select(1, to)));
          step_difference = std::max(step_difference, largest_difference(step[from], other_step[to]));
        }
      const bool is_symmetric = options.critic_view == CriticView::kOwnFirst;
      EXPECT_EQ(difference < 1e-5, is_symmetric) << name << order.size();
      EXPECT_EQ(step_difference < 1e-5, is_symmetric) << name << order.size();
    }
}

TEST(ActorCritic, OwnFirstIsTheCriticOfOwnFeaturesAndTheMeanOfTheOthers) {
  NetworkOptions options = variant("central_feedforward");
  options.critic_widths = {};  // linear, so that weights are read off: no core, no decoder, own | mean
  const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
  const Rows rows = random_rows(options, 1, 2);
  torch::NoGradGuard no_grad;
  const Tensor features = net.encode(rows.frame[0], rows.measurement[0]);
  const auto parameters = net.named_parameters();
  const Tensor weight = parameters[parameters.size() - 2].second, bias = parameters.back().second;
  const int64_t count = features.size(1);
  ASSERT_EQ(weight.sizes(), at::IntArrayRef({1, 2 * count}));
  const Tensor value = net.step(rows.frame[0], rows.measurement[0], rows.state).value;
  for (int64_t row = 0; row < 6; ++row) {
    double expected = bias.item<double>();
    for (int64_t i = 0; i < count; ++i) {
      double others = 0;
      for (int64_t other = row / 3 * 3; other < row / 3 * 3 + 3; ++other)
        if (other != row) others += features[other][i].item<double>() / 2;
      expected += weight[0][i].item<double>() * features[row][i].item<double>() +
                  weight[0][count + i].item<double>() * others;
    }
    EXPECT_NEAR(value[row].item<double>(), expected, 1e-4) << row;
  }
}

TEST(ActorCritic, AnAgentsValueLearnsFromItsPartnersObservations) {
  for (const char* name : {"central", "central_position"}) {
    const NetworkOptions options = variant(name);
    const ActorCritic net = ActorCritic::create(options, 3, torch::kCPU);
    Rows rows = random_rows(options, 2, 2);
    rows.measurement.requires_grad_();
    net.sequence(input_of(rows)).value[1][0].backward();  // agent 0 of world 0 in the last step
    const Tensor gradient = rows.measurement.grad().abs().sum(2);
    for (int64_t row = 0; row < 6; ++row)
      EXPECT_EQ(gradient[1][row].item<double>() > 0, row < 3) << name << row;
  }
}

TEST(ActorCritic, OnlyTheCriticByPositionGrowsWithTheNumberOfAgents) {
  std::map<std::string, std::vector<int64_t>> counts;
  for (const int32_t agents : {1, 2, 8})
    for (const CriticView view : {CriticView::kOwnFirst, CriticView::kPosition}) {
      RunConfig config;
      config.run.algo = "mappo";
      config.network.mappo_critic_view = view;
      EnvShape env;
      env.num_agents = agents;
      const ActorCritic net = ActorCritic::create(NetworkOptions::from(config, env), 1, torch::kCPU);
      int64_t critic = 0;
      for (const auto& [name, tensor] : net.named_parameters())
        if (name.starts_with("critic.")) critic += tensor.numel();
      counts[word_of(view)].push_back(critic);
    }
  // 512 or 1024 features to 512, 256 and 1 output; of 512 N to 512, 256 and N.
  EXPECT_EQ(counts["own_first"], (std::vector<int64_t>{394'241, 656'385, 656'385}));
  EXPECT_EQ(counts["position"], (std::vector<int64_t>{394'241, 656'642, 2'231'048}));
}

// Encoders.

TEST(Encoder, HasTheParameterCountsOfItsArchitectures) {
  torch::NoGradGuard no_grad;
  for (const auto& [name, expected] :
       {std::pair("simple", 1'293'024), {"impala", 1'617'456}, {"atari", 2'042'528}, {"resnet", 2'457'408}}) {
    const std::shared_ptr<const Encoder> encoder = made_encoder({}, name).encoder;
    int64_t count = 0;
    for (auto& [layer, parameter] : encoder->named_parameters()) count += parameter.numel();
    EXPECT_EQ(count, expected) << name;
    EXPECT_EQ(encoder->feature_count(), 512);
    EXPECT_EQ(encoder->forward(torch::randint(0, 256, {2, 3, 72, 128}, torch::kUInt8), {}).size(1), 512);
  }
}

/// The layers of an architecture written out, in double precision with autograd.
Tensor written_out(const std::string& name, Tensor x, const std::vector<Tensor>& p) {
  size_t next = 0;
  const auto conv = [&](const Tensor& input, int64_t stride, int64_t padding) {
    const Tensor y = at::conv2d(input, p[next], p[next + 1], stride, padding);
    next += 2;
    return y;
  };
  if (name == "resnet") {
    for (int stage = 0; stage < 3; ++stage) {
      x = at::max_pool2d(conv(x, 1, 1), 3, 2, 1);
      for (int block = 0; block < 2; ++block) {
        const Tensor inner = conv(at::elu(x), 1, 1);
        x = x + conv(at::elu(inner), 1, 1);
      }
    }
    x = at::elu(x);
  } else {
    const std::vector<int64_t> strides = name == "impala"  ? std::vector<int64_t>{4, 2}
                                         : name == "atari" ? std::vector<int64_t>{4, 2, 1}
                                                           : std::vector<int64_t>{4, 2, 2};
    for (const int64_t stride : strides) x = at::elu(conv(x, stride, 0));
  }
  return at::elu(at::linear(x.flatten(1), p[next], p[next + 1]));
}

TEST(Encoder, EveryArchitectureEqualsItsLayersWrittenOutForwardAndBackward) {
  EnvShape env;
  env.height = 40;
  env.width = 44;
  for (const char* name : {"simple", "impala", "atari", "resnet"}) {
    torch::manual_seed(1);
    const std::shared_ptr<const Encoder> encoder = made_encoder(env, name).encoder;
    const Tensor frame = torch::randint(0, 256, {67, 3, 40, 44}, torch::kUInt8),  // more than one chunk
        weights = torch::randn({67, 512});
    // Which pixel of a pooling window is the largest is a matter of the last digit: there the reference is
    // f32 as well, over the same rows at a time.
    const auto dtype = std::string(name) == "resnet" ? torch::kFloat32 : torch::kFloat64;
    std::vector<Tensor> p;
    for (auto& [layer, parameter] : encoder->named_parameters())
      p.push_back(parameter.detach().to(dtype).clone().requires_grad_());
    const Tensor pixels = frame.to(dtype) * (1 / (255 * std::sqrt(1 + 1e-5)));
    std::vector<Tensor> chunks;
    for (int64_t first = 0; first < 67; first += 32)
      chunks.push_back(written_out(name, pixels.slice(0, first, first + 32), p));
    const Tensor x = at::cat(chunks);
    (x * weights).sum().backward();
    const Tensor features = encoder->forward(frame, {});
    (features * weights).sum().backward();
    EXPECT_LT(largest_difference(features, x), 1e-5) << name;
    size_t index = 0;
    for (auto& [layer, parameter] : encoder->named_parameters()) {
      EXPECT_LT(largest_difference(parameter.grad(), p[index].grad()),
                2e-5 * p[index].grad().abs().max().item<double>())
          << name << " " << layer;
      ++index;
    }
  }
}

// Precision.

TEST(Precision, ProductsOfRoundedFactorsAreWithinTheBoundOfTheRounding) {
  torch::manual_seed(1);
  const Tensor x = torch::randn({16, 300}), weight = torch::randn({20, 300}), bias = torch::randn({20});
  const Tensor exact = linear(x, weight, bias, Precision::kFp32);
  const Tensor rounded = linear(x, weight, bias, Precision::kBf16);
  ASSERT_EQ(rounded.scalar_type(), torch::kFloat32);
  // Each factor is off by at most 2^-8 of itself, a bfloat16 product by as much again.
  const Tensor bound = (at::linear(x.abs(), weight.abs()) + exact.abs()) * (3.0 / 256);
  EXPECT_TRUE(((rounded - exact).abs() <= bound).all().item<bool>());
  EXPECT_GT(largest_difference(rounded, exact), 1e-4);  // and it is not f32 under another name
}

TEST(Precision, Bf16AgreesWithFp32InOutputsAndGradient) {
  for (const char* name : {"shared", "lstm", "joint", "resnet"}) {
    torch::manual_seed(2);
    const NetworkOptions exact = variant(name);
    NetworkOptions rounded = exact;
    rounded.precision = Precision::kBf16;
    const ActorCritic a = ActorCritic::create(exact, 3, torch::kCPU),
                      b = ActorCritic::create(rounded, 3, torch::kCPU);
    const Rows rows = random_rows(exact, 8, 4);
    const SequenceOutput x = a.sequence(input_of(rows)), y = b.sequence(input_of(rows));
    EXPECT_LT(largest_difference(x.logits, y.logits), 0.03 * x.logits.abs().max().item<double>()) << name;
    EXPECT_LT(largest_difference(x.value, y.value), 0.03 * x.value.abs().max().item<double>()) << name;
    EXPECT_GT(largest_difference(x.logits, y.logits), 0) << name;
    (x.logits.square().sum() + x.value.square().sum()).backward();
    (y.logits.square().sum() + y.value.square().sum()).backward();
    double dot = 0, aa = 0, bb = 0;
    for (size_t i = 0; i < a.parameters().size(); ++i) {
      const Tensor g = a.parameters()[i].grad().to(torch::kFloat64),
                   h = b.parameters()[i].grad().to(torch::kFloat64);
      dot += (g * h).sum().item<double>();
      aa += g.square().sum().item<double>();
      bb += h.square().sum().item<double>();
    }
    EXPECT_GT(dot / std::sqrt(aa * bb), 0.999) << name;
    EXPECT_NEAR(std::sqrt(bb / aa), 1.0, 0.01) << name;
  }
}

}  // namespace network_variants_test
}  // namespace comrad::policy
