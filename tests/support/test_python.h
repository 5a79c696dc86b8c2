// A Python with the packages of deploy/requirements_test.txt, for tests that ask one.
#pragma once

#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::test {

/// True where a command ends with exit code 0; its output is dropped.
inline bool runs_well(const std::string& command) {
  const int result = std::system((command + " >/dev/null 2>&1").c_str());
  return result != -1 && WIFEXITED(result) && WEXITSTATUS(result) == 0;
}

/// Path of a Python that can import `module`: COMRAD_TEST_PYTHON alone where it is set, else the environment that
/// `./comrad test` makes in the build folder, else python3. Nothing is installed here. Errors: kNotFound with a line to
/// skip a test with.
inline Expected<std::string> python_with(const std::string& module) {
  const auto has_module = [&](const std::string& python) {
    return runs_well("timeout 60 '" + python + "' -c 'import " + module + "'");
  };
  if (const char* set = std::getenv("COMRAD_TEST_PYTHON"); set != nullptr && *set != '\0') {
    if (has_module(set)) return std::string(set);
    return Error{ErrorCode::kNotFound, std::string("COMRAD_TEST_PYTHON=") + set + " cannot import " + module};
  }
  std::error_code ignored;  // this test lies in <build>/tests
  const auto build = std::filesystem::read_symlink("/proc/self/exe", ignored).parent_path().parent_path();
  for (const std::string& python : {(build / "test-python/bin/python").string(), std::string("python3")})
    if (has_module(python)) return python;
  return Error{ErrorCode::kNotFound, "no Python here can import " + module +
                                         ": ./comrad test installs it (deploy/requirements_test.txt), or set "
                                         "COMRAD_TEST_PYTHON to one that can"};
}

}  // namespace comrad::test
