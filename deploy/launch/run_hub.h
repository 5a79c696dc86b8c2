// Where the processes of a run on this host meet: the arena, the socket through which workers join it, and the bus on
// which monitors listen. The supervisor owns them; a run in lock step gets new ones after a death.
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/run_meter.h"
#include "deploy/launch/worker_table.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace comrad::deploy {

/// Threads: the supervisor's. Plan, meter and printer outlive the hub.
class RunHub {
 public:
  RunHub(const LaunchPlan& plan, RunMeter& meter, ProgressPrinter& printer)
      : plan_(plan), meter_(meter), printer_(printer) {}

  /// Makes all three anew, for a run that is starting; the meter counts in the new arena from now on.
  /// Errors: kNoSpace (arena), kBadInput, kSystem (socket, bus).
  Status open();
  /// All three are there. Other methods want that, unless they say otherwise.
  bool is_open() const { return bus_.has_value(); }

  const shm::Arena& arena() const { return *arena_; }
  const std::string& socket_name() const { return server_->name(); }
  /// Readable when a worker joins; -1 while there is no socket.
  int socket() const { return server_ ? server_->descriptor() : -1; }
  /// The next worker that has joined, if one has. Also where the hub is not open.
  std::optional<shm::JoinRequest> next_join();

  /// Tells everybody of the run to begin, or to end.
  void begin();
  void stop();
  /// Simulators and learner stand still where they are, or go on.
  void set_paused(bool is_paused);
  /// Takes the simulators' episodes: on to the learner, to monitors, and, of an evaluation, to the meter.
  void drain_episodes();
  /// Tells monitors of the supervisor, which is in `state`, and of its simulators; the other workers speak
  /// for themselves.
  void tell_of_workers(const std::vector<Worker>& workers, const std::string& state);
  /// One message for monitors.
  template <typename Message>
  void tell(const Message& message) {
    warn_once(bus_->write(message));
  }
  /// A bus or a status file that fails is no reason to stop training, and one line about it is enough.
  void warn_once(const Status& status);

 private:
  const LaunchPlan& plan_;
  RunMeter& meter_;
  ProgressPrinter& printer_;
  std::optional<shm::Arena> arena_;
  std::optional<shm::ArenaServer> server_;
  std::optional<dds::Bus> bus_;
  bool has_warned_ = false;
  uint64_t episodes_dropped_ = 0;
  double workers_told_s_ = 0;
  std::vector<uint64_t> decisions_told_;  // by simulator, at that time
};

}  // namespace comrad::deploy
