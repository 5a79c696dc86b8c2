#include "deploy/watch/watched_run.h"

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <utility>

#include "deploy/run/run_client.h"
#include "deploy/settings/existing_run.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

using nlohmann::json;

constexpr std::size_t kLineBytesMax = 1 << 20;
constexpr double kAnswerS = 1;  // that a run's supervisor may take

/// Curves and the keys of a report that they come from.
constexpr std::pair<const char*, const char*> kCurves[] = {{"env_frames", "env_frames"},
                                                           {"J", "policy_stats/avg_true_objective"},
                                                           {"return", "reward/reward"},
                                                           {"env_frames_per_s", "perf/_fps"},
                                                           {"lag", "train/version_diff_avg"}};

}  // namespace

void WatchedRun::read_metrics() {
  std::ifstream file(run_dir_ + "/metrics.jsonl", std::ios::binary);
  file.seekg(offset_);
  for (std::string line;
       std::getline(file, line) && !file.eof();) {  // one without its end is still being written
    offset_ += static_cast<int64_t>(line.size()) + 1;
    if (line.size() > kLineBytesMax || reports_++ % keep_every_ != 0) continue;
    const json report = json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (!report.is_object()) continue;
    std::vector<double>& point = points_.emplace_back();
    for (const auto& [name, key] : kCurves) {
      const auto found = report.find(key);
      point.push_back(found != report.end() && found->is_number() ? found->get<double>()
                                                                  : std::numeric_limits<double>::quiet_NaN());
    }
    if (points_.size() <= kPointsMax) continue;
    std::size_t kept = 0;
    for (std::size_t i = 0; i < points_.size(); i += 2) points_[kept++] = std::move(points_[i]);
    points_.resize(kept);
    keep_every_ *= 2;
  }
}

json WatchedRun::look() {
  if (run_dir_.empty()) return json{{"type", "run"}, {"name", ""}};
  read_metrics();
  json curves = json::object();
  for (std::size_t curve = 0; curve < std::size(kCurves); ++curve) {
    json values = json::array();
    for (const std::vector<double>& point : points_)
      values.push_back(std::isfinite(point[curve]) ? json(point[curve]) : json());
    curves[kCurves[curve].first] = std::move(values);
  }
  json status;
  if (const Expected<LiveRun> run = find_live_run(run_dir_, ""))
    if (Expected<json> answer = ask(*run, {{"do", "status"}}, kAnswerS)) status = std::move(answer).value();
  const json file = json::parse(read_file(run_dir_ + "/status.json").value_or(""), nullptr, false);
  return {{"type", "run"},
          {"name", std::filesystem::path(run_dir_).filename().string()},
          {"file", file.is_object() ? file : json()},
          {"status", status},
          {"curves", curves}};
}

std::string WatchedRun::newest_checkpoint() const {
  if (run_dir_.empty()) return "";
  const Expected<std::string> found = find_checkpoint(run_dir_, CheckpointKind::kLatest);
  return found ? *found : "";
}

}  // namespace comrad::deploy
