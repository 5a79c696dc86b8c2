// metrics.jsonl of a run, and TensorBoard scalars under the same names. The learner writes its reports here, the
// supervisor the scores of evaluations: each its own lines of the one file, each its own event file.
// Stage: beside update, for eyes and scripts.
#pragma once

#include <cstdint>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/metrics/event_file.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad {

/// Named numbers of one report, in the order they are written.
using MetricValues = std::vector<std::pair<std::string, double>>;

/// Where the file lies in a run directory.
constexpr const char* kMetricsFile = "metrics.jsonl";

/// The settings of a run for TensorBoard's HPARAMS page: all but those that say where it lies and how it was started.
/// Scenario, algo, seed and preset lead; those that make no difference in this run have no value.
std::vector<Hparam> hparams_of(const RunConfig& config);

/// Appends reports to <run_dir>/metrics.jsonl and to an event file of this process.
class MetricsWriter {
 public:
  /// The event file comes into `events_folder`, which is made; empty: into the run directory. TensorBoard follows one
  /// event file a folder, so a second writer needs its own folder. Errors: kSystem, kNoSpace.
  static Expected<MetricsWriter> open(const std::string& run_dir, const std::string& events_folder = "");
  MetricsWriter(MetricsWriter&& other) noexcept;
  MetricsWriter& operator=(MetricsWriter&& other) noexcept;
  ~MetricsWriter();

  /// Notes that this process writes from `env_frames` on: TensorBoard forgets what older event files of the folder hold there,
  /// which a crashed run had reported and a resumed one repeats. Before the first report. Errors: kSystem, kNoSpace.
  Status begin_at(uint64_t env_frames);

  /// Puts the run into TensorBoard's HPARAMS page: its settings, its score in training and in evaluations. Once, before the
  /// first report. Errors: kSystem, kNoSpace.
  Status describe_run(const RunConfig& config);

  /// One object per line: time_s, env_frames, decisions, then `values`; a number that is not finite is null
  /// there and left out of the event file. A half line that a crash or a full disk left is closed first. The line is
  /// appended by one call, so that two writers do not mix theirs. Errors: kSystem, kNoSpace.
  Status write(double time_s, uint64_t env_frames, uint64_t decisions, const MetricValues& values);

  /// Puts a video, the bytes of a GIF file, into the event file. Errors: as EventFile::write_gif.
  Status write_gif(uint64_t env_frames, const std::string& tag, const std::string& gif);

 private:
  MetricsWriter(int descriptor, std::string path, EventFile events)
      : descriptor_(descriptor), path_(std::move(path)), events_(std::move(events)) {}
  int descriptor_ = -1;
  std::string path_;
  EventFile events_;
};

}  // namespace comrad
