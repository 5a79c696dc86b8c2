#include "rollout_buffer/core/cores.h"

#include <sched.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

namespace comrad {
namespace {

/// The words of a file's first line.
std::vector<std::string> words_in(const std::string& path) {
  std::ifstream file(path);
  std::string line;
  std::getline(file, line);
  std::istringstream stream(line);
  std::vector<std::string> words;
  for (std::string word; stream >> word;) words.push_back(word);
  return words;
}

std::optional<double> ratio(const std::string& quota, const std::string& period) {
  const double quota_us = std::strtod(quota.c_str(), nullptr),
               period_us = std::strtod(period.c_str(), nullptr);
  if (!(quota_us > 0) || !(period_us > 0)) return std::nullopt;  // "max" and -1: none
  return quota_us / period_us;
}

/// The quota of one control group.
std::optional<double> cores_of(const ControlGroup& group) {
  if (group.is_version_2) {
    const std::vector<std::string> words = words_in(group.folder + "/cpu.max");
    return words.size() == 2 ? ratio(words[0], words[1]) : std::nullopt;
  }
  const std::vector<std::string> quota = words_in(group.folder + "/cpu.cfs_quota_us");
  const std::vector<std::string> period = words_in(group.folder + "/cpu.cfs_period_us");
  return quota.size() == 1 && period.size() == 1 ? ratio(quota[0], period[0]) : std::nullopt;
}

}  // namespace

std::vector<int> allowed_cpus() {
  std::vector<int> cpus;
  cpu_set_t mask;
  CPU_ZERO(&mask);
  if (sched_getaffinity(0, sizeof mask, &mask) == 0)
    for (int cpu = 0; cpu < CPU_SETSIZE; ++cpu)
      if (CPU_ISSET(static_cast<std::size_t>(cpu), &mask)) cpus.push_back(cpu);
  if (cpus.empty()) cpus.push_back(0);
  return cpus;
}

std::optional<double> control_group_cores(const std::vector<ControlGroup>& groups) {
  std::optional<double> tightest;
  for (const ControlGroup& group : groups) {
    const std::optional<double> cores = cores_of(group);
    if (cores && (!tightest || *cores < *tightest)) tightest = cores;
  }
  return tightest;
}

int usable_cores() {
  const int masked = static_cast<int>(allowed_cpus().size());
  const std::optional<double> quota = control_group_cores(own_control_groups("cpu"));
  return quota ? std::min(masked, std::max(1, static_cast<int>(std::ceil(*quota)))) : masked;
}

}  // namespace comrad
