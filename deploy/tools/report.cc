// `comrad report`: becomes deploy/report/report.py, with a Python that has what it needs.

#include <cstdio>
#include <string>
#include <vector>

#include "deploy/process/child_program.h"
#include "deploy/process/python_program.h"
#include "deploy/run/command.h"

namespace comrad::deploy {

int report_command(Arguments arguments) {
  const bool asks_for_help = arguments.size() == 1 && (arguments[0] == "--help" || arguments[0] == "-h");
  const Expected<std::string> python = python_that_imports(asks_for_help ? "sys" : kReportModules);
  if (!python && asks_for_help) {
    std::printf("usage: comrad report DIR [--output FOLDER]\n\n%s\n", python.error().message.c_str());
    return kExitDone;
  }
  if (!python) return report_error("report", python.error());
  return report_error("report", replace_process(python_command(*python, "deploy/report/report.py",
                                                               {arguments.begin(), arguments.end()})));
}

}  // namespace comrad::deploy
