// `comrad scenarios`, `comrad doomgen` and `comrad acs`: programs under the names that users look for.

#include "deploy/process/child_program.h"
#include "deploy/run/command.h"

namespace comrad::deploy {
namespace {

/// Becomes the program beside this one with the same words.
int become(const char* command, const std::string& program, Arguments arguments) {
  std::vector<std::string> words = {sibling_program(program)};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return report_error(command, replace_process(words));
}

}  // namespace

int scenarios_command(Arguments arguments) { return become("scenarios", "comrad-scenarios", arguments); }
int doomgen_command(Arguments arguments) { return become("doomgen", "comrad-doomgen", arguments); }
int acs_command(Arguments arguments) { return become("acs", "comrad-acs", arguments); }
int trace_command(Arguments arguments) { return become("trace", "comrad-trace", arguments); }

}  // namespace comrad::deploy
