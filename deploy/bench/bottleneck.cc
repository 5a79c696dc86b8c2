#include "deploy/bench/bottleneck.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <numeric>

namespace comrad::deploy {
namespace {

constexpr double kAllBusy = 0.9;       // of the cores' time: more would need more cores
constexpr double kNeverWaits = 0.85;   // of a process's time
constexpr double kOthersMatter = 0.1;  // of the cores' time

std::string percent(double share) { return fmt::format("{} %", std::lround(100 * share)); }

std::string words_of(Stage stage) {
  switch (stage) {
    case Stage::kTic:
      return "playing the worlds";
    case Stage::kRender:
      return "drawing";
    case Stage::kHandOver:
      return "the simulators' hand-overs";
    case Stage::kGather:
      return "gathering batches";
    case Stage::kWeights:
      return "taking in weights";
    case Stage::kPack:
      return "packing frames for the GPU";
    case Stage::kForward:
      return "the policy workers' forward pass";
    case Stage::kScatter:
      return "drawing actions and handing them back";
    case Stage::kCollate:
      return "copying trajectories into batches";
    case Stage::kForwardBackward:
      return "the learner's forward and backward pass";
    case Stage::kOptimizer:
      return "the optimizer's step";
    case Stage::kPublish:
      return "publishing weights";
  }
  return "";
}

/// What makes a stage cheaper where no core is idle.
std::string cheaper(Stage stage, const PipelineNumbers& numbers) {
  const std::string more_cores = "only more cores make it faster";
  switch (stage) {
    case Stage::kForward:
    case Stage::kForwardBackward:
      return numbers.is_fp32 && !numbers.is_on_gpu ? "--precision bf16 may make it cheaper, more cores will"
                                                   : more_cores;
    case Stage::kHandOver:
    case Stage::kGather:
    case Stage::kPack:
    case Stage::kScatter:
      return fmt::format("--num_envs_per_worker {} hands over more at a time",
                         2 * numbers.num_envs_per_worker);
    case Stage::kWeights:
    case Stage::kOptimizer:
    case Stage::kPublish:
      return "a larger --batch_size takes fewer steps";
    case Stage::kTic:
    case Stage::kRender:
    case Stage::kCollate:
      return more_cores;
  }
  return more_cores;
}

}  // namespace

std::string bottleneck_text(const PipelineNumbers& numbers) {
  const std::string beside =
      numbers.others_busy > kOthersMatter
          ? "Beside other programs, which took " + percent(numbers.others_busy) + " of the cores: "
          : "";
  if (numbers.cores_busy >= kAllBusy) {
    const auto largest = std::ranges::max_element(numbers.stage_cpu_s);
    const double all = std::accumulate(numbers.stage_cpu_s.begin(), numbers.stage_cpu_s.end(), 0.0);
    if (all <= 0)
      return beside + "all cores are busy (" + percent(numbers.cores_busy) +
             "), only more cores make it faster.";
    const auto stage = static_cast<Stage>(largest - numbers.stage_cpu_s.begin());
    return beside + "all cores are busy (" + percent(numbers.cores_busy) + ") and " + words_of(stage) +
           " takes " + percent(*largest / all) + " of the run's processor time; " + cheaper(stage, numbers) +
           ".";
  }
  const std::string idle = percent(1 - numbers.cores_busy) + " of the cores' time is idle; ";
  const double busiest = std::max({numbers.sim_busy, numbers.policy_busy, numbers.learner_busy});
  if (busiest < kNeverWaits)
    return fmt::format(
        "{}no component is saturated: simulators, policy workers and learner wait for each other's "
        "hand-overs, and {}set --num_envs_per_worker {}.",
        beside, idle, 2 * numbers.num_envs_per_worker);
  // The component that never waits is the bottleneck.
  if (numbers.learner_busy == busiest)
    return beside + "the learner never waits (busy " + percent(busiest) + "), and " + idle +
           (numbers.is_on_gpu ? "set a larger --batch_size."
            : numbers.learner_threads < numbers.cores
                ? fmt::format("set --learner_threads {}.", numbers.learner_threads + 1)
                : "set a larger --micro_batch_size.");
  if (numbers.policy_busy == busiest)
    return beside + "the policy workers never wait (busy " + percent(busiest) + "), and " + idle +
           (numbers.is_on_gpu ? fmt::format("set --num_envs_per_worker {}: policy workers take turns on a "
                                            "GPU, larger batches need fewer.",
                                            2 * numbers.num_envs_per_worker)
                              : fmt::format("set --policy_workers {}.", numbers.policy_workers + 1));
  return fmt::format("{}the simulators never wait (busy {}), and {}set --num_workers {}.", beside,
                     percent(busiest), idle, numbers.num_workers + 1);
}

}  // namespace comrad::deploy
