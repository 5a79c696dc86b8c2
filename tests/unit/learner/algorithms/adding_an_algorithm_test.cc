// "Adding things" of the README, done for an algorithm: a row for the settings, a learner for the registry, a game that it learns; a loss
// term and a metric of a line each.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "learner/algorithms/ippo.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/recipes.h"
#include "rollout_buffer/settings/resolve.h"
#include "rollout_buffer/settings/setting.h"
#include "tests/support/matrix_game.h"

namespace comrad::learn {
namespace adding_an_algorithm_test {

constexpr AlgorithmRow kRow{
    .name = "hopeful_ippo", .other_names = {"hope"}, .can_follow_kl = true, .recipe_of = "ippo"};

/// IPPO that adds one to every reward before it learns.
class HopefulIppo final : public Ippo {
 public:
  using Ippo::Ippo;
  Expected<UpdateStats> update(RolloutBatch& batch, const UpdateContext& context) override {
    batch.reward.add_(1.0);
    return Ippo::update(batch, context);
  }
};

std::unique_ptr<Algorithm> make(const RunConfig& config, const EnvShape& env, torch::Device device) {
  return std::make_unique<HopefulIppo>(config, env, device);
}

class AddingAnAlgorithm : public ::testing::Test {
 protected:
  static void SetUpTestSuite() {
    add_algorithm(kRow);
    add_learner("hopeful_ippo", make);
  }
};

TEST_F(AddingAnAlgorithm, ItsSettingsAreMergedAndItsLearnerIsMade) {
  RunConfig config;
  config.environment.num_agents = 2;
  ASSERT_TRUE(apply_layer(config, {"command line", {{"algo", "HOPE"}}}));
  ASSERT_TRUE(apply_layer(config, algorithm_defaults(config.run.algo)));
  ASSERT_TRUE(apply_layer(config, preset_settings(Preset::kSmall, config.run.algo)));
  ASSERT_TRUE(resolve_settings(config, 2));
  EXPECT_EQ(config.optimisation.batch_size, 1024) << "a row of small for every on-policy algorithm";
  EnvShape env;
  env.head_count = 1;
  env.head_sizes = {3};
  const auto made = make_algorithm(config, env, torch::kCPU);
  ASSERT_TRUE(made) << made.error().message;
  EXPECT_NE(dynamic_cast<HopefulIppo*>(made->get()), nullptr);
  StateDict state;
  (*made)->save(state);
  EXPECT_TRUE((*made)->load(state)) << "its name is in its checkpoints";
}

TEST_F(AddingAnAlgorithm, ItsNameIsInTheHelpOfAlgo) {
  const SettingRow* const row = find_setting("algo");
  EXPECT_THAT(row->words(), ::testing::Contains("hopeful_ippo"));
  for (const std::string& name : algorithm_names())
    EXPECT_EQ(row->help.find(name), std::string_view::npos)
        << "the words are the table's; typed by hand they would lack the new one";
}

TEST_F(AddingAnAlgorithm, ItLearnsTheBestCellOfAGame) {
  const RunConfig config = test::matrix_game_config("hopeful_ippo", 1);
  test::MatrixGame<HopefulIppo> game(config, {{0, 0, 0}, {0, 0, 0}, {0, 0, 10}}, 32);
  game.bias_to(2, 0.5);
  for (int update = 0; update < 60; ++update) ASSERT_TRUE(game.update());
  EXPECT_GT(game.policy()[0][2].item<double>(), 0.9);
}

TEST_F(AddingAnAlgorithm, ARowWithoutALearnerIsRefused) {
  static constexpr AlgorithmRow kOnlyARow{.name = "only_a_row"};
  add_algorithm(kOnlyARow);
  RunConfig config;
  config.run.algo = "only_a_row";
  const auto made = make_algorithm(config, EnvShape{}, torch::kCPU);
  ASSERT_FALSE(made);
  EXPECT_NE(made.error().message.find("only_a_row"), std::string::npos);
}

/// IPPO that keeps logits small.
class CalmIppo final : public Ippo {
 public:
  CalmIppo(const RunConfig& config, const EnvShape& env, torch::Device device, double coeff = 1)
      : Ippo(config, env, device), coeff_(coeff) {}

 protected:
  LossTerms loss(const policy::SequenceOutput& output, const RolloutBatch& rows,
                 const PpoScalars& scalars) const override {
    LossTerms terms = Ippo::loss(output, rows, scalars);
    const Tensor weight = rows.acting().to(torch::kFloat32) / scalars.acting_count,
                 square = output.logits.square().sum(-1);
    terms.add("logit_penalty", coeff_ * (square * weight).sum());
    terms.mean("logit_square", square.detach(), weight);
    return terms;
  }

 private:
  double coeff_;
};

TEST(AddingALossTerm, OneLineIsLearnedAndAnotherReported) {
  const RunConfig config = test::matrix_game_config("ippo", 1);
  test::MatrixGame<CalmIppo> game(config, {{0, 0, 0}, {0, 0, 0}, {0, 0, 0}}, 32);
  game.bias_to(2, 0.9);
  const auto number = [&game](const std::string& name) {
    for (const auto& [key, value] : game.stats().values)
      if (key == name) return value;
    ADD_FAILURE() << name << " is not reported";
    return 0.0;
  };
  ASSERT_TRUE(game.update());
  const double before = number("train/logit_square");
  EXPECT_GT(before, 1);
  EXPECT_NEAR(number("train/logit_penalty"), before, 1e-4 * before) << "its coefficient is 1";
  for (int update = 0; update < 40; ++update) ASSERT_TRUE(game.update());
  EXPECT_LT(number("train/logit_square"), 0.5 * before);
}

}  // namespace adding_an_algorithm_test
}  // namespace comrad::learn
