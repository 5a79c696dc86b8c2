// Runs of several hosts for longer than the suite has time: four hosts, a bad line, processes that stand still, a slow
// learner, two runs on one network, hosts called through ssh and by srun. Label long:
//
//   ctest -L long -R hosts_long_test

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>
#include <memory>
#include <sstream>

#include "tests/integration/decision_accounts.h"
#include "tests/integration/running_program.h"
#include "tests/integration/slurm_cluster.h"
#include "tests/support/network_pair.h"
#include "tests/support/network_star.h"

namespace comrad::test {
namespace hosts_long_test {

using ::testing::HasSubstr;
using Words = std::vector<std::string>;

constexpr double kStartSeconds = 180;

std::size_t hosts_with_deliveries(const std::string& run) {
  std::size_t count = 0;
  const nlohmann::json peers = read_json(run + "/guests.json");
  if (peers.is_object())
    for (const auto& peer : peers["guests"]) count += peer["decisions_delivered"].get<double>() > 0;
  return count;
}

/// Its own memory: pages of the arena become resident as slabs are first used.
double private_mb(const std::string& folder, const std::string& name) {
  double sum = 0;
  for (const pid_t pid : processes_of(folder, name)) {
    std::ifstream statm("/proc/" + std::to_string(pid) + "/statm");
    double total = 0, resident = 0, shared = 0;
    statm >> total >> resident >> shared;
    sum += (resident - shared) * 4096 / 1e6;
  }
  return sum;
}

/// The newest line of a run's metrics.jsonl; empty where there is none yet.
nlohmann::json last_report(const std::string& run) {
  std::ifstream file(run + "/metrics.jsonl");
  std::string line, last;
  while (std::getline(file, line)) last = line;
  const nlohmann::json report = nlohmann::json::parse(last, nullptr, /*allow_exceptions=*/false);
  return report.is_object() ? report : nlohmann::json::object();
}

/// A run that serves and hosts that play for it, on hosts in `on`.
class HostRuns : public ::testing::Test {
 protected:
  using On = std::function<Words(int host, const Words& command)>;

  std::unique_ptr<RunningProgram> start_learner(const On& on, const std::string& name,
                                                const std::string& device, const Words& more = {}) {
    Words flags = {"--num_workers", "1",    "--serve",           "--serve_workers", "8",
                   "--interface",   device, "--insecure_network"};
    flags.insert(flags.end(), more.begin(), more.end());
    auto learner = std::make_unique<RunningProgram>(on(0, small_training(scratch_, name, 1e9, flags)));
    EXPECT_TRUE(
        wait_until([&] { return env_frames(scratch_ / name) > 0 || !learner->running(); }, kStartSeconds));
    EXPECT_TRUE(learner->running()) << learner->wait(1).err;
    return learner;
  }
  std::string address(const std::string& run) const {
    const std::string text = read_text(scratch_ / run / "link_address");
    return text.substr(0, text.find('\n'));
  }
  std::unique_ptr<RunningProgram> start_player(const On& on, int host, const std::string& run,
                                               const std::string& name) {
    return std::make_unique<RunningProgram>(
        on(host, {program("comrad"), "join", address(run), "--insecure_network", "--num_workers", "1",
                  "--device", "cpu", "--train_dir", scratch_.string(), "--experiment", name,
                  "--progress_interval", "1", "--wait_s", "60"}));
  }
  void end(RunningProgram& running, const std::string& name) {
    running.signal(SIGINT);
    const Ending ending = running.wait(30);
    EXPECT_EQ(ending.exit_code, 0) << name << ": " << ending.err;
    (void)checked_account(scratch_ / name);
  }
  bool delivers_more(const std::string& run, double timeout_s) {
    const double before = decisions_delivered(scratch_ / run);
    return wait_until([&] { return decisions_delivered(scratch_ / run) > before; }, timeout_s);
  }
  void stop_for_ten_seconds(const std::string& run, const std::string& worker) {
    const std::vector<pid_t> pids = processes_of(scratch_ / run, worker);
    ASSERT_FALSE(pids.empty()) << worker;
    kill(pids[0], SIGSTOP);
    sleep_s(10);
    kill(pids[0], SIGCONT);
  }

  ScratchFolder scratch_;
};

/// Where a run stands, for what it did between two looks.
struct Look {
  double time_s = now_s(), trained = 0, delivered = 0, bytes = 0, sent_bytes = 0;
  std::map<std::string, double> cpu_s;
};

TEST_F(HostRuns, FourHostsTrainTogether) {
  const test::NetworkStar network(4, 1);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const On on = [&](int host, const Words& command) { return network.on(host, command); };
  const std::string run = scratch_ / "learning";
  const auto look = [&] {
    Look now;
    const nlohmann::json status = read_json(run + "/status.json");
    now.trained = status["decisions_account"]["trained"];
    now.delivered = decisions_delivered(run);
    for (const auto& [role, seconds] : status["cpu_s"].items()) now.cpu_s[role] = seconds;
    const auto counter = [&](const char* name) {
      const std::string file = "/sys/class/net/" + network.device(0) + "/statistics/" + name;
      return std::strtod(RunningProgram(on(0, {"/bin/cat", file})).wait(10).out.c_str(), nullptr);
    };
    now.bytes = counter("rx_bytes");
    now.sent_bytes = counter("tx_bytes");
    return now;
  };
  const auto measure = [&](int hosts) {
    const Look before = look();
    sleep_s(number_of("COMRAD_HOSTS_WINDOW_S", 20));
    const Look now = look();
    const double seconds = now.time_s - before.time_s, trained = now.trained - before.trained,
                 delivered = now.delivered - before.delivered;
    std::printf("%d hosts: %.0f decisions/s trained on, %.0f of them from other hosts", hosts,
                trained / seconds, delivered / seconds);
    if (delivered > 0)
      std::printf(", %.0f bytes each; %.1f MB/s sent", (now.bytes - before.bytes) / delivered,
                  (now.sent_bytes - before.sent_bytes) / seconds / 1e6);
    double all_cpu_s = 0, receiver_cpu_s = 0;
    for (const auto& [role, cpu_s] : now.cpu_s) {
      const double used_s = cpu_s - (before.cpu_s.contains(role) ? before.cpu_s.at(role) : 0);
      const bool is_receiver = role == "trajectory receiver";
      const double count = is_receiver ? delivered : trained;
      all_cpu_s += used_s;
      if (is_receiver) receiver_cpu_s = used_s;
      if (count > 0) std::printf("; %s %.3f CPU s per 1000", role.c_str(), used_s / count * 1000);
    }
    if (all_cpu_s > 0)
      std::printf("; receiver %.1f %% of the CPU s of the learner's host", 100 * receiver_cpu_s / all_cpu_s);
    const nlohmann::json report = last_report(run);
    std::printf("; policy lag %.1f versions, at most %.0f\n", report.value("train/version_diff_avg", -1.0),
                report.value("train/version_diff_max", -1.0));
    EXPECT_GT(trained, 0);
  };
  const char* more = std::getenv("COMRAD_HOSTS_FLAGS");  // of the run, to measure what they change
  std::istringstream flags(more == nullptr ? "" : more);
  const auto learner =
      start_learner(on, "learning", network.device(0), {std::istream_iterator<std::string>(flags), {}});
  measure(1);
  std::vector<std::unique_ptr<RunningProgram>> players;
  for (int host = 1; host < 4; ++host) {
    players.push_back(start_player(on, host, "learning", "playing" + std::to_string(host)));
    EXPECT_TRUE(wait_until([&] { return hosts_with_deliveries(run) == static_cast<std::size_t>(host); },
                           kStartSeconds));
    measure(host + 1);
  }
  for (int host = 1; host < 4; ++host)
    end(*players[static_cast<std::size_t>(host - 1)], "playing" + std::to_string(host));
  end(*learner, "learning");
}

TEST_F(HostRuns, ALineThatDelaysLosesSwapsAndDoublesCostsNoDecision) {
  const test::NetworkPair near(21), far(22);
  if (!near.is_made() || !far.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  // Two cables whose far ends lie on one host, with the relay between them; both ends get addresses of one network.
  const auto run = [](const Words& command) { return RunningProgram(command).wait(10).exit_code; };
  const std::string ip = "/usr/sbin/ip";
  ASSERT_EQ(run(near.on(1, {ip, "addr", "flush", "dev", near.device(1)})), 0);
  ASSERT_EQ(run(far.on(1, {ip, "addr", "flush", "dev", far.device(1)})), 0);
  ASSERT_EQ(run(far.on(1, {ip, "link", "set", far.device(1), "netns", near.name(1)})), 0);
  ASSERT_EQ(run(near.on(1, {ip, "link", "set", far.device(1), "up"})), 0);
  ASSERT_EQ(run(far.on(0, {ip, "addr", "flush", "dev", far.device(0)})), 0);
  ASSERT_EQ(run(far.on(0, {ip, "addr", "add", "10.77.21.9/24", "dev", far.device(0)})), 0);
  RunningProgram line(
      near.on(1, {COMRAD_BAD_LINE, near.device(1), far.device(1), "25", "0.01", "0.01", "0.02", "7"}));
  const On on = [&](int host, const Words& command) {
    return host == 0 ? near.on(0, command) : far.on(0, command);
  };
  const auto learner = start_learner(on, "learning", near.device(0));
  const auto player = start_player(on, 1, "learning", "playing");
  ASSERT_TRUE(delivers_more("learning", kStartSeconds)) << player->wait(1).err;
  const Ending way = RunningProgram(on(1, {program("comrad"), "doctor", "--hosts", address("learning"),
                                           "--insecure_network", "--json"}))
                         .wait(90);
  EXPECT_THAT(way.out, HasSubstr("round trip")) << way.err;
  std::printf("%s\n", way.out.c_str());
  const double began_s = now_s(), before = decisions_delivered(scratch_ / "learning");
  sleep_s(30);
  std::printf("%.0f decisions/s delivered through 50 ms round trip, 1 %% loss\n",
              (decisions_delivered(scratch_ / "learning") - before) / (now_s() - began_s));
  EXPECT_GT(decisions_delivered(scratch_ / "learning"), before);
  end(*player, "playing");
  end(*learner, "learning");
}

TEST_F(HostRuns, ProcessesThatStandStillForTenSecondsBlockNoOtherForGood) {
  const test::NetworkPair network(23);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const On on = [&](int host, const Words& command) { return network.on(host, command); };
  const auto learner = start_learner(on, "learning", network.device(0));
  const auto player = start_player(on, 1, "learning", "playing");
  ASSERT_TRUE(delivers_more("learning", kStartSeconds)) << player->wait(1).err;
  for (const auto& [run, worker] : {std::pair<std::string, std::string>{"playing", "comrad-sim-worker"},
                                    {"playing", "comrad-policy-worker"},
                                    {"learning", "comrad-learner"},
                                    {"playing", "comrad-trajectory-sender"},
                                    {"learning", "comrad-trajectory-receiver"}}) {
    stop_for_ten_seconds(run, worker);
    EXPECT_TRUE(delivers_more("learning", 60)) << "after " << worker << " stood still";
    EXPECT_TRUE(player->running() && learner->running()) << worker;
  }
  end(*player, "playing");
  end(*learner, "learning");
}

TEST_F(HostRuns, ASlowLearnerFillsNoMemory) {
  const test::NetworkPair network(24);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const On on = [&](int host, const Words& command) { return network.on(host, command); };
  const auto learner =
      start_learner(on, "learning", network.device(0),
                    {"--num_epochs", "40", "--learner_threads", "1", "--save_every_sec", "1e6"});
  const auto player = start_player(on, 1, "learning", "playing");
  ASSERT_TRUE(delivers_more("learning", kStartSeconds)) << player->wait(1).err;
  sleep_s(20);  // everything that may fill is full by then
  const std::vector<std::string> programs = {"comrad-trajectory-receiver", "comrad-trajectory-sender",
                                             "comrad"};
  std::map<std::string, double> before;
  for (const std::string& name : programs)
    for (const char* run : {"learning", "playing"}) before[name + run] = private_mb(scratch_ / run, name);
  sleep_s(40);
  for (const std::string& name : programs)
    for (const char* run : {"learning", "playing"}) {
      const double now = private_mb(scratch_ / run, name);
      EXPECT_LT(now, before[name + run] + 16) << name << " of " << run;
      std::printf("%s of %s: %.0f MB, 40 s later %.0f MB\n", name.c_str(), run, before[name + run], now);
    }
  end(*player, "playing");
  end(*learner, "learning");
}

TEST_F(HostRuns, TwoRunsOnOneNetworkNeverMix) {
  const test::NetworkPair network(25);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const On on = [&](int host, const Words& command) { return network.on(host, command); };
  const auto one = start_learner(on, "one", network.device(0));
  const auto two = start_learner(on, "two", network.device(0), {"--seed", "43"});
  const auto plays_one = start_player(on, 1, "one", "plays_one"),
             plays_two = start_player(on, 1, "two", "plays_two");
  ASSERT_TRUE(delivers_more("one", kStartSeconds));
  ASSERT_TRUE(delivers_more("two", kStartSeconds));
  end(*plays_one, "plays_one");
  ASSERT_TRUE(delivers_more("two", 60));
  end(*plays_two, "plays_two");
  for (const char* run : {"one", "two"}) {
    const nlohmann::json account =
        read_json(scratch_ / (std::string("plays_") + run) / "status.json")["decisions_account"];
    const auto peers = [&] { return read_json(scratch_ / run / "guests.json")["guests"]; };
    ASSERT_EQ(peers().size(), 1u) << peers();
    // The file is written now and then.
    EXPECT_TRUE(wait_until([&] { return peers()[0]["decisions_delivered"] == account["trained"]; }, 10))
        << run << " had " << peers() << " delivered, which sent " << account;
  }
  end(*one, "one");
  end(*two, "two");
}

TEST_F(HostRuns, SshCallsAHostAndEveryReasonWhyNotIsReported) {
  const test::NetworkPair network(26);
  if (!network.is_made()) GTEST_SKIP() << test::NetworkPair::why_not();
  const std::string sshd = found_program("sshd"), keygen = found_program("ssh-keygen");
  if (sshd.empty() || keygen.empty())
    GTEST_SKIP() << "sshd is not installed (deploy/packages_test.txt: openssh-server)";
  for (const char* key : {"host_key", "user_key"})
    ASSERT_EQ(
        RunningProgram({keygen, "-q", "-t", "ed25519", "-N", "", "-f", scratch_ / key}).wait(20).exit_code,
        0);
  std::filesystem::create_directories("/run/sshd");
  const std::string there = scratch_ / "there";
  std::filesystem::create_directories(there);
  std::filesystem::permissions(scratch_.string(), std::filesystem::perms::owner_all);
  const std::string config = scratch_.write(
      "sshd_config",
      "Port 22\nListenAddress " + network.address(1) + "\nHostKey " + (scratch_ / "host_key").string() +
          "\nAuthorizedKeysFile " + (scratch_ / "user_key.pub").string() +
          "\nStrictModes no\nUsePAM no\nPasswordAuthentication no\nPermitRootLogin yes\nPidFile none\n"
          "ForceCommand cd " +
          there + "; eval \"$SSH_ORIGINAL_COMMAND\"\n");
  RunningProgram daemon(network.on(1, {sshd, "-D", "-e", "-f", config}));
  const std::string knock = "exec 3<>/dev/tcp/" + network.address(1) + "/22";
  ASSERT_TRUE(wait_until(
      [&] {
        return RunningProgram(network.on(0, {"/bin/bash", "-c", knock})).wait(10).exit_code == 0;
      },
      30))
      << "sshd does not listen";
  // ssh as the user has it, but for where its keys lie.
  const std::string ssh_config = scratch_.write(
      "ssh_config",
      "IdentityFile " + (scratch_ / "user_key").string() +
          "\nIdentitiesOnly yes\nUserKnownHostsFile /dev/null\nStrictHostKeyChecking no\nLogLevel ERROR\n");
  const std::string wrapper =
      scratch_.write("bin/ssh", "#!/bin/sh\nexec /usr/bin/ssh -F " + ssh_config + " \"$@\"\n");
  std::filesystem::permissions(wrapper, std::filesystem::perms::owner_all);
  const Environment environment = {{"PATH", (scratch_ / "bin").string() + ":/usr/sbin:/usr/bin:/sbin:/bin"}};

  const Ending way =
      RunningProgram(
          network.on(0, {program("comrad"), "doctor", "--hosts", network.address(1), "--insecure_network"}),
          environment)
          .wait(90);
  EXPECT_THAT(way.out, HasSubstr("round trip")) << way.err;
  EXPECT_THAT(way.out, HasSubstr("clock")) << way.out;
  std::printf("%s\n", way.out.c_str());

  RunningProgram learner(network.on(0, small_training(scratch_, "learning", 1e9,
                                                      {"--num_workers", "1", "--hosts",
                                                       network.address(1) + ",no-user@" + network.address(1),
                                                       "--insecure_network"})),
                         environment);
  const std::string log = scratch_ / "learning/logs/supervisor.log";
  EXPECT_TRUE(wait_until([&] { return decisions_delivered(scratch_ / "learning") > 0 || !learner.running(); },
                         kStartSeconds))
      << read_text(log);
  EXPECT_THAT(read_text(log), HasSubstr("Permission denied"));
  EXPECT_THAT(read_text(log), HasSubstr("is called again in"));
  learner.signal(SIGINT);
  const Ending ended = learner.wait(30);
  EXPECT_EQ(ended.exit_code, 0) << ended.err;
  (void)checked_account(scratch_ / "learning");
  EXPECT_TRUE(wait_until([&] { return processes_of(there).empty(); }, 20))
      << "the other host has left as well";
  daemon.signal(SIGTERM);
}

TEST_F(HostRuns, AnAllocationOfTwoTasksTrainsWithBoth) {
  Cluster cluster;
  if (const std::string why = cluster.start(); !why.empty()) GTEST_SKIP() << "no Slurm here: " << why;
  std::string script = "#!/bin/bash\ncd " + scratch_.string() + "\nexec";
  for (const std::string& word : small_training(scratch_, "learning", 400000, {"--num_workers", "1"}))
    script += " " + word;
  const std::string job = scratch_.write("job.sh", script + "\n");
  RunningProgram(Words{found_program("sbatch"), "--ntasks=2", "--cpus-per-task=1", "--mem=6G",
                       "--output=" + scratch_.string() + "/job.log", job},
                 cluster.environment())
      .wait(30);
  EXPECT_TRUE(wait_until([&] { return decisions_delivered(scratch_ / "learning") > 0; }, kStartSeconds))
      << read_text(scratch_ / "job.log") << cluster.ask({"squeue"});
  EXPECT_TRUE(wait_until(
      [&] {
        return cluster.ask({"squeue", "-h"}).empty();
      },
      2 * kStartSeconds))
      << read_text(scratch_ / "job.log");
  EXPECT_EQ(read_json(scratch_ / "learning/status.json")["state"], "finished")
      << read_text(scratch_ / "job.log");
  (void)checked_account(scratch_ / "learning");
}

}  // namespace hosts_long_test
}  // namespace comrad::test
