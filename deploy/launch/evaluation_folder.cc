#include "deploy/launch/evaluation_folder.h"

#include <fcntl.h>
#include <spdlog/fmt/fmt.h>

#include <charconv>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>

#include "rollout_buffer/core/files.h"
#include "rollout_buffer/metrics/learner_messages.h"

namespace comrad::deploy {

namespace fs = std::filesystem;

constexpr std::string_view kVideoStem = "video_";

std::vector<Snapshot> RunEvaluationFolder::snapshots() {
  const std::string folder = run_dir_ + "/checkpoint";
  std::vector<Snapshot> found;
  for (const RequestedEvaluation& request : requested_evaluations(folder)) {
    const std::string path = folder + "/" + request.file;
    std::error_code failed;
    if (fs::exists(path, failed))
      found.push_back({.path = path,
                       .version = request.version,
                       .env_frames = request.env_frames,
                       .train_seconds = request.train_seconds});
  }
  return found;
}

void RunEvaluationFolder::remove(const Snapshot& snapshot) {
  std::error_code ignored;
  fs::remove(snapshot.path, ignored);
}

std::vector<uint64_t> RunEvaluationFolder::recorded() {
  std::vector<uint64_t> env_frames;
  std::ifstream lines(run_dir_ + "/" + kMetricsFile);
  const std::string quoted = "\"" + std::string(kScoreKey) + "\"";
  for (std::string line; std::getline(lines, line);) {
    if (line.find(quoted) == std::string::npos) continue;
    const nlohmann::json report = nlohmann::json::parse(line, nullptr, /*allow_exceptions=*/false);
    if (report.is_object() && report.contains("env_frames") && report["env_frames"].is_number_unsigned())
      env_frames.push_back(report["env_frames"]);
  }
  return env_frames;
}

Status RunEvaluationFolder::open_metrics(const Snapshot& snapshot) {
  if (metrics_) return {};
  COMRAD_TRY_ASSIGN(metrics_, MetricsWriter::open(run_dir_, run_dir_ + "/eval"));
  return metrics_->begin_at(snapshot.env_frames);
}

Status RunEvaluationFolder::record(const Snapshot& snapshot, uint64_t decisions, const MetricValues& values) {
  COMRAD_TRY(open_metrics(snapshot));
  return metrics_->write(static_cast<double>(snapshot.train_seconds), snapshot.env_frames, decisions, values);
}

std::vector<uint64_t> RunEvaluationFolder::recorded_videos() {
  std::vector<uint64_t> env_frames;
  std::error_code ignored;
  for (const auto& entry : fs::directory_iterator(videos_folder(), ignored)) {
    const std::string name = entry.path().stem().string();
    uint64_t count = 0;
    if (name.starts_with(kVideoStem) &&
        std::from_chars(name.data() + kVideoStem.size(), name.data() + name.size(), count).ec == std::errc())
      env_frames.push_back(count);
  }
  return env_frames;
}

Expected<std::string> RunEvaluationFolder::keep_video(const Snapshot& snapshot) {
  COMRAD_TRY(open_metrics(snapshot));
  COMRAD_TRY(metrics_->write_gif(snapshot.env_frames, "eval/video", read_file(video_path()).value_or("")));
  const std::string kept = fmt::format("{}/{}{:012}.gif", videos_folder(), kVideoStem, snapshot.env_frames);
  std::error_code failed;
  fs::create_directories(videos_folder(), failed);
  fs::rename(video_path(), kept, failed);
  if (failed) return file_error(kept, failed.value());
  return kept;
}

Expected<Descriptor> RunEvaluationFolder::open_scratch() {
  std::error_code failed;
  fs::create_directories(scratch(), failed);
  Descriptor output(open(result_path().c_str(), O_WRONLY | O_CREAT | O_TRUNC | O_CLOEXEC, 0644));
  if (!output.is_open()) return system_error("cannot write " + result_path());
  return output;
}

std::string RunEvaluationFolder::result() { return read_file(result_path()).value_or(""); }

void RunEvaluationFolder::clear_scratch() {
  std::error_code ignored;
  fs::remove_all(scratch(), ignored);
}

}  // namespace comrad::deploy
