#include "deploy/process/python_program.h"

#include <cstdlib>
#include <filesystem>

#include "deploy/process/child_program.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

constexpr double kImportTimeoutS = 300;  // of a busy machine with a cold disk

/// The first of `pythons` that runs `imports`. Errors: kNotFound with `message`.
Expected<std::string> first_that_runs(const std::vector<std::string>& pythons, const std::string& imports,
                                      const std::string& message) {
  for (const std::string& python : pythons) {
    const auto tried = run_program({python, "-c", imports}, {.timeout_s = kImportTimeoutS});
    if (tried && tried->exit_code == 0) return python;
  }
  return Error{ErrorCode::kNotFound, message};
}

}  // namespace

Expected<std::string> python_that_imports(const std::string& modules, const std::string& what_to_do) {
  return first_that_runs({"/usr/bin/python3", "python3"}, "import " + modules,
                         "no Python that can import " + modules + "; " + what_to_do);
}

Expected<std::string> python_of_environment(const char* variable, const std::string& environment,
                                            const std::string& imports, const std::string& what_to_do) {
  const char* named = std::getenv(variable);
  if (named != nullptr && *named != '\0') return first_that_runs({named}, imports, what_to_do);
  return first_that_runs({build_folder() + "/" + environment + "/bin/python", "/usr/bin/python3", "python3"},
                         imports, what_to_do);
}

std::vector<std::string> python_command(const std::string& python, const std::string& script,
                                        const std::vector<std::string>& words) {
  // -B: no compiled files among the sources, whose age ./comrad looks at.
  std::vector<std::string> command = {python, "-B", data_dir() + "/" + script};
  command.insert(command.end(), words.begin(), words.end());
  return command;
}

Status check_checkout_has(const std::string& script) {
  const std::string path = data_dir() + "/" + script;
  if (std::filesystem::exists(path)) return {};
  return Error{ErrorCode::kNotFound, "there is no " + path + "; run this command in a checkout of COMRAD"};
}

}  // namespace comrad::deploy
