// What a run with --publish reports to monitors on other hosts: its workers, the learner's report, finished episodes. A
// participant beside the link's (link_bus.h), in the same domain and with the same keys. It takes no orders.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus_config.h"
#include "rollout_buffer/dds/keys.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/train_stats.h"

namespace comrad::dds {

constexpr uint32_t kBusVersion =
    6;  ///< of these topics: builds of other versions see each other, and no more

/// One worker of the run; its role "supervisor": the run itself, "host": all workers of another host that plays for it.
struct WorkerStatus {
  std::string worker_id = {};  ///< the key: "sim-0", "policy-0", "learner", "supervisor"
  std::string host = {};
  int32_t pid = 0;  ///< 0: none now
  std::string role = {};
  std::string state = {};
  double decisions_per_s = 0;
  double busy = 0;  ///< share of the last second or so that it did not wait for others, 0 to 1
  double silent_s = 0;
  double cpu_s = 0;
  uint64_t resident_bytes = 0;
  uint32_t restarts = 0;
  std::string message = {};
};

/// One finished episode.
struct EpisodeResult {
  std::string scenario = {};
  EpisodeRecord record = {};
};

/// The learner's report, and what it is a part of.
struct RunStats {
  std::string run = {};        ///< name of the run's folder
  double elapsed_s = 0;        ///< of this start of the run
  double env_frames_goal = 0;  ///< train_for_env_frames
  uint32_t frame_skip = 1;
  TrainStats stats = {};
};

/// The topics, for permissions. The run writes all of them, hosts read them.
const std::vector<LinkTopic>& monitor_topics();

/// One end. Writers and readers are made on first use; take_*() never blocks; strings longer than the topic's bound
/// (comrad.idl) are cut between two characters. Threads: one.
class MonitorBus {
 public:
  /// `config` is that of the run's link (link/link_address.h). Another `version` is for tests. Errors: those of validate(),
  /// kBadInput where this process takes part in another run of the same domain, kSystem with Cyclone's return code and
  /// what to check.
  static Expected<MonitorBus> open(const BusConfig& config, uint32_t version = kBusVersion);
  MonitorBus(MonitorBus&&) noexcept;
  MonitorBus& operator=(MonitorBus&&) noexcept;
  ~MonitorBus();

  /// Errors: kTimeout where readers do not keep up, and nothing was written; kBadInput where keys do not allow it; kSystem.
  Status write(const WorkerStatus& status);
  Status write(const EpisodeResult& result);
  Status write(const RunStats& stats);

  void take_workers(const std::function<void(const WorkerStatus&)>& visit);
  void take_episodes(const std::function<void(const EpisodeResult&)>& visit);
  void take_stats(const std::function<void(const RunStats&)>& visit);
  /// Blocks until something lies ready on any reader made so far, or `timeout_ms`. True if something does.
  bool wait(int timeout_ms);

  /// The writers that discovery shows on this run's link: the versions in which these topics are written, and whether the run serves.
  struct Seen {
    std::vector<uint32_t> versions = {};
    bool has_link = false;
  };
  Seen seen() const;

 private:
  struct State;
  explicit MonitorBus(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace comrad::dds
