// How this program starts another one: fork and exec in one place, for the workers of a run (child_process.h) and for
// the programs that a command queries (deploy/process/child_program.h).
#pragma once

#include <sys/types.h>

#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/descriptor.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// Two ends that a child does not inherit by itself.
struct Pipe {
  Descriptor read_end, write_end;
  /// Errors: kSystem.
  static Expected<Pipe> open();
};

/// For programs that compute with several threads, on top of ours: a thread that waits at a barrier sleeps, unless our environment has
/// another OMP_WAIT_POLICY. One that spins takes a core from a thread that computes.
std::vector<std::pair<std::string, std::string>> sleeping_threads();

/// What to start.
struct ProcessOptions {
  std::vector<std::string> command;                              ///< first a path, or a name on PATH
  std::vector<std::pair<std::string, std::string>> environment;  ///< on top of ours
  int input = -1;                                                ///< becomes standard input; -1: /dev/null
  int output = -1;                                               ///< becomes standard output
  int error_output = -1;                                         ///< becomes standard error
  int inherited_descriptor = -1;                                 ///< kept open in the child; -1: none
  int cpu = -1;                                                  ///< pinned to this core; -1: anywhere
  bool waits_its_turn =
      false;  ///< takes a core when another thread's turn ends, not as soon as it wakes up (SCHED_BATCH)
  bool ignores_interrupts = false;  ///< SIGINT and SIGHUP, which a terminal sends to all processes
  bool has_own_group =
      false;  ///< what a terminal sends does not reach it, and kill(-pid) reaches its children
};

/// Starts the program and returns its pid once it runs. SIGTERM comes when the
/// calling thread ends, however it ends; other signals have their defaults and none is blocked (prepare_process() is
/// for our own programs); all other descriptors are closed.
/// Errors: kNotFound, or kSystem, when it cannot be executed.  Threads: call from a thread that outlives the child.
Expected<pid_t> start_process(const ProcessOptions& options);

}  // namespace comrad::deploy
