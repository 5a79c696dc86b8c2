#include "deploy/process/child_program.h"

#include <spdlog/fmt/fmt.h>

#include <poll.h>
#include <sys/signalfd.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <csignal>
#include <filesystem>
#include <thread>

#include "deploy/process/process_start.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/process.h"

namespace comrad::deploy {
namespace {

std::filesystem::path own_executable() {
  std::error_code error;
  return std::filesystem::read_symlink("/proc/self/exe", error);
}

std::vector<char*> argument_vector(const std::vector<std::string>& command) {
  std::vector<char*> arguments;
  for (const std::string& word : command) arguments.push_back(const_cast<char*>(word.c_str()));
  arguments.push_back(nullptr);
  return arguments;
}

}  // namespace

std::string sibling_program(const std::string& name) {
  return (own_executable().parent_path() / name).string();
}

std::string build_folder() { return own_executable().parent_path().parent_path().string(); }

bool is_installed() { return own_executable().parent_path().parent_path().filename() == "libexec"; }

Expected<ProgramResult> run_program(const std::vector<std::string>& command, const ProgramOptions& options) {
  if (command[0].find('/') != std::string::npos && access(command[0].c_str(), X_OK) != 0)
    return Error{ErrorCode::kNotFound, command[0] + ": no such program; build it with ./comrad"};

  COMRAD_TRY_ASSIGN(Pipe out, Pipe::open());
  COMRAD_TRY_ASSIGN(Pipe err, Pipe::open());
  const sigset_t stop_signals = heard_of({SIGINT, SIGTERM});
  sigset_t previous_mask;
  pthread_sigmask(SIG_BLOCK, &stop_signals, &previous_mask);
  struct RestoreMask {
    sigset_t* mask;
    ~RestoreMask() { pthread_sigmask(SIG_SETMASK, mask, nullptr); }
  } restore{&previous_mask};
  const Descriptor signals(signalfd(-1, &stop_signals, SFD_CLOEXEC | SFD_NONBLOCK));
  // In its own group: a terminal's Ctrl-C reaches us alone, and we pass it on.
  COMRAD_TRY_ASSIGN(const pid_t child, start_process({.command = command,
                                                      .environment = options.environment,
                                                      .output = out.write_end.get(),
                                                      .error_output = err.write_end.get(),
                                                      .has_own_group = true}));
  out.write_end.close();
  err.write_end.close();

  ProgramResult result;
  size_t line_begin = 0;
  const double timeout_s = options.timeout_s * patience();
  const double deadline_s = monotonic_s() + timeout_s;
  bool timed_out = false;
  auto drain = [&](Descriptor& from, std::string& into) {
    char bytes[65536];
    const ssize_t count = read(from.get(), bytes, sizeof(bytes));
    if (count > 0)
      into.append(bytes, static_cast<size_t>(count));
    else if (count == 0 || errno != EINTR)
      from.close();
    return count > 0 ? std::string_view(bytes, static_cast<size_t>(count)) : std::string_view();
  };
  while (out.read_end.is_open() || err.read_end.is_open()) {
    const double left_s = deadline_s - monotonic_s();
    if (left_s <= 0) {
      timed_out = true;
      kill(-child, SIGKILL);
      break;
    }
    pollfd waits[3] = {
        {out.read_end.get(), POLLIN, 0}, {err.read_end.get(), POLLIN, 0}, {signals.get(), POLLIN, 0}};
    if (poll(waits, 3, static_cast<int>(std::min(left_s, 1.0) * 1000) + 1) < 0 && errno != EINTR) break;
    if (waits[0].revents != 0) {
      drain(out.read_end, result.output);
      for (size_t end; options.on_line && (end = result.output.find('\n', line_begin)) != std::string::npos;
           line_begin = end + 1)
        options.on_line(result.output.substr(line_begin, end - line_begin));
    }
    if (waits[1].revents != 0) {
      const std::string_view fresh = drain(err.read_end, result.error_output);
      if (options.echo_stderr) (void)!write(STDERR_FILENO, fresh.data(), fresh.size());
    }
    signalfd_siginfo received;
    if (waits[2].revents != 0 && read(signals.get(), &received, sizeof(received)) == sizeof(received)) {
      kill(-child, result.interrupted ? SIGKILL : SIGTERM);
      result.interrupted = true;
    }
  }
  int status = 0;
  while (waitpid(child, &status, 0) < 0 && errno == EINTR) {
  }
  result.exit_code = WIFSIGNALED(status) ? 128 + WTERMSIG(status) : WEXITSTATUS(status);
  if (timed_out)
    return Error{ErrorCode::kTimeout,
                 fmt::format("{}: still running after {} s", command[0], static_cast<int>(timeout_s))};
  return result;
}

std::string last_words(const ProgramResult& result) {
  std::string text = result.error_output;
  while (!text.empty() && (text.back() == '\n' || text.back() == ' ')) text.pop_back();
  text = text.substr(text.rfind('\n') + 1);
  // "comrad-doomgen: error: no such scenario" is for a terminal; our own message names the program.
  if (text.starts_with("comrad-"))
    if (const size_t colon = text.find(": "); colon < text.find(' ')) text.erase(0, colon + 2);
  if (text.starts_with("error: ")) text.erase(0, 7);
  return text;
}

Error replace_process(const std::vector<std::string>& command) {
  signal(SIGPIPE, SIG_DFL), signal(SIGXFSZ, SIG_DFL);  // prepare_process() is for our own programs
  execvp(command[0].c_str(), argument_vector(command).data());
  Error failed = file_error(command[0], errno);
  failed.message += "; build it with ./comrad";
  return failed;
}

}  // namespace comrad::deploy
