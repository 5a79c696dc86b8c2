#include "deploy/launch/gpu_load.h"

#include <algorithm>
#include <charconv>
#include <map>
#include <string_view>
#include <utility>

namespace comrad::deploy {
namespace {

/// "2, 87": a GPU's index and percent; none of other text.
std::optional<std::pair<int, int>> reading_of(std::string_view line) {
  const auto number = [](std::string_view text) -> std::optional<int> {
    while (text.starts_with(' ')) text.remove_prefix(1);
    int value = 0;
    const auto [end, failure] = std::from_chars(text.data(), text.data() + text.size(), value);
    if (failure != std::errc() || end != text.data() + text.size() || value < 0) return std::nullopt;
    return value;
  };
  const std::size_t comma = line.find(',');
  if (comma == std::string_view::npos) return std::nullopt;
  const std::optional<int> gpu = number(line.substr(0, comma)), percent = number(line.substr(comma + 1));
  if (!gpu || !percent || *percent > 100) return std::nullopt;
  return std::pair(*gpu, *percent);
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
  std::map<int, Sum> of_gpus;
  for (const std::string& line : watcher_->read_lines())
    if (const auto reading = reading_of(line)) {
      of_gpus[reading->first].percent += reading->second;
      ++of_gpus[reading->first].readings;
    }
  std::optional<double> busiest;
  for (const auto& [gpu, sum] : of_gpus)
    busiest = std::max(busiest.value_or(0), sum.percent / sum.readings / 100);
  return busiest;
}

}  // namespace comrad::deploy
