// A real Slurm of one node for a test: munged, slurmctld and slurmd in a scratch folder, without a database and without
// control groups.
#pragma once

#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <map>
#include <memory>
#include <random>
#include <sstream>
#include <string>
#include <vector>

#include "tests/integration/running_program.h"

namespace comrad::test {

namespace fs = std::filesystem;

constexpr double kSettleSeconds = 5;  // of a requeued job: slurmd still clears away what it ran before

inline std::string found_program(const std::string& name) {
  for (const char* folder : {"/usr/sbin/", "/usr/bin/", "/usr/local/sbin/", "/usr/local/bin/"})
    if (access((folder + name).c_str(), X_OK) == 0) return folder + name;
  return "";
}

inline int free_port() {
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
            "/munge.socket\nCredType=cred/munge\nSlurmctldPidFile=" + folder +
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
    if (!wait_until([&] { return fs::exists(folder_ / "munge.socket"); }))
      return "munged does not start: " + failure();
    daemons_.push_back(std::make_unique<RunningProgram>(
        std::vector<std::string>{found_program("slurmctld"), "-D", "-f", configuration_}, environment_));
    daemons_.push_back(std::make_unique<RunningProgram>(
        std::vector<std::string>{found_program("slurmd"), "-D", "-N", host, "-f", configuration_},
        environment_));
    const bool is_up = wait_until([&] { return ask({"sinfo", "-h", "-o", "%T"}).find("idle") == 0; });
    return is_up ? "" : "slurmctld and slurmd do not come up: " + failure();
  }

  /// What a program of Slurm prints.
  std::string ask(std::vector<std::string> command) const {
    command[0] = found_program(command[0]);
    return RunningProgram(command, environment_).wait().out;
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
      if (!daemon->running()) text += daemon->wait().err;
    return text.empty() ? "no answer" : text.substr(0, 300);
  }

  ScratchFolder folder_;
  std::string configuration_;
  Environment environment_;
  std::vector<std::unique_ptr<RunningProgram>> daemons_;
  std::map<std::string, double> pending_since_s_;
};

}  // namespace comrad::test
