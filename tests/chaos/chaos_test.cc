// A run whose processes are killed and stopped at random, whose disk is full, read-only or slow, whose clock jumps and whose
// memory is too small. Training continues where it can, and every decision is accounted for. Longer:
//   ./comrad test -L long -R chaos_long
// COMRAD_CHAOS_SEED=n repeats the choices of a run that failed (their moments are the machine's).

#include <dirent.h>
#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/prctl.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <deque>
#include <fstream>
#include <memory>
#include <set>
#include <sstream>
#include <utility>

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/rng.h"
#include "tests/chaos/victims.h"
#include "tests/integration/decision_accounts.h"
#include "tests/integration/running_program.h"

namespace comrad::test {
namespace chaos_test {

namespace fs = std::filesystem;
using nlohmann::json;
using ::testing::AllOf;
using ::testing::AnyOf;
using ::testing::HasSubstr;
using ::testing::Not;

constexpr int kClockJumpSeconds = 4000;

/// What a process holds.
struct Footprint {
  int descriptors = 0;
  std::multiset<std::string> threads;  ///< by name
  double megabytes = 0;
};

std::multiset<std::string> threads_of(const std::string& process) {
  std::multiset<std::string> names;
  std::error_code failed;
  for (auto entry = fs::directory_iterator(process + "/task", failed); entry != fs::directory_iterator();
       entry.increment(failed)) {
    std::string name;
    std::getline(std::ifstream(entry->path() / "comm"), name);
    names.insert(name);
  }
  return names;
}

int entries_of(const std::string& folder) {
  int count = 0;
  std::error_code failed;
  for (auto entry = fs::directory_iterator(folder, failed); entry != fs::directory_iterator();
       entry.increment(failed))
    ++count;
  return count;
}

Footprint footprint_of(pid_t pid) {
  const std::string process = "/proc/" + std::to_string(pid);
  std::ifstream file(process + "/statm");
  double pages = 0, resident = 0, shared = 0;
  file >> pages >> resident >> shared;
  return {.descriptors = entries_of(process + "/fd"),
          .threads = threads_of(process),
          .megabytes = (resident - shared) * static_cast<double>(getpagesize()) / 1e6};
}

/// Program and word of each kind of worker.
constexpr std::pair<const char*, const char*> kKinds[] = {
    {"comrad-sim-worker", "sim"}, {"comrad-policy-worker", "policy"}, {"comrad-learner", "learner"}};

class Chaos : public ::testing::Test {
 protected:
  void begin(const std::vector<std::string>& more = {}, const Environment& environment = {}) {
    std::vector<std::string> flags = {"--save_every_sec", "2"};
    flags.insert(flags.end(), more.begin(), more.end());
    training_ = std::make_unique<RunningProgram>(small_training(scratch_, "run", 1e9, flags), environment);
    ASSERT_TRUE(wait_until([this] { return env_frames(run_) > 0 || !training_->running(); }));
    ASSERT_TRUE(training_->running()) << training_->wait(1).err;
  }
  bool trains_on(double frames) {
    const double before = env_frames(run_);
    return wait_until([&] { return env_frames(run_) >= before + frames || env_frames(run_) < before; }) &&
           training_->running();
  }
  /// The last words, the status and its accounts, which must be exact.
  json end() {
    training_->signal(SIGTERM);
    ending_ = training_->wait();
    EXPECT_FALSE(ending_.timed_out);
    EXPECT_EQ(ending_.exit_code, 0) << ending_.err;
    EXPECT_THAT(ending_.err, Not(HasSubstr("do not add up")));
    EXPECT_TRUE(wait_until([&] { return processes_of(run_).empty(); })) << "something is left";
    const json account = checked_account(run_), status = read_json(run_ + "/status.json");
    EXPECT_EQ(status["decisions"].get<int64_t>(),
              account["trained"].get<int64_t>() - account["forgotten"].get<int64_t>())
        << status;
    EXPECT_EQ(status["env_frames"].get<int64_t>(), 4 * status["decisions"].get<int64_t>());
    return account;
  }
  std::vector<std::string> checkpoints() const {
    std::vector<std::string> paths;
    for (const std::string& name : files(run_ + "/checkpoint", "checkpoint_", ".pt"))
      paths.push_back(name.find('/') == std::string::npos ? run_ + "/checkpoint/" + name : name);
    return paths;
  }
  /// Every checkpoint that bears its final name is whole.
  void expect_whole_checkpoints() const {
    for (const std::string& path : checkpoints()) {
      const auto read = learn::read_checkpoint(path);
      // One may be deleted for a newer one while it is read.
      if (!read && fs::exists(path)) ADD_FAILURE() << path << " is torn: " << read.error().message;
    }
  }

  const ScratchFolder scratch_;
  const std::string run_ = scratch_ / "run";
  std::unique_ptr<RunningProgram> training_;
  Ending ending_;
};

TEST_F(Chaos, RandomKillsAndStopsLoseNothingUntold) {
  const double seconds = number_of("COMRAD_CHAOS_SECONDS", 8);
  Rng rng(chosen_seed());
  begin();
  ASSERT_TRUE(trains_on(8192));
  const pid_t supervisor = training_->pid();
  std::map<std::string, Footprint> before;
  before["supervisor"] = footprint_of(supervisor);
  for (const auto& [name, word] : kKinds) before[word] = footprint_of(processes_of(run_, name).at(0));

  Victims victims({{run_, "comrad-sim-worker", "sim", 4},
                   {run_, "comrad-policy-worker", "policy", 2},
                   // One that receives a stop signal ends the run; the others start again.
                   {run_, "comrad-learner", "learner", 2, /*may_be_terminated=*/false}},
                  rng);
  double progress_s = now_s(), frames = env_frames(run_);
  for (const double end_s = now_s() + seconds; now_s() < end_s; sleep_s(0.05 + 0.001 * rng.below(1200))) {
    ASSERT_TRUE(training_->running()) << training_->wait(1).err;
    if (const double now = env_frames(run_); now != frames) frames = now, progress_s = now_s();
    EXPECT_LT(now_s() - progress_s, kPatienceSeconds * patience()) << "nothing is learned any more";
    victims.strike();
  }
  victims.let_go_on();

  // All workers are back, none holds more than before, and learning continues.
  ASSERT_TRUE(wait_until([&] {
    return processes_of(run_, "comrad-sim-worker").size() == 2 &&
           processes_of(run_, "comrad-policy-worker").size() == 1 &&
           processes_of(run_, "comrad-learner").size() == 1;
  }));
  ASSERT_TRUE(trains_on(4096));
  ASSERT_TRUE(trains_on(4096));
  for (const auto& [word, was] : before) {
    pid_t pid = supervisor;
    for (const auto& [name, kind] : kKinds)
      if (word == kind) pid = processes_of(run_, name).at(0);
    const Footprint now = footprint_of(pid);
    EXPECT_LE(now.descriptors, was.descriptors + 1) << word << ": one more while status.json is written";
    EXPECT_LE(now.threads.size(), was.threads.size())
        << word << " had " << ::testing::PrintToString(was.threads) << " and has "
        << ::testing::PrintToString(now.threads);
    EXPECT_LE(now.megabytes, was.megabytes * 1.2 + 30) << word;
  }
  const json account = end();
  std::printf("%.0f s: killed %s; stopped %d; decisions %s\n", seconds, victims.kills_text().c_str(),
              victims.stops, account.dump().c_str());
  // What a death costs has a bound: what the worker held. 2 simulators of 4 environments of 2 agents, 16 steps a slab, and
  // batches of 256 decisions of which a learner holds four at most.
  const auto count = [&](const char* key) { return account[key].get<int64_t>(); };
  EXPECT_LE(count("lost_with_simulators"), victims.kills["sim"] * 4 * 2 * 2 * 16);
  EXPECT_LE(count("lost_with_learners"), victims.kills["learner"] * 5 * 256);
  EXPECT_LE(count("left"), 2 * 4 * 2 * 2 * 16 + 16 * 2 * 64 + 5 * 256);
  EXPECT_EQ(count("lost_in_restarts"), 0);
  expect_whole_checkpoints();
}

using ChaosLong = Chaos;

TEST_F(ChaosLong, ALearnerKilledAtAnyMomentLeavesWholeCheckpointsAndLosesNoMoreThanSaveEverySec) {
  const int rounds = static_cast<int>(number_of("COMRAD_CHAOS_LEARNER_KILLS", 20));
  Rng rng(chosen_seed());
  constexpr double kSaveEverySeconds = 1, kStatusSeconds = 2.1;  // between two looks that status.json gives
  begin({"--save_every_sec", "1"});
  double worst_s = 0;
  std::deque<double> deaths;
  for (int round = 0; round < rounds; ++round) {
    ASSERT_TRUE(wait_until([&] { return !checkpoints().empty(); }));
    // A learner that has just begun loses what it has learned since then, not the time in which it started.
    sleep_s(kStatusSeconds);
    double frames = env_frames(run_);
    ASSERT_TRUE(wait_until([&] {
      const double now = env_frames(run_);
      return now > std::exchange(frames, now);
    }));
    struct timespec trains {};
    clock_gettime(CLOCK_REALTIME, &trains);
    ASSERT_TRUE(trains_on(2048));
    while (deaths.size() >= kMostDeathsInWindow && now_s() - deaths.front() < kDeathsWindowSeconds)
      sleep_s(0.2);
    if (deaths.size() >= kMostDeathsInWindow) deaths.pop_front();
    sleep_s(0.001 * rng.below(2000));
    const auto learner = processes_of(run_, "comrad-learner");
    ASSERT_EQ(learner.size(), 1u);
    kill(learner[0], SIGKILL);
    deaths.push_back(now_s());
    struct timespec killed {};
    clock_gettime(CLOCK_REALTIME, &killed);
    ASSERT_TRUE(wait_until([&] { return processes_of(run_, "comrad-learner") != learner; }));
    expect_whole_checkpoints();
    double newest_s = static_cast<double>(trains.tv_sec) - kStatusSeconds;
    for (const std::string& path : checkpoints()) {
      struct stat file {};
      if (stat(path.c_str(), &file) == 0)
        newest_s = std::max(newest_s, static_cast<double>(file.st_mtim.tv_sec) +
                                          1e-9 * static_cast<double>(file.st_mtim.tv_nsec));
    }
    const double lost_s =
        static_cast<double>(killed.tv_sec) + 1e-9 * static_cast<double>(killed.tv_nsec) - newest_s;
    worst_s = std::max(worst_s, lost_s);
    // Beyond the interval: the optimizer step in hand, and the writing itself. How long they take is the machine's.
    EXPECT_LT(lost_s, kSaveEverySeconds + 8 * patience()) << "round " << round;
    ASSERT_TRUE(wait_until([&] { return processes_of(run_, "comrad-learner").size() == 1; }));
  }
  ASSERT_TRUE(trains_on(2048));
  const json account = end();
  std::printf(
      "%d kills of the learner: at most %.2f s of learning lost (save_every_sec %.0f), %ld decisions "
      "forgotten, "
      "%ld lost with it\n",
      rounds, worst_s, kSaveEverySeconds, account["forgotten"].get<long>(),
      account["lost_with_learners"].get<long>());
  EXPECT_TRUE(files(run_ + "/checkpoint", ".tmp-").empty()) << "half-written files";
}

/// A folder that is its own small disk while this lives.
class SmallDisk {
 public:
  SmallDisk(std::string folder, const std::string& size) : folder_(std::move(folder)) {
    is_mounted_ = mount("tmpfs", folder_.c_str(), "tmpfs", 0, ("size=" + size).c_str()) == 0;
  }
  SmallDisk(const SmallDisk&) = delete;
  SmallDisk& operator=(const SmallDisk&) = delete;
  ~SmallDisk() {
    if (is_mounted_) umount2(folder_.c_str(), MNT_DETACH);
  }
  bool is_mounted() const { return is_mounted_; }
  bool set_read_only(bool read_only) const {
    return mount("tmpfs", folder_.c_str(), "tmpfs",
                 MS_REMOUNT | (read_only ? static_cast<unsigned long>(MS_RDONLY) : 0UL), nullptr) == 0;
  }

 private:
  std::string folder_;
  bool is_mounted_ = false;
};

TEST_F(Chaos, AFullOrReadOnlyDiskCostsCheckpointsAndNotTheRun) {
  fs::create_directories(run_ + "/checkpoint");
  const SmallDisk disk(run_ + "/checkpoint", "64m");
  if (!disk.is_mounted())
    GTEST_SKIP() << "a small disk cannot be mounted here (it needs root and the right to mount)";
  begin();
  const auto checkpoint_fails = [&] { return comrad({"ctl", run_, "checkpoint"}); };
  ASSERT_TRUE(wait_until([&] { return !checkpoints().empty(); }));

  // Full.
  {
    std::ofstream filler(run_ + "/checkpoint/filler");
    const std::string block(1 << 16, 'x');
    while (filler << block << std::flush) continue;
  }
  const std::vector<std::string> good = checkpoints();
  const Ending full = checkpoint_fails();
  EXPECT_EQ(full.exit_code, 1) << full.out;
  EXPECT_THAT(full.err, HasSubstr("could not be written, training continues"));
  ASSERT_TRUE(trains_on(4096)) << "training stopped on a full disk";
  EXPECT_EQ(checkpoints(), good);
  expect_whole_checkpoints();

  // A learner that dies now goes back to the last good one.
  kill(processes_of(run_, "comrad-learner").at(0), SIGKILL);
  ASSERT_TRUE(wait_until(
      [&] { return read_text(run_ + "/logs/learner-0.log").find("resumed from ") != std::string::npos; }));
  ASSERT_TRUE(trains_on(4096));

  // Room again, then read-only.
  fs::remove(run_ + "/checkpoint/filler");
  EXPECT_EQ(comrad({"ctl", run_, "checkpoint"}).exit_code, 0);
  ASSERT_TRUE(wait_until([&] { return disk.set_read_only(true); })) << "the disk is never at rest";
  EXPECT_EQ(checkpoint_fails().exit_code, 1);
  ASSERT_TRUE(trains_on(4096)) << "training stopped on a read-only disk";
  expect_whole_checkpoints();
  ASSERT_TRUE(disk.set_read_only(false));
  (void)end();
  EXPECT_THAT(ending_.err, HasSubstr("warning: no checkpoint was written"));
  expect_whole_checkpoints();
}

TEST_F(Chaos, ASlowDiskIsNamedAndTheRunContinues) {
  begin({}, {{"LD_PRELOAD", COMRAD_FAULT_SHIM}, {"COMRAD_FAULT_DISK_MS", "1500"}});
  ASSERT_TRUE(wait_until([&] { return !checkpoints().empty(); }));
  ASSERT_TRUE(trains_on(4096));
  (void)end();
  EXPECT_THAT(ending_.err, HasSubstr("warning: writing a checkpoint took"));
  expect_whole_checkpoints();
}

TEST_F(Chaos, AClockThatIsSetWhileItTrainsChangesNothing) {
  begin({}, {{"LD_PRELOAD", COMRAD_FAULT_SHIM}, {"COMRAD_FAULT_CLOCK_S", std::to_string(kClockJumpSeconds)}});
  ASSERT_TRUE(trains_on(4096));
  kill(processes_of(run_, "comrad-sim-worker").at(0), SIGKILL);
  ASSERT_TRUE(trains_on(4096));
  (void)end();
  EXPECT_THAT(ending_.err, HasSubstr("sim-"));
  double last_s = 0;
  for (const json& report : read_json_lines(run_ + "/metrics.jsonl")) {
    EXPECT_GE(report["time_s"].get<double>(), last_s);
    last_s = report["time_s"];
  }
  EXPECT_GT(last_s, 0);
  EXPECT_LT(last_s, kClockJumpSeconds) << "the jump was taken for training";
  const json status = read_json(run_ + "/status.json");
  EXPECT_LT(status["elapsed_s"].get<double>(), kClockJumpSeconds);
}

/// A control group that this process may put a child into; removed with it.
class MemoryGroup {
 public:
  MemoryGroup() {
    struct Try {
      const char *root, *limit;
    };
    for (const Try& version :
         {Try{"/sys/fs/cgroup", "memory.max"}, Try{"/sys/fs/cgroup/memory", "memory.limit_in_bytes"}}) {
      const std::string folder = std::string(version.root) + "/comrad-chaos-" + std::to_string(getpid());
      std::ofstream(std::string(version.root) + "/cgroup.subtree_control") << "+memory";
      if (mkdir(folder.c_str(), 0755) != 0) continue;
      folder_ = folder;
      limit_ = folder + "/" + version.limit;
      if (fs::exists(limit_)) return;
      rmdir(folder_.c_str());
      folder_.clear();
    }
  }
  MemoryGroup(const MemoryGroup&) = delete;
  MemoryGroup& operator=(const MemoryGroup&) = delete;
  ~MemoryGroup() {
    if (!folder_.empty()) rmdir(folder_.c_str());
  }
  bool limit(int64_t bytes) const {
    if (folder_.empty()) return false;
    std::ofstream file(limit_);
    return static_cast<bool>(file << bytes << std::flush);
  }
  const std::string& folder() const { return folder_; }

 private:
  std::string folder_, limit_;
};

TEST_F(Chaos, AMemoryLimitThatIsTooLowIsRefusedWithNumbers) {
  const MemoryGroup group;
  if (!group.limit(400 << 20))
    GTEST_SKIP() << "no control group with a memory limit can be made here (it needs root)";
  std::string line = "echo $$ > '" + group.folder() + "/cgroup.procs' && exec";
  for (const std::string& word :
       small_training(scratch_, "run", 8192, {"--num_envs_per_worker", "96", "--rollout", "64"}))
    line += " '" + word + "'";
  const Ending ending = RunningProgram({"/bin/bash", "-c", line}).wait();
  EXPECT_FALSE(ending.timed_out);
  EXPECT_THAT(ending.exit_code, AnyOf(1, 2)) << ending.err;
  EXPECT_THAT(ending.err,
              AllOf(HasSubstr("MB"), HasSubstr("control group"), HasSubstr("--num_envs_per_worker")));
}

}  // namespace chaos_test
}  // namespace comrad::test
