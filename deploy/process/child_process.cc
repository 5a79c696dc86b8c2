#include "deploy/process/child_process.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <signal.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <string_view>
#include <system_error>

#include "deploy/process/process_start.h"
#include "deploy/process/process_time.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

constexpr std::size_t kMaxLineBytes = 4096;  // a child that never ends a line fills no memory of ours

double seconds_of(const timeval& time) {
  return static_cast<double>(time.tv_sec) + 1e-6 * static_cast<double>(time.tv_usec);
}

/// What the file "stat" of a process or a thread contains behind the program's name, which is in brackets and may hold
/// anything (proc(5)): from the state on. Empty where there is no such process.
std::string stat_of(const std::string& folder) {
  const std::string stat = read_file(folder + "/stat").value_or("");
  const std::size_t name_end = stat.rfind(')');
  return name_end == std::string::npos || name_end + 2 >= stat.size() ? "" : stat.substr(name_end + 2);
}

}  // namespace

std::string ExitStatus::text() const {
  if (signal == 0) return fmt::format("exit code {}", code);
  return fmt::format("killed by signal {} ({})", signal, strsignal(signal));
}

Expected<ChildProcess> ChildProcess::spawn(const ChildOptions& options) {
  COMRAD_TRY_ASSIGN(Pipe output, Pipe::open());
  Pipe input;
  if (options.takes_input) {
    COMRAD_TRY_ASSIGN(input, Pipe::open());
  }
  ProcessOptions process{.command = {options.program},
                         .environment = options.environment,
                         .input = input.read_end.get(),
                         .output = options.output >= 0 ? options.output : output.write_end.get(),
                         .error_output = output.write_end.get(),
                         .inherited_descriptor = options.inherited_descriptor,
                         .cpu = options.cpu,
                         .waits_its_turn = options.waits_its_turn,
                         .ignores_interrupts = true};
  process.command.insert(process.command.end(), options.arguments.begin(), options.arguments.end());
  COMRAD_TRY_ASSIGN(const pid_t pid, start_process(process));
  fcntl(output.read_end.get(), F_SETFL, O_NONBLOCK);
  return ChildProcess(pid, std::move(output.read_end), std::move(input.write_end));
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)),
      output_(std::move(other.output_)),
      input_(std::move(other.input_)),
      partial_(std::move(other.partial_)),
      exit_(other.exit_),
      cpu_s_at_exit_(other.cpu_s_at_exit_) {}

ChildProcess& ChildProcess::operator=(ChildProcess&& other) noexcept {
  if (this != &other) {
    end();
    pid_ = std::exchange(other.pid_, -1);
    output_ = std::move(other.output_);
    input_ = std::move(other.input_);
    partial_ = std::move(other.partial_);
    exit_ = other.exit_;
    cpu_s_at_exit_ = other.cpu_s_at_exit_;
  }
  return *this;
}

ChildProcess::~ChildProcess() { end(); }

void ChildProcess::end() {
  if (pid_ > 0 && !exit_) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  output_.close();
  input_.close();
}

std::vector<std::string> ChildProcess::read_lines() {
  std::vector<std::string> lines;
  char bytes[4096];
  while (output_.is_open()) {
    const ssize_t size = read(output_.get(), bytes, sizeof bytes);
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) break;
    if (size <= 0) {
      output_.close();
      if (!partial_.empty()) lines.push_back(std::exchange(partial_, {}));
      break;
    }
    for (const char c : std::string_view(bytes, static_cast<std::size_t>(size))) {
      if (c == '\n' || partial_.size() >= kMaxLineBytes) {
        if (!partial_.empty()) lines.push_back(std::exchange(partial_, {}));
      }
      // Control characters could drive the user's terminal.
      if (c != '\n' && c != '\r') partial_ += static_cast<unsigned char>(c) < 0x20 || c == 0x7F ? ' ' : c;
    }
    if (lines.size() > 1000) break;  // let others have their turn
  }
  return lines;
}

const std::optional<ExitStatus>& ChildProcess::poll_exit() {
  int status = 0;
  rusage usage{};
  if (!exit_ && pid_ > 0 && wait4(pid_, &status, WNOHANG, &usage) == pid_) {
    cpu_s_at_exit_ = seconds_of(usage.ru_utime) + seconds_of(usage.ru_stime);
    exit_ = WIFSIGNALED(status) ? ExitStatus{.code = 0, .signal = WTERMSIG(status)}
                                : ExitStatus{.code = WEXITSTATUS(status), .signal = 0};
  }
  return exit_;
}

bool ChildProcess::is_stopped() const {
  const std::string stat = stat_of(fmt::format("/proc/{}", pid_));
  return stat.starts_with('T') || stat.starts_with('t');
}

bool ChildProcess::is_at_work() const {
  std::error_code ended;
  for (std::filesystem::directory_iterator thread(fmt::format("/proc/{}/task", pid_), ended), end;
       !ended && thread != end; thread.increment(ended)) {
    const std::string stat = stat_of(thread->path().string());
    if (stat.starts_with('R') || stat.starts_with('D')) return true;
  }
  return false;
}

double ChildProcess::cpu_seconds() const { return exit_ ? cpu_s_at_exit_ : family_seconds(pid_); }

void ChildProcess::send_signal(int signal) {
  if (pid_ > 0 && !exit_) kill(pid_, signal);
}

void ChildProcess::write_input(const std::string& text) {
  if (input_.is_open()) (void)!write(input_.get(), text.data(), text.size());
}

Expected<std::unique_ptr<Process>> MachineProcessHost::spawn(const ChildOptions& options) {
  COMRAD_TRY_ASSIGN(ChildProcess child, ChildProcess::spawn(options));
  return std::unique_ptr<Process>(std::make_unique<ChildProcess>(std::move(child)));
}

}  // namespace comrad::deploy
