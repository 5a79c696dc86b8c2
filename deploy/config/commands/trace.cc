// `comrad trace`: comrad-trace under the name that users look for.

#include "deploy/config/child_program.h"
#include "deploy/config/commands/command.h"

namespace comrad::deploy {

int trace_command(Arguments arguments) {
  std::vector<std::string> command = {sibling_program("comrad-trace")};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return report_error("trace", replace_process(command));
}

}  // namespace comrad::deploy
