#include "rollout_buffer/core/control_group.h"

#include <algorithm>
#include <fstream>
#include <sstream>

namespace comrad {

std::vector<ControlGroup> control_groups(std::string_view controller, const std::string& proc_cgroup,
                                         const std::string& root) {
  std::vector<ControlGroup> groups;
  const std::string name(controller);
  std::istringstream lines(proc_cgroup);
  for (std::string line; std::getline(lines, line);) {  // "hierarchy:controllers:path"
    const std::size_t first = line.find(':'), second = line.find(':', first + 1);
    if (first == std::string::npos || second == std::string::npos) continue;
    const std::string controllers = line.substr(first + 1, second - first - 1);
    const bool is_version_2 = controllers.empty();
    if (!is_version_2 && ("," + controllers + ",").find("," + name + ",") == std::string::npos) continue;
    const std::string mount = root + (is_version_2 ? "" : "/" + name);
    std::string path = line.substr(second + 1);
    for (;;) {
      while (!path.empty() && path.back() == '/') path.pop_back();
      groups.push_back({mount + path, is_version_2});
      if (path.empty()) break;
      path.erase(path.rfind('/') == std::string::npos ? 0 : path.rfind('/'));
    }
  }
  return groups;
}

std::vector<ControlGroup> own_control_groups(std::string_view controller) {
  std::ifstream file("/proc/self/cgroup");
  std::stringstream text;
  text << file.rdbuf();
  return control_groups(controller, text.str(), "/sys/fs/cgroup");
}

uint64_t memory_kills(const std::vector<ControlGroup>& groups) {
  uint64_t most = 0;  // a group counts those of the groups below it, in version 2
  for (const ControlGroup& group : groups) {
    std::ifstream file(group.folder + (group.is_version_2 ? "/memory.events" : "/memory.oom_control"));
    std::string key;
    uint64_t value = 0;
    while (file >> key >> value)
      if (key == "oom_kill") most = std::max(most, value);
  }
  return most;
}

uint64_t memory_kills() { return memory_kills(own_control_groups("memory")); }

}  // namespace comrad
