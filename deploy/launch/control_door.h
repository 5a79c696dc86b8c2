// Where `comrad ctl` and `comrad top` talk to a run: an abstract Unix socket of the supervisor, at which the kernel says who
// asks. Nothing of it lies on a disk but its name, in the run directory's lock file; no other user gets an answer, and the
// message bus, on which anybody can speak, is not asked.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "deploy/process/reply_server.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Where the door of a run is: what the supervisor leaves in the run directory's lock file.
struct DoorSign {
  int64_t pid = 0;   ///< of the supervisor
  std::string door;  ///< the socket's name; empty where there is none
  std::string host;
};
/// A sign for this process, with a name that nobody can guess and take.
DoorSign make_door_sign();
/// Writes it into the lock file. Errors: those of the file.
Status write_door_sign(int lock, const DoorSign& sign);
/// Nothing where there is no lock file.
std::optional<DoorSign> read_door_sign(const std::string& run_dir);

/// What the supervisor does when it is told to; each says in words why it cannot.
struct DoorOrders {
  std::function<std::string()> status = nullptr;  ///< a JSON object on one line
  std::function<Status()> pause = nullptr, resume = nullptr, stop = nullptr;
  std::function<Expected<uint32_t>()> checkpoint =
      nullptr;  ///< gives the request's number: done when `checkpoint.done` reaches it
  std::function<Status(const std::string& host)> drain = nullptr;
};

/// One request, one line: {"do": "status" | "pause" | "resume" | "checkpoint" | "stop" | "drain", "host": "name"}. The answer
/// is the status, or {"ok": true, ...}, or {"error": "words"}.
/// Threads: the supervisor's.
class ControlDoor {
 public:
  /// Errors: kSystem.
  static Expected<ControlDoor> open(const std::string& name, DoorOrders orders);
  void tick(double now_s) { server_.tick(now_s); }

 private:
  explicit ControlDoor(ReplyServer server) : server_(std::move(server)) {}
  ReplyServer server_;
};

/// The answer to one request.
std::string answer_at_door(std::string_view request, const DoorOrders& orders);

}  // namespace comrad::deploy
