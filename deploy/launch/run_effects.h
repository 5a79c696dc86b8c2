// What supervision (supervision.h) does beside starting processes and sending them signals: an interface, so that a simulation
// may replace sockets and the terminal.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "deploy/launch/worker_table.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::deploy {

/// Threads: the supervisor's.
class RunEffects {
 public:
  virtual ~RunEffects() = default;

  /// Makes arena and socket anew, for a run that is starting; those of before are gone even where that fails.
  virtual Status open() = 0;
  /// They are there. Other functions but note() and memory_kills() want that.
  virtual bool is_open() const = 0;
  virtual const shm::Arena& arena() const = 0;
  virtual const std::string& socket_name() const = 0;
  /// What every worker should do from now on.
  virtual void set_run_state(shm::RunState state) = 0;
  /// As reclaim_worker() of worker_table.h.
  virtual std::optional<uint64_t> reclaim(const Worker& worker) = 0;
  /// Words for the user, in the terminal and the log.
  virtual void note(const std::string& text) = 0;
  /// Kills for lack of memory so far, of the kernel in this control group.
  virtual uint64_t memory_kills() = 0;
};

}  // namespace comrad::deploy
