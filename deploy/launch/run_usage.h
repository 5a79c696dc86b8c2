// What the processes of a run use: processor time by stage and role, bytes copied, waits, and how busy each core is. A bench
// reads it at both ends of its window.
#pragma once

#include <array>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::deploy {

/// Those of policy workers, in the order of a batch.
inline constexpr std::array kPolicyStages = {Stage::kGather, Stage::kWeights, Stage::kPack, Stage::kForward,
                                             Stage::kScatter};

/// The processes of one role.
struct RoleUsage {
  double cpu_s = 0;   ///< of all of them
  double wait_s = 0;  ///< waited for others, all of them
  int processes = 0;
};

struct RunUsage {
  std::array<double, kStageCount> stage_cpu_s{};  ///< by Stage
  std::array<double, kStageCount>
      stage_wall_s{};  ///< of threads that only do such stages: simulators, policy workers
  double copied_bytes = 0;
  RoleUsage sims, policy_workers, learner;
  std::vector<double> core_busy_s;  ///< of the CPUs that this process may use, by any process

  double of(Stage stage) const { return stage_cpu_s[static_cast<std::size_t>(stage)]; }
  double cpu_s() const { return sims.cpu_s + policy_workers.cpu_s + learner.cpu_s; }
};

/// Since the workers began and the machine started. Stages and processor time are 0 unless the run's folder has a folder
/// `stages` (core/stage_clock.h). Errors: none; what cannot be read counts 0.
RunUsage read_usage(const std::string& run_dir, const shm::Arena& arena);

/// What was used between two looks; nothing falls below 0, as it would where a worker died.
RunUsage usage_between(const RunUsage& before, const RunUsage& after);

/// Seconds at work of these CPUs since the start, by the text of /proc/stat; 0 for one that is not there.
std::vector<double> core_seconds(std::string_view proc_stat, std::span<const int> cpus);

}  // namespace comrad::deploy
