// A Python with ViZDoom's pip package, for tests that compare with it.
#pragma once

#include <cstdio>
#include <string>

#include "tests/support/test_python.h"

namespace comrad::test {

/// As python_with("vizdoom").
inline Expected<std::string> vizdoom_python() { return python_with("vizdoom"); }

/// The folder with the package's .cfg and .wad files. Errors: as vizdoom_python().
inline Expected<std::string> vizdoom_scenario_folder() {
  COMRAD_TRY_ASSIGN(const std::string python, vizdoom_python());
  const std::string command = python + " -c 'import vizdoom; print(vizdoom.scenarios_path)' 2>/dev/null";
  FILE* const pipe = ::popen(command.c_str(), "r");
  if (pipe == nullptr) return Error{ErrorCode::kSystem, "no process for Python"};
  std::string output;
  char buffer[1024];
  while (std::fgets(buffer, sizeof(buffer), pipe) != nullptr) output += buffer;
  ::pclose(pipe);
  while (!output.empty() && (output.back() == '\n' || output.back() == ' ')) output.pop_back();
  return output;
}

}  // namespace comrad::test
