#include "deploy/launch/worker_table.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cstring>
#include <optional>
#include <string>
#include <vector>

#include "deploy/launch/run_report.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/metrics/learner_messages.h"
#include "rollout_buffer/shm/learner_report.h"
#include "tests/simulation/simulated_host.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/small_arena.h"

namespace comrad::deploy {
namespace worker_table_test {

using ::testing::HasSubstr;
using ::testing::IsEmpty;
using ::testing::Not;

/// Two simulators, a policy worker and a learner that do not exist, on a clock that is moved by hand.
class WorkerTableTest : public ::testing::Test {
 protected:
  WorkerTableTest() {
    plan_.run_dir = folder_.string();
    plan_.config.collection.num_workers = 2;
    plan_.config.collection.policy_workers = 1;
    plan_.join_timeout_s = 120;
    table_.emplace(plan_, clock_, host_);
    for (Worker& worker : table_->workers()) EXPECT_TRUE(table_->start(worker, arena_, "arena"));
    table_->listen(arena_, /*at_work=*/false);
  }
  simulation::Body& body(int place) { return *host_.body(place); }
  /// So many seconds, in each of which the simulators named count.
  void pass(int seconds, const std::vector<int>& playing) {
    for (int second = 0; second < seconds; ++second) {
      clock_.advance_s(1);
      for (const int sim : playing) arena_.sim_counters(sim).decisions += 10;
      table_->listen(arena_, true);
    }
  }
  void join(const char* role, uint32_t index) {
    shm::JoinRequest request;
    std::strncpy(request.role, role, sizeof request.role - 1);
    request.worker_index = index;
    table_->note_joined(request);
  }
  /// All that was shown while `act` ran.
  template <typename Act>
  std::string shown(Act&& act) {
    const std::string path = folder_ / "shown";
    {
      const Descriptor file(open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600));
      ProgressPrinter printer(file.get(), /*show=*/true);
      act(printer);
    }
    return read_file(path).value_or("");
  }

  const test::ScratchFolder folder_;
  LaunchPlan plan_;
  ManualClock clock_;
  const simulation::Setting setting_{.sims = 2, .policies = 1};
  simulation::SimulatedHost host_{setting_, clock_};
  const shm::Arena arena_ = *shm::Arena::create(test::small_arena_shape(), 1);
  std::optional<WorkerTable> table_;
};

TEST_F(WorkerTableTest, AWorkerThatStandsStillIsNamedAndTheRateIsZeroWhenNoneIsLeft) {
  pass(9, {1});
  EXPECT_EQ(table_->silence_text(), "") << "it may have been at a long episode's end";
  body(0).is_stopped = true;
  pass(3, {1});
  EXPECT_EQ(table_->silence_text(), "sim-0 silent for 12s (SIGSTOP)");
  EXPECT_FALSE(table_->stands_still());

  RateMeter meter(plan_);
  meter.use(&arena_);
  TrainStats report;
  report.learner_version = 4, report.env_frames = 1024, report.env_frames_per_s = 5120,
  report.decisions_per_s = 1280;
  arena_.learner_reports().publish(report);
  ASSERT_TRUE(meter.take_report());
  RunEvaluationFolder evaluations(plan_.run_dir);
  const Evaluator evaluator(plan_, clock_, host_, evaluations);
  const RunReport words(plan_, clock_, meter, *table_, evaluator);
  EXPECT_THAT(words.progress_line(), HasSubstr("5120 env frames/s"));
  body(1).is_stopped = true;
  pass(10, {});
  EXPECT_TRUE(table_->stands_still());
  EXPECT_THAT(words.progress_line(), HasSubstr("| 0 env frames/s, 0 decisions/s"));
  EXPECT_THAT(words.progress_line(), HasSubstr("sim-1 silent for 10s (SIGSTOP)"));

  body(0).is_stopped = body(1).is_stopped = false;
  pass(1, {0, 1});
  EXPECT_EQ(table_->silence_text(), "");
  EXPECT_THAT(words.progress_line(), HasSubstr("5120 env frames/s"));
}

TEST_F(WorkerTableTest, AWorkerThatWaitsForOthersIsNotNamed) {
  pass(60, {});
  EXPECT_EQ(table_->silence_text(), "") << "both simulators wait, for the learner as it may be";
  table_->listen(arena_, /*at_work=*/false);
  pass(9, {0});
  EXPECT_EQ(table_->silence_text(), "") << "a pause is no silence";
}

TEST_F(WorkerTableTest, AWorkerThatDoesNotJoinInTimeIsKilled) {
  join("sim", 0);
  clock_.advance_s(119);
  EXPECT_THAT(table_->reap_exited(/*is_stopping=*/false), IsEmpty());
  clock_.advance_s(2);
  EXPECT_THAT(table_->reap_exited(/*is_stopping=*/true), IsEmpty()) << "a stop has its own deadlines";
  const auto exited = table_->reap_exited(/*is_stopping=*/false);
  ASSERT_EQ(exited.size(), 3u);
  EXPECT_EQ(exited[0].first->name, "learner") << "in the order in which they are taken back";
  EXPECT_EQ(exited[0].second.signal, SIGKILL);
  EXPECT_EQ(table_->last_words(*exited[0].first), "did not join the run within 120 s");
  EXPECT_TRUE(body(0).is_alive());
}

TEST_F(WorkerTableTest, ALearnerWithPolicyWorkersHasNoProcessesOfThem) {
  plan_.config.collection.policy_processes = false;
  EXPECT_FALSE(WorkerTable(plan_, clock_, host_).has(Role::kPolicy));
  plan_.policy = PolicySource::kCheckpoint;
  EXPECT_TRUE(WorkerTable(plan_, clock_, host_).has(Role::kPolicy)) << "an evaluation";
}

TEST_F(WorkerTableTest, ARequestOfADeadWorkerDoesNotCount) {
  body(1).end({.code = 1, .signal = 0}, clock_.now_s());
  ASSERT_EQ(table_->reap_exited(false).size(), 1u);
  join("sim", 0), join("sim", 1), join("policy", 0), join("learner", 0);
  EXPECT_EQ(table_->joined_text(), "1/2 simulators, 1/1 policy workers, 1/1 learner");
  EXPECT_FALSE(table_->all_joined());
}

TEST_F(WorkerTableTest, ALearnersWorkIsWhatItCountsBeyondItsCheckpoint) {
  Worker& learner = table_->workers()[3];
  ASSERT_EQ(learner.role, Role::kLearner);
  EXPECT_FALSE(has_worked(learner, arena_));
  const auto read_checkpoint = [&] {
    arena_.learner_counters().begin_life();
    EXPECT_FALSE(has_worked(learner, arena_)) << "what it counts is its predecessor's";
    arena_.control().learner_decisions_before = 100;
    arena_.learner_counters().decisions = 100;
    arena_.learner_counters().state = shm::WorkerState::kRunning;
    EXPECT_FALSE(has_worked(learner, arena_)) << "it has read its checkpoint";
    arena_.learner_counters().decisions = 164;
  };
  read_checkpoint();
  EXPECT_TRUE(has_worked(learner, arena_));
  // It dies and comes to the same count again.
  learner.decisions_at_start = 164, learner.epoch_at_start = arena_.learner_counters().epoch;
  EXPECT_FALSE(has_worked(learner, arena_));
  read_checkpoint();
  EXPECT_TRUE(has_worked(learner, arena_));
}

TEST_F(WorkerTableTest, WhatAWorkerPrintsIsShownTwentyLinesAMinuteAndAWarningOnce) {
  EXPECT_EQ(shown([&](ProgressPrinter& printer) {
              body(3).lines = {to_line({UserMessage::Kind::kWarning, "31% of the samples are old"})};
              table_->read_output(printer);
              body(3).lines = {to_line({UserMessage::Kind::kWarning, "32% of the samples are old"})};
              table_->read_output(printer);
            }),
            "warning: 31% of the samples are old\n");
  EXPECT_EQ(table_->last_words(table_->workers()[3]), "warning: 32% of the samples are old");
  // Words in a log are no message.
  EXPECT_EQ(shown([&](ProgressPrinter& printer) {
              body(3).lines = {"2026-11-22T10:00:02.000 W learner: warning: 33%"};
              table_->read_output(printer);
            }),
            "learner: 2026-11-22T10:00:02.000 W learner: warning: 33%\n");
  const std::string many = shown([&](ProgressPrinter& printer) {
    for (int line = 1; line <= 30; ++line) body(0).lines.push_back("line " + std::to_string(line));
    table_->read_output(printer);
  });
  EXPECT_THAT(many, HasSubstr("sim-0: line 20\nsim-0: (more in logs/supervisor.log)\n"));
  EXPECT_THAT(many, Not(HasSubstr("line 21")));
  EXPECT_EQ(table_->last_words(table_->workers()[0]), "line 30");
  clock_.advance_s(61);
  EXPECT_EQ(shown([&](ProgressPrinter& printer) {
              body(0).lines = {"line 31"};
              table_->read_output(printer);
            }),
            "sim-0: line 31\n");
}

}  // namespace worker_table_test
}  // namespace comrad::deploy
