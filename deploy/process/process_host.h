// Where programs of a run are started and their ends are heard of: on this machine, or in a simulation without processes.
#pragma once

#include <sys/types.h>

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

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
  bool takes_input = false;  ///< its standard input is what Process::write_input() writes; else /dev/null
  int output = -1;           ///< where its standard output goes; -1: to us, as standard error does
};

/// How a child ended.
struct ExitStatus {
  int code = 0;              ///< exit code, when signal is 0
  int signal = 0;            ///< killed by this one
  std::string text() const;  ///< "exit code 1", "killed by signal 9 (Killed)"
};

/// A program that was started. Destroying it kills (SIGKILL) and reaps one that still runs.
class Process {
 public:
  virtual ~Process() = default;

  virtual pid_t pid() const = 0;
  /// Readable when it has printed something; -1: never.
  virtual int output_descriptor() const = 0;
  /// Whole lines printed since the last call; never blocks. At the end of output also an unfinished one.
  virtual std::vector<std::string> read_lines() = 0;
  /// Set once it has ended; reaps it. Never blocks.
  virtual const std::optional<ExitStatus>& poll_exit() = 0;
  /// Sends a signal, unless it was reaped.
  virtual void send_signal(int signal) = 0;
  /// To its standard input, of one that takes input; and the end of that.
  virtual void write_input(const std::string& text) = 0;
  virtual void end_input() = 0;
  /// CPU time of it and its children until now; after poll_exit() saw its end, all that it took. 0 where it cannot be read.
  virtual double cpu_seconds() const = 0;
  /// Whether SIGSTOP or a debugger holds it.
  virtual bool is_stopped() const = 0;
  /// Whether a thread of it runs, or waits for a core or a disk, at this moment.
  virtual bool is_at_work() const = 0;
};

/// Threads: the supervisor's.
class ProcessHost {
 public:
  virtual ~ProcessHost() = default;
  /// Errors: kNotFound or kSystem when it cannot be started.
  virtual Expected<std::unique_ptr<Process>> spawn(const ChildOptions& options) = 0;
};

/// This machine: child_process.h. Threads: call from a thread that outlives the children.
class MachineProcessHost final : public ProcessHost {
 public:
  Expected<std::unique_ptr<Process>> spawn(const ChildOptions& options) override;
};

}  // namespace comrad::deploy
