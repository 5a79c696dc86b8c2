// Several hosts in one: network namespaces whose cables end in a switch. Needs root and the `ip` program.
#pragma once

#include <unistd.h>

#include <cstdlib>
#include <string>
#include <vector>

namespace comrad::test {

class NetworkStar {
 public:
  /// Addresses are 10.78.<subnet>.1 and up. The first host holds the switch.
  NetworkStar(int hosts, int subnet)
      : subnet_(subnet), id_(std::to_string(getpid()) + "s" + std::to_string(subnet)) {
    is_made_ = hosts > 0;
    for (int host = 0; host < hosts && is_made_; ++host) is_made_ = ip("netns add " + space(host));
    is_made_ = is_made_ && ip("-n " + space(0) + " link add " + device(0) + " type bridge");
    for (int host = 0; host < hosts && is_made_; ++host) {
      const std::string in = "-n " + space(host) + " ";
      if (host > 0) {
        const std::string plug = "cp" + id_ + std::to_string(host);
        is_made_ = ip("link add " + device(host) + " netns " + space(host) + " type veth peer name " + plug +
                      " netns " + space(0)) &&
                   ip("-n " + space(0) + " link set " + plug + " master " + device(0)) &&
                   ip("-n " + space(0) + " link set " + plug + " up");
      }
      is_made_ = is_made_ && ip(in + "addr add " + address(host) + "/24 dev " + device(host)) &&
                 ip(in + "link set lo up") && ip(in + "link set " + device(host) + " up");
    }
    hosts_ = hosts;
  }
  NetworkStar(const NetworkStar&) = delete;
  NetworkStar& operator=(const NetworkStar&) = delete;
  ~NetworkStar() {
    for (int host = 0; host < hosts_; ++host) ip("netns del " + space(host));
  }

  bool is_made() const { return is_made_; }
  std::string address(int host) const {
    return "10.78." + std::to_string(subnet_) + "." + std::to_string(host + 1);
  }
  std::string device(int host) const { return "cs" + id_ + std::to_string(host); }

  /// A command that runs on one of the hosts.
  std::vector<std::string> on(int host, const std::vector<std::string>& command) const {
    std::vector<std::string> words = {"/usr/sbin/ip", "netns", "exec", space(host)};
    words.insert(words.end(), command.begin(), command.end());
    return words;
  }

 private:
  std::string space(int host) const { return "comrad-" + id_ + "h" + std::to_string(host); }
  static bool ip(const std::string& words) {
    return std::system(("/usr/sbin/ip " + words + " >/dev/null 2>&1").c_str()) == 0;
  }

  const int subnet_;
  const std::string id_;
  int hosts_ = 0;
  bool is_made_ = false;
};

}  // namespace comrad::test
