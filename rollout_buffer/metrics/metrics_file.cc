#include "rollout_buffer/metrics/metrics_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad {
namespace {

/// Whether the file's last line has no end.
bool ends_half_way(int descriptor) {
  const off_t end = lseek(descriptor, 0, SEEK_END);
  char last = '\n';
  return end > 0 && pread(descriptor, &last, 1, end - 1) == 1 && last != '\n';
}

/// What users tell runs apart by.
constexpr std::array<std::string_view, 4> kLeadingColumns = {"scenario", "algo", "seed", "preset"};

Hparam hparam_of(const SettingRow& row, const RunConfig& config) {
  const std::string text = row.text(config);
  Hparam hparam{.name = std::string(row.name),
                .value = text,
                .has_value = row.applies(config),
                .leads = std::ranges::find(kLeadingColumns, row.name) != kLeadingColumns.end()};
  if (row.kind == SettingKind::kBool)
    hparam.value = text == "true";
  else if (!row.is_text(text))
    hparam.value = std::strtod(text.c_str(), nullptr);
  return hparam;
}

}  // namespace

std::vector<Hparam> hparams_of(const RunConfig& config) {
  std::vector<Hparam> hparams;
  for (const SettingRow& row : setting_rows())
    if (!row.traits.is_of_the_start) hparams.push_back(hparam_of(row, config));
  return hparams;
}

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

Status MetricsWriter::begin_at(uint64_t env_frames) {
  return events_.write_start(wall_s(), static_cast<int64_t>(env_frames));
}

Status MetricsWriter::describe_run(const RunConfig& config) {
  static const std::vector<HparamMetric> kMetrics = {
      {.tag = "policy_stats/avg_true_objective", .title = "J (training)", .below = ""},
      {.tag = "policy_stats/avg_true_objective_share", .title = "J share (training)", .below = ""},
      {.tag = "eval/J", .title = "J (evaluation)", .below = "eval"},
      {.tag = "eval/J_share", .title = "J share (evaluation)", .below = "eval"},
      {.tag = "reward/reward", .title = "return", .below = ""},
      {.tag = "perf/_fps", .title = "env frames/s", .below = ""}};
  return events_.write_hparams(wall_s(), hparams_of(config), kMetrics);
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

Status MetricsWriter::write_gif(uint64_t env_frames, const std::string& tag, const std::string& gif) {
  return events_.write_gif(wall_s(), static_cast<int64_t>(env_frames), tag, gif);
}

}  // namespace comrad
