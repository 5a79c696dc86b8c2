// How a process of the same host joins a run: it connects to the run's Unix socket, the supervisor checks the
// peer's user (SO_PEERCRED) and hands the arena's descriptor over (SCM_RIGHTS). Nothing else travels here.
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <string>

#include "rollout_buffer/core/descriptor.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::shm {

/// The worker that joins; sent as one fixed-size datagram.
struct JoinRequest {
  uint32_t magic = kArenaMagic;
  uint32_t arena_version = kArenaVersion;
  char role[16] = {};  ///< "sim", "policy", "learner", "monitor"
  uint32_t worker_index = 0;
};

/// Listens on an abstract Unix socket (no file is left behind). Owned by the supervisor; poll descriptor()
/// and call serve_one() when it is readable.
class ArenaServer {
 public:
  /// Errors: kSystem when the name is taken (another run of the same name on this host).
  static Expected<ArenaServer> listen(const std::string& name, const Arena& arena);

  int descriptor() const { return socket_.get(); }
  const std::string& name() const { return name_; }
  /// Accepts one peer, checks that it runs as the same user, hands the arena over. Bounded wait of 1 s on a
  /// peer that connects and stays silent. Errors: kBadInput (wrong user, magic or version), kTimeout,
  /// kSystem; the server continues.
  Expected<JoinRequest> serve_one();

 private:
  ArenaServer() = default;
  std::string name_;
  Descriptor socket_, arena_;
};

/// Joins the run that listens on `name`. Retries until `timeout_ms` while no process listens yet.
/// Errors: kNotFound, kTimeout, kBadFormat, kBadInput.
Expected<Arena> join_arena(const std::string& name, const JoinRequest& request, int timeout_ms);

}  // namespace comrad::shm
