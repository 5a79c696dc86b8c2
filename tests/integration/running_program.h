// Starts the real programs for the integration tests, watches and signals them, and looks at what they
// leave behind.
#pragma once

#include <sys/types.h>

#include <filesystem>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/patience.h"
#include "tests/support/scratch_folder.h"

namespace comrad::test {

/// How a program ended.
struct Ending {
  int exit_code = -1;      ///< 128 + signal when a signal ended it
  bool timed_out = false;  ///< it was killed after the time limit
  std::string out, err;    ///< all it printed
};

using Environment = std::map<std::string, std::string>;

/// A `comrad` process (or another program by path) in its own process group. The destructor kills what
/// is left.
class RunningProgram {
 public:
  explicit RunningProgram(const std::vector<std::string>& command, const Environment& environment = {});
  RunningProgram(const RunningProgram&) = delete;
  RunningProgram& operator=(const RunningProgram&) = delete;
  ~RunningProgram();

  pid_t pid() const { return pid_; }
  bool running();
  void signal(int number) const;
  /// Waits for the end; kills the group after `timeout_s`.
  Ending wait(double timeout_s = kPatienceSeconds);

 private:
  pid_t pid_ = -1;
  int status_ = 0;
  bool reaped_ = false;
  std::filesystem::path out_, err_;
};

/// The path of a built program.
std::string program(const std::string& name);

/// Runs `comrad <arguments>` to its end.
Ending comrad(const std::vector<std::string>& arguments, const Environment& environment = {});

/// `comrad train` of a run that two cores finish in seconds: small core, small batches, 8 environments.
std::vector<std::string> small_training(const ScratchFolder& scratch, const std::string& experiment,
                                        double env_steps, const std::vector<std::string>& more = {});

/// Processes whose command line names `folder` (and `program`, if given); zombies are not counted.
std::vector<pid_t> processes_of(const std::string& folder, const std::string& program = {});

/// The number in an environment variable.
double number_of(const char* name, double otherwise);

/// Reads the JSON object of a file, or null while there is none.
nlohmann::json read_json(const std::string& path);
/// Reads a file of one JSON object per line.
std::vector<nlohmann::json> read_json_lines(const std::string& path);
std::string read_text(const std::string& path);

/// The files of `folder` whose names begin so and end so, sorted by name.
std::vector<std::string> files(const std::string& folder, const std::string& begin,
                               const std::string& end = {});

/// env_frames of a run's status.json; -1 while there is none.
double env_frames(const std::string& run_dir);

void sleep_s(double seconds);
double now_s();

}  // namespace comrad::test
