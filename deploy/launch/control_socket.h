// The control socket, through which `comrad ctl` and `comrad top` talk to a run: an abstract Unix socket of the supervisor,
// whose peer's user the kernel reports. Only its name lies on a disk, in the run directory's lock file; other users get no
// answer, and the message bus, on which any process can write, plays no part.
#pragma once

#include <cstdint>
#include <functional>
#include <optional>
#include <string>

#include "deploy/process/reply_server.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Where the control socket of a run is: what the supervisor leaves in the run directory's lock file.
struct ControlAddress {
  int64_t pid = 0;     ///< of the supervisor
  std::string socket;  ///< the socket's name; empty where there is none
  std::string host;
};
/// An address for this process, with a name that no other process can guess and take.
ControlAddress make_control_address();
/// Writes it into the lock file. Errors: those of the file.
Status write_control_address(int lock, const ControlAddress& address);
/// Nothing where there is no lock file.
std::optional<ControlAddress> read_control_address(const std::string& run_dir);

/// What the supervisor does on each command; each returns a message when it cannot.
struct ControlCommands {
  std::function<std::string()> status = nullptr;  ///< a JSON object on one line
  std::function<Status()> pause = nullptr, resume = nullptr, stop = nullptr;
  std::function<Expected<uint32_t>()> checkpoint =
      nullptr;  ///< returns the request's number: done when `checkpoint.done` reaches it
  std::function<Status(const std::string& host)> drain = nullptr;
};

/// One request, one line: {"do": "status" | "pause" | "resume" | "checkpoint" | "stop" | "drain", "host": "name"}. The answer
/// is the status, or {"ok": true, ...}, or {"error": "words"}.
/// Threads: the supervisor's.
class ControlSocket {
 public:
  /// Errors: kSystem.
  static Expected<ControlSocket> open(const std::string& name, ControlCommands orders);
  void tick(double now_s) { server_.tick(now_s); }

 private:
  explicit ControlSocket(ReplyServer server) : server_(std::move(server)) {}
  ReplyServer server_;
};

/// The answer to one request.
std::string answer_command(std::string_view request, const ControlCommands& orders);

}  // namespace comrad::deploy
