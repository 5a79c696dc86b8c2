// Two hosts in one: network namespaces joined by a veth pair, which a test makes, cuts and removes. Needs root and the
// `ip` program; can_make() returns why it is unavailable.
#pragma once

#include <fcntl.h>
#include <sched.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <functional>
#include <string>
#include <vector>

namespace comrad::test {

class NetworkPair {
 public:
  /// `subnet` distinguishes pairs of one process: addresses are 10.77.<subnet>.1 and .2.
  explicit NetworkPair(int subnet = 1) : subnet_(subnet) {
    const std::string id = std::to_string(getpid()) + "x" + std::to_string(subnet);
    for (int end = 0; end < 2; ++end) {
      namespaces_.push_back("comrad-" + id + (end == 0 ? "a" : "b"));
      devices_.push_back("cm" + id + (end == 0 ? "a" : "b"));
    }
    is_made_ = ip("netns add " + namespaces_[0]) && ip("netns add " + namespaces_[1]) &&
               ip("link add " + devices_[0] + " netns " + namespaces_[0] + " type veth peer name " +
                  devices_[1] + " netns " + namespaces_[1]);
    for (int end = 0; end < 2 && is_made_; ++end) {
      const std::string in = "-n " + namespaces_[static_cast<std::size_t>(end)] + " ";
      is_made_ = ip(in + "addr add " + address(end) + "/24 dev " + device(end)) &&
                 ip(in + "link set lo up") && ip(in + "link set " + device(end) + " up");
    }
  }
  NetworkPair(const NetworkPair&) = delete;
  NetworkPair& operator=(const NetworkPair&) = delete;
  ~NetworkPair() {
    for (const std::string& name : namespaces_) ip("netns del " + name);
  }

  bool is_made() const { return is_made_; }
  static const char* why_not() {
    return "network namespaces and veth pairs need root and the program `ip` (iproute2)";
  }

  std::string address(int end) const {
    return "10.77." + std::to_string(subnet_) + "." + std::to_string(end + 1);
  }
  /// Of the namespace.
  const std::string& name(int end) const { return namespaces_[static_cast<std::size_t>(end)]; }
  const std::string& device(int end) const { return devices_[static_cast<std::size_t>(end)]; }

  /// The cable is pulled, or plugged in again.
  bool set_up(bool is_up) const {
    return ip("-n " + namespaces_[0] + " link set " + devices_[0] + (is_up ? " up" : " down"));
  }

  /// A command that runs on one of the hosts.
  std::vector<std::string> on(int end, const std::vector<std::string>& command) const {
    std::vector<std::string> words = {program(), "netns", "exec", namespaces_[static_cast<std::size_t>(end)]};
    words.insert(words.end(), command.begin(), command.end());
    return words;
  }

  /// Forks; the child does `work` on one of the hosts and exits with what it gives. Call before other threads begin.
  pid_t start(int end, const std::function<int()>& work) const {
    const pid_t pid = fork();
    if (pid != 0) return pid;
    const int space =
        open(("/run/netns/" + namespaces_[static_cast<std::size_t>(end)]).c_str(), O_RDONLY | O_CLOEXEC);
    if (space < 0 || setns(space, CLONE_NEWNET) != 0) _exit(99);
    _exit(work());
  }
  /// The exit code of a started child.
  static int wait(pid_t pid) {
    int status = 0;
    waitpid(pid, &status, 0);
    return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  }

 private:
  static std::string program() {
    for (const char* path : {"/usr/sbin/ip", "/sbin/ip", "/usr/bin/ip"})
      if (access(path, X_OK) == 0) return path;
    return "ip";
  }
  static bool ip(const std::string& words) {
    return std::system((program() + " " + words + " >/dev/null 2>&1").c_str()) == 0;
  }

  const int subnet_;
  std::vector<std::string> namespaces_, devices_;
  bool is_made_ = false;
};

}  // namespace comrad::test
