#include "deploy/launch/gpu_load.h"

#include <algorithm>
#include <cstdint>
#include <map>
#include <string_view>
#include <utility>

#include "rollout_buffer/core/take_number.h"

namespace comrad::deploy {
namespace {

/// A line of the driver.
struct Reading {
  uint64_t gpu = 0, percent = 0;
};

/// Of "2, 87"; none of other text.
std::optional<Reading> reading_of(std::string_view line) {
  Reading reading;
  if (!take_number(line, "", reading.gpu) || !take_number(line, ", ", reading.percent) || !line.empty() ||
      reading.percent > 100)
    return std::nullopt;
  return reading;
}

}  // namespace

GpuLoad::GpuLoad(const std::string& program) {
  ChildOptions options;
  options.program = program;
  options.arguments = {"--query-gpu=index,utilization.gpu", "--format=csv,noheader,nounits", "--loop-ms=500"};
  Expected<ChildProcess> started = ChildProcess::spawn(options);
  if (started) watcher_ = std::move(started).value();
}

std::optional<double> GpuLoad::busy() {
  if (!watcher_) return std::nullopt;
  struct Sum {
    double percent = 0;
    int readings = 0;
  };
  std::map<uint64_t, Sum> of_gpus;
  for (const std::string& line : watcher_->read_lines())
    if (const auto reading = reading_of(line)) {
      of_gpus[reading->gpu].percent += static_cast<double>(reading->percent);
      ++of_gpus[reading->gpu].readings;
    }
  std::optional<double> busiest;
  for (const auto& [gpu, sum] : of_gpus)
    busiest = std::max(busiest.value_or(0), sum.percent / sum.readings / 100);
  return busiest;
}

}  // namespace comrad::deploy
