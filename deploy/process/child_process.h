// One program started by the supervisor: it dies with us, keeps nothing of ours open, and what it prints
// comes back line by line.
#pragma once

#include <sys/types.h>

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "deploy/process/process_start.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What to start.
struct ChildOptions {
  std::string program;                                           ///< absolute path
  std::vector<std::string> arguments;                            ///< without argv[0]
  std::vector<std::pair<std::string, std::string>> environment;  ///< on top of ours
  int inherited_descriptor = -1;  ///< kept open in the child (the run directory's lock); -1: none
  int cpu = -1;                   ///< pinned to this core; -1: anywhere
  bool waits_its_turn = false;    ///< as of ProcessOptions
  int input = -1;                 ///< its standard input; -1: /dev/null
  int output = -1;                ///< where its standard output goes; -1: to us, as standard error does
};

/// How a child ended.
struct ExitStatus {
  int code = 0;              ///< exit code, when signal is 0
  int signal = 0;            ///< killed by this one
  std::string text() const;  ///< "exit code 1", "killed by signal 9 (Killed)"
};

/// A running child. Destroying it kills (SIGKILL) and reaps a child that still runs.
class ChildProcess {
 public:
  /// Starts the program as process_start.h says: standard error and (unless it goes elsewhere) output are one pipe to us; SIGINT and SIGHUP are
  /// ignored (the supervisor decides). Errors: kNotFound or kSystem when it cannot be executed.
  /// Threads: call from a thread that outlives the child.
  static Expected<ChildProcess> spawn(const ChildOptions& options);

  ChildProcess(ChildProcess&& other) noexcept;
  ChildProcess& operator=(ChildProcess&& other) noexcept;
  ~ChildProcess();

  pid_t pid() const { return pid_; }
  int output_descriptor() const { return output_.get(); }
  /// Whole lines printed since the last call; never blocks. At the end of output also an unfinished one.
  std::vector<std::string> read_lines();
  /// Set once the child has ended; reaps it. Never blocks.
  const std::optional<ExitStatus>& poll_exit();
  /// Sends a signal, unless the child was reaped.
  void send_signal(int signal);
  /// CPU time of it and its children until now; after poll_exit() saw its end, all that it took. 0 where it cannot be read.
  double cpu_seconds() const;
  /// Whether it stands still because somebody sent it SIGSTOP (or a debugger holds it).
  bool is_stopped() const;

 private:
  ChildProcess(pid_t pid, Descriptor output) : pid_(pid), output_(std::move(output)) {}
  void end();
  pid_t pid_ = -1;
  Descriptor output_;
  std::string partial_;
  std::optional<ExitStatus> exit_;
  double cpu_s_at_exit_ = 0;
};

}  // namespace comrad::deploy
