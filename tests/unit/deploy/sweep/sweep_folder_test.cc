// What a sweep leaves on the disk, and what is read off it.
#include "deploy/sweep/sweep_folder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "deploy/sweep/sweep_table.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace sweep_folder_test {

using ::testing::HasSubstr;

SweepPlan plan_in(const test::ScratchFolder& scratch) {
  SweepPlan plan;
  plan.file.path = "s.toml";
  plan.file.name = "study";
  plan.folder = scratch.string() + "/study";
  for (const char* name : {"a", "b"}) plan.runs.push_back({name, {"", {{"seed", "1"}}}, 1000});
  return plan;
}

SweepFolder folder_of(const SweepPlan& plan) {
  Expected<SweepFolder> folder = SweepFolder::make(plan, "text", {});
  EXPECT_TRUE(folder) << folder.error().message;
  return *std::move(folder);
}

TEST(SweepFolder, ReadsBackWhatItWrote) {
  const test::ScratchFolder scratch;
  const SweepPlan plan = plan_in(scratch);
  folder_of(plan);
  const Expected<SweepFolder> again = SweepFolder::open(plan.folder + "/");
  ASSERT_TRUE(again) << again.error().message;
  EXPECT_EQ(again->name(), "study");
  ASSERT_EQ(again->runs().size(), 2u);
  EXPECT_EQ(again->runs()[1].settings.values[0].second, "1");
  EXPECT_EQ(again->runs()[1].goal_env_frames, 1000);
  EXPECT_EQ(again->find("c"), nullptr);
}

TEST(SweepFolder, StatesFollowFromRecordProcessQueueAndStatus) {
  const test::ScratchFolder scratch;
  SweepPlan plan = plan_in(scratch);
  const SweepFolder folder = folder_of(plan);
  const SweepRun& run = folder.runs()[0];
  EXPECT_EQ(folder.look(run, {}).state, RunState::kWaiting);

  RunRecord record;
  record.state = RunState::kRunning;
  record.host = host_name();
  record.pid = getpid();
  record.pid_start_tics = *start_tics_of(getpid());
  record.goal_env_frames = 1000;
  ASSERT_TRUE(folder.write_record(run, record));
  EXPECT_EQ(folder.look(run, {}).state, RunState::kRunning);
  record.pid_start_tics += 1;  // the pid is another process's now
  ASSERT_TRUE(folder.write_record(run, record));
  EXPECT_EQ(folder.look(run, {}).state, RunState::kInterrupted);

  record.job = "12_0";
  record.commit = "0123abc-changed";
  ASSERT_TRUE(folder.write_record(run, record));
  EXPECT_EQ(folder.read_record(run)->commit, "0123abc-changed");
  EXPECT_EQ(folder.look(run, {.running_runs = {"a"}}).state, RunState::kRunning);
  EXPECT_EQ(folder.look(run, {.is_known = false}).state, RunState::kRunning);
  EXPECT_EQ(folder.look(run, {.pending_runs = {"a"}}).state, RunState::kQueued);
  EXPECT_EQ(folder.look(run, {}).state, RunState::kInterrupted);

  record.state = RunState::kFailed;
  record.error = "no room";
  ASSERT_TRUE(folder.write_record(run, record));
  EXPECT_THAT(sweep_table(folder.look({})), HasSubstr("a failed: no room"));

  record.state = RunState::kFinished;
  ASSERT_TRUE(folder.write_record(run, record));
  EXPECT_EQ(folder.look(run, {}).state, RunState::kFinished);
  plan.runs[0].goal_env_frames = 2000;  // the file requests more now
  const SweepFolder longer = folder_of(plan);
  EXPECT_EQ(longer.look(longer.runs()[0], {}).state, RunState::kWaiting);
  scratch.write("study/a/status.json", R"({"state": "finished", "env_frames": 2000, "J_mean": null})");
  EXPECT_EQ(longer.look(longer.runs()[0], {}).state, RunState::kFinished);
}

TEST(SweepFolder, ADamagedRecordIsNone) {
  const test::ScratchFolder scratch;
  const SweepFolder folder = folder_of(plan_in(scratch));
  for (const char* text : {"", "{", "[]", R"({"state": "odd"})", R"({"state": 3})"}) {
    scratch.write("study/records/a.json", text);
    EXPECT_FALSE(folder.read_record(folder.runs()[0])) << text;
    EXPECT_EQ(folder.look(folder.runs()[0], {}).state, RunState::kWaiting);
  }
  scratch.write("study/sweep.json", R"({"runs": [{"name": "../x", "settings": {}}]})");
  EXPECT_EQ(SweepFolder::open((scratch / "study").string()).error().code, ErrorCode::kBadFormat);
}

TEST(SweepFolder, OneSweepAtATimeAndNoForeignFolder) {
  const test::ScratchFolder scratch;
  const SweepPlan plan = plan_in(scratch);
  {
    const Expected<Descriptor> lock = SweepFolder::lock(plan.folder);
    ASSERT_TRUE(lock) << lock.error().message;
    EXPECT_EQ(folder_of(plan).lock_owner(), getpid());
    EXPECT_THAT(SweepFolder::lock(plan.folder).error().message,
                HasSubstr("at work already (pid " + std::to_string(getpid())));
  }
  EXPECT_EQ(folder_of(plan).lock_owner(), 0);
  scratch.write("other/note.txt", "mine");
  SweepPlan other = plan;
  other.folder = scratch.string() + "/other";
  EXPECT_THAT(SweepFolder::make(other, "text", {}).error().message, HasSubstr("is no folder of a sweep"));
}

TEST(SweepFolder, ASettingThatTheFileForgetsIsNamed) {
  const test::ScratchFolder scratch;
  SweepPlan plan = plan_in(scratch);
  folder_of(plan);
  plan.runs[0].settings.values.clear();
  EXPECT_TRUE(SweepFolder::make(plan, "text", {}));  // nothing was trained yet
  folder_of(plan_in(scratch));
  scratch.write("study/a/checkpoint/checkpoint_1_100.pt", "x");
  EXPECT_THAT(SweepFolder::make(plan, "text", {}).error().message, HasSubstr("a was made with seed = 1"));
}

}  // namespace sweep_folder_test
}  // namespace comrad::deploy
