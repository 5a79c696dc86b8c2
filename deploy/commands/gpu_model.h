// How fast a host with one GPU would be: a model, not a measurement, from counted work of the networks, a GPU's published
// peaks, and what the rest costs a processor here.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "deploy/commands/scaling_model.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What its maker prints, dense tensors.
struct GpuPeaks {
  const char* name;
  double fp32_flop_per_s, bf16_flop_per_s;
  double memory_bytes_per_s;
  double bus_bytes_per_s;  ///< from the host, one direction
};

/// "a100": A100 80GB SXM (NVIDIA A100 Tensor Core GPU data sheet, 2022); "h100": H100 SXM5 (NVIDIA H100 Tensor Core GPU data
/// sheet, 2023). Errors: kBadInput for another name.
Expected<GpuPeaks> peaks_of(const std::string& name);

/// The time in which a host starts one operator: an assumption, the only one that is not counted or printed.
constexpr double kLaunchS = 5e-6;

/// Work of one stage, as the worker programs count it (policy_workers/device/work_report.h).
struct CountedWork {
  double flop = 0, bytes = 0;                   ///< of one decision
  double launches = 0, decisions_per_pass = 1;  ///< of one pass
  /// Errors: kBadFormat where a number is missing or below 0.
  static Expected<CountedWork> from(const nlohmann::ordered_json& work);
};

/// Seconds of one decision, and which of the peaks they come from.
struct GpuTime {
  double compute_s = 0, memory_s = 0, launch_s = 0;
  /// An operator runs as long as its products or its memory take, and no sooner than the host started it.
  double all_s() const;
  const char* bound() const;  ///< "compute", "memory" or "launches"
};
GpuTime gpu_time(const CountedWork& work, const GpuPeaks& gpu, bool is_bf16);

/// The row of one GPU in a host of so many cores: `policy` and `learner` (its phases) share the GPU, the processor has what is
/// left of `costs`: simulators, gather, scatter, collate, publish and other. `frame_bytes` of a decision cross the bus twice.
nlohmann::ordered_json gpu_row(const GpuPeaks& gpu, int64_t cores, const DecisionCosts& costs,
                               const CountedWork& policy, const std::vector<CountedWork>& learner,
                               bool is_bf16, double frame_bytes, double tics_per_decision);

}  // namespace comrad::deploy
