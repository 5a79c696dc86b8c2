#include "learner/curriculum/curriculum.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numeric>

#include "tests/support/documented_metrics.h"

namespace comrad::learn {
namespace curriculum_test {

using testing::DoubleNear;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::IsEmpty;

std::vector<std::string> names(int count) {
  std::vector<std::string> result;
  for (int i = 0; i < count; ++i) result.push_back("task_" + std::to_string(i));
  return result;
}

std::unique_ptr<Curriculum> made(const CurriculumOptions& options, int count) {
  auto curriculum = Curriculum::create(options, names(count));
  EXPECT_TRUE(curriculum) << curriculum.error().message;
  return std::move(*curriculum);
}

void expect_distribution(const std::vector<double>& weights) {
  for (const double w : weights) EXPECT_GE(w, 0.0);
  EXPECT_NEAR(std::accumulate(weights.begin(), weights.end(), 0.0), 1.0, 1e-12);
}

constexpr CurriculumKind kAllKinds[] = {CurriculumKind::kUniform, CurriculumKind::kSequential,
                                        CurriculumKind::kLearningProgress, CurriculumKind::kOmni,
                                        CurriculumKind::kPlr};

TEST(Curriculum, WeightsSumToOneWhateverHappens) {
  for (const CurriculumKind kind : kAllKinds) {
    SCOPED_TRACE(word_of(kind));
    auto curriculum = made({.kind = kind, .seed = 3}, 5);
    for (int i = 0; i < 200; ++i) {
      const int task = curriculum->draw();
      ASSERT_TRUE(task >= 0 && task < 5);
      curriculum->update(task, (i * 7 % 11) / 10.0);
      if (i % 3 == 0) curriculum->score(task, 32, (i % 5) - 1.0, 2.0);
      expect_distribution(curriculum->weights());
    }
    EXPECT_EQ(
        std::accumulate(curriculum->episode_counts().begin(), curriculum->episode_counts().end(), int64_t{0}),
        200);
  }
}

TEST(Curriculum, UniformDrawsEveryTaskEquallyOften) {
  auto curriculum = made({.kind = CurriculumKind::kUniform, .seed = 9}, 4);
  std::vector<int> drawn(4);
  for (int i = 0; i < 4000; ++i) ++drawn[curriculum->draw()];
  for (const int count : drawn) EXPECT_NEAR(count, 1000, 120);
}

TEST(Curriculum, SequentialAdvancesWhenTheMeanReachesTheThresholdAndNeverBack) {
  auto curriculum = made({.kind = CurriculumKind::kSequential,
                          .threshold = 0.5,
                          .max_return = 10.0,
                          .window = 4,
                          .min_outcomes = 2},
                         3);
  EXPECT_EQ(curriculum->draw(), 0);
  curriculum->update(0, 9.0);  // one lucky episode does not suffice
  EXPECT_EQ(curriculum->draw(), 0);
  curriculum->update(1, 10.0);  // of another task: does not count
  curriculum->update(0, 0.0);   // mean 4.5: below 0.5 * 10
  EXPECT_EQ(curriculum->draw(), 0);
  curriculum->update(0, 6.0);  // mean 5.0: reached
  EXPECT_EQ(curriculum->draw(), 1);
  for (int i = 0; i < 10; ++i) curriculum->update(1, 0.0);
  EXPECT_EQ(curriculum->draw(), 1);
  for (int i = 0; i < 4; ++i) curriculum->update(1, 10.0);  // the window forgets the zeros
  EXPECT_EQ(curriculum->draw(), 2);
  for (int i = 0; i < 10; ++i) curriculum->update(2, 10.0);
  EXPECT_EQ(curriculum->draw(), 2);
}

TEST(Curriculum, ATaskWithASeparateScaleIsMeasuredAgainstIt) {
  auto sequential = made({.kind = CurriculumKind::kSequential,
                          .threshold = 0.5,
                          .max_return = 100.0,
                          .window = 4,
                          .min_outcomes = 1,
                          .task_scale = {10.0, 0.0}},
                         3);
  sequential->update(0, 4.9);
  EXPECT_EQ(sequential->draw(), 0);
  sequential->update(0, 5.5);  // mean 5.2 of 10
  EXPECT_EQ(sequential->draw(), 1);
  sequential->update(1, 49.0);  // without a scale: of 100
  EXPECT_EQ(sequential->draw(), 1);
  // Fractions, not points, decide which task OMNI takes for mastered: 9 of 10 beats 20 of 100.
  CurriculumOptions options{.kind = CurriculumKind::kOmni, .max_return = 100.0, .task_scale = {10.0, 100.0}};
  options.uninteresting["task_0"] = {"task_1"};
  options.uninteresting["task_1"] = {"task_0"};
  auto omni = made(options, 2);
  omni->update(0, 9.0), omni->update(1, 20.0);
  EXPECT_LT(omni->weights()[1], 0.01);
}

TEST(LearningProgress, ReweightingIsThatOfTheFormula) {
  EXPECT_DOUBLE_EQ(learning_progress_reweight(0.5, 0.1), 0.5 * 0.9 / 0.5);
  EXPECT_DOUBLE_EQ(learning_progress_reweight(0.1, 0.1), 0.09 / (0.1 + 0.1 * 0.8));
  EXPECT_DOUBLE_EQ(learning_progress_reweight(1.0, 0.1), 1.0);
  EXPECT_DOUBLE_EQ(learning_progress_reweight(0.0, 0.0), 0.0);  // not 0 / 0
}

TEST(LearningProgress, IsUniformUntilEveryTaskWasSeen) {
  auto curriculum = made({.kind = CurriculumKind::kLearningProgress}, 3);
  curriculum->update(0, 0.2), curriculum->update(0, 0.9), curriculum->update(1, 0.5);
  for (const double w : curriculum->weights()) EXPECT_DOUBLE_EQ(w, 1.0 / 3);
}

TEST(LearningProgress, MatchesACalculationByHand) {
  auto curriculum = made({.kind = CurriculumKind::kLearningProgress}, 2);
  curriculum->update(0, 0.0), curriculum->update(0, 1.0);  // fast 0.1, slow 0.1 * 0.1 + 0 = 0.01
  curriculum->update(1, 0.5);                              // no change: no progress
  // g(0.1) = 0.09 / 0.18 = 0.5, g(0.01) = 0.009 / 0.108 = 1/12; L = (5/12, 0); z = (1, -1).
  const double up = 1.0 / (1.0 + std::exp(-1.0)), down = 1.0 / (1.0 + std::exp(1.0));
  const double expected = 0.75 * up / (up + down) + 0.25 / 2;
  EXPECT_THAT(curriculum->weights(),
              ElementsAre(DoubleNear(expected, 1e-12), DoubleNear(1.0 - expected, 1e-12)));
}

TEST(LearningProgress, ATaskWithoutSuccessAndProgressKeepsItsUniformShareAlone) {
  auto curriculum = made({.kind = CurriculumKind::kLearningProgress}, 3);
  curriculum->update(0, 0.0), curriculum->update(1, 0.5), curriculum->update(2, 0.9);
  EXPECT_NEAR(curriculum->weights()[0], 0.25 / 3, 1e-12);
}

TEST(Omni, WithAnAllInterestingGraphItIsLearningProgress) {
  auto omni = made({.kind = CurriculumKind::kOmni}, 4),
       plain = made({.kind = CurriculumKind::kLearningProgress}, 4);
  for (int i = 0; i < 40; ++i) {
    omni->update(i % 4, (i % 7) / 7.0);
    plain->update(i % 4, (i % 7) / 7.0);
  }
  EXPECT_EQ(omni->weights(), plain->weights());
}

TEST(Omni, AMasteredTaskMakesEarlierOnesBoring) {
  CurriculumOptions options{.kind = CurriculumKind::kOmni};
  options.uninteresting["task_1"] = {"task_0", "task_1"};
  auto omni = made(options, 3);
  auto plain = made({.kind = CurriculumKind::kLearningProgress}, 3);
  for (Curriculum* c : {omni.get(), plain.get()}) c->update(0, 0.3), c->update(1, 0.9), c->update(2, 0.1);
  const std::vector<double> base = plain->weights();
  const double sum = base[0] * 0.001 + base[1] + base[2];
  EXPECT_THAT(omni->weights(),
              ElementsAre(DoubleNear(base[0] * 0.001 / sum, 1e-12), DoubleNear(base[1] / sum, 1e-12),
                          DoubleNear(base[2] / sum, 1e-12)));
  options.omni_mastery = 0.95;  // task_1 is not mastered: nothing is boring yet
  auto strict = made(options, 3);
  strict->update(0, 0.3), strict->update(1, 0.9), strict->update(2, 0.1);
  EXPECT_EQ(strict->weights(), base);
}

TEST(Plr, TransformsMatchTheTable) {
  const std::vector<double> value{1.0, 3.0, 2.0, 9.0}, seen{1.0, 1.0, 1.0, 0.0};
  // Ranks count all tasks: the unseen one has rank 1 and no weight.
  auto w = plr_weights(value, seen, PlrTransform::kRank, 1.0, 0.05, 0.1, 0);
  const double rank_sum = 1.0 / 2 + 1.0 / 3 + 1.0 / 4;
  EXPECT_THAT(w, ElementsAre(DoubleNear(0.25 / rank_sum, 1e-12), DoubleNear(0.5 / rank_sum, 1e-12),
                             DoubleNear(1.0 / 3 / rank_sum, 1e-12), 0.0));
  w = plr_weights(value, seen, PlrTransform::kPower, 0.5, 0.05, 0.1, 0);
  EXPECT_THAT(w, ElementsAre(DoubleNear(1.0 / 14, 1e-12), DoubleNear(9.0 / 14, 1e-12),
                             DoubleNear(4.0 / 14, 1e-12), 0.0));
  w = plr_weights(value, seen, PlrTransform::kSoftmax, 1.0, 0.05, 0.1, 0);
  EXPECT_NEAR(w[1] / w[0], std::exp(2.0), 1e-9);
  w = plr_weights({{1e9, 2e9}}, {{1.0, 1.0}}, PlrTransform::kSoftmax, 1.0, 0.05, 0.1, 0);
  EXPECT_THAT(w, ElementsAre(0.0, 1.0)) << "no overflow";
  w = plr_weights(value, seen, PlrTransform::kMax, 1.0, 0.05, 0.1, 0);
  EXPECT_THAT(w, ElementsAre(0.0, 1.0, 0.0, 0.0)) << "the maximum among seen tasks";
  w = plr_weights(value, seen, PlrTransform::kEpsGreedy, 1.0, 0.2, 0.1, 0);
  EXPECT_NEAR(w[1], 0.85 / 0.95, 1e-12);
  w = plr_weights(value, seen, PlrTransform::kConstant, 1.0, 0.05, 0.1, 0);
  EXPECT_THAT(w, ElementsAre(DoubleNear(1.0 / 3, 1e-12), DoubleNear(1.0 / 3, 1e-12),
                             DoubleNear(1.0 / 3, 1e-12), 0.0));
  w = plr_weights({{0.0, 0.0, 5.0}}, {{1.0, 1.0, 0.0}}, PlrTransform::kPower, 1.0, 0.05, 0.1, 0);
  EXPECT_THAT(w, ElementsAre(0.5, 0.5, 0.0)) << "all zero: uniform over seen tasks";
}

TEST(Plr, NoTaskIsReplayedBeforeAllWereScored) {
  auto plr = made({.kind = CurriculumKind::kPlr, .seed = 1}, 6);
  std::vector<bool> scored(6);
  for (int i = 0; i < 6; ++i) {
    const int task = plr->draw();
    EXPECT_FALSE(scored[task]) << "rho 1: unseen tasks first";
    scored[task] = true;
    plr->score(task, 100, 0.1 * task, 0.0);
  }
  std::vector<int> drawn(6);
  for (int i = 0; i < 300; ++i) ++drawn[plr->draw()];
  EXPECT_GT(drawn[5], 200) << "temperature 0.1: the best-scored task takes almost all, staleness the rest";
  EXPECT_GT(*std::min_element(drawn.begin(), drawn.end()), 0);
}

TEST(Plr, ANewTaskIsDrawnUntilItIsScored) {
  auto plr = made({.kind = CurriculumKind::kPlr, .seed = 4, .rho = 0.5}, 2);
  plr->score(0, 10, 1.0, 1.0);
  // v = 0.5 >= rho: replay with probability min(0.5, 0.5); else the unseen one. Drawing does not make
  // it seen.
  int unseen = 0;
  for (int i = 0; i < 1000; ++i) unseen += plr->draw();
  EXPECT_NEAR(unseen, 500, 60);
}

TEST(Plr, ScoresMixMeanAndMaximumAndForget) {
  auto plr = made({.kind = CurriculumKind::kPlr,
                   .max_score_coef = 0.25,
                   .alpha = 0.5,
                   .temperature = 1.0,
                   .transform = PlrTransform::kPower,
                   .staleness_coef = 0.0},
                  2);
  plr->score(0, 1, 4.0, 8.0);    // 0.5 * (0.25 * 8 + 0.75 * 4) = 2.5
  plr->score(1, 1, 10.0, 10.0);  // 5
  plr->score(1, 1, 0.0, 0.0);    // 2.5
  EXPECT_THAT(plr->weights(), ElementsAre(DoubleNear(0.5, 1e-9), DoubleNear(0.5, 1e-9)));
}

TEST(Curriculum, AResumedOneDrawsTheSame) {
  for (const CurriculumKind kind : kAllKinds) {
    SCOPED_TRACE(word_of(kind));
    const CurriculumOptions options{.kind = kind, .seed = 12};
    auto first = made(options, 7);
    const auto live = [](Curriculum& c, int rounds, std::vector<int>* drawn) {
      for (int i = 0; i < rounds; ++i) {
        const int task = c.draw();
        c.update(task, (task * 3 + i) % 10 / 10.0);
        c.score(task, 8, task + i % 3, 9.0);
        if (drawn != nullptr) drawn->push_back(task);
      }
    };
    live(*first, 50, nullptr);
    auto second = made({.kind = kind, .seed = 99}, 7);
    const Status restored = second->restore(first->state());
    ASSERT_TRUE(restored) << restored.error().message;
    std::vector<int> one, two;
    live(*first, 50, &one), live(*second, 50, &two);
    EXPECT_EQ(one, two);
    EXPECT_EQ(first->state(), second->state());
  }
}

TEST(Curriculum, LookingAtItLeavesNoTrace) {
  for (const CurriculumKind kind : kAllKinds) {
    SCOPED_TRACE(word_of(kind));
    auto seen = made({.kind = kind, .seed = 5}, 4), alone = made({.kind = kind, .seed = 5}, 4);
    for (int i = 0; i < 30; ++i) {
      for (Curriculum* c : {seen.get(), alone.get()}) {
        const int task = c->draw();
        c->update(task, (task + i) % 5 / 5.0);
        c->score(task, 4, task * 0.3, 1.0);
      }
      (void)seen->metrics();
      ASSERT_EQ(seen->state(), alone->state());
    }
  }
}

TEST(Curriculum, RefusesAnotherPoolAndBrokenState) {
  auto curriculum = made({.kind = CurriculumKind::kPlr}, 3);
  const std::string state = curriculum->state();
  auto other = made({.kind = CurriculumKind::kPlr}, 4);
  EXPECT_THAT(other->restore(state).error().message, HasSubstr("tasks"));
  EXPECT_THAT(made({.kind = CurriculumKind::kOmni}, 3)->restore(state).error().message, HasSubstr("plr"));
  for (const char* text : {"", "[]", "{\"format\": 1}", "{\"format\": 2}", "{\"format\": 1, \"kind\": 7}"})
    EXPECT_FALSE(curriculum->restore(text)) << text;
  for (std::size_t i = 0; i < state.size(); i += 3) EXPECT_FALSE(curriculum->restore(state.substr(0, i)));
  EXPECT_EQ(curriculum->state(), state) << "a refused state changes nothing";
}

TEST(Curriculum, BadOptionsAreNamed) {
  const auto words = [](const CurriculumOptions& options) {
    const auto result = Curriculum::create(options, names(2));
    return result ? "no error" : result.error().message;
  };
  EXPECT_THAT(words({.window = 0}), HasSubstr("window"));
  EXPECT_THAT(words({.temperature = 0.0}), HasSubstr("temperature"));
  EXPECT_THAT(words({.rho = 2.0}), HasSubstr("rho"));
  EXPECT_FALSE(Curriculum::create({}, {}));
  EXPECT_FALSE(Curriculum::create({}, {"a", "a"}));
}

TEST(Curriculum, MetricsAreThoseOfTheDocument) {
  std::vector<std::string> names = {"curriculum/late_draws",
                                    "curriculum/lost_outcomes"};  // layout_service.cc
  for (const CurriculumKind kind : kAllKinds) {
    auto curriculum = made({.kind = kind, .seed = 5}, 4);
    curriculum->update(curriculum->draw(), 0.5);
    for (const auto& [name, value] : curriculum->metrics()) names.push_back("curriculum/" + name);
  }
  const auto documented = test::documented_metrics({"curriculum/"});
  EXPECT_THAT(test::undocumented(documented, names), IsEmpty());
  EXPECT_THAT(test::unwritten(documented, names), IsEmpty());
}

TEST(Curriculum, MetricsTellEntropyAndTasks) {
  auto uniform = made({}, 4);
  const auto metrics = uniform->metrics();
  EXPECT_THAT(metrics[0].second, DoubleNear(std::log(4.0), 1e-12));
  EXPECT_EQ(metrics[1].second, 4.0);
}

}  // namespace curriculum_test
}  // namespace comrad::learn
