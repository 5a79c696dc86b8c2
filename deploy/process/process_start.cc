#include "deploy/process/process_start.h"

#include <fcntl.h>
#include <sched.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cerrno>
#include <cstdlib>
#include <map>

#include "rollout_buffer/core/files.h"

extern char** environ;

namespace comrad::deploy {
namespace {

/// Everything exec needs, made before fork: in the child only async-signal-safe calls are allowed.
struct Image {
  explicit Image(const ProcessOptions& options) : words(options.command) {
    std::map<std::string, std::string> merged;
    for (char** entry = environ; *entry != nullptr; ++entry) {
      const std::string text = *entry;
      const std::size_t equals = text.find('=');
      if (equals != std::string::npos) merged[text.substr(0, equals)] = text.substr(equals + 1);
    }
    for (const auto& [name, value] : options.environment) merged[name] = value;
    for (const auto& [name, value] : merged) variables.push_back(name + "=" + value);
    for (std::string& word : words) argv.push_back(word.data());
    for (std::string& variable : variables) envp.push_back(variable.data());
    argv.push_back(nullptr);
    envp.push_back(nullptr);
  }
  std::vector<std::string> words, variables;
  std::vector<char*> argv, envp;
};

/// The child's part between fork and exec. Returns only on failure, with errno.
void become(const ProcessOptions& options, Image& image, pid_t parent, int input, int report) {
  prctl(PR_SET_PDEATHSIG, SIGTERM);
  if (getppid() != parent) _exit(1);  // the parent died before the line above
  if (options.has_own_group) setpgid(0, 0);
  for (const int number : {SIGTERM, SIGPIPE, SIGXFSZ, SIGCHLD}) signal(number, SIG_DFL);
  if (options.ignores_interrupts)
    for (const int number : {SIGINT, SIGHUP}) signal(number, SIG_IGN);
  sigset_t none;
  sigemptyset(&none);
  sigprocmask(SIG_SETMASK, &none, nullptr);
  if (options.cpu >= 0) {
    cpu_set_t cpus;
    CPU_ZERO(&cpus);
    CPU_SET(static_cast<std::size_t>(options.cpu), &cpus);
    sched_setaffinity(0, sizeof cpus, &cpus);  // best effort: a container may forbid it
  }
  if (options.waits_its_turn && sched_getscheduler(0) == SCHED_OTHER) {
    const sched_param plain{};
    sched_setscheduler(0, SCHED_BATCH, &plain);  // best effort, too
  }
  // Low numbers: 0-2 for the child's own use, 3 the report of a failed exec, 4 the inherited one. Sources are
  // first moved out of the way.
  const int high_input = fcntl(input, F_DUPFD, 10);
  const int high_output = fcntl(options.output, F_DUPFD, 10);
  const int high_error = fcntl(options.error_output, F_DUPFD, 10);
  const int high_report = fcntl(report, F_DUPFD, 10);
  const int high_inherited =
      options.inherited_descriptor < 0 ? -1 : fcntl(options.inherited_descriptor, F_DUPFD, 10);
  if (dup2(high_input, 0) < 0 || dup2(high_output, 1) < 0 || dup2(high_error, 2) < 0) return;
  dup3(high_report, 3, O_CLOEXEC);
  if (high_inherited >= 0) dup2(high_inherited, 4);
  close_range(high_inherited >= 0 ? 5 : 4, ~0u, 0);
  execvpe(image.argv[0], image.argv.data(), image.envp.data());
}

}  // namespace

std::vector<std::pair<std::string, std::string>> sleeping_threads() {
  if (std::getenv("OMP_WAIT_POLICY") != nullptr) return {};
  return {{"OMP_WAIT_POLICY", "PASSIVE"}};
}

Expected<Pipe> Pipe::open() {
  int ends[2];
  if (pipe2(ends, O_CLOEXEC) != 0) return system_error("pipe");
  return Pipe{.read_end = Descriptor(ends[0]), .write_end = Descriptor(ends[1])};
}

Expected<pid_t> start_process(const ProcessOptions& options) {
  const auto failed = [&](int code) { return file_error("cannot start " + options.command[0], code); };
  Image image(options);
  COMRAD_TRY_ASSIGN(Pipe report, Pipe::open());
  const Descriptor null_input(open("/dev/null", O_RDONLY | O_CLOEXEC));
  if (!null_input.is_open()) return failed(errno);
  const pid_t parent = getpid();
  const pid_t pid = fork();
  if (pid < 0) return failed(errno);
  if (pid == 0) {
    become(options, image, parent, options.input >= 0 ? options.input : null_input.get(),
           report.write_end.get());
    const int code = errno;
    [[maybe_unused]] const ssize_t told = write(3, &code, sizeof code);
    _exit(127);
  }
  report.write_end.close();
  // Ends at once: exec closes the other side, and so does death.
  int code = 0;
  ssize_t size;
  do {
    size = read(report.read_end.get(), &code, sizeof code);
  } while (size < 0 && errno == EINTR);
  if (size != static_cast<ssize_t>(sizeof code)) return pid;
  waitpid(pid, nullptr, 0);
  return failed(code);
}

}  // namespace comrad::deploy
