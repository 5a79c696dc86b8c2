// Where checkpoints wait to be evaluated and their scores are kept: in the folder of the run, so that a run that was killed
// plays on what it had not played; a simulation keeps them in memory. Stage: beside the flow of frames.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "deploy/process/process_start.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/metrics/metrics_file.h"

namespace comrad::deploy {

/// A checkpoint that waits to be evaluated.
struct Snapshot {
  std::string path;
  uint64_t version = 0;
  uint64_t env_frames = 0;
  uint64_t train_seconds = 0;
};

/// The metric that every evaluation writes.
constexpr const char* kScoreKey = "eval/J";

/// Threads: the supervisor's.
class EvaluationFolder {
 public:
  virtual ~EvaluationFolder() = default;
  /// All that lie there, in any order.
  virtual std::vector<Snapshot> snapshots() = 0;
  virtual void remove(const Snapshot& snapshot) = 0;
  /// Env frames of the evaluations that were recorded, in earlier lives of the run too.
  virtual std::vector<uint64_t> recorded() = 0;
  virtual Status record(const Snapshot& snapshot, uint64_t decisions, const MetricValues& values) = 0;

  /// Env frames of the videos that were kept, likewise.
  virtual std::vector<uint64_t> recorded_videos() = 0;
  /// Keeps the video that lies at video_path(). Returns where. Errors: kBadFormat for no video; kSystem, kNoSpace.
  virtual Expected<std::string> keep_video(const Snapshot& snapshot) = 0;

  /// A place for what one evaluation leaves, and the file in it that takes its output. Errors: kSystem.
  virtual Expected<Descriptor> open_scratch() = 0;
  virtual std::string scratch() const = 0;
  /// In it.
  std::string video_path() const { return scratch() + "/video.gif"; }
  /// What it has printed.
  virtual std::string result() = 0;
  virtual void clear_scratch() = 0;
};

/// What the learner requests in `<run_dir>/checkpoint` (rollout_buffer/metrics/learner_messages.h), metrics.jsonl, event files in
/// `<run_dir>/eval`, videos `<run_dir>/videos/video_<env_frames>.gif`; `<run_dir>/.evaluation` is the scratch.
class RunEvaluationFolder final : public EvaluationFolder {
 public:
  explicit RunEvaluationFolder(std::string run_dir) : run_dir_(std::move(run_dir)) {}
  std::vector<Snapshot> snapshots() override;
  void remove(const Snapshot& snapshot) override;
  std::vector<uint64_t> recorded() override;
  Status record(const Snapshot& snapshot, uint64_t decisions, const MetricValues& values) override;
  std::vector<uint64_t> recorded_videos() override;
  Expected<std::string> keep_video(const Snapshot& snapshot) override;
  Expected<Descriptor> open_scratch() override;
  std::string scratch() const override { return run_dir_ + "/.evaluation"; }
  std::string result() override;
  void clear_scratch() override;

 private:
  std::string result_path() const { return scratch() + "/result.json"; }
  std::string videos_folder() const { return run_dir_ + "/videos"; }
  /// Opens metrics_ for a first result. Errors: kSystem, kNoSpace.
  Status open_metrics(const Snapshot& snapshot);
  const std::string run_dir_;
  std::optional<MetricsWriter> metrics_;
};

}  // namespace comrad::deploy
