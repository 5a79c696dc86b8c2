#include "deploy/launch/run_usage.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <iterator>
#include <sstream>

#include "deploy/process/process_time.h"
#include "rollout_buffer/core/cores.h"

namespace comrad::deploy {
namespace {

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

double ticks_per_s() { return static_cast<double>(sysconf(_SC_CLK_TCK)); }

double since(double before, double after) { return std::max(0.0, after - before); }

RoleUsage since(const RoleUsage& before, const RoleUsage& after) {
  return {.cpu_s = since(before.cpu_s, after.cpu_s),
          .wait_s = since(before.wait_s, after.wait_s),
          .processes = after.processes};
}

/// Of policy workers, which may be threads of a learner.
double policy_cpu_s(const StageTotals& totals) {
  double cpu_s = 0;
  for (const Stage stage : kPolicyStages)
    cpu_s += 1e-9 * static_cast<double>(totals.cpu_ns[static_cast<std::size_t>(stage)]);
  return cpu_s;
}

void add_waits(RoleUsage& role, const shm::WorkerCounters& counters) {
  role.wait_s += 1e-9 * static_cast<double>(counters.wait_ns.load(std::memory_order_relaxed));
  ++role.processes;
}

}  // namespace

std::vector<double> core_seconds(std::string_view proc_stat, std::span<const int> cpus) {
  std::vector<double> seconds(cpus.size(), 0);
  std::istringstream lines{std::string(proc_stat)};
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::string name;
    double user = 0, nice = 0, system = 0, idle = 0, iowait = 0, irq = 0, softirq = 0;
    if (!(words >> name >> user >> nice >> system >> idle >> iowait >> irq >> softirq)) continue;
    for (std::size_t i = 0; i < cpus.size(); ++i)
      if (name == fmt::format("cpu{}", cpus[i]))
        seconds[i] = (user + nice + system + irq + softirq) / ticks_per_s();
  }
  return seconds;
}

RunUsage read_usage(const std::string& run_dir, const shm::Arena& arena) {
  RunUsage usage;
  usage.core_busy_s = core_seconds(text_of("/proc/stat"), allowed_cpus());
  for (int sim = 0; sim < arena.shape().sim_worker_count; ++sim)
    add_waits(usage.sims, arena.sim_counters(sim));
  for (int worker = 0; worker < arena.shape().policy_worker_count; ++worker)
    add_waits(usage.policy_workers, arena.policy_counters(worker));
  add_waits(usage.learner, arena.learner_counters());
  for (const StageTotals& totals : read_stages(run_dir + "/" + kStagesFolder)) {
    for (std::size_t i = 0; i < kStageCount; ++i) {
      usage.stage_cpu_s[i] += 1e-9 * static_cast<double>(totals.cpu_ns[i]);
      usage.stage_wall_s[i] += 1e-9 * static_cast<double>(totals.wall_ns[i]);
    }
    usage.copied_bytes += static_cast<double>(totals.copied_bytes);
    RoleUsage& role = totals.name.starts_with("sim-")      ? usage.sims
                      : totals.name.starts_with("policy-") ? usage.policy_workers
                                                           : usage.learner;
    const double cpu_s = family_seconds(static_cast<pid_t>(totals.pid));
    const double of_threads_s = &role == &usage.learner ? std::min(cpu_s, policy_cpu_s(totals)) : 0;
    role.cpu_s += cpu_s - of_threads_s;
    usage.policy_workers.cpu_s += of_threads_s;
  }
  return usage;
}

RunUsage usage_between(const RunUsage& before, const RunUsage& after) {
  RunUsage usage;
  for (std::size_t i = 0; i < kStageCount; ++i) {
    usage.stage_cpu_s[i] = since(before.stage_cpu_s[i], after.stage_cpu_s[i]);
    usage.stage_wall_s[i] = since(before.stage_wall_s[i], after.stage_wall_s[i]);
  }
  usage.copied_bytes = since(before.copied_bytes, after.copied_bytes);
  usage.sims = since(before.sims, after.sims);
  usage.policy_workers = since(before.policy_workers, after.policy_workers);
  usage.learner = since(before.learner, after.learner);
  for (std::size_t i = 0; i < std::min(before.core_busy_s.size(), after.core_busy_s.size()); ++i)
    usage.core_busy_s.push_back(since(before.core_busy_s[i], after.core_busy_s[i]));
  return usage;
}

}  // namespace comrad::deploy
