#include "deploy/launch/child_process.h"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <map>

#include "rollout_buffer/core/files.h"

extern char** environ;

namespace comrad::deploy {
namespace {

constexpr std::size_t kMaxLineBytes = 4096;  // a child that never ends a line fills no memory of ours

/// Everything exec needs, made before fork: in the child only async-signal-safe calls are allowed.
struct Image {
  explicit Image(const ChildOptions& options) {
    std::map<std::string, std::string> merged;
    for (char** entry = environ; *entry != nullptr; ++entry) {
      const std::string text = *entry;
      const std::size_t equals = text.find('=');
      if (equals != std::string::npos) merged[text.substr(0, equals)] = text.substr(equals + 1);
    }
    for (const auto& [name, value] : options.environment) merged[name] = value;
    for (const auto& [name, value] : merged) variables.push_back(name + "=" + value);
    words.push_back(options.program);
    words.insert(words.end(), options.arguments.begin(), options.arguments.end());
    for (std::string& word : words) argv.push_back(word.data());
    for (std::string& variable : variables) envp.push_back(variable.data());
    argv.push_back(nullptr);
    envp.push_back(nullptr);
  }
  std::vector<std::string> words, variables;
  std::vector<char*> argv, envp;
};

/// The child's part between fork and exec. Returns only on failure, with errno.
void become(const ChildOptions& options, Image& image, pid_t parent, int null_input, int output, int report) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(1);  // the parent died before the line above
  signal(SIGINT, SIG_IGN);
  signal(SIGHUP, SIG_IGN);
  for (const int number : {SIGTERM, SIGPIPE, SIGXFSZ, SIGCHLD}) signal(number, SIG_DFL);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  if (options.cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(static_cast<std::size_t>(options.cpu), &cpus);
    sched_setaffinity(0, sizeof cpus, &cpus);  // a wish: a container may forbid it
  }
  // Low numbers: 0-2 for the child's own use, 3 the report of a failed exec, 4 the inherited one. Sources are
  // first moved out of the way.
  const int high_input = fcntl(null_input, F_DUPFD, 10);
  const int high_output = fcntl(output, F_DUPFD, 10);
  const int high_report = fcntl(report, F_DUPFD, 10);
  const int high_inherited =
      options.inherited_descriptor < 0 ? -1 : fcntl(options.inherited_descriptor, F_DUPFD, 10);
  if (dup2(high_input, 0) < 0 || dup2(high_output, 1) < 0 || dup2(high_output, 2) < 0) return;
  dup3(high_report, 3, O_CLOEXEC);
  if (high_inherited >= 0) dup2(high_inherited, 4);
  close_range(high_inherited >= 0 ? 5 : 4, ~0u, 0);
  execve(options.program.c_str(), image.argv.data(), image.envp.data());
}

}  // namespace

std::string ExitStatus::text() const {
  if (signal == 0) return "exit code " + std::to_string(code);
  return "killed by signal " + std::to_string(signal) + " (" + strsignal(signal) + ")";
}

Expected<ChildProcess> ChildProcess::spawn(const ChildOptions& options) {
  const auto failed = [&](int code) { return file_error("cannot start " + options.program, code); };
  Image image(options);
  int output[2], report[2];
  if (pipe2(output, O_CLOEXEC) != 0) return failed(errno);
  if (pipe2(report, O_CLOEXEC) != 0) {
    const int code = errno;
    close(output[0]), close(output[1]);
    return failed(code);
  }
  const int null_input = open("/dev/null", O_RDONLY | O_CLOEXEC);
  const pid_t parent = getpid();
  const pid_t pid = null_input < 0 ? -1 : fork();
  if (pid == 0) {
    become(options, image, parent, null_input, output[1], report[1]);
    const int code = errno;
    [[maybe_unused]] const ssize_t told = write(3, &code, sizeof code);
    _exit(127);
  }
  int code = pid < 0 ? errno : 0;
  for (const int descriptor : {null_input, output[1], report[1]}) {
    if (descriptor >= 0) close(descriptor);
  }
  if (pid > 0) {
    // Ends at once: exec closes the other side, and so does death.
    ssize_t size;
    do {
      size = read(report[0], &code, sizeof code);
    } while (size < 0 && errno == EINTR);
    if (size != static_cast<ssize_t>(sizeof code)) code = 0;
  }
  close(report[0]);
  if (code != 0) {
    close(output[0]);
    if (pid > 0) waitpid(pid, nullptr, 0);
    return failed(code);
  }
  fcntl(output[0], F_SETFL, O_NONBLOCK);
  return ChildProcess(pid, output[0]);
}

ChildProcess::ChildProcess(ChildProcess&& other) noexcept
    : pid_(std::exchange(other.pid_, -1)),
      output_(std::exchange(other.output_, -1)),
      partial_(std::move(other.partial_)),
      exit_(other.exit_) {}

ChildProcess& ChildProcess::operator=(ChildProcess&& other) noexcept {
  if (this != &other) {
    end();
    pid_ = std::exchange(other.pid_, -1);
    output_ = std::exchange(other.output_, -1);
    partial_ = std::move(other.partial_);
    exit_ = other.exit_;
  }
  return *this;
}

ChildProcess::~ChildProcess() { end(); }

void ChildProcess::end() {
  if (pid_ > 0 && !exit_) {
    kill(pid_, SIGKILL);
    waitpid(pid_, nullptr, 0);
  }
  if (output_ >= 0) close(output_);
}

std::vector<std::string> ChildProcess::read_lines() {
  std::vector<std::string> lines;
  char bytes[4096];
  while (output_ >= 0) {
    const ssize_t size = read(output_, bytes, sizeof bytes);
    if (size < 0 && errno == EINTR) continue;
    if (size < 0 && errno == EAGAIN) break;
    if (size <= 0) {
      close(std::exchange(output_, -1));
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
  if (!exit_ && pid_ > 0 && waitpid(pid_, &status, WNOHANG) == pid_) {
    exit_ = WIFSIGNALED(status) ? ExitStatus{.code = 0, .signal = WTERMSIG(status)}
                                : ExitStatus{.code = WEXITSTATUS(status), .signal = 0};
  }
  return exit_;
}

bool ChildProcess::is_stopped() const {
  const std::string stat = read_file("/proc/" + std::to_string(pid_) + "/stat").value_or("");
  // The state is the letter behind the name, which stands in brackets and may hold anything (proc(5)).
  const std::size_t name_end = stat.rfind(')');
  return name_end != std::string::npos && name_end + 2 < stat.size() &&
         (stat[name_end + 2] == 'T' || stat[name_end + 2] == 't');
}

void ChildProcess::send_signal(int signal) {
  if (pid_ > 0 && !exit_) kill(pid_, signal);
}

}  // namespace comrad::deploy
