// Programs that this one starts and waits for: generator, scenario list, benches, ctest. Workers of a run are
// the supervisor's (deploy/launch), not these.
#pragma once

#include <functional>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// The program of this name in the folder of our own executable.
std::string sibling_program(const std::string& name);

/// The build folder that our own executable lies in (<build>/bin/comrad).
std::string build_folder();

/// Whether our own executable was installed (<prefix>/libexec/comrad/comrad): it has no sources and no build folder.
bool is_installed();

struct ProgramOptions {
  double timeout_s = 60;     ///< the program is killed then; more in a process of low priority (patience())
  bool echo_stderr = false;  ///< also pass its stderr on, as it comes
  std::vector<std::pair<std::string, std::string>> environment = {};  ///< on top of ours
  /// Called for every whole line of stdout as it comes; the output is kept all the same.
  std::function<void(const std::string& line)> on_line = {};
};

struct ProgramResult {
  int exit_code = 0;         ///< 128 + signal number when a signal ended it
  std::string output;        ///< stdout
  std::string error_output;  ///< stderr
  bool interrupted = false;  ///< SIGINT or SIGTERM reached us meanwhile; it was passed on as SIGTERM
};

/// Runs `command` (its first word is a path, or a name on PATH) to its end. The child dies with us.
/// Errors: kNotFound (no such program), kTimeout, kSystem. A non-zero exit is a result, not an error.
/// Threads: blocks SIGINT and SIGTERM in the calling thread while the child runs.
Expected<ProgramResult> run_program(const std::vector<std::string>& command,
                                    const ProgramOptions& options = {});

/// The last line of a failed program's stderr without its "comrad-name: error: " prefix, for our own message.
std::string last_words(const ProgramResult& result);

/// Replaces this process by `command`. Returns only when that fails. Errors: kNotFound, kSystem.
Error replace_process(const std::vector<std::string>& command);

}  // namespace comrad::deploy
