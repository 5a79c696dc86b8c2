// `comrad report`: becomes deploy/report/report.py, with a Python that has what it needs.

#include <cstdio>
#include <string>
#include <vector>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {

int report_command(Arguments arguments) {
  const bool asks_for_help = arguments.size() == 1 && (arguments[0] == "--help" || arguments[0] == "-h");
  const Expected<std::string> python = python_that_imports(asks_for_help ? "sys" : kReportModules);
  if (!python && asks_for_help) {
    std::printf("usage: comrad report DIR [--output FOLDER]\n\n%s\n", python.error().message.c_str());
    return kExitDone;
  }
  if (!python) return report_error("report", python.error());
  // -B: no compiled files among the sources, whose age ./comrad looks at.
  std::vector<std::string> words = {*python, "-B", data_dir() + "/deploy/report/report.py"};
  words.insert(words.end(), arguments.begin(), arguments.end());
  return report_error("report", replace_process(words));
}

}  // namespace comrad::deploy
