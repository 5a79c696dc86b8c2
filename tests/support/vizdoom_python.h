// A Python with ViZDoom's pip package, for tests that compare with it.
#pragma once

#include <fcntl.h>
#include <sys/file.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::test {

/// True where a command ends with exit code 0 in time; its output is dropped.
inline bool runs_well(const std::string& command) {
  const int result = std::system((command + " >/dev/null 2>&1").c_str());
  return result != -1 && WIFEXITED(result) && WEXITSTATUS(result) == 0;
}

/// Path of a Python that can import vizdoom: COMRAD_TEST_PYTHON, the system's own, or that of a virtual
/// environment which is made once for a user in the folder for temporary files. Errors: kNotFound with a line
/// to skip a test with.
inline Expected<std::string> vizdoom_python() {
  const auto has_vizdoom = [](const std::string& python) {
    return runs_well("timeout 60 '" + python + "' -c 'import vizdoom'");
  };
  if (const char* set = std::getenv("COMRAD_TEST_PYTHON"); set != nullptr && *set != '\0') {
    if (has_vizdoom(set)) return std::string(set);
    return Error{ErrorCode::kNotFound, std::string("COMRAD_TEST_PYTHON=") + set + " cannot import vizdoom"};
  }
  if (has_vizdoom("python3")) return std::string("python3");
  const std::string folder =
      std::filesystem::temp_directory_path() / ("comrad-vizdoom-" + std::to_string(::getuid()));
  const std::string python = folder + "/bin/python";
  const int lock = ::open((folder + ".lock").c_str(), O_CREAT | O_RDWR | O_CLOEXEC, 0600);
  if (lock >= 0) ::flock(lock, LOCK_EX);  // tests that start together make it once
  bool ready = has_vizdoom(python);
  if (!ready)
    ready = runs_well("python3 -m venv '" + folder + "' && timeout 100 '" + python +
                      "' -m pip install --quiet --retries 1 --timeout 10 vizdoom") &&
            has_vizdoom(python);
  if (lock >= 0) ::close(lock);
  if (ready) return python;
  return Error{ErrorCode::kNotFound,
               "the pip package vizdoom cannot be had here (no network, or no wheel for this Python): set "
               "COMRAD_TEST_PYTHON to a Python that has it"};
}

}  // namespace comrad::test
