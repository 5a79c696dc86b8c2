#include "rollout_buffer/metrics/metrics_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"

namespace comrad {
namespace {

/// Whether the file's last line has no end.
bool ends_half_way(int descriptor) {
  const off_t end = lseek(descriptor, 0, SEEK_END);
  char last = '\n';
  return end > 0 && pread(descriptor, &last, 1, end - 1) == 1 && last != '\n';
}

}  // namespace

Expected<MetricsWriter> MetricsWriter::open(const std::string& run_dir, const std::string& events_folder) {
  const std::string path = run_dir + "/" + kMetricsFile;
  std::error_code failed;
  if (!events_folder.empty()) std::filesystem::create_directories(events_folder, failed);
  COMRAD_TRY_ASSIGN(EventFile events, EventFile::create(events_folder.empty() ? run_dir : events_folder));
  const int descriptor = ::open(path.c_str(), O_RDWR | O_CREAT | O_APPEND | O_CLOEXEC, 0644);
  if (descriptor < 0) return system_error("cannot open " + path);
  return MetricsWriter(descriptor, path, std::move(events));
}

MetricsWriter::MetricsWriter(MetricsWriter&& other) noexcept
    : descriptor_(std::exchange(other.descriptor_, -1)),
      path_(std::move(other.path_)),
      events_(std::move(other.events_)) {}

MetricsWriter& MetricsWriter::operator=(MetricsWriter&& other) noexcept {
  std::swap(descriptor_, other.descriptor_);
  std::swap(path_, other.path_);
  std::swap(events_, other.events_);
  return *this;
}

MetricsWriter::~MetricsWriter() {
  if (descriptor_ >= 0) close(descriptor_);
}

Status MetricsWriter::write(double time_s, uint64_t env_frames, uint64_t decisions,
                            const MetricValues& values) {
  nlohmann::ordered_json line;
  line["time_s"] = time_s;
  line["env_frames"] = env_frames;
  line["decisions"] = decisions;
  MetricValues finite;
  for (const auto& [name, value] : values) {
    line[name] = value;  // nlohmann writes null for what is not finite
    if (std::isfinite(value)) finite.emplace_back(name, value);
  }
  COMRAD_TRY(write_all(descriptor_, (ends_half_way(descriptor_) ? "\n" : "") + line.dump() + "\n", path_));
  return events_.write(wall_s(), static_cast<int64_t>(env_frames), finite);
}

}  // namespace comrad
