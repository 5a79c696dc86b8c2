#include "deploy/process/python_program.h"

#include "deploy/process/child_program.h"

namespace comrad::deploy {
namespace {

constexpr double kImportTimeoutS = 300;  // of a busy machine with a cold disk

}  // namespace

Expected<std::string> python_that_imports(const std::string& modules, const std::string& what_to_do) {
  for (const char* python : {"/usr/bin/python3", "python3"}) {
    const auto tried = run_program({python, "-c", "import " + modules}, {.timeout_s = kImportTimeoutS});
    if (tried && tried->exit_code == 0) return std::string(python);
  }
  return Error{ErrorCode::kNotFound, "no Python that can import " + modules + "; " + what_to_do};
}

}  // namespace comrad::deploy
