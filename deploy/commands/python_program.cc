#include "deploy/commands/python_program.h"

#include "deploy/process/child_program.h"

namespace comrad::deploy {
namespace {

constexpr double kImportTimeoutS = 300;  // of a busy machine with a cold disk

}  // namespace

Expected<std::string> python_that_imports(const std::string& modules) {
  for (const char* python : {"/usr/bin/python3", "python3"}) {
    const auto tried = run_program({python, "-c", "import " + modules}, {.timeout_s = kImportTimeoutS});
    if (tried && tried->exit_code == 0) return std::string(python);
  }
  return Error{ErrorCode::kNotFound, "no Python that can import " + modules +
                                         "; ./comrad report installs what is missing on Debian "
                                         "(deploy/packages_report.txt)"};
}

}  // namespace comrad::deploy
