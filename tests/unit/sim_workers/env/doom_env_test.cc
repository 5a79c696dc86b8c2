#include "sim_workers/env/doom_env.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <vector>

#include "doomgen/acs/compiler.h"
#include "scenarios/spec/global_state.h"
#include "sim_workers/engine/acs/behavior.h"
#include "tests/support/level_builder.h"

namespace comrad::sim {
namespace doom_env_test {

/// Paints every view with the world's clock, the player added, and counts its calls.
class FlatRenderer final : public doom::Renderer {
 public:
  explicit FlatRenderer(int bytes) : bytes_(bytes) {}
  Status prepare(std::shared_ptr<const doom::Level>, std::shared_ptr<const doom::ActorCatalog>) override {
    return {};
  }
  void draw(std::span<const doom::ViewRequest> views) override {
    ++call_count;
    for (const doom::ViewRequest& view : views)
      std::fill_n(view.destination, bytes_,
                  static_cast<uint8_t>(view.world->tic_count() + 100 * view.player));
  }
  int undrawn_pixels() override { return 0; }
  unsigned driver_error() override { return 0; }
  int draw_depth(const doom::World&, int, std::vector<float>*) override { return 0; }
  int draw_labels(const doom::World&, int, std::vector<uint8_t>*, std::vector<doom::ThingLabel>*) override {
    return 0;
  }
  void mark_seen_lines(const doom::World&, int, std::vector<uint8_t>*) override {}
  int call_count = 0;

 private:
  int bytes_;
};

scenarios::RewardTerm term(const std::string& variable, const std::string& kind, double weight,
                           const std::string& scope = "own") {
  scenarios::RewardTerm result;
  result.name = variable;
  result.variable = variable;
  result.kind = kind;
  result.weight = weight;
  result.scope = scope;
  return result;
}

std::shared_ptr<DoomGame> one_room_game() {
  auto game = std::make_shared<DoomGame>();
  game->spec.heads = {{{"MOVE_FORWARD", "MOVE_BACKWARD"}}, {{"TURN_LEFT", "TURN_RIGHT"}}};
  game->spec.decision_limit = 2100;
  game->spec.score = "survival_tics";
  game->spec.rewards = {term("USER1", "delta", 1.0, "team")};
  game->level = doom::test::one_room();
  game->catalog = std::make_shared<doom::ActorCatalog>();
  game->actions = *ActionMap::create(game->spec.heads);
  return game;
}

/// The same room with scripts that count tics in USER1, end the map at `exit_tic` and kill player 0 at `death_tic`; 0: never.
std::shared_ptr<DoomGame> clock_game(int exit_tic = 0, int death_tic = 0) {
  const std::string source =
      "#include \"zcommon.acs\"\nglobal int 1:clock;\n"
      "script 1 OPEN { while (TRUE) { clock++; if (clock == " +
      std::to_string(exit_tic) +
      ") Exit_Normal(0); Delay(1); } }\n"
      "script 2 ENTER { if (PlayerNumber() == 0 && " +
      std::to_string(death_tic) + " > 0) { Delay(" + std::to_string(death_tic - 1) +
      "); DamageThing(1000); } }\n";
  const auto compiled = acs_compiler::compile(source, "clock.acs");
  EXPECT_TRUE(compiled) << (compiled ? "" : compiled.error().message);
  auto behavior = doom::acs::Behavior::load(compiled->behavior, "clock.acs");
  EXPECT_TRUE(behavior) << (behavior ? "" : behavior.error().message);
  auto game = one_room_game();
  game->behavior = *behavior;
  return game;
}

const std::vector<int32_t> kIdle = {0, 0, 0, 0};

TEST(DoomEnvironment, AWorldThatPaysOnePerTicPaysFourPerDecision) {
  DoomEnvironment env(clock_game());
  env.reset(1);
  for (int i = 0; i < 5; ++i) {
    env.step(kIdle);
    EXPECT_EQ(env.last_step().reward, (std::vector<float>{4, 4})) << "the first decision as well";
    EXPECT_EQ(env.world().tic_count(), 4u * (i + 1));
  }
}

TEST(DoomEnvironment, FrameSkipIsHowLongADecisionLasts) {
  const auto game = clock_game();
  game->frame_skip = 1;
  DoomEnvironment env(game);
  env.reset(1);
  env.step(kIdle);
  EXPECT_EQ(env.world().tic_count(), 1u);
  EXPECT_EQ(env.last_step().reward[0], 1);
}

TEST(DoomEnvironment, ButtonsAreHeldForAllTicsOfADecision) {
  DoomEnvironment env(one_room_game());
  env.reset(1);
  for (int i = 0; i < 2; ++i) env.step(kIdle);  // a newly spawned monster stands still for eight tics
  const doom::Angle before = env.world().body(0).angle;
  env.step(std::vector<int32_t>{0, 1, 0, 0});
  EXPECT_NEAR(static_cast<double>(env.world().body(0).angle - before) / 4294967296.0 * 360.0, 4 * 1.7578125,
              1e-6);
  EXPECT_EQ(env.world().body(1).angle, doom::kAngle180) << "the other agent pressed nothing";
}

TEST(DoomEnvironment, TheMapsExitTerminatesInTheMiddleOfADecision) {
  DoomEnvironment env(clock_game(6));
  env.reset(1);
  env.step(kIdle);
  EXPECT_FALSE(env.last_step().episode_over());
  env.step(kIdle);
  EXPECT_TRUE(env.last_step().terminated);
  EXPECT_FALSE(env.last_step().truncated);
  EXPECT_EQ(env.last_step().reward[0], 2) << "what the last tics brought is paid";
  EXPECT_EQ(env.summary().length_steps, 2u);
  EXPECT_EQ(env.summary().length_tics, 6u);
  EXPECT_EQ(env.summary().score, 6.0f);
  EXPECT_EQ(std::vector(env.summary().returns().begin(), env.summary().returns().end()),
            (std::vector<float>{6, 6}));
}

TEST(DoomEnvironment, TheDecisionLimitTruncates) {
  const auto game = one_room_game();
  game->spec.decision_limit = 10;
  DoomEnvironment env(game);
  env.reset(1);
  for (int i = 0; i < 9; ++i) {
    env.step(kIdle);
    ASSERT_FALSE(env.last_step().episode_over());
  }
  env.step(kIdle);
  EXPECT_TRUE(env.last_step().truncated);
  EXPECT_FALSE(env.last_step().terminated);
  EXPECT_EQ(env.summary().length_steps, 10u);
  EXPECT_EQ(env.summary().score, 40.0f);
}

TEST(DoomEnvironment, LimitsAreTicsWhateverTheFrameSkip) {
  const auto game = one_room_game();
  game->spec.decision_limit = 10;
  game->frame_skip = 3;
  DoomEnvironment env(game);
  env.reset(1);
  int step_count = 0;
  while (!env.last_step().episode_over()) env.step(kIdle), ++step_count;
  EXPECT_EQ(step_count, 14);
  EXPECT_EQ(env.summary().length_tics, 40u);
}

TEST(DoomEnvironment, TheEnginesTenMinutesTruncateToo) {
  const auto game = one_room_game();
  game->spec.decision_limit = 100'000;
  game->frame_skip = 100;
  DoomEnvironment env(game);
  env.reset(1);
  while (!env.last_step().episode_over()) env.step(kIdle);
  EXPECT_TRUE(env.last_step().truncated);
  EXPECT_EQ(env.summary().length_tics, 21'000u);
}

TEST(DoomEnvironment, AnExitAtTheLimitTerminates) {
  const auto game = clock_game(40);
  game->spec.decision_limit = 10;
  DoomEnvironment env(game);
  env.reset(1);
  while (!env.last_step().episode_over()) env.step(kIdle);
  EXPECT_TRUE(env.last_step().terminated);
  EXPECT_FALSE(env.last_step().truncated);
}

TEST(DoomEnvironment, OwnTermsReachTheirAgentAndTeamTermsSumAgents) {
  const auto game = clock_game(0, 2);
  game->spec.rewards = {term("HEALTH", "fall", -0.01), term("DEAD", "event", -3.0),
                        term("DEAD", "event", 0.5, "team")};
  DoomEnvironment env(game);
  env.reset(1);
  env.step(kIdle);
  EXPECT_FLOAT_EQ(env.last_step().reward[0], -1.0f - 3.0f + 0.5f)
      << "100 health lost, own death, a death in the team";
  EXPECT_FLOAT_EQ(env.last_step().reward[1], 0.5f);
}

TEST(DoomEnvironment, TheScoreMayBeTheReturnOrAVariable) {
  const auto game = clock_game();
  game->spec.decision_limit = 3;
  game->spec.score = "return";
  DoomEnvironment by_return(game);
  by_return.reset(1);
  while (!by_return.last_step().episode_over()) by_return.step(kIdle);
  EXPECT_EQ(by_return.summary().score, 12.0f);

  game->spec.score = "USER1";
  DoomEnvironment by_variable(game);
  by_variable.reset(1);
  while (!by_variable.last_step().episode_over()) by_variable.step(kIdle);
  EXPECT_EQ(by_variable.summary().score, 12.0f);
}

TEST(DoomEnvironment, SameSeedAndActionsGiveTheSameStates) {
  const auto play = [](uint64_t seed, uint64_t action_seed) {
    DoomEnvironment env(clock_game());
    env.reset(seed);
    Rng rng(action_seed);
    std::vector<uint64_t> hashes;
    for (int i = 0; i < 50; ++i) {
      std::vector<int32_t> action(4);
      for (int32_t& choice : action) choice = static_cast<int32_t>(rng.below(3));
      env.step(action);
      hashes.push_back(env.state_hash());
    }
    return hashes;
  };
  EXPECT_EQ(play(1, 2), play(1, 2));
  EXPECT_NE(play(1, 2), play(2, 2));
  EXPECT_NE(play(1, 2), play(1, 3));
}

TEST(DoomEnvironment, AResetLeavesNothingOfTheEpisodeBefore) {
  DoomEnvironment used(clock_game());
  DoomEnvironment fresh(clock_game());
  used.reset(5);
  for (int i = 0; i < 20; ++i) used.step(std::vector<int32_t>{1, 1, 2, 2});
  used.reset(9);
  fresh.reset(9);
  EXPECT_EQ(used.state_hash(), fresh.state_hash());
  used.step(kIdle);
  fresh.step(kIdle);
  EXPECT_EQ(used.state_hash(), fresh.state_hash());
  EXPECT_EQ(used.last_step().reward, fresh.last_step().reward);
}

TEST(DoomEnvironment, MeasurementsAreScaledShiftedAndClipped) {
  const auto game = clock_game();
  game->use_measurements = true;
  scenarios::MeasurementTerm health, x;
  health.variable = "HEALTH", health.scale = 0.1, health.offset = -1.0, health.clip = 5.0;
  x.variable = "POSITION_X", x.scale = 1.0, x.clip = 100.0;
  game->spec.measurements = {health, x};
  DoomEnvironment env(game);
  env.reset(1);
  std::vector<float> measurement(4);
  ObservationTarget target;
  target.measurement = measurement.data();
  env.observe_numbers(target);
  EXPECT_EQ(measurement, (std::vector<float>{5, -100, 5, 100}));
}

TEST(DoomEnvironment, TheGlobalStateHoldsAllAgentsAndWhatScriptsExport) {
  const auto game = clock_game();
  game->spec.exports = {{.name = "clock", .user = 1, .meaning = ""}, {.name = "", .user = 7, .meaning = ""}};
  EXPECT_EQ(DoomEnvironment(game).shape().global_state_count, 0) << "not requested";
  game->use_global_state = true;
  DoomEnvironment env(game);
  const std::vector<std::string> names = scenarios::global_state_names(game->spec, 2);
  ASSERT_EQ(env.shape().global_state_count, static_cast<int32_t>(names.size()));
  env.reset(1);
  for (int step = 0; step < 3; ++step) env.step(kIdle);
  std::vector<float> state(names.size(), -1e9f);
  env.observe_numbers({.global_state = state.data()});
  const auto at = [&](const std::string& name) {
    return state[static_cast<std::size_t>(std::ranges::find(names, name) - names.begin())];
  };
  for (int agent = 0; agent < 2; ++agent) {
    const std::string who = "agent_" + std::to_string(agent) + "/";
    const auto* body = env.world().body_of(agent);
    EXPECT_EQ(at(who + "x"), static_cast<float>(doom::to_double(body->x)));
    EXPECT_EQ(at(who + "y"), static_cast<float>(doom::to_double(body->y)));
    EXPECT_NEAR(std::hypot(at(who + "cos_angle"), at(who + "sin_angle")), 1, 1e-5);
    EXPECT_EQ(at(who + "health"), 100);
    EXPECT_EQ(at(who + "alive"), 1);
  }
  EXPECT_EQ(at("clock"), static_cast<float>(env.world().exported(1)));
  EXPECT_GT(at("clock"), 0);
  EXPECT_EQ(at("USER7"), 0);
}

TEST(DoomEnvironment, AStrideGivesEveryAgentASeparateGlobal) {
  const auto game = clock_game();
  game->spec.rewards[0].scope = "own";
  game->spec.rewards[0].agent_stride =
      1;  // agent 0 reads USER1, which counts tics; agent 1 USER2, which stands still
  DoomEnvironment env(game);
  env.reset(1);
  env.step(kIdle);
  EXPECT_EQ(env.last_step().reward, (std::vector<float>{4, 0}));
}

TEST(DoomEnvironment, AGatedTermPaysAtTheEndItWaitsForAlone) {
  const auto gated_game = [](int exit_tic) {
    auto game = clock_game(exit_tic);
    game->spec.decision_limit = 2;
    game->spec.rewards = {term("ONE", "value", 2.0), term("ONE", "value", -1.0), term("ONE", "value", 0.25)};
    game->spec.rewards[0].when = "TRUNCATED";
    game->spec.rewards[1].when = "TERMINATED";
    game->spec.rewards[2].unless = "TRUNCATED";
    return game;
  };
  const auto rewards_of = [&](int exit_tic) {
    const auto game = gated_game(exit_tic);
    DoomEnvironment env(game);
    std::vector<float> rewards;
    for (int episode = 0; episode < 2; ++episode) {  // the second one must not see the first one's end
      rewards.clear();
      env.reset(episode);
      while (!env.last_step().episode_over()) {
        env.step(kIdle);
        rewards.push_back(env.last_step().reward[1]);
      }
    }
    return rewards;
  };
  EXPECT_EQ(rewards_of(0), (std::vector<float>{0.25f, 2.0f}));
  EXPECT_EQ(rewards_of(6), (std::vector<float>{0.25f, -0.75f}));
}

TEST(DoomEnvironment, MasksTakeChoicesFromOneAgent) {
  const auto game = one_room_game();
  game->spec.masks = {{.agent = 1, .head = 1, .allowed = {"none", "TURN_RIGHT"}}};
  DoomEnvironment env(game);
  env.reset(1);
  std::vector<uint8_t> mask(12, 7);
  ObservationTarget target;
  target.action_mask = mask.data();
  env.observe_numbers(target);
  EXPECT_EQ(mask, (std::vector<uint8_t>{1, 1, 1, 1, 1, 1, 1, 1, 1, 1, 0, 1}));
}

TEST(DoomEnvironment, AScoreMayBeAShareOfAnotherVariable) {
  const auto game = clock_game();
  game->spec.decision_limit = 2;
  game->spec.score = "USER1";
  game->spec.score_scale = 0.5;
  game->spec.score_divisor = "USER1";
  DoomEnvironment env(game);
  env.reset(1);
  env.step(kIdle);
  env.step(kIdle);
  EXPECT_EQ(env.summary().score, 0.5f);
  game->spec.score_divisor = "USER2";  // 0: nothing to divide by
  DoomEnvironment plain(game);
  plain.reset(1);
  plain.step(kIdle);
  plain.step(kIdle);
  EXPECT_EQ(plain.summary().score, 4.0f);
}

/// Room for one observation of two agents.
struct Picture {
  explicit Picture(const EnvShape& shape)
      : frame(shape.frame_bytes() * shape.num_agents),
        mask(shape.logit_count() * shape.num_agents),
        active(2, 9) {}
  ObservationTarget target() { return {frame.data(), nullptr, mask.data(), active.data()}; }
  std::vector<uint8_t> frame, mask, active;
};

TEST(DoomEnvironmentSet, DrawsAllViewsInOneCall) {
  const auto game = one_room_game();
  auto renderer = std::make_unique<FlatRenderer>(3 * 72 * 128);
  FlatRenderer* const counter = renderer.get();
  DoomEnvironmentSet set(game, std::move(renderer), 3, kObservationSize, Resize::kNone);
  for (int i = 0; i < 3; ++i) {
    set.at(i).reset(1);
    for (int step = 0; step < i; ++step) set.at(i).step(kIdle);
  }
  Picture first(set.at(0).shape()), second(set.at(0).shape());
  const std::vector<int> indices = {2, 1};
  const std::vector<ObservationTarget> targets = {first.target(), second.target()};
  set.observe(indices, targets);
  EXPECT_EQ(counter->call_count, 1);
  const int64_t frame_bytes = 3 * 72 * 128;
  EXPECT_EQ(first.frame[0], 8);
  EXPECT_EQ(first.frame[frame_bytes - 1], 8);
  EXPECT_EQ(first.frame[frame_bytes], 108);
  EXPECT_EQ(second.frame[0], 4);
  EXPECT_EQ(second.frame[2 * frame_bytes - 1], 104);
  EXPECT_EQ(first.mask, std::vector<uint8_t>(first.mask.size(), 1));
  EXPECT_EQ(first.active, (std::vector<uint8_t>{1, 1}));
}

TEST(DoomEnvironmentSet, AFilterBringsOtherSizesTo128x72) {
  const auto game = one_room_game();
  DoomEnvironmentSet set(game, std::make_unique<FlatRenderer>(3 * 160 * 120), 1, {160, 120},
                         Resize::kNearest);
  set.at(0).reset(1);
  set.at(0).step(kIdle);
  Picture picture(set.at(0).shape());
  const int index = 0;
  const ObservationTarget target = picture.target();
  set.observe(std::span(&index, 1), std::span(&target, 1));
  for (int i = 0; i < 3 * 72 * 128; ++i) ASSERT_EQ(picture.frame[i], 4);
  for (int i = 0; i < 3 * 72 * 128; ++i) ASSERT_EQ(picture.frame[3 * 72 * 128 + i], 104);
}

TEST(DoomEnvironmentSet, TheLastObservationOfAnEpisodeIsTheTrueOne) {
  DoomEnvironment env(clock_game(7, 6));
  env.reset(1);
  env.step(kIdle);
  env.step(kIdle);
  ASSERT_TRUE(env.last_step().terminated);
  EXPECT_EQ(env.world().tic_count(), 7u) << "the world stands where it ended until the reset";
  std::vector<uint8_t> active(2, 9);
  ObservationTarget target;
  target.agent_active = active.data();
  env.observe_numbers(target);
  EXPECT_EQ(active, (std::vector<uint8_t>{0, 1})) << "the dead agent is inactive";
}

}  // namespace doom_env_test
}  // namespace comrad::sim
