// `comrad scenarios`, `comrad doomgen` and `comrad acs`: programs under the names that users look for.

#include <algorithm>
#include <string>
#include <vector>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"

namespace comrad::deploy {
namespace {

/// Becomes the program beside this one with the same words.
int become(const char* command, const std::string& program, Arguments arguments) {
  std::vector<std::string> words = {sibling_program(program)};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return report_error(command, replace_process(words));
}

/// Becomes deploy/site/scenario_pages.py. Errors: kNotFound outside of a checkout, or without Python.
Error write_pages(Arguments arguments) {
  const std::string script = "deploy/site/scenario_pages.py";
  COMRAD_TRY(check_checkout_has(script));
  COMRAD_TRY_ASSIGN(const std::string python, python_that_imports("tomllib", "install Python 3.11 or later"));
  std::vector<std::string> words = {"--comrad", sibling_program("comrad")};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return replace_process(python_command(python, script, words));
}

}  // namespace

int scenarios_command(Arguments arguments) {
  const auto is_pages = [](const std::string& word) {
    return word == "--pages" || word.starts_with("--pages=");
  };
  if (std::ranges::any_of(arguments, is_pages)) return report_error("scenarios", write_pages(arguments));
  return become("scenarios", "comrad-scenarios", arguments);
}
int doomgen_command(Arguments arguments) { return become("doomgen", "comrad-doomgen", arguments); }
int acs_command(Arguments arguments) { return become("acs", "comrad-acs", arguments); }
int trace_command(Arguments arguments) { return become("trace", "comrad-trace", arguments); }

}  // namespace comrad::deploy
