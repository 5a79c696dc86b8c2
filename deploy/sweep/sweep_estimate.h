// How long a sweep will take on this machine, from rates measured here and now.
#pragma once

#include <string>
#include <vector>

#include "deploy/sweep/sweep_plan.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Runs that are taken to be equally fast: they differ in seed and scenario alone.
struct EstimateGroup {
  std::string label;         ///< "ippo, preset paper": the values of the other axes
  const SweepRun* measured;  ///< the first of them, which stands for all
  std::size_t run_count = 0;
  double env_frames = 0;        ///< of all of them
  double env_frames_per_s = 0;  ///< 0: not measured yet
};

/// The groups of a plan, in its order. Pure; `plan` outlives them.
std::vector<EstimateGroup> estimate_groups(const SweepPlan& plan);

/// Measures each group with `comrad bench train` on the cores of one run, `seconds` each. Errors: those of the bench.
Status measure(std::vector<EstimateGroup>& groups, const SweepPlan& plan, double seconds,
               const std::string& comrad);

/// The table with its sums.
std::string estimate_text(const std::vector<EstimateGroup>& groups, const SweepPlan& plan);

}  // namespace comrad::deploy
