// Plays whole runs' control side without processes (simulated_run.h), thousands a second, each judged after every turn
// (referee.h). COMRAD_SIMULATION_SEED=n plays one again, COMRAD_SIMULATION_RUNS=n plays more of them.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <spdlog/spdlog.h>

#include <cstdio>
#include <cstdlib>
#include <map>

#include "rollout_buffer/core/clock.h"
#include "tests/simulation/play.h"

namespace comrad::simulation {
namespace simulation_test {

using ::testing::AllOf;
using ::testing::Contains;
using ::testing::HasSubstr;
using ::testing::Key;
using ::testing::Le;

uint64_t number_of(const char* name, uint64_t otherwise) {
  const char* value = std::getenv(name);
  return value == nullptr ? otherwise : std::strtoull(value, nullptr, 10);
}

class Simulation : public ::testing::Test {
 protected:
  Simulation() { spdlog::set_level(spdlog::level::off); }
  ~Simulation() override { spdlog::set_level(spdlog::level::info); }

  /// How the schedule ends; its steps are legal and no rule is broken.
  static Played play_text(std::string_view text) {
    const Expected<Schedule> schedule = parse_schedule(text);
    if (!schedule) return ADD_FAILURE() << schedule.error().message, Played();
    Expected<Played> played = play(*schedule);
    if (!played) return ADD_FAILURE() << played.error().message, Played();
    EXPECT_FALSE(played->failure) << report_of(*played);
    return *played;
  }
  static std::string refusal_of(std::string_view text) {
    const Expected<Schedule> schedule = parse_schedule(text);
    if (!schedule) return schedule.error().message;
    const Expected<Played> played = play(*schedule);
    return played ? "" : played.error().message;
  }
};

TEST_F(Simulation, NoScheduleBreaksARule) {
  const uint64_t first = number_of("COMRAD_SIMULATION_SEED", 1);
  const uint64_t count =
      std::getenv("COMRAD_SIMULATION_SEED") ? 1 : number_of("COMRAD_SIMULATION_RUNS", 4000);
  std::map<StopReason, int> endings;
  std::size_t steps = 0;
  const Stopwatch watch;
  for (uint64_t seed = first; seed < first + count; ++seed) {
    const Played played = play_seed(seed);
    ++endings[played.ending.reason];
    steps += played.schedule.steps.size();
    ASSERT_FALSE(played.failure) << "seed " << seed << ", " << report_of(shrink(played));
  }
  std::printf("%llu schedules, %zu steps, %.0f schedules a second of this thread\n",
              static_cast<unsigned long long>(count), steps,
              static_cast<double>(count) / watch.cpu_elapsed());
  for (const auto& [reason, number] : endings) std::printf("%d schedules end %s\n", number, word_of(reason));
  if (count == 1) return;
  for (const StopReason reason : {StopReason::kFinished, StopReason::kInterrupted, StopReason::kNotSaved,
                                  StopReason::kKilled, StopReason::kFailed})
    EXPECT_THAT(endings, Contains(Key(reason)))
        << "no schedule ends so: the others show less than they should";
}

// What each test with text claims is what the real programs claimed once: supervision_test and supervisor_test keep one kill
// and one stop.

constexpr const char* kAllJoin = R"(
join sim-0
join sim-1
join policy-0
join learner
wait 0.1
)";

TEST_F(Simulation, ARunEndsWhenItsLearnerHasReachedTheGoal) {
  const Played played = play_text(std::string("run train") + kAllJoin + R"(
play sim-0 8
take learner
train learner
finish learner
wait 1)");
  EXPECT_EQ(played.ending.reason, StopReason::kFinished);
  EXPECT_EQ(played.ending.message, "finished");
}

TEST_F(Simulation, ALearnerThatLeavesBeforeTheGoalHasNotFinishedTheRun) {
  const Played played = play_text(std::string("run train") + kAllJoin + "leave learner\nwait 1");
  EXPECT_EQ(played.ending.reason, StopReason::kInterrupted);
  EXPECT_THAT(played.ending.message, HasSubstr("the learner received SIGTERM"));
}

TEST_F(Simulation, DeadWorkersStartAgainAndWhatTheyHeldIsAccountedFor) {
  const Played played = play_text(std::string("run train") + kAllJoin + R"(
play sim-0 5
ask sim-0
die sim-0 9
wait 1          # a policy worker still writes for it
die policy-0 9
wait 1
join sim-0
join policy-0
play sim-0 13
take learner
die learner 11  # with a slab in its hands
wait 1
join learner
terminate)");
  EXPECT_EQ(played.ending.restarts, 3);
  EXPECT_EQ(played.ending.reason, StopReason::kInterrupted);
}

TEST_F(Simulation, ALearnerThatDiesBetweenTwoCheckpointsForgetsWhatCameAfterTheFirst) {
  play_text(std::string("run train") + kAllJoin + R"(
play sim-0 8
take learner
train learner
save learner
play sim-1 8
take learner
train learner
die learner 9
wait 1
join learner
wait 1
die learner 9   # before it has learned anything
wait 1
join learner
wait 1)");
}

TEST_F(Simulation, AWorkerThatKeepsDyingIsGivenUpHoweverSlowlyItDies) {
  // The learner's counter jumps to its checkpoint's at each start, which is no work.
  for (const char* worker : {"sim-1", "policy-0", "learner"}) {
    std::string text = std::string("run train") + kAllJoin;
    for (int death = 0; death < 4; ++death) {
      text += std::string("die ") + worker + " 11\nwait 70\n";
      if (death < 3) text += std::string("join ") + worker + "\n";
    }
    const Played played = play_text(text);
    EXPECT_EQ(played.ending.reason, StopReason::kFailed) << worker;
    EXPECT_THAT(played.ending.message, HasSubstr(std::string(worker) + " died 4 times and is given up"));
  }
}

TEST_F(Simulation, ALearnerThatRestoresItsCheckpointAndDiesHasNotWorked) {
  std::string text = std::string("run train") + kAllJoin + "play sim-0 8\ntake learner\ntrain learner\n";
  for (int death = 0; death < 5; ++death)
    text += "die learner 11\nwait 70\n" + std::string(death < 4 ? "join learner\n" : "");
  EXPECT_EQ(play_text(text).ending.reason, StopReason::kFailed);
}

TEST_F(Simulation, BadInputAndAFullDiskAreNotTriedTwice) {
  const Played unusable = play_text(std::string("run train") + kAllJoin + "exit policy-0 2\nwait 1");
  EXPECT_THAT(unusable.ending.message, HasSubstr("policy-0 cannot run"));
  EXPECT_EQ(unusable.ending.restarts, 0);
  const Played full = play_text(std::string("run train") + kAllJoin + "exit learner 3\nwait 1");
  EXPECT_THAT(full.ending.message, HasSubstr("the last checkpoint could not be written"));
}

TEST_F(Simulation, AWorkerThatNeverJoinsIsKilledAndStartedAgain) {
  const Played played = play_text(
      "run train\nhang sim-0\njoin sim-1\njoin policy-0\njoin learner\nwait 130\nwait 1\njoin sim-0\nwait "
      "1\npause");
  EXPECT_EQ(played.ending.restarts, 1);
}

TEST_F(Simulation, InLockStepOneDeathSendsAllWorkersBackToTheCheckpointAndAPauseStays) {
  const Played played = play_text(std::string("run lock_step") + kAllJoin + R"(
play sim-0 8
take learner
train learner
pause
die sim-1 9
die policy-0 9
wait 0.05
refused_resume
wait 1
refused_pause)" + kAllJoin + R"(
refused_pause
resume
play sim-1 4)");
  EXPECT_EQ(played.ending.restarts, 2) << "the others did not die";
}

TEST_F(Simulation, AStopKillsTheStubbornAndReportsThatTheLearnerDidNotSave) {
  EXPECT_EQ(play_text(std::string("run train") + kAllJoin + "hang sim-0\nterminate\nwait 12").ending.reason,
            StopReason::kInterrupted);
  const Played played = play_text(std::string("run train") + kAllJoin + "hang learner\nstop\nwait 12");
  EXPECT_EQ(played.ending.reason, StopReason::kNotSaved);
  EXPECT_THAT(played.ending.message,
              AllOf(HasSubstr("stopped by comrad ctl"), HasSubstr("did not save a last checkpoint")));
  EXPECT_EQ(play_text(std::string("run train") + kAllJoin + "die learner 9\nwait 0.1\nterminate\nwait 12")
                .ending.reason,
            StopReason::kNotSaved)
      << "a dead learner saves nothing";
}

TEST_F(Simulation, ALearnerThatIsSlowToSaveIsWaitedForAsLongAsItWorks) {
  const std::string text = std::string("run train") + kAllJoin + R"(
play sim-0 8
take learner
train learner
slow learner 60
interrupt
wait 30)";
  const Played saved = play_text(text + "\nwait 40");
  EXPECT_EQ(saved.ending.reason, StopReason::kInterrupted);
  EXPECT_THAT(saved.ending.message, HasSubstr("continue with --experiment"));
  EXPECT_EQ(play_text(text + "\nhang learner\nwait 10").ending.reason, StopReason::kNotSaved);
  EXPECT_EQ(play_text(text + "\ninterrupt\nwait 0.3").ending.reason, StopReason::kKilled);
  EXPECT_EQ(
      play_text(std::string("run train") + kAllJoin + "slow sim-0 60\nterminate\nwait 10").ending.reason,
      StopReason::kInterrupted)
      << "a simulator has nothing to save";
}

TEST_F(Simulation, ASecondSigintEndsItAtOnce) {
  const Played played = play_text(std::string("run train") + kAllJoin +
                                  "hang learner\nhang sim-1\ninterrupt\nwait 0.3\ninterrupt\nwait 0.3");
  EXPECT_EQ(played.ending.reason, StopReason::kKilled);
  EXPECT_THAT(played.ending.message, HasSubstr("stopped at once"));
  EXPECT_EQ(
      play_text(std::string("run train") + kAllJoin + "interrupt\ninterrupt\nwait 0.2\ninterrupt\nwait 2")
          .ending.reason,
      StopReason::kInterrupted)
      << "one Ctrl-C that comes several times";
}

TEST_F(Simulation, TheLastEvaluationsArePlayedUnlessTheUserLeavesThemOut) {
  const std::string text = std::string("run train evaluations=1 leave=0.1") + kAllJoin + R"(
snapshot learner
wait 1.2
snapshot learner
finish learner
wait 60)";
  EXPECT_EQ(play_text(text + "\nexit evaluation 0\nwait 2\nexit evaluation 1\nwait 1").ending.reason,
            StopReason::kFinished);
  EXPECT_EQ(play_text(text + "\nhang evaluation\nterminate\nwait 5").ending.reason, StopReason::kFinished)
      << "the training is done";
}

TEST_F(Simulation, HostsComeAndGoAndOneThatTheRunNeedsEndsIt) {
  EXPECT_EQ(
      play_text(std::string("run train hosts=2") + kAllJoin + "die host-0 9\nwait 3\nexit host-1 0\nwait 1")
          .ending.reason,
      StopReason::kInterrupted);
  const Played played =
      play_text(std::string("run train hosts=1 needed=1") + kAllJoin + "exit host-0 0\nwait 1");
  EXPECT_EQ(played.ending.reason, StopReason::kFailed);
  EXPECT_THAT(played.ending.message, HasSubstr("host-0 has left"));
}

TEST_F(Simulation, AnEvaluationEndsWithItsLastEpisodeHoweverOftenOneIsReported) {
  const Played played = play_text(R"(run evaluate
join sim-0
join sim-1
join policy-0
wait 0.1
episode sim-0 0
episode sim-1 0
episode sim-0 1
episode sim-1 2
wait 1
episode sim-0 3
wait 1)");
  EXPECT_EQ(played.ending.reason, StopReason::kFinished);
}

TEST_F(Simulation, AStepThatCannotComeIsRefusedByName) {
  const std::string joined = std::string("run train") + kAllJoin;
  EXPECT_EQ(refusal_of(joined + "resume"), "step 6, 'resume': the run is not paused");
  EXPECT_EQ(refusal_of(joined + "pause\npause"), "step 7, 'pause': the run is paused already");
  EXPECT_EQ(refusal_of(joined + "stop\npause"), "step 7, 'pause': the run is stopping");
  EXPECT_EQ(refusal_of("run train\npause"), "step 1, 'pause': the run is starting");
  EXPECT_EQ(refusal_of(joined + "join sim-0"), "step 6, 'join sim-0': it has joined already");
  EXPECT_EQ(refusal_of("run train hosts=1\ndie host-0 9"), "step 1, 'die host-0 9': it was not started");
  EXPECT_EQ(refusal_of(joined + "die sim-0 9\njoin sim-0"), "step 7, 'join sim-0': it has ended");
  EXPECT_EQ(refusal_of("run train\nplay sim-0 1"), "step 1, 'play sim-0 1': it has not joined");
  EXPECT_EQ(refusal_of(joined + "train learner"), "step 6, 'train learner': it has taken nothing");
  EXPECT_EQ(refusal_of(joined + "take learner"), "step 6, 'take learner': no slab is sealed");
  EXPECT_EQ(refusal_of(joined + "refused_pause"), "step 6, 'refused_pause': the run may be paused");
  EXPECT_EQ(refusal_of(joined + "hang sim-0\nexit sim-0 0"), "step 7, 'exit sim-0 0': it hangs");
  EXPECT_EQ(refusal_of(joined + "terminate\nwait 11\nwait 1"), "step 8, 'wait 1': the run has ended");
}

TEST_F(Simulation, WhatIsNoScheduleIsRefusedWithItsLine) {
  EXPECT_EQ(refusal_of(""), "the schedule is empty");
  EXPECT_EQ(refusal_of("join sim-0"), "line 1: a schedule begins with 'run', not with 'join'");
  EXPECT_EQ(refusal_of("run dance"), "line 1: 'dance' is no kind of run");
  EXPECT_EQ(refusal_of("run train tick=9"), "line 1: 'tick=9' is no setting of a run");
  EXPECT_EQ(refusal_of("run train\n# nothing\nfly sim-0"), "line 3: 'fly' is no step");
  EXPECT_EQ(refusal_of("run train\njoin sim-7"), "line 2: 'sim-7' is no process of this run");
  EXPECT_EQ(refusal_of("run evaluate\njoin learner"), "line 2: 'learner' is no process of this run");
  EXPECT_EQ(refusal_of("run train\nwait long"), "line 2: 'long' is no number");
  EXPECT_EQ(refusal_of("run train\npause now"), "line 2: 'now' is an unexpected argument");
}

TEST_F(Simulation, AScheduleReadsBackAsItWasWritten) {
  for (uint64_t seed = 1; seed <= 50; ++seed) {
    const Played played = play_seed(seed);
    const std::string text = text_of(played.schedule);
    const Expected<Schedule> read = parse_schedule(text);
    ASSERT_TRUE(read) << read.error().message;
    EXPECT_EQ(text_of(*read), text);
    const Expected<Played> again = play(*read);
    ASSERT_TRUE(again) << again.error().message;
    EXPECT_EQ(again->ending.reason, played.ending.reason) << text;
    EXPECT_EQ(again->ending.message, played.ending.message) << text;
  }
}

/// A fault, the rule that must catch it, and the most steps that are left of a schedule which shows it.
struct Planted {
  Fault fault;
  const char* rule;
  std::size_t steps;
};

TEST_F(Simulation, APlantedFaultIsCaughtAndItsScheduleShortened) {
  for (const Planted& planted :
       {Planted{Fault::kForgetsTheDead, "accounts", 10}, Planted{Fault::kRestartsWithoutBound, "phase", 12},
        Planted{Fault::kHurries, "restarts", 4}, Planted{Fault::kSparesTheStubborn, "deadlines", 3},
        Planted{Fault::kTellsNobodyOfTheStop, "run state", 1},
        Planted{Fault::kSeesNobodyAtWork, "deadlines", 5}}) {
    std::optional<Played> broken;
    uint64_t seed = 0;
    while (!broken && ++seed <= 2000)
      if (Played played = play_seed(seed, planted.fault);
          played.failure && played.failure->rule == planted.rule)
        broken = std::move(played);
    ASSERT_TRUE(broken) << "no schedule shows that " << planted.rule << " are broken";
    const Played shortest = shrink(*broken, planted.fault);
    std::printf("seed %llu, from %zu steps: %s\n", static_cast<unsigned long long>(seed),
                broken->schedule.steps.size(), report_of(shortest).c_str());
    EXPECT_EQ(shortest.failure->rule, planted.rule);
    EXPECT_THAT(shortest.schedule.steps.size(), Le(planted.steps)) << report_of(shortest);
    const Expected<Played> sound = play(shortest.schedule);
    EXPECT_TRUE(!sound || !sound->failure) << "the fault is not the cause: " << report_of(*sound);
  }
}

}  // namespace simulation_test
}  // namespace comrad::simulation
