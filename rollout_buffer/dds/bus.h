// The run's message bus: one Cyclone DDS participant per process, typed topics, loopback only. Carries what
// is small and rare (status, desired state, version notices, episode results, statistics); frames and weights
// of a host lie in the arena. Cyclone and the IDL types stay behind this header.
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus_config.h"
#include "rollout_buffer/schema/episode_record.h"

namespace comrad::dds {

/// A worker's own words about itself (topic WorkerStatus, key worker_id).
struct WorkerStatus {
  std::string worker_id;  ///< "sim-0", "policy-0", "learner", "supervisor"
  std::string host;
  int32_t pid = 0;
  std::string role;
  std::string state;  ///< starting, running, paused, stopping, failed
  double decisions_per_s = 0;
  std::string message;
};

/// The desired state (topic RunControl, one instance).
struct RunControl {
  std::string run_state;        ///< running, paused, stopping
  uint32_t checkpoint_seq = 0;  ///< grows: save a checkpoint
  uint32_t settings_epoch = 0;
};

/// Version notice (topic WeightsUpdate); inside a host the bytes lie in the arena.
struct WeightsUpdate {
  uint32_t version = 0;
  uint64_t bytes = 0;
  uint64_t checksum = 0;
};

/// One finished episode (topic EpisodeResult).
struct EpisodeResult {
  std::string scenario;
  EpisodeRecord record;
};

/// The learner's report (topic TrainStats).
struct TrainStats {
  double time_s = 0;
  uint64_t env_frames = 0;
  uint64_t decisions = 0;
  uint32_t learner_version = 0;
  double env_frames_per_s = 0;
  double decisions_per_s = 0;
  double score_mean = 0;  ///< J over the last stats_avg episodes; NaN before the first
  double return_mean = 0;
  uint64_t episodes = 0;
  double policy_lag_mean = 0;
  uint32_t policy_lag_max = 0;
  std::string last_checkpoint;
};

/// One participant. Writers and readers are made on first use; take_*() returns what has arrived since the
/// last call, oldest first, and never blocks. A participant also hears itself. Strings longer than the
/// topic's bound (comrad.idl) are cut, except worker_id, which is an error. Threads: any thread may write and
/// take; the destructor needs the bus for itself.
class Bus {
 public:
  /// Errors: kBadInput for a config that validate() refuses or a second run in this process's domain; kSystem with
  /// Cyclone's return code and what to check.
  static Expected<Bus> open(const BusConfig& config);
  Bus(Bus&&) noexcept;
  Bus& operator=(Bus&&) noexcept;
  ~Bus();

  Status write(const WorkerStatus& status);
  Status write(const RunControl& control);
  Status write(const WeightsUpdate& update);
  Status write(const EpisodeResult& result);
  Status write(const TrainStats& stats);

  std::vector<WorkerStatus> take_worker_status();
  /// worker_ids whose liveliness ended since the last call (writer gone without goodbye).
  std::vector<std::string> take_lost_workers();
  std::optional<RunControl> take_run_control();        ///< newest
  std::optional<WeightsUpdate> take_weights_update();  ///< newest
  std::vector<EpisodeResult> take_episode_results();
  std::optional<TrainStats> take_train_stats();  ///< newest

  /// Blocks until something lies ready on any reader made so far (by its first take), or `timeout_ms`. True
  /// if something does. The waiting thread takes from every reader it made, or the next wait returns at once.
  bool wait(int timeout_ms);

 private:
  struct State;
  explicit Bus(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;  // only bus.cc includes Cyclone
};

}  // namespace comrad::dds
