// The control groups that a process is in: their folders contain limits of memory and cores. Stage: start-up.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

namespace comrad {

/// A folder of control groups. Version 1 and 2 name their files differently.
struct ControlGroup {
  std::string folder;
  bool is_version_2 = false;
};

/// The groups that limit `controller` ("cpu", "memory") for a process whose /proc/self/cgroup reads `proc_cgroup`: its own
/// and those above, up to the mount, which in a container is its own. `root` is where control groups are mounted. A folder
/// need not be there.
std::vector<ControlGroup> control_groups(std::string_view controller, const std::string& proc_cgroup,
                                         const std::string& root);

/// The same of this process, below /sys/fs/cgroup.
std::vector<ControlGroup> own_control_groups(std::string_view controller);

/// How many processes the kernel has killed in this process's memory control groups because their limit was reached; 0 where
/// it does not count them.
uint64_t memory_kills();
/// The same of groups at other places.
uint64_t memory_kills(const std::vector<ControlGroup>& groups);

}  // namespace comrad
