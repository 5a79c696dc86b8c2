#include "tests/integration/running_program.h"

#include <fcntl.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <utility>

#include "rollout_buffer/core/clock.h"

namespace comrad::test {

namespace fs = std::filesystem;

namespace {

fs::path scratch_file(const std::string& kind) {
  std::string path = (fs::temp_directory_path() / ("comrad-test-" + kind + "-XXXXXX")).string();
  const int descriptor = mkstemp(path.data());
  if (descriptor >= 0) close(descriptor);
  return path;
}

void redirect(const fs::path& path, int descriptor) {
  const int file = open(path.c_str(), O_WRONLY | O_CREAT | O_TRUNC, 0600);
  if (file >= 0) dup2(file, descriptor);
}

}  // namespace

RunningProgram::RunningProgram(const std::vector<std::string>& command, const Environment& environment)
    : out_(scratch_file("out")), err_(scratch_file("err")) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  pid_ = fork();
  if (pid_ != 0) return;
  setpgid(0, 0);
  prctl(PR_SET_PDEATHSIG, SIGKILL);
  for (const auto& [name, value] : environment) setenv(name.c_str(), value.c_str(), 1);
  redirect(out_, STDOUT_FILENO);
  redirect(err_, STDERR_FILENO);
  const int nothing = open("/dev/null", O_RDONLY);
  if (nothing >= 0) dup2(nothing, STDIN_FILENO);
  execv(arguments[0], arguments.data());
  _exit(126);
}

RunningProgram::~RunningProgram() {
  if (pid_ > 0 && !reaped_) {
    kill(-pid_, SIGKILL);
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  std::error_code error;
  fs::remove(out_, error);
  fs::remove(err_, error);
}

bool RunningProgram::running() {
  if (!reaped_ && waitpid(pid_, &status_, WNOHANG) == pid_) reaped_ = true;
  return !reaped_;
}

void RunningProgram::signal(int number) const { kill(pid_, number); }

Ending RunningProgram::wait(double timeout_s) {
  Ending ending;
  if (!wait_until([this] { return !running(); }, timeout_s)) {
    ending.timed_out = true;
    kill(-pid_, SIGKILL);
    kill(pid_, SIGKILL);
    waitpid(pid_, &status_, 0);
    reaped_ = true;
  }
  ending.exit_code = WIFSIGNALED(status_) ? 128 + WTERMSIG(status_) : WEXITSTATUS(status_);
  ending.out = read_text(out_.string());
  ending.err = read_text(err_.string());
  return ending;
}

std::string program(const std::string& name) { return std::string(COMRAD_BIN_DIR) + "/" + name; }

Ending comrad(const std::vector<std::string>& arguments, const Environment& environment) {
  std::vector<std::string> command = {program("comrad")};
  command.insert(command.end(), arguments.begin(), arguments.end());
  return RunningProgram(command, environment).wait();
}

std::vector<std::string> small_training(const ScratchFolder& scratch, const std::string& experiment,
                                        double env_steps, const std::vector<std::string>& more) {
  std::vector<std::string> command = {program("comrad"), "train"};
  for (const auto& [flag, value] : std::vector<std::pair<std::string, std::string>>{
           {"--scenario", "coop_health_gathering"},
           {"--algo", "ippo"},
           {"--train_dir", scratch.string()},
           {"--experiment", experiment},
           {"--seed", "42"},
           {"--num_workers", "2"},
           {"--num_envs_per_worker", "4"},
           {"--worker_num_splits", "2"},  // as where there are more cores; two would take one
           {"--rollout", "16"},
           {"--batch_size", "256"},
           {"--micro_batch_size", "64"},
           {"--num_epochs", "1"},
           {"--rnn_type", "gru"},
           {"--rnn_size", "32"},
           {"--device", "cpu"},
           {"--progress_interval", "1"},
           {"--experiment_summaries_interval", "1"},
           {"--train_for_env_frames", std::to_string(static_cast<long>(env_steps))}})
    command.insert(command.end(), {flag, value});
  command.insert(command.end(), more.begin(), more.end());
  return command;
}

std::vector<pid_t> processes_of(const std::string& folder, const std::string& program_name) {
  std::vector<pid_t> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator("/proc", error)) {
    const std::string pid = entry.path().filename().string();
    if (!std::all_of(pid.begin(), pid.end(), [](char c) { return c >= '0' && c <= '9'; })) continue;
    const std::string line =
        read_text(entry.path().string() + "/cmdline");  // words end in NUL; a zombie has none
    const std::string first = line.substr(0, line.find('\0'));
    if (line.find(folder) != std::string::npos &&
        fs::path(first).filename().string().starts_with(program_name))
      found.push_back(static_cast<pid_t>(std::atoi(pid.c_str())));
  }
  return found;
}

std::string read_text(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  // A file of /proc cannot be read on once its process has ended; iterators would throw then.
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

nlohmann::json read_json(const std::string& path) {
  const auto object = nlohmann::json::parse(read_text(path), nullptr, false);
  return object.is_discarded() ? nlohmann::json() : object;
}

std::vector<nlohmann::json> read_json_lines(const std::string& path) {
  std::ifstream file(path);
  std::vector<nlohmann::json> objects;
  for (std::string line; std::getline(file, line);)
    objects.push_back(nlohmann::json::parse(line, nullptr, false));
  return objects;
}

std::vector<std::string> files(const std::string& folder, const std::string& begin, const std::string& end) {
  std::vector<std::string> found;
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(folder, error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with(begin) && name.ends_with(end)) found.push_back(entry.path().string());
  }
  std::sort(found.begin(), found.end());
  return found;
}

double env_frames(const std::string& run_dir) {
  const nlohmann::json status = read_json(run_dir + "/status.json");
  return status.is_object() && status.contains("env_frames") ? status["env_frames"].get<double>() : -1;
}

double number_of(const char* name, double otherwise) {
  const char* text = std::getenv(name);
  return text == nullptr ? otherwise : std::strtod(text, nullptr);
}

void sleep_s(double seconds) { usleep(static_cast<useconds_t>(seconds * 1e6)); }

double now_s() { return monotonic_s(); }

}  // namespace comrad::test
