// The commands of `comrad`, one source file each. A command parses its own arguments, does its work and
// returns an exit code: see core/process.h.
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "deploy/settings/command_line.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/process.h"

namespace comrad::deploy {

using Arguments = std::span<const std::string>;

struct Command {
  std::string name;
  std::string summary;                  ///< one line of `comrad help`
  int (*run)(Arguments arguments);      ///< the words after the command's name; `--help` prints and returns 0
  std::vector<std::string> words = {};  ///< that may follow without dashes, for shells; none: names of files
};

/// Among Command::words: the name of any scenario.
constexpr const char* kAnyScenario = "<scenario>";

/// Every command, in the order of `comrad help`.
const std::vector<Command>& commands();

int train_command(Arguments arguments);
int serve_command(Arguments arguments);
int join_command(Arguments arguments);
int eval_command(Arguments arguments);
int watch_command(Arguments arguments);
int play_command(Arguments arguments);
int plot_command(Arguments arguments);
int report_command(Arguments arguments);
int export_command(Arguments arguments);
int pack_policies_command(Arguments arguments);
int fetch_policies_command(Arguments arguments);
int bench_command(Arguments arguments);
int tune_command(Arguments arguments);
int sweep_command(Arguments arguments);
int ctl_command(Arguments arguments);
int top_command(Arguments arguments);
int config_command(Arguments arguments);
int scenarios_command(Arguments arguments);
int doomgen_command(Arguments arguments);
int acs_command(Arguments arguments);
int trace_command(Arguments arguments);
int docs_command(Arguments arguments);
int doctor_command(Arguments arguments);
int keys_command(Arguments arguments);
int completion_command(Arguments arguments);
int test_command(Arguments arguments);

/// What `comrad help <command>` prints for a command with the settings of a run: those that people change first, with --all
/// every one, with the values that hold for the settings among the arguments. Returns the exit code.
int print_settings_help(const std::string& command, const CommandLine& line);

/// Parses the arguments and does `work`, which returns the exit code; prints the help where it is requested, and what failed.
int run_command(const std::string& command, CommandLine& line, Arguments arguments,
                const std::function<Expected<int>()>& work);

/// Prints "comrad <command>: error: <message>" to stderr and returns the exit code of the error's kind.
int report_error(const std::string& command, const Error& error);

}  // namespace comrad::deploy
