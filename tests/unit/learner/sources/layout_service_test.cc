#include "learner/sources/layout_service.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <numeric>

#include "learner/algorithms/algorithm.h"
#include "rollout_buffer/shm/episode_stream.h"
#include "rollout_buffer/shm/layout_mailbox.h"
#include "tests/support/noise_batch.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/slab_pool.h"
#include "tests/support/small_arena.h"

namespace comrad::learn {
namespace layout_service_test {

namespace fs = std::filesystem;
using test::small_arena_shape;
using ::testing::AllOf;
using ::testing::DoubleNear;
using ::testing::HasSubstr;

class LayoutServiceTest : public ::testing::Test {
 protected:
  LayoutServiceTest() : arena_(*shm::Arena::create(small_arena_shape(), 1)) {
    fs::create_directories(folder_ / "layouts");
    write_pool(4);
    config_.environment.layout_pool = "pool";
    config_.curriculum.lp_max_return = config_.curriculum.seq_max_return = 1.0;
  }

  void write_pool(int count) const {
    LayoutList list;
    for (int i = 0; i < count; ++i) {
      const std::string id = "task_" + std::to_string(i);
      list.layouts.push_back({id, "/nowhere/" + id + ".wad", 10.0 + i});
    }
    folder_.write(kLayoutListFile, layout_list_text(list));
  }
  /// A pool whose layouts allow these scores (0: not known).
  void write_ceilings(const std::vector<double>& ceilings) const {
    LayoutList list;
    for (const double ceiling : ceilings) {
      const std::string id = "task_" + std::to_string(list.layouts.size());
      list.layouts.push_back({.id = id, .path = "/nowhere/" + id + ".wad", .ceiling = ceiling});
    }
    folder_.write(kLayoutListFile, layout_list_text(list));
  }
  std::string write(const std::string& name, const std::string& text) const {
    return folder_.write(name, text);
  }
  std::unique_ptr<LayoutService> open() const {
    auto service = LayoutService::open(config_, folder_.string());
    EXPECT_TRUE(service) << service.error().message;
    return service ? *std::move(service) : nullptr;
  }
  std::string open_error() const {
    const auto service = LayoutService::open(config_, folder_.string());
    return service ? "no error" : service.error().message;
  }
  /// What a simulator does at the end of an episode.
  void report(int env, float score) const {
    report(env, score, arena_.layout_mailboxes().of(env).playing.load());
  }
  void report(int env, float score, uint32_t layout_index) const {
    arena_.episodes().write(
        {.layout_index = layout_index, .env_index = static_cast<uint32_t>(env), .score = score});
  }
  /// What it does when its next layout is due.
  uint32_t take(int env) const {
    arena_.layout_mailboxes().of(env).take_assignment();
    return arena_.layout_mailboxes().of(env).playing.load();
  }

  const test::ScratchFolder folder_;
  shm::Arena arena_;
  RunConfig config_;
};

TEST_F(LayoutServiceTest, ARunWithOneMapHasNone) {
  config_.environment.layout_pool.clear();
  EXPECT_EQ(open(), nullptr);
}

TEST_F(LayoutServiceTest, GrantsOneLayoutToEachEnvironmentAndWaitsUntilItIsTaken) {
  const auto service = open();
  service->serve(arena_);
  std::vector<uint32_t> first;
  for (int env = 0; env < 8; ++env) {
    EXPECT_EQ(arena_.layout_mailboxes().of(env).assigned.load(), 1u);
    first.push_back(arena_.layout_mailboxes().of(env).layout_index.load());
    EXPECT_LT(first.back(), 4u);
  }
  EXPECT_GT(std::set<uint32_t>(first.begin(), first.end()).size(), 1u);
  service->serve(arena_);
  for (int env = 0; env < 8; ++env) EXPECT_EQ(arena_.layout_mailboxes().of(env).assigned.load(), 1u);
  EXPECT_EQ(take(3), first[3]);
  service->serve(arena_);
  for (int env = 0; env < 8; ++env)
    EXPECT_EQ(arena_.layout_mailboxes().of(env).assigned.load(), env == 3 ? 2u : 1u);
}

TEST_F(LayoutServiceTest, OutcomesReachTheCurriculumUnderTheirLayout) {
  config_.curriculum.curriculum = CurriculumKind::kSequential;
  config_.curriculum.seq_min_outcomes = 2;
  const auto service = open();
  service->serve(arena_);
  for (int env = 0; env < 8; ++env) EXPECT_EQ(take(env), 0u) << "the first of the sequence";
  service->serve(arena_);
  report(0, 9.0f), report(5, 9.0f);  // of 10, the layout's own scale
  service->serve(arena_);            // task 0 is mastered; the grants that lie there are still of it
  EXPECT_EQ(service->curriculum().episode_counts()[0], 2);
  EXPECT_EQ(take(0), 0u) << "stale by one episode";
  service->serve(arena_);
  EXPECT_EQ(take(0), 1u);
  report(0, 0.9f);
  service->serve(arena_);
  EXPECT_EQ(service->curriculum().episode_counts()[1], 1);
}

TEST_F(LayoutServiceTest, DamagedAndOverwrittenOutcomesAreCountedAndDoNoHarm) {
  const auto service = open();
  report(1, 1.0f, 99);
  report(1, std::nanf(""), 2);
  report(1, 1.0f, kNoLayoutIndex);  // of another host
  report(1, 0.5f, 2);
  service->serve(arena_);
  EXPECT_EQ(std::accumulate(service->curriculum().episode_counts().begin(),
                            service->curriculum().episode_counts().end(), int64_t{0}),
            1);
  for (int i = 0; i < arena_.episodes().capacity() + 12; ++i) report(1, 0.25f);
  service->serve(arena_);
  std::vector<std::pair<std::string, double>> metrics;
  service->append_to(metrics);
  std::map<std::string, double> by_name(metrics.begin(), metrics.end());
  EXPECT_EQ(by_name.at("curriculum/lost_outcomes"), 12.0);
  EXPECT_EQ(by_name.at("curriculum/episodes"), 1.0 + static_cast<double>(arena_.episodes().capacity()));
  EXPECT_EQ(by_name.at("curriculum/layouts_seen"), 2.0);
  EXPECT_THAT(by_name.at("curriculum/entropy"), DoubleNear(std::log(4.0), 1e-12));
  EXPECT_THAT(by_name.at("curriculum/mean_score"), DoubleNear((0.25 + 0.5) / 2, 1e-6));
}

TEST_F(LayoutServiceTest, TheOrderInWhichASimulatorsEnvironmentsEndDoesNotCount) {
  config_.curriculum.curriculum = CurriculumKind::kLearningProgress;
  const auto play = [&](const std::vector<int>& order) {
    arena_ = *shm::Arena::create(small_arena_shape(), 1);
    const auto service = open();
    service->serve(arena_);
    for (const int env : order) report(env, static_cast<float>(env) / 7.0f, 1);
    service->serve(arena_);
    return service->curriculum().state();
  };
  EXPECT_EQ(play({0, 1, 2, 3, 1, 5}), play({5, 1, 3, 2, 0, 1}));
}

TEST_F(LayoutServiceTest, ACheckpointContinuesTheDrawsAndTheMailboxes) {
  config_.curriculum.curriculum = CurriculumKind::kLearningProgress;
  const auto first = open();
  for (int round = 0; round < 20; ++round) {
    first->serve(arena_);
    for (int env = 0; env < 8; ++env)
      take(env), report(env, static_cast<float>((env * 3 + round) % 7) / 7.0f);
  }
  first->serve(arena_);
  first->capture_mailboxes(arena_, true);
  StateDict state;
  first->save(state);

  const shm::Arena fresh = *shm::Arena::create(small_arena_shape(), 2);
  const auto second = open();
  const Status loaded = second->load(state);
  ASSERT_TRUE(loaded) << loaded.error().message;
  ASSERT_TRUE(second->restore_mailboxes(fresh));
  for (int env = 0; env < 8; ++env) {
    EXPECT_EQ(fresh.layout_mailboxes().of(env).playing.load(),
              arena_.layout_mailboxes().of(env).playing.load());
    EXPECT_EQ(fresh.layout_mailboxes().of(env).layout_index.load(),
              arena_.layout_mailboxes().of(env).layout_index.load());
    EXPECT_EQ(fresh.layout_mailboxes().of(env).assigned.load(),
              arena_.layout_mailboxes().of(env).assigned.load());
    EXPECT_EQ(fresh.layout_mailboxes().of(env).taken.load(), arena_.layout_mailboxes().of(env).taken.load());
  }
  for (int i = 0; i < 50; ++i) ASSERT_EQ(first->curriculum().draw(), second->curriculum().draw());
  EXPECT_EQ(first->curriculum().state(), second->curriculum().state());

  shm::ArenaShape other = small_arena_shape();
  other.sim_worker_count = 1;
  EXPECT_THAT(second->restore_mailboxes(*shm::Arena::create(other, 3)).error().message,
              HasSubstr("8 environments"));
  ASSERT_TRUE(first->write_file(folder_.string()));
  std::ifstream file(folder_ / "curriculum_state.json");
  const std::string text{std::istreambuf_iterator<char>(file), {}};
  EXPECT_TRUE(open()->curriculum().restore(text));
}

TEST_F(LayoutServiceTest, ResumingWithoutStateOrWithOtherLayoutsIsRefused) {
  StateDict state;
  EXPECT_THAT(open()->load(state).error().message, HasSubstr("without --layout_pool"));
  open()->save(state);
  write_pool(5);
  EXPECT_THAT(open()->load(state).error().message, HasSubstr("tasks"));
}

TEST_F(LayoutServiceTest, SettingsAndFilesThatAreWrongAreNamed) {
  config_.curriculum.curriculum = CurriculumKind::kSequential;
  config_.curriculum.seq_max_return = 0;
  write_ceilings({35, 0});
  EXPECT_THAT(open_error(), AllOf(HasSubstr("seq_max_return is 0"), HasSubstr("layout task_1")));
  config_.curriculum.curriculum = CurriculumKind::kLearningProgress;
  config_.curriculum.lp_min_return = 40;
  config_.curriculum.lp_max_return = 0;
  write_ceilings({47, 35});
  EXPECT_THAT(open_error(), AllOf(HasSubstr("lp_min_return is 40"), HasSubstr("layout task_1, 35")));
  write_pool(4);
  config_.curriculum.lp_min_return = 0;
  config_.curriculum.lp_max_return = 1;
  config_.curriculum.curriculum = CurriculumKind::kOmni;
  config_.curriculum.interestingness_graph_path = (folder_ / "none.json").string();
  EXPECT_THAT(open_error(), HasSubstr("none.json: cannot be read"));
  config_.curriculum.interestingness_graph_path = write("g.json", "{\"task_0\": ");
  EXPECT_THAT(open_error(), HasSubstr("line 1"));
  config_.curriculum.interestingness_graph_path = write("g.json", "{\"task_0\": {\"task_1\": \"no\"}}");
  EXPECT_THAT(open_error(), HasSubstr("neither true nor false about 'task_1'"));
  config_.curriculum.interestingness_graph_path = write("g.json", "{\"task_0\": {\"tsk_1\": false}}");
  EXPECT_THAT(open_error(), HasSubstr("did you mean 'task_1'"));
  config_.curriculum.interestingness_graph_path =
      write("g.json", "{\"task_3\": {\"task_1\": false, \"task_0\": true}}");
  EXPECT_EQ(open_error(), "no error");
  fs::remove(folder_ / kLayoutListFile);
  EXPECT_THAT(open_error(), HasSubstr("pool.toml"));
}

TEST_F(LayoutServiceTest, SequentialGoesPastALayoutThatAllowsLessThanTheDefaultMap) {
  // A chain of 36 platforms allows 35, that of the scenario's default map 47: 0.8 of 47 is out of reach there.
  write_ceilings({35, 47, 59});
  config_.curriculum.curriculum = CurriculumKind::kSequential;
  config_.curriculum.seq_max_return = 0;
  config_.curriculum.seq_min_outcomes = 5;
  const auto service = open();
  ASSERT_NE(service, nullptr);
  Curriculum& curriculum = service->curriculum();
  for (int episode = 0; episode < 5; ++episode) curriculum.update(0, 34);
  EXPECT_EQ(curriculum.draw(), 1);
  for (int episode = 0; episode < 5; ++episode) curriculum.update(1, 37);
  EXPECT_EQ(curriculum.draw(), 1) << "37 of 47 is less than 0.8";
  for (int episode = 0; episode < 5; ++episode) curriculum.update(1, 47);
  EXPECT_EQ(curriculum.draw(), 2);
  // A score that a setting names counts for every layout.
  config_.curriculum.seq_max_return = 10;
  const auto named = open();
  ASSERT_NE(named, nullptr);
  for (int episode = 0; episode < 5; ++episode) named->curriculum().update(0, 9);
  EXPECT_EQ(named->curriculum().draw(), 1);
}

TEST_F(LayoutServiceTest, TheGraphAndTheScalesReachOmni) {
  config_.curriculum.curriculum = CurriculumKind::kOmni;
  config_.curriculum.interestingness_graph_path =
      write("g.json", "{\"task_3\": {\"task_1\": false, \"task_0\": true}}");
  const auto list = read_layout_list(folder_.string());
  ASSERT_TRUE(list);
  const auto options = curriculum_options(config_, *list);
  ASSERT_TRUE(options) << options.error().message;
  EXPECT_EQ(options->uninteresting.at("task_3"), (std::set<std::string>{"task_1"}));
  EXPECT_EQ(options->task_scale, (std::vector<double>{10, 11, 12, 13}));
}

/// One slab of layouts 0,0,1,2 and another of 2,2,2,5 (which is in no pool of four).
RolloutBatch batch_of_layouts() {
  TrajectoryShape shape = small_arena_shape().trajectory;
  shape.rollout_steps = 4;
  const test::SlabPool pool(shape, 2);
  pool.fill_with_noise(5);
  constexpr int kLayouts[2][4] = {{0, 0, 1, 2}, {2, 2, 2, 5}};
  for (int i = 0; i < 2; ++i)
    for (int t = 0; t < 4; ++t) pool.view(i).layout_index(t) = kLayouts[i][t];
  RolloutBatch batch = make_rollout_batch(shape, 2);
  clear(batch);
  for (int i = 0; i < 2; ++i) collate_slab(batch, i, pool.view(i), 4);
  batch.raw_advantage = torch::zeros({4, 4});
  for (int t = 0; t < 4; ++t)
    for (int row = 0; row < 4; ++row) batch.raw_advantage[t][row] = (row % 2 == 0 ? 1.0 : -1.0) * (t + 1);
  batch.advantage = torch::full({4, 4}, 1e6);  // what the algorithm made of it is not the signal
  batch.valid[2][1] = 0;                       // layout 1, agent 1: -3 does not count
  return batch;
}

TEST(LayoutSignals, AreMeansAndMaximaOverEachLayoutsValidDecisions) {
  const RolloutBatch batch = batch_of_layouts();
  const auto l1 = layout_signals(batch, PlrScore::kMeanValueL1, 4);
  ASSERT_EQ(l1.size(), 3u);
  EXPECT_EQ(l1[0].layout_index, 0);
  EXPECT_EQ(l1[0].decisions, 4);
  EXPECT_DOUBLE_EQ(l1[0].mean, 1.5);  // |+-1|, |+-2|
  EXPECT_DOUBLE_EQ(l1[0].maximum, 2.0);
  EXPECT_EQ(l1[1].decisions, 1);
  EXPECT_DOUBLE_EQ(l1[1].mean, 3.0);
  EXPECT_EQ(l1[2].decisions, 8);  // 4 of the first slab, 1, 2, 3 of the second, two agents each
  EXPECT_DOUBLE_EQ(l1[2].mean, 2.5);
  const auto signed_mean = layout_signals(batch, PlrScore::kMeanAdvantage, 4);
  EXPECT_DOUBLE_EQ(signed_mean[0].mean, 0.0);
  EXPECT_DOUBLE_EQ(signed_mean[1].mean, 3.0);
  EXPECT_DOUBLE_EQ(signed_mean[2].maximum, 4.0);
}

TEST(LayoutSignals, DecisionsOfTheDeadDoNotCount) {
  RolloutBatch batch = batch_of_layouts();
  batch.agent_active[0][0] = 0;  // layout 0, agent 0: 1 does not count
  const auto signals = layout_signals(batch, PlrScore::kMeanAdvantage, 4);
  EXPECT_EQ(signals[0].decisions, 3);
  EXPECT_DOUBLE_EQ(signals[0].mean, -1.0 / 3.0);
}

TEST(LayoutSignals, TenTimesTheRewardScoresTenTimesAsMuchForEveryAlgorithm) {
  for (const char* algo : {"ippo", "mappo", "happo"}) {
    std::vector<double> scores;
    for (const double scale : {1.0, 10.0}) {
      RunConfig config = test::small_config(algo, 2);
      config.network.share_parameters = config.run.algo != "happo";
      config.network.critic_hidden_sizes = "16";
      const TrajectoryShape shape = test::small_shape(config, 2);
      const auto made = make_algorithm(config, shape.env, torch::kCPU);
      ASSERT_TRUE(made);
      StateDict state;
      (*made)->save(state);
      state.put("normalizer/returns_mean", 0.3 * scale);  // statistics that saw rewards of this scale
      state.put("normalizer/returns_variance", 2.0 * scale * scale);
      ASSERT_TRUE((*made)->load(state));
      RolloutBatch batch = test::noise_batch(shape, 4, 7);
      batch.reward.mul_(scale);
      ASSERT_TRUE(dynamic_cast<OnPolicyAlgorithm&>(**made).update(batch, {}));
      scores.push_back(layout_signals(batch, PlrScore::kMeanValueL1, 1).front().mean);
    }
    EXPECT_NEAR(scores[1] / scores[0], 10, 1e-3) << algo;
  }
}

TEST(LayoutSignals, EntropyIsThatOfTheBehaviourPolicy) {
  RolloutBatch batch = batch_of_layouts();
  batch.logits.zero_();  // uniform over 3 and over 4 choices
  for (const LayoutSignal& one : layout_signals(batch, PlrScore::kMeanEntropy, 4))
    EXPECT_NEAR(one.mean, std::log(3.0) + std::log(4.0), 1e-6);
}

TEST_F(LayoutServiceTest, OnlyPlrListensToTraining) {
  for (const CurriculumKind kind : {CurriculumKind::kUniform, CurriculumKind::kPlr}) {
    config_.curriculum.curriculum = kind;
    const auto service = open();
    const std::string before = service->curriculum().state();
    RankGroup alone;
    service->score(batch_of_layouts(), alone);
    EXPECT_EQ(service->curriculum().state() != before, config_.curriculum.curriculum == CurriculumKind::kPlr)
        << word_of(kind);
  }
}

}  // namespace layout_service_test
}  // namespace comrad::learn
