// Where the processes of a run on this host meet: the arena, the socket through which workers join it, and the bus on
// which monitors listen. The supervisor owns them; a run in lock step gets new ones after a death.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/rate_meter.h"
#include "deploy/launch/run_effects.h"
#include "deploy/launch/worker_table.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/control_group.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace comrad::deploy {

/// Threads: the supervisor's. What the arguments name outlives them.
class RunResources final : public RunEffects {
 public:
  RunResources(const LaunchPlan& plan, const Clock& clock, ProgressPrinter& printer)
      : plan_(plan), clock_(clock), printer_(printer) {}

  /// Creates arena, socket and bus for a run that is starting.
  /// Errors: kNoSpace (arena), kBadInput, kSystem (socket, bus).
  Status open() override;
  /// Arena, socket and bus exist. Other methods require that unless their comment states otherwise.
  bool is_open() const override { return bus_.has_value(); }

  const shm::Arena& arena() const override { return *arena_; }
  const std::string& socket_name() const override { return server_->name(); }
  /// Publishes it to monitors and workers; a stop also wakes workers that wait for something else.
  void set_run_state(shm::RunState state) override;
  std::optional<uint64_t> reclaim(const Worker& worker) override { return reclaim_worker(worker, *arena_); }
  void note(const std::string& text) override;
  uint64_t memory_kills() override { return comrad::memory_kills(); }

  /// Readable when a worker joins; -1 while there is no socket.
  int socket() const { return server_ ? server_->descriptor() : -1; }
  /// The next worker that has joined, if one has. Also while the resources are closed.
  std::optional<shm::JoinRequest> next_join();

  /// Reads the simulators' episodes: on to monitors, and, of an evaluation, to the meter.
  void drain_episodes(RateMeter& meter);
  /// Publishes the state of the supervisor (`state`) and of its simulators; the other workers report
  /// themselves.
  void publish_workers(const std::vector<Worker>& workers, const std::string& state);
  /// One message for monitors.
  template <typename Message>
  void publish(const Message& message) {
    warn_once(bus_->write(message));
  }
  /// A bus or a status file that fails is no reason to stop training, and one line about it is enough.
  void warn_once(const Status& status);

 private:
  const LaunchPlan& plan_;
  const Clock& clock_;
  ProgressPrinter& printer_;
  std::optional<shm::Arena> arena_;
  std::optional<shm::ArenaServer> server_;
  std::optional<dds::Bus> bus_;
  bool has_warned_ = false;
  uint64_t episodes_lost_ = 0;
  double workers_published_s_ = 0;
  std::vector<uint64_t> decisions_published_;  // by simulator, at that time
};

}  // namespace comrad::deploy
