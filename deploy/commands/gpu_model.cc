#include "deploy/commands/gpu_model.h"

#include <algorithm>
#include <array>
#include <utility>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {

using nlohmann::ordered_json;

namespace {

constexpr std::array<GpuPeaks, 2> kGpus = {{{.name = "a100",
                                             .fp32_flop_per_s = 19.5e12,
                                             .bf16_flop_per_s = 312e12,
                                             .memory_bytes_per_s = 2039e9,
                                             .bus_bytes_per_s = 32e9},
                                            {.name = "h100",
                                             .fp32_flop_per_s = 67e12,
                                             .bf16_flop_per_s = 989e12,
                                             .memory_bytes_per_s = 3350e9,
                                             .bus_bytes_per_s = 64e9}}};

}  // namespace

Expected<GpuPeaks> peaks_of(const std::string& name) {
  const auto found = std::ranges::find(kGpus, name, &GpuPeaks::name);
  if (found != kGpus.end()) return *found;
  std::vector<std::string> names;
  for (const GpuPeaks& gpu : kGpus) names.emplace_back(gpu.name);
  return Error{ErrorCode::kBadInput,
               "unknown GPU '" + name + "'" + did_you_mean(name, names) + " (" + joined(names) + ")"};
}

Expected<CountedWork> CountedWork::from(const ordered_json& work) {
  CountedWork counted;
  for (const auto& [name, value] :
       {std::pair{"flop_per_decision", &counted.flop}, std::pair{"bytes_per_decision", &counted.bytes},
        std::pair{"launches_per_pass", &counted.launches},
        std::pair{"decisions_per_pass", &counted.decisions_per_pass}}) {
    if (!work.is_object() || !work.contains(name) || !work[name].is_number() ||
        !(work[name].get<double>() >= 0))
      return Error{ErrorCode::kBadFormat, "the counted work has no " + std::string(name)};
    *value = work[name].get<double>();
  }
  counted.decisions_per_pass = std::max(1.0, counted.decisions_per_pass);
  return counted;
}

double GpuTime::all_s() const { return std::max({compute_s, memory_s, launch_s}); }

const char* GpuTime::bound() const {
  return all_s() == compute_s ? "compute" : all_s() == memory_s ? "memory" : "launches";
}

GpuTime gpu_time(const CountedWork& work, const GpuPeaks& gpu, bool is_bf16) {
  return {.compute_s = work.flop / (is_bf16 ? gpu.bf16_flop_per_s : gpu.fp32_flop_per_s),
          .memory_s = work.bytes / gpu.memory_bytes_per_s,
          .launch_s = work.launches * kLaunchS / work.decisions_per_pass};
}

ordered_json gpu_row(const GpuPeaks& gpu, int64_t cores, const DecisionCosts& costs,
                     const CountedWork& policy, const std::vector<CountedWork>& learner, bool is_bf16,
                     double frame_bytes, double tics_per_decision) {
  const GpuTime forward = gpu_time(policy, gpu, is_bf16);
  GpuTime update;
  for (const CountedWork& phase : learner) {
    const GpuTime time = gpu_time(phase, gpu, is_bf16);
    update.compute_s += time.compute_s;
    update.memory_s += time.memory_s;
    update.launch_s += time.launch_s;
  }
  const double host_s = costs.simulators_s() + costs.of(Stage::kGather) + costs.of(Stage::kScatter) +
                        costs.of(Stage::kCollate) + costs.of(Stage::kPublish) + costs.other_s;
  // The policy workers' and the learner's streams share the GPU; each process starts its own operators.
  const double gpu_s =
      std::max(forward.compute_s, forward.memory_s) + std::max(update.compute_s, update.memory_s);
  const auto rate = [](double seconds) { return seconds > 0 ? 1 / seconds : 1e12; };
  const std::array<std::pair<double, const char*>, 5> limits = {
      {{static_cast<double>(cores) * rate(host_s), "cores"},
       {rate(gpu_s), "GPU"},
       {rate(forward.launch_s), "launches of a policy worker"},
       {rate(update.launch_s), "launches of the learner"},
       {rate(2 * frame_bytes / gpu.bus_bytes_per_s), "bus"}}};
  const auto least = std::ranges::min_element(limits, {}, &std::pair<double, const char*>::first);
  return {{"gpu", gpu.name},
          {"cores", cores},
          {"cores_rate", limits[0].first},
          {"gpu_rate", limits[1].first},
          {"policy_launch_rate", limits[2].first},
          {"learner_launch_rate", limits[3].first},
          {"bus_rate", limits[4].first},
          {"policy_bound", forward.bound()},
          {"learner_bound", update.bound()},
          {"decisions_per_s", least->first},
          {"env_frames_per_s", least->first * tics_per_decision},
          {"saturates", least->second}};
}

}  // namespace comrad::deploy
