// Where the processes of a run on this host meet: the arena and the socket through which workers join it. The supervisor
// owns them; a run in lock step gets new ones after a death.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/run_effects.h"
#include "deploy/launch/worker_table.h"
#include "rollout_buffer/core/control_group.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/shm/arena.h"
#include "rollout_buffer/shm/arena_socket.h"

namespace comrad::deploy {

/// Threads: the supervisor's. What the arguments name outlives them.
class RunResources final : public RunEffects {
 public:
  RunResources(const LaunchPlan& plan, ProgressPrinter& printer) : plan_(plan), printer_(printer) {}

  /// Creates arena and socket for a run that is starting.
  /// Errors: kNoSpace (arena), kBadInput, kSystem (socket).
  Status open() override;
  /// Arena and socket exist. Other methods require that unless their comment states otherwise.
  bool is_open() const override { return server_.has_value(); }

  const shm::Arena& arena() const override { return *arena_; }
  const std::string& socket_name() const override { return server_->name(); }
  /// Writes it into the arena; a stop also wakes workers that wait for something else.
  void set_run_state(shm::RunState state) override;
  std::optional<uint64_t> reclaim(const Worker& worker) override { return reclaim_worker(worker, *arena_); }
  void note(const std::string& text) override;
  uint64_t memory_kills() override { return comrad::memory_kills(); }

  /// Readable when a worker joins; -1 while there is no socket.
  int socket() const { return server_ ? server_->descriptor() : -1; }
  /// The next worker that has joined, if one has. Also while the resources are closed.
  std::optional<shm::JoinRequest> next_join();

  /// Gives each episode that ended since the last call to `visit`.
  void drain_episodes(const std::function<void(const EpisodeRecord&)>& visit);
  /// A status file or a monitor that fails is no reason to stop training, and one line about it is enough.
  void warn_once(const Status& status);

 private:
  const LaunchPlan& plan_;
  ProgressPrinter& printer_;
  std::optional<shm::Arena> arena_;
  std::optional<shm::ArenaServer> server_;
  bool has_warned_ = false;
  uint64_t episodes_lost_ = 0;
};

}  // namespace comrad::deploy
