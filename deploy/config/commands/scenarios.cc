// `comrad scenarios`, `comrad doomgen` and `comrad acs`: programs under the names that users look for.

#include <algorithm>

#include "deploy/config/child_program.h"
#include "deploy/config/commands/command.h"

namespace comrad::deploy {
namespace {

const std::vector<std::string> kGalleryHelp = {"--gallery", ".", "--help"};

}  // namespace

int scenarios_command(Arguments arguments) {
  // Pictures need the engine, which comrad-scenarios does not know.
  const bool draws = !arguments.empty() && arguments[0].starts_with("--gallery");
  std::vector<std::string> command = {sibling_program(draws ? "comrad-trace" : "comrad-scenarios")};
  if (draws && std::any_of(arguments.begin(), arguments.end(),
                           [](const std::string& word) { return word == "--help" || word == "-h"; }))
    arguments = kGalleryHelp;  // else the folder would be called --help
  command.insert(command.end(), arguments.begin(), arguments.end());
  if (draws) return report_error("scenarios", replace_process(command));
  if (arguments.empty() || (arguments[0].starts_with("--") && arguments[0] != "--help"))
    command.insert(command.begin() + 1, "list");
  return report_error("scenarios", replace_process(command));
}

int doomgen_command(Arguments arguments) {
  std::vector<std::string> command = {sibling_program("comrad-doomgen")};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return report_error("doomgen", replace_process(command));
}

int acs_command(Arguments arguments) {
  std::vector<std::string> command = {sibling_program("comrad-acs")};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return report_error("acs", replace_process(command));
}

}  // namespace comrad::deploy
