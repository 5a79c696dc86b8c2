// What limits a training run, from what a bench of the whole pipeline measured.
#pragma once

#include <array>
#include <cstdint>
#include <string>

#include "rollout_buffer/core/stage_clock.h"

namespace comrad::deploy {

struct PipelineNumbers {
  int64_t cores = 1;
  double cores_busy = 0;   ///< mean share of the time that a core was at work, for this run or for others
  double others_busy = 0;  ///< of it, for other programs
  double sim_busy = 0, policy_busy = 0,
         learner_busy = 0;  ///< share of its time that a process did not wait for others
  std::array<double, kStageCount> stage_cpu_s{};  ///< processor seconds, by Stage
  int64_t num_workers = 1, num_envs_per_worker = 8, policy_workers = 1, learner_threads = 1;
  bool is_fp32 = true;
  bool is_on_gpu = false;
};

/// One sentence: what limits the run, and which setting to change. Where all cores are at work, the stage that takes most of
/// their time; where not, the role that never waits; where all wait, the hand-overs between them.
std::string bottleneck_text(const PipelineNumbers& numbers);

}  // namespace comrad::deploy
