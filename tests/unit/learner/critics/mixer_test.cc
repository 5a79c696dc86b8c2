#include "learner/critics/mixer.h"

#include <gtest/gtest.h>
#include <torch/csrc/autograd/autograd.h>

#include <cmath>
#include <vector>

#include "learner/critics/qmix_mixer.h"
#include "learner/critics/qplex_mixer.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/rng.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/recipes.h"

namespace comrad::learn {
namespace mixer_test {

constexpr const char* kKinds[] = {"vdn", "qmix", "dmaq", "dmaq_qatten"};

/// A small mixer: N agents with one head of A choices, slices of 3 entries.
/// The algorithm whose mixer has the name `kind`.
AlgorithmName algorithm_of(std::string_view kind) {
  for (const AlgorithmRow* row : algorithm_rows())
    if (row->mixer_name == kind) return *row;
  ADD_FAILURE() << "no mixer " << kind;
  return "vdn";
}

MixerOptions small(const char* kind, int64_t agents = 2, int64_t choices = 3,
                   QplexPreset preset = QplexPreset::kComrad) {
  RunConfig config;
  config.run.algo = algorithm_of(kind);
  EXPECT_TRUE(apply_layer(config, qplex_preset_settings(preset)));
  EnvShape env;
  env.num_agents = static_cast<int32_t>(agents);
  env.head_count = 1;
  env.head_sizes = {static_cast<int32_t>(choices)};
  return MixerOptions::from(config, env, /*features=*/3);
}

/// The benchmark's: two agents with heads of 3, 3, 3, 2 and 3 choices, 512 features each, a run's defaults.
MixerOptions benchmark(const char* kind) {
  RunConfig config;
  config.run.algo = algorithm_of(kind);
  EnvShape env;
  env.num_agents = 2;
  env.head_count = 5;
  env.head_sizes = {3, 3, 3, 2, 3};
  return MixerOptions::from(config, env, /*features=*/512);
}

at::Generator generator(uint64_t seed) { return at::make_generator<at::CPUGeneratorImpl>(seed); }

Tensor normal(at::IntArrayRef sizes, at::Generator& draws, double deviation = 1.0) {
  return torch::empty(sizes).normal_(0, deviation, draws);
}

int64_t parameter_count(const Mixer& mixer) {
  int64_t count = 0;
  for (const auto& [name, tensor] : mixer.named_parameters()) count += tensor.numel();
  return count;
}

Tensor parameter(const Mixer& mixer, const std::string& wanted) {
  for (const auto& [name, tensor] : mixer.named_parameters())
    if (name == wanted) return tensor;
  ADD_FAILURE() << "no parameter " << wanted;
  return {};
}

/// Far from the start: mixers as training may leave them.
void shake(const Mixer& mixer, at::Generator& draws, double deviation) {
  torch::NoGradGuard no_grad;
  for (const auto& [name, tensor] : mixer.named_parameters())
    tensor.add_(normal(tensor.sizes(), draws, deviation));
}

/// Every joint action of N agents with A choices each, i64 [A^N, N]; agent 0 turns slowest.
Tensor all_joint_actions(int64_t agents, int64_t choices) {
  const int64_t count = static_cast<int64_t>(std::llround(std::pow(choices, agents)));
  const Tensor action = torch::empty({count, agents}, torch::kInt64);
  for (int64_t row = 0; row < count; ++row) {
    int64_t rest = row;
    for (int64_t agent = agents - 1; agent >= 0; --agent, rest /= choices)
      action[row][agent] = rest % choices;
  }
  return action;
}

/// Utilities q [N, A] at every joint action under one state [S], in the order of all_joint_actions.
MixerInput at_all_joint_actions(const Tensor& q, const Tensor& state) {
  const int64_t agents = q.size(0), choices = q.size(1);
  const Tensor action = all_joint_actions(agents, choices);
  const int64_t rows = action.size(0);
  MixerInput input;
  input.chosen = q.unsqueeze(0).expand({rows, agents, choices}).gather(2, action.unsqueeze(2)).squeeze(2);
  input.greedy = q.amax(1).unsqueeze(0).expand({rows, agents}).contiguous();
  input.action = torch::zeros({rows, agents, choices}).scatter_(2, action.unsqueeze(2), 1).flatten(1);
  input.state = state.unsqueeze(0).expand({rows, state.size(0)}).contiguous();
  return input;
}

MixerInput random_input(const MixerOptions& options, int64_t rows, at::Generator& draws) {
  MixerInput input;
  input.chosen = normal({rows, options.num_agents}, draws);
  input.greedy = input.chosen + normal({rows, options.num_agents}, draws).abs();
  const Tensor action =
      torch::empty({rows, options.num_agents, 1}, torch::kInt64).random_(0, options.logit_count, draws);
  input.action =
      torch::zeros({rows, options.num_agents, options.logit_count}).scatter_(2, action, 1).flatten(1);
  input.state = normal({rows, options.state_count}, draws);
  return input;
}

void expect_values(const Tensor& actual, const std::vector<double>& expected, double tolerance = 2e-6) {
  const Tensor flat = actual.detach().flatten();
  ASSERT_EQ(flat.size(0), static_cast<int64_t>(expected.size()));
  for (size_t index = 0; index < expected.size(); ++index)
    EXPECT_NEAR(flat[static_cast<int64_t>(index)].item<double>(), expected[index], tolerance)
        << "entry " << index;
}

Tensor gradient(const Tensor& output, const Tensor& input) {
  const Tensor result = torch::autograd::grad({output}, {input}, {}, /*retain_graph=*/true,
                                              /*create_graph=*/false, /*allow_unused=*/true)[0];
  return result.defined() ? result : torch::zeros_like(input);
}

// ---- all kinds

TEST(Mixer, HasTheParametersOfTheBenchmark) {
  const auto count = [](const char* kind, int64_t layers = 0) {
    MixerOptions options = benchmark(kind);
    if (layers > 0) options.adv_hypernet_layers = layers;
    return parameter_count(*make_mixer(options, 1, torch::kCPU));
  };
  EXPECT_EQ(count("vdn"), 0);
  EXPECT_EQ(count("qmix"), 203'073);
  EXPECT_EQ(count("dmaq"), 152'184);
  EXPECT_EQ(count("dmaq_qatten"), 389'685);
  EXPECT_EQ(count("dmaq", 3), 977'048);
}

TEST(Mixer, IsAFunctionOfItsSeed) {
  for (const char* kind : {"qmix", "dmaq", "dmaq_qatten"}) {
    const auto first = make_mixer(small(kind), 7, torch::kCPU)->named_parameters();
    const auto same = make_mixer(small(kind), 7, torch::kCPU)->named_parameters();
    const auto other = make_mixer(small(kind), 8, torch::kCPU)->named_parameters();
    bool any_differs = false;
    for (size_t index = 0; index < first.size(); ++index) {
      EXPECT_EQ(first[index].first, same[index].first);
      EXPECT_TRUE(first[index].second.equal(same[index].second)) << kind << " " << first[index].first;
      any_differs = any_differs || !first[index].second.equal(other[index].second);
      for (size_t before = 0; before < index; ++before) EXPECT_NE(first[index].first, first[before].first);
    }
    EXPECT_TRUE(any_differs) << kind;
  }
}

TEST(Mixer, TakesABatchOfOneAndEveryRowAlone) {
  at::Generator draws = generator(3);
  for (const char* kind : kKinds) {
    const MixerOptions options = small(kind, 3, 4);
    const auto mixer = make_mixer(options, 5, torch::kCPU);
    const MixerInput input = random_input(options, 6, draws);
    const Tensor all = mixer->mix(input).q_tot;
    EXPECT_EQ(all.sizes(), torch::IntArrayRef({6}));
    for (int64_t row = 0; row < 6; ++row) {
      const auto only = [&](const Tensor& x) { return x.slice(0, row, row + 1); };
      const Tensor one =
          mixer->mix({only(input.chosen), only(input.greedy), only(input.action), only(input.state)}).q_tot;
      EXPECT_NEAR(one.item<double>(), all[row].item<double>(), 1e-5) << kind;
    }
  }
}

TEST(Mixer, ReadsTheState) {
  at::Generator draws = generator(4);
  for (const char* kind : {"qmix", "dmaq", "dmaq_qatten"}) {
    const MixerOptions options = small(kind);
    const auto mixer = make_mixer(options, 5, torch::kCPU);
    MixerInput input = random_input(options, 8, draws);
    const Tensor before = mixer->mix(input).q_tot;
    input.state = normal(input.state.sizes(), draws);
    EXPECT_GT((mixer->mix(input).q_tot - before).abs().min().item<double>(), 1e-5) << kind;
  }
}

TEST(Mixer, SendsNoGradientIntoTheStateOrTheGreedyUtilities) {
  at::Generator draws = generator(6);
  for (const char* kind : {"qmix", "dmaq", "dmaq_qatten"}) {
    MixerOptions options = small(kind);
    options.weighted_head = options.nonlinear = options.state_bias = true;
    const auto mixer = make_mixer(options, 5, torch::kCPU);
    MixerInput input = random_input(options, 4, draws);
    for (Tensor* tensor : {&input.chosen, &input.greedy, &input.state}) tensor->requires_grad_();
    const MixerOutput output = mixer->mix(input);
    Tensor loss = output.q_tot.square().sum();
    if (output.regularizer.defined()) loss = loss + output.regularizer.sum();
    loss.backward();
    EXPECT_GT(input.chosen.grad().abs().min().item<double>(), 0) << kind;
    EXPECT_FALSE(input.greedy.grad().defined()) << kind;
    EXPECT_FALSE(input.state.grad().defined()) << kind;
  }
}

TEST(Mixer, ItsGainIsWhatTheTeamsValueRisesByWithAnAgentsUtility) {
  at::Generator draws = generator(12);
  EXPECT_FALSE(make_mixer(small("vdn"), 1, torch::kCPU)->mix({.chosen = torch::ones({1, 2})}).gain.defined());
  for (const char* kind : {"qmix", "dmaq", "dmaq_qatten"})
    for (const QplexPreset preset : {QplexPreset::kComrad, QplexPreset::kPaper}) {
      const MixerOptions options = small(kind, 3, 3, preset);
      const auto mixer = make_mixer(options, 5, torch::kCPU);
      shake(*mixer, draws, 0.5);
      MixerInput input = random_input(options, 40, draws);
      input.chosen.requires_grad_();
      const MixerOutput output = mixer->mix(input);
      const Tensor rise = gradient(output.q_tot.sum(), input.chosen).mean(1);
      ASSERT_EQ(output.gain.sizes(), rise.sizes()) << kind;
      EXPECT_LT((output.gain - rise).abs().max().item<float>(), 1e-5) << kind;
      EXPECT_FALSE(output.gain.requires_grad()) << kind;
    }
}

TEST(Mixer, AttentionNeedsASliceOfTheStatePerAgent) {
  MixerOptions options = small("dmaq_qatten");
  options.state_count = 5;  // of two agents with 3 features each
  EXPECT_DEATH((void)make_mixer(options, 1, torch::kCPU), "one slice for each agent");
}

// ---- VDN

TEST(VdnMixer, SumsTheUtilities) {
  const Tensor q = torch::tensor({1.0f, -2.0f}).view({1, 2}).requires_grad_();
  const Tensor q_tot = make_mixer(small("vdn"), 1, torch::kCPU)->mix({.chosen = q}).q_tot;
  EXPECT_EQ(q_tot.item<float>(), -1.0f);
  expect_values(gradient(q_tot, q), {1, 1}, 0);
}

// ---- QMIX

TEST(QmixMixer, MatchesTheKnownAnswer) {
  const Tensor q = torch::tensor({1.0f, -2.0f}).view({1, 2}).requires_grad_();
  const QmixWeights weights{.w1 = torch::tensor({0.5f, 1.0f, 0.25f, 0.75f}).view({1, 2, 2}),
                            .b1 = torch::tensor({0.1f, -0.2f}).view({1, 2}),
                            .w2 = torch::tensor({2.0f, 0.5f}).view({1, 2}),
                            .b2 = torch::tensor({0.3f})};
  const Tensor q_tot = qmix_value(q, weights).q_tot;
  expect_values(q_tot, {0.248293});
  expect_values(gradient(q_tot, q), {1.248293, 0.686219});
}

TEST(QmixMixer, MakesTheKnownAnswersWeightsFromItsHypernets) {
  MixerOptions options = small("qmix");
  options.embed_dim = 2;
  const auto mixer = make_mixer(options, 1, torch::kCPU);
  {
    // With zero weights the last biases are what the hypernets put out; signs must fall away.
    torch::NoGradGuard no_grad;
    for (const auto& [name, tensor] : mixer->named_parameters()) tensor.zero_();
    parameter(*mixer, "w1.1.bias").copy_(torch::tensor({-0.5f, 1.0f, 0.25f, -0.75f}).view({1, 4}));
    parameter(*mixer, "b1.0.bias").copy_(torch::tensor({0.1f, -0.2f}).view({1, 2}));
    parameter(*mixer, "w2.1.bias").copy_(torch::tensor({2.0f, -0.5f}).view({1, 2}));
    parameter(*mixer, "b2.1.bias").fill_(0.3f);
  }
  const Tensor q = torch::tensor({1.0f, -2.0f}).view({1, 2}).requires_grad_();
  const Tensor q_tot = mixer->mix({.chosen = q, .state = torch::ones({1, options.state_count})}).q_tot;
  expect_values(q_tot, {0.248293});
  expect_values(gradient(q_tot, q), {1.248293, 0.686219});
}

TEST(QmixMixer, StartsAsXavierWithGainOneHalf) {
  for (const auto& [name, tensor] : make_mixer(benchmark("qmix"), 2, torch::kCPU)->named_parameters()) {
    if (name.ends_with(".bias")) {
      EXPECT_EQ(tensor.abs().max().item<float>(), 0.0f) << name;
      continue;
    }
    const double bound = 0.5 * std::sqrt(6.0 / static_cast<double>(tensor.size(1) + tensor.size(2)));
    const double largest = tensor.abs().max().item<double>();
    EXPECT_LE(largest, bound * (1 + 1e-6)) << name;
    EXPECT_GT(largest, 0.85 * bound) << name;
    EXPECT_NEAR(tensor.std().item<double>(), bound / std::sqrt(3.0), 0.2 * bound) << name;
  }
}

/// Every row has a state, utilities and (across the shaken mixers) its own weights.
TEST(QmixMixer, RisesWithEveryUtilityAtTenThousandRandomPoints) {
  at::Generator draws = generator(11);
  int64_t points = 0;
  for (int64_t round = 0; round < 100; ++round) {
    const int64_t agents = 2 + round % 4;
    const MixerOptions options = small("qmix", agents);
    const auto mixer = make_mixer(options, static_cast<uint64_t>(round), torch::kCPU);
    shake(*mixer, draws, round % 2 == 0 ? 0.0 : 0.3);
    MixerInput input;
    input.chosen = normal({100, agents}, draws, 3.0).requires_grad_();
    input.state = normal({100, options.state_count}, draws, 2.0);
    const Tensor q_tot = mixer->mix(input).q_tot;
    EXPECT_GE(gradient(q_tot.sum(), input.chosen).min().item<double>(), 0.0);
    for (int64_t agent = 0; agent < agents; ++agent) {
      MixerInput raised = input;
      raised.chosen = input.chosen.detach().clone();
      raised.chosen.select(1, agent).add_(0.1);
      const Tensor rise = mixer->mix(raised).q_tot - q_tot;
      // Rounding of a sum of terms as large as Q_tot may take back what a tiny slope gives.
      EXPECT_GE((rise + 1e-5 * (1 + q_tot.abs())).min().item<double>(), 0.0);
    }
    points += 100;
  }
  EXPECT_EQ(points, 10'000);
}

/// The ELU layer is convex, so what one agent's better utility adds grows with the other's. This bounds what
/// QMIX can represent more tightly than monotonicity does (mixer_games_test).
TEST(QmixMixer, HasIncreasingDifferences) {
  at::Generator draws = generator(12);
  for (uint64_t round = 0; round < 50; ++round) {
    const MixerOptions options = small("qmix");
    const auto mixer = make_mixer(options, round, torch::kCPU);
    shake(*mixer, draws, round % 2 == 0 ? 0.0 : 0.3);
    const Tensor low = normal({100, 2}, draws, 2.0), rise = normal({100, 2}, draws, 2.0).abs();
    const Tensor state = normal({100, options.state_count}, draws, 2.0);
    const auto value = [&](float first, float second) {
      const Tensor chosen = low + rise * torch::tensor({first, second});
      return mixer->mix({.chosen = chosen, .state = state}).q_tot;
    };
    const Tensor both = value(1, 1), neither = value(0, 0), one = value(1, 0), other = value(0, 1);
    const Tensor rounding = 1e-5 * (1 + both.abs() + neither.abs() + one.abs() + other.abs());
    EXPECT_GE((both + neither - one - other + rounding).min().item<double>(), 0.0) << round;
  }
}

// ---- individual and global argmax agree, by enumeration

void expect_igm(const MixerOptions& options, uint64_t seed) {
  at::Generator draws = generator(seed);
  const auto mixer = make_mixer(options, seed, torch::kCPU);
  shake(*mixer, draws, seed % 3 == 0 ? 0.0 : 0.5);
  const Tensor q = normal({options.num_agents, options.logit_count}, draws, seed % 2 == 0 ? 1.0 : 10.0);
  const MixerInput input = at_all_joint_actions(q, normal({options.state_count}, draws));
  const MixerOutput output = mixer->mix(input);
  int64_t greedy_row = 0;
  for (int64_t agent = 0; agent < options.num_agents; ++agent)
    greedy_row = greedy_row * options.logit_count + q[agent].argmax().item<int64_t>();
  const double at_greedy = output.q_tot[greedy_row].item<double>();
  const double best = output.q_tot.max().item<double>();
  EXPECT_GE(at_greedy, best - 1e-5 * (1 + std::abs(best)))
      << static_cast<int>(options.kind) << " seed " << seed;
  if (output.a_tot.defined()) {
    EXPECT_EQ(output.a_tot[greedy_row].item<double>(), 0.0)
        << static_cast<int>(options.kind) << " seed " << seed;
    // What is added to the greedy value is never above 0.
    const Tensor added = output.q_tot - at_greedy;
    EXPECT_LE(added.max().item<double>(), 1e-5 * (1 + std::abs(at_greedy)))
        << static_cast<int>(options.kind) << " seed " << seed;
  }
}

TEST(Igm, HoldsForRandomParametersOfEveryKind) {
  for (uint64_t seed = 0; seed < 60; ++seed) {
    const int64_t agents = 2 + static_cast<int64_t>(seed % 3);
    for (const char* kind : kKinds) expect_igm(small(kind, agents, 4), seed);
    for (const char* kind : {"dmaq", "dmaq_qatten"}) {
      MixerOptions options = small(kind, agents, 4);
      options.weighted_head = options.state_bias = true;
      options.nonlinear = seed % 2 == 0;
      options.adv_hypernet_layers = 1 + static_cast<int64_t>(seed % 3);
      expect_igm(options, seed);
      MixerOptions paper = small(kind, agents, 4, QplexPreset::kPaper);
      paper.nonlinear = options.nonlinear;
      expect_igm(paper, seed);
      options.is_minus_one = false;
      expect_igm(options, seed);
    }
  }
}

// ---- QPLEX

struct QplexExample {
  Tensor chosen = torch::tensor({1.0f, 2.0f}).view({1, 2}).requires_grad_();
  Tensor greedy = torch::tensor({2.0f, 2.5f}).view({1, 2});
  QplexTransform transform = {.weight = torch::tensor({1.0f, 2.0f}).view({1, 2}).requires_grad_(),
                              .bias = torch::tensor({0.5f, -0.5f}).view({1, 2}).requires_grad_()};
  static Tensor lambda(float first, float second) {
    return torch::tensor({first, second}).view({1, 2}).requires_grad_();
  }
};

TEST(QplexValue, MatchesTheKnownAnswers) {
  const QplexExample example;
  const auto mix = [&](const Tensor& lambda, bool is_minus_one) {
    return qplex_value(example.chosen, example.greedy, example.transform, lambda, is_minus_one);
  };
  const MixerOutput first = mix(QplexExample::lambda(0.5f, 2.0f), true);
  expect_values(first.v_tot, {5.0});
  expect_values(first.a_tot, {-0.5});
  expect_values(first.q_tot, {4.5});
  const MixerOutput second = mix(QplexExample::lambda(0.5f, 1.5f), true);
  expect_values(second.a_tot, {0.0});
  expect_values(second.q_tot, {5.0});
  const MixerOutput plain = mix(QplexExample::lambda(0.5f, 1.5f), false);
  expect_values(plain.a_tot, {-2.0});
  expect_values(plain.q_tot, {3.0});
}

TEST(QplexValue, RoutesGradients) {
  const QplexExample example;
  const Tensor lambda = QplexExample::lambda(0.5f, 2.0f);
  const MixerOutput output = qplex_value(example.chosen, example.greedy, example.transform, lambda, true);
  EXPECT_FALSE(gradient(output.a_tot, example.chosen).ne(0).any().item<bool>());
  EXPECT_FALSE(gradient(output.a_tot, example.transform.weight).ne(0).any().item<bool>());
  EXPECT_FALSE(gradient(output.a_tot, example.transform.bias).ne(0).any().item<bool>());
  EXPECT_FALSE(gradient(output.v_tot, lambda).ne(0).any().item<bool>());
  expect_values(gradient(output.v_tot, example.chosen), {1, 2}, 0);
  expect_values(gradient(output.q_tot, example.chosen), {1, 2}, 0);
  expect_values(gradient(output.v_tot, example.transform.weight), {1, 2}, 0);
  expect_values(gradient(output.a_tot, lambda), {-1, -1}, 0);
}

TEST(QplexMixer, OnlyTheAdvantagePartTrainsLambda) {
  at::Generator draws = generator(21);
  for (const char* kind : {"dmaq", "dmaq_qatten"}) {
    MixerOptions options = small(kind);
    options.weighted_head = options.state_bias = true;
    const auto mixer = make_mixer(options, 1, torch::kCPU);
    MixerInput input = random_input(options, 5, draws);
    input.chosen.requires_grad_();
    const MixerOutput output = mixer->mix(input);
    const Tensor w = static_cast<const QplexMixer&>(*mixer).transform(input.state, input.greedy).weight;
    expect_values(gradient(output.v_tot.sum(), input.chosen) - w, std::vector<double>(10, 0.0), 1e-6);
    EXPECT_FALSE(gradient(output.a_tot.sum(), input.chosen).ne(0).any().item<bool>());
    for (const auto& [name, tensor] : mixer->named_parameters()) {
      const bool from_value = gradient(output.v_tot.sum(), tensor).ne(0).any().item<bool>();
      const bool from_advantage = gradient(output.a_tot.sum(), tensor).ne(0).any().item<bool>();
      const bool is_lambda = name.starts_with("lambda_");
      EXPECT_EQ(from_advantage, is_lambda) << kind << " " << name;
      EXPECT_EQ(from_value, !is_lambda) << kind << " " << name;
    }
  }
}

TEST(QplexMixer, InTheBenchmarksSettingsTheValuePartIsThePlainSum) {
  at::Generator draws = generator(22);
  const MixerOptions options = small("dmaq");
  const auto mixer = make_mixer(options, 1, torch::kCPU);
  const MixerInput input = random_input(options, 5, draws);
  EXPECT_TRUE(mixer->mix(input).v_tot.equal(input.chosen.sum(1)));
  EXPECT_FALSE(mixer->mix(input).regularizer.defined());
}

TEST(SiWeights, MatchTheKnownAnswer) {
  const Tensor lambda =
      si_weights(torch::tensor({-1.5f}).view({1, 1}), torch::tensor({0.0f, 1.0f}).view({1, 1, 2}),
                 torch::tensor({2.0f, -1.0f}).view({1, 1, 2}));
  expect_values(lambda, {0.660598, 0.294918});
}

TEST(SiWeights, AreThePlainSumOverKernels) {
  at::Generator draws = generator(23);
  const Tensor key = normal({3, 4}, draws), agents = normal({3, 4, 2}, draws),
               action = normal({3, 4, 2}, draws);
  const Tensor lambda = si_weights(key, agents, action);
  const auto sigmoid = [](double x) { return 1 / (1 + std::exp(-x)); };
  for (int64_t row = 0; row < 3; ++row)
    for (int64_t agent = 0; agent < 2; ++agent) {
      double sum = 0;
      for (int64_t k = 0; k < 4; ++k)
        sum += std::abs(key[row][k].item<double>()) * sigmoid(agents[row][k][agent].item<double>()) *
               sigmoid(action[row][k][agent].item<double>());
      EXPECT_NEAR(lambda[row][agent].item<double>(), sum, 1e-6);
    }
}

/// The kernels' networks are kept side by side; this walks them one by one.
TEST(QplexMixer, LambdaOfSeveralLayersIsThatOfItsSeparateNetworks) {
  at::Generator draws = generator(24);
  for (int64_t layers = 1; layers <= 3; ++layers) {
    MixerOptions options = small("dmaq", 2, 3);
    options.adv_hypernet_layers = layers;
    const auto mixer = make_mixer(options, 9, torch::kCPU);
    const MixerInput input = random_input(options, 4, draws);
    const auto network = [&](const std::string& name, int64_t kernel, Tensor x) {
      for (int64_t layer = 0; layer < layers; ++layer) {
        const std::string prefix = name + "." + std::to_string(layer);
        if (layer > 0) x = x.clamp_min(0);
        x = x.mm(parameter(*mixer, prefix + ".weight")[kernel].t()) +
            parameter(*mixer, prefix + ".bias")[kernel];
      }
      return x;
    };
    Tensor expected = torch::zeros({4, 2});
    for (int64_t kernel = 0; kernel < options.num_kernel; ++kernel)
      expected =
          expected + network("lambda_key", kernel, input.state).abs() *
                         network("lambda_agents", kernel, input.state).sigmoid() *
                         network("lambda_action", kernel, at::cat({input.state, input.action}, 1)).sigmoid();
    const Tensor lambda = static_cast<const QplexMixer&>(*mixer).lambda(input.state, input.action);
    EXPECT_LT((lambda - expected).abs().max().item<double>(), 1e-6) << layers << " layers";
  }
}

TEST(QplexMixer, StartsAsTheFrameworksLayersDo) {
  for (const auto& [name, tensor] :
       make_mixer(benchmark("dmaq_qatten"), 2, torch::kCPU)->named_parameters()) {
    if (!name.ends_with(".weight")) continue;
    const double bound = 1.0 / std::sqrt(static_cast<double>(tensor.size(2)));
    const double largest = tensor.abs().max().item<double>();
    EXPECT_LE(largest, bound * (1 + 1e-6)) << name;
    EXPECT_GT(largest, 0.85 * bound) << name;
  }
}

TEST(Qatten, MatchesTheKnownAnswer) {
  const Tensor selector = torch::tensor({1.0f, 2.0f}).view({1, 1, 2});
  const Tensor key = torch::tensor({0.5f, 0.5f, 1.0f, -1.0f}).view({1, 2, 1, 2});
  const QplexTransform result = qatten_weights(selector, key, {}, 0.001);
  expect_values(result.weight, {0.854180, 0.145820});
  expect_values(result.head_entropy, {0.415390});
  expect_values(result.regularizer, {0.001625});
}

TEST(Qatten, WeightsSumToTheNumberOfHeads) {
  at::Generator draws = generator(25);
  MixerOptions options = small("dmaq_qatten", 3);
  const auto mixer = make_mixer(options, 4, torch::kCPU);
  shake(*mixer, draws, 0.5);
  const MixerInput input = random_input(options, 7, draws);
  const QplexTransform transform =
      static_cast<const QplexMixer&>(*mixer).transform(input.state, input.greedy);
  EXPECT_GT(transform.weight.min().item<double>(), 0);
  expect_values(transform.weight.sum(1), std::vector<double>(7, 4.0), 1e-5);
  EXPECT_FALSE(transform.bias.ne(0).any().item<bool>());
  EXPECT_EQ(transform.regularizer.sizes(), torch::IntArrayRef({7}));
  EXPECT_GT(transform.regularizer.min().item<double>(), 0);
}

TEST(Qatten, AgentsAreWeighedByTheirOwnSliceOfTheState) {
  at::Generator draws = generator(26);
  MixerOptions options = small("dmaq_qatten", 2);
  const auto mixer = make_mixer(options, 4, torch::kCPU);
  // Equal slices draw equal attention, whatever the selectors say; different ones do not.
  const Tensor slice = normal({1, 3}, draws);
  const auto& qplex = static_cast<const QplexMixer&>(*mixer);
  expect_values(qplex.transform(at::cat({slice, slice}, 1), {}).weight, {2, 2}, 1e-5);
  const Tensor weight = qplex.transform(at::cat({slice, normal({1, 3}, draws)}, 1), {}).weight;
  EXPECT_GT((weight - 2).abs().max().item<double>(), 1e-4);
}

TEST(Qatten, OptionsAddHeadWeightsKeysAndABias) {
  at::Generator draws = generator(27);
  MixerOptions options = small("dmaq_qatten", 2);
  const MixerInput input = random_input(options, 4, draws);
  const auto transform = [&](const Mixer& mixer, const Tensor& greedy) {
    return static_cast<const QplexMixer&>(mixer).transform(input.state, greedy);
  };
  options.weighted_head = true;
  const auto weighted = make_mixer(options, 4, torch::kCPU);
  EXPECT_GT((transform(*weighted, input.greedy).weight.sum(1) - 4).abs().min().item<double>(), 1e-3);
  options.weighted_head = false;
  options.nonlinear = true;
  const auto nonlinear = make_mixer(options, 4, torch::kCPU);
  EXPECT_GT((transform(*nonlinear, input.greedy).weight - transform(*nonlinear, input.greedy * 2).weight)
                .abs()
                .max()
                .item<double>(),
            1e-4);
  options.nonlinear = false;
  options.state_bias = true;
  const auto biased = make_mixer(options, 4, torch::kCPU);
  options.state_bias = false;
  const auto plain = make_mixer(options, 4, torch::kCPU);
  const Tensor bias = transform(*biased, input.greedy).bias;
  EXPECT_TRUE(bias.select(1, 0).equal(bias.select(1, 1)));
  EXPECT_LT((biased->mix(input).q_tot - plain->mix(input).q_tot - bias.sum(1)).abs().max().item<double>(),
            1e-5);
  EXPECT_GT(bias.abs().min().item<double>(), 1e-4);
}

}  // namespace mixer_test
}  // namespace comrad::learn
