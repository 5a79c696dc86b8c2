// A run of another host as it reports itself with --publish, in the form in which a run of this host answers `comrad top`.
#pragma once

#include <deque>
#include <map>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/link_bus.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// Where to look. `hosts` holds the interface (auto: the one that leads there) and whether a network without keys may be used.
struct RemoteRequest {
  std::string address;          ///< as of `comrad join`
  std::string key_folder = {};  ///< this host's keys; empty: none
  HostSettings hosts = {};
  double wait_s = 10;  ///< for the run's first report
};

/// What it reports is its sender's word: texts and numbers are bounded and made fit for a terminal. Threads: one.
class RemoteRun {
 public:
  /// Waits for the first report. Errors: kBadInput for an address, interface or keys, or where the run publishes in another
  /// version or not at all; kTimeout without a report, saying what to check; those of LinkBus::open().
  static Expected<RemoteRun> open(const RemoteRequest& request);

  /// What has been reported until now, as run_table.h reads it.
  nlohmann::json look();
  /// Whether the run has reported its end.
  bool has_ended() const;

 private:
  RemoteRun(std::string address, dds::LinkBus bus) : address_(std::move(address)), bus_(std::move(bus)) {}
  void listen();
  bool has_report() const { return stats_.has_value() && workers_.contains(kSupervisor); }
  Error why_nothing(const RemoteRequest& request, const std::string& address, uint32_t first_port) const;

  static constexpr const char* kSupervisor = "supervisor";
  std::string address_;
  dds::LinkBus bus_;
  std::map<std::string, dds::WorkerStatus> workers_;  ///< by id
  std::optional<dds::RunStats> stats_;
  std::deque<EpisodeRecord> episodes_;  ///< the newest
  uint64_t episodes_heard_ = 0;
  double heard_s_ = 0;  ///< when the supervisor's last report came
};

}  // namespace comrad::deploy
