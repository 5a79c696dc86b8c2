// `comrad sweep` with a real Slurm of one node: munged, slurmctld and slurmd in a scratch folder, without a database and
// without control groups. What the elements of the array make is the stand-in of sweep_probe.cc.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <random>
#include <sstream>

#include "tests/integration/running_program.h"

namespace comrad::testing {
namespace {

using ::testing::ContainsRegex;
using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr double kWaitSeconds = 90;
constexpr double kSettleSeconds = 5;  // of a requeued job: slurmd still clears away what it ran before

std::string found_program(const std::string& name) {
  for (const char* folder : {"/usr/sbin/", "/usr/bin/", "/usr/local/sbin/", "/usr/local/bin/"})
    if (access((folder + name).c_str(), X_OK) == 0) return folder + name;
  return "";
}

int free_port() {
  const int listener = socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  socklen_t size = sizeof address;
  bind(listener, reinterpret_cast<sockaddr*>(&address), size);
  getsockname(listener, reinterpret_cast<sockaddr*>(&address), &size);
  close(listener);
  return ntohs(address.sin_port);
}

/// The daemons, for as long as it lives. They stay in the foreground, so that they end with the test.
class Cluster {
 public:
  /// Empty, or why Slurm cannot run here.
  std::string start() {
    for (const char* name : {"munged", "slurmctld", "slurmd", "sbatch", "squeue", "scontrol", "scancel"})
      if (found_program(name).empty())
        return std::string(name) +
               " is not installed (deploy/packages_test.txt: slurmctld, slurmd, slurm-client, munge)";
    if (geteuid() != 0) return "slurmd must be started by root";
    char host[256] = "localhost";
    gethostname(host, sizeof host - 1);
    if (char* dot = std::strchr(host, '.')) *dot = '\0';
    const std::string folder = folder_.string();
    std::string key(128, '\0');
    std::random_device random;
    for (char& byte : key) byte = static_cast<char>(random());
    const std::string key_file = folder_.write("munge.key", key);
    fs::permissions(key_file, fs::perms::owner_read | fs::perms::owner_write);
    fs::create_directories(folder_ / "state");
    fs::create_directories(folder_ / "spool");
    configuration_ = folder_.write(
        "slurm.conf",
        "ClusterName=test\nSlurmctldHost=" + std::string(host) + "(127.0.0.1)\nSlurmctldPort=" +
            std::to_string(free_port()) + "\nSlurmdPort=" + std::to_string(free_port()) +
            "\nSlurmUser=root\nSlurmdUser=root\nAuthType=auth/munge\nAuthInfo=socket=" + folder +
            "/munge.socket,cred_expire=2\nCredType=cred/munge\nSlurmctldPidFile=" + folder +
            "/slurmctld.pid\nSlurmdPidFile=" + folder + "/slurmd.pid\nStateSaveLocation=" + folder +
            "/state\nSlurmdSpoolDir=" + folder +
            "/spool\nProctrackType=proctrack/linuxproc\nTaskPlugin=task/none\nSwitchType=switch/"
            "none\nMpiDefault=none\n"
            "SelectType=select/"
            "cons_tres\nSelectTypeParameters=CR_CPU_Memory\nSlurmdParameters=config_overrides\n"
            "AccountingStorageType=accounting_storage/none\nJobAcctGatherType=jobacct_gather/none\n"
            "JobCompType=jobcomp/"
            "none\nReturnToService=2\nKillWait=20\nSchedulerParameters=sched_min_interval=100000\n"
            "NodeName=" +
            std::string(host) +
            " NodeAddr=127.0.0.1 CPUs=4 RealMemory=8000 State=UNKNOWN\nPartitionName=main Nodes=" + host +
            " Default=YES MaxTime=INFINITE State=UP\n");
    environment_ = {{"SLURM_CONF", configuration_}};
    daemons_.push_back(std::make_unique<RunningProgram>(std::vector<std::string>{
        found_program("munged"), "--foreground", "--force", "--key-file=" + key_file,
        "--socket=" + folder + "/munge.socket", "--pid-file=" + folder + "/munged.pid",
        "--log-file=" + folder + "/munged.log", "--seed-file=" + folder + "/munge.seed"}));
    if (!wait_until([&] { return fs::exists(folder_ / "munge.socket"); }, 20))
      return "munged does not start: " + failure();
    daemons_.push_back(std::make_unique<RunningProgram>(
        std::vector<std::string>{found_program("slurmctld"), "-D", "-f", configuration_}, environment_));
    daemons_.push_back(std::make_unique<RunningProgram>(
        std::vector<std::string>{found_program("slurmd"), "-D", "-N", host, "-f", configuration_},
        environment_));
    const bool is_up = wait_until([&] { return ask({"sinfo", "-h", "-o", "%T"}).find("idle") == 0; }, 30);
    return is_up ? "" : "slurmctld and slurmd do not come up: " + failure();
  }

  /// What a program of Slurm prints.
  std::string ask(std::vector<std::string> command) const {
    command[0] = found_program(command[0]);
    return RunningProgram(command, environment_).wait(20).out;
  }
  /// Whatever waits for its turn after a requeue may start: Slurm holds it for two minutes, an administrator need not. One
  /// that starts while its first run is being cleared away fails.
  void hurry() {
    std::map<std::string, double> since;
    std::istringstream ids(ask({"squeue", "-h", "-r", "-t", "PENDING", "-o", "%i"}));
    for (std::string id; ids >> id;) {
      since[id] = pending_since_s_.contains(id) ? pending_since_s_[id] : now_s();
      if (now_s() - since[id] > kSettleSeconds) ask({"scontrol", "update", "JobId=" + id, "StartTime=now"});
    }
    pending_since_s_ = since;
  }
  const Environment& environment() const { return environment_; }
  std::string string() const { return folder_.string(); }

 private:
  std::string failure() {
    std::string text;
    for (const auto& daemon : daemons_)
      if (!daemon->running()) text += daemon->wait(1).err;
    return text.empty() ? "no answer" : text.substr(0, 300);
  }

  ScratchFolder folder_;
  std::string configuration_;
  Environment environment_;
  std::vector<std::unique_ptr<RunningProgram>> daemons_;
  std::map<std::string, double> pending_since_s_;
};

int count(const std::string& text, const std::string& part) {
  int found = 0;
  for (std::size_t place = text.find(part); place != std::string::npos; place = text.find(part, place + 1))
    ++found;
  return found;
}

TEST(SlurmSweep, MakesAnArrayThatIsRequeuedResumedAndReported) {
  Cluster cluster;
  if (const std::string why = cluster.start(); !why.empty()) GTEST_SKIP() << "no Slurm here: " << why;
  const ScratchFolder scratch;
  const auto write = [&](const std::string& seeds, const std::string& frames) {
    return scratch.write("study.toml",
                         "name = \"study\"\nbackend = \"slurm\"\ntrain_dir = \"" + scratch.string() +
                             "\"\nreport = \"echo reported; cat events.log > seen.txt\"\n[axes]\nseed = [" +
                             seeds + "]\n[settings]\nscenario = \"field\"\ntrain_for_env_frames = " + frames +
                             "\n[resources]\ncores = 1\nmemory_gb = 0.1\n[slurm]\npartition = \"main\"\n"
                             "time = \"1\"\nsignal_before_s = 50\nsetup = [\"export COMRAD_SET_UP=1\"]\n");
  };
  const auto events = [&] { return read_text(scratch / "study/events.log"); };
  const auto start = [&](const std::string& file) {
    return RunningProgram({COMRAD_SWEEP_PROBE, "start", file}, cluster.environment()).wait(60);
  };
  const auto status = [&] {
    return nlohmann::json::parse(
        comrad({"sweep", "status", (scratch / "study").string(), "--json"}, 60, cluster.environment()).out,
        nullptr, false);
  };

  // One run that ends, one that fails, one that is killed, one that is longer than the time limit.
  const std::string file = write("1, 600, 700, 800", "2000");
  Ending submitted = start(file);
  ASSERT_EQ(submitted.exit_code, 0) << submitted.err;
  EXPECT_THAT(submitted.err, ContainsRegex("job array [0-9]+: 4 runs"));
  // Nothing is submitted twice.
  Ending again = start(file);
  EXPECT_EQ(again.exit_code, 0) << again.err;
  EXPECT_THAT(again.err, HasSubstr("nothing to submit"));

  ASSERT_TRUE(wait_until(
      [&] { return count(events(), "seed700 begins 1000 ") == 1 || (cluster.hurry(), false); }, kWaitSeconds))
      << events() << cluster.ask({"squeue", "-r"});  // seed 700, killed and resumed
  const nlohmann::json seen = status();
  ASSERT_TRUE(seen.is_object());
  EXPECT_EQ(seen["failed"], 1);
  EXPECT_EQ(seen["runs"][1]["error"], "seed 600 is unlucky");
  EXPECT_EQ(seen["runs"][2]["attempts"], 2);
  EXPECT_THAT(seen["runs"][2]["job"].get<std::string>(), ContainsRegex("^[0-9]+_2$"));

  // The time limit comes near: the run saves, is queued again and goes on from there.
  ASSERT_TRUE(wait_until(
      [&] {
        return (count(events(), "seed800 ends paused") >= 1 && count(events(), "seed800 begins") >= 2) ||
               (cluster.hurry(), false);
      },
      kWaitSeconds))
      << events() << cluster.ask({"squeue", "-r"}) << status();
  EXPECT_EQ(count(events(), "seed800 begins 0 "), 1) << events();

  // All ends are reached, the failed run's aside; only then the report is made.
  ASSERT_TRUE(wait_until([&] { return fs::exists(scratch / "study/seen.txt") || (cluster.hurry(), false); },
                         2 * kWaitSeconds))
      << events() << cluster.ask({"squeue", "-r"});
  const nlohmann::json done = status();
  EXPECT_EQ(done["finished"], 3) << done;
  EXPECT_EQ(done["failed"], 1) << done;
  EXPECT_EQ(count(events(), "meets another"), 0);
  EXPECT_EQ(count(read_text(scratch / "study/seen.txt"), "ends finished"), 3);

  // The same command submits what failed and what is new; `stop` empties the queue and lets what runs save.
  submitted = start(write("1, 600, 700, 800, 3", "6000000"));
  EXPECT_THAT(submitted.err, ContainsRegex("job array [0-9]+: 5 runs")) << submitted.err;
  ASSERT_TRUE(wait_until([&] { return status()["running"] == 4; }, kWaitSeconds)) << events();
  const Ending stopped = comrad({"sweep", "stop", (scratch / "study").string()}, 60, cluster.environment());
  EXPECT_EQ(stopped.exit_code, 0) << stopped.err;
  ASSERT_TRUE(wait_until(
      [&] {
        return cluster.ask({"squeue", "-h"}).empty();
      },
      kWaitSeconds))
      << cluster.ask({"squeue", "-r"});
  EXPECT_GE(count(events(), "seed3 ends paused"), 1) << events();
  EXPECT_EQ(status()["interrupted"], 4);
}

TEST(SlurmScript, ARunNearItsTimeLimitIsQueuedAgainUnderItsName) {
  Cluster cluster;
  if (const std::string why = cluster.start(); !why.empty()) GTEST_SKIP() << "no Slurm here: " << why;
  const ScratchFolder scratch;
  // `comrad train`: saves when it is told to stop; the second time it reaches its goal. A seed of 600 is bad input.
  const std::string program = scratch.write(
      "comrad",
      "#!/bin/bash\nevents=" + scratch.string() +
          "/events\necho \"begins $*\" >> $events\n[[ \"$*\" != *600* ]] || exit 2\n"
          "trap 'echo saved >> $events; exit 0' TERM\n[[ -z \"${SLURM_RESTART_COUNT:-}\" ]] || exit 0\n"
          "for _ in {1..3000}; do sleep 0.1; done\n");
  fs::permissions(program, fs::perms::owner_all);
  const auto events = [&] { return read_text(scratch / "events"); };
  Environment environment = cluster.environment();
  environment["COMRAD"] = program;
  const auto submit = [&](const std::vector<std::string>& words) {
    std::vector<std::string> command = {found_program("sbatch"),
                                        "--parsable",
                                        "--time=1",
                                        "--mem=100M",
                                        "--signal=B:USR1@50",
                                        "--cpus-per-task=1",
                                        "--output=" + scratch.string() + "/%j.log",
                                        std::string(COMRAD_SOURCE_DIR) + "/deploy/slurm/train.sbatch"};
    command.insert(command.end(), words.begin(), words.end());
    const std::string printed = RunningProgram(command, environment).wait(30).out;
    return printed.substr(0, printed.find('\n'));
  };
  const auto state_of = [&](const std::string& job) { return cluster.ask({"scontrol", "show", "job", job}); };

  const std::string bad = submit({"--scenario", "field", "--seed", "600"});
  ASSERT_TRUE(
      wait_until([&] { return state_of(bad).find("JobState=FAILED") != std::string::npos; }, kWaitSeconds))
      << state_of(bad);
  EXPECT_THAT(state_of(bad), HasSubstr("ExitCode=2:0"));
  EXPECT_EQ(count(events(), "begins"), 1) << events();

  const std::string job = submit({"--scenario", "field", "--seed", "1"});
  ASSERT_TRUE(wait_until(
      [&] {
        cluster.hurry();
        return state_of(job).find("JobState=COMPLETED") != std::string::npos;
      },
      2 * kWaitSeconds))
      << events() << state_of(job) << read_text(scratch / (job + ".log"));
  EXPECT_EQ(count(events(), "begins train --scenario field --seed 1 --experiment slurm_" + job + "\n"), 2)
      << events();
  EXPECT_EQ(count(events(), "saved"), 1) << events();
  EXPECT_THAT(read_text(scratch / (job + ".log")), HasSubstr("is queued again"));
}

}  // namespace
}  // namespace comrad::testing
