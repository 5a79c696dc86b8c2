// `comrad top`: the runs of this host that are alive, or one of another host, looked at again and again.

#include <spdlog/fmt/fmt.h>

#include <poll.h>
#include <sys/ioctl.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <csignal>
#include <cstdio>
#include <optional>

#include "deploy/run/command.h"
#include "deploy/run/remote_run.h"
#include "deploy/run/run_client.h"
#include "deploy/run/run_table.h"
#include "deploy/settings/command_line.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {
namespace {

using nlohmann::json;

constexpr std::size_t kWidthWithoutTerminal = 160;

struct TopRequest {
  std::vector<std::string> runs;
  std::string train_dir = RunSettings().train_dir;
  double interval_s = 1;
  bool once = false, as_json = false;
  RemoteRequest remote;  ///< without an address: runs of this host
};

volatile std::sig_atomic_t has_ended = 0;

/// Keys come one by one and unseen while this lives, and Ctrl-C leaves the terminal as it was.
class Keyboard {
 public:
  Keyboard() {
    if (isatty(STDIN_FILENO) == 0 || tcgetattr(STDIN_FILENO, &before_) != 0) return;
    termios now = before_;
    now.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    is_ours_ = tcsetattr(STDIN_FILENO, TCSANOW, &now) == 0;
  }
  Keyboard(const Keyboard&) = delete;
  Keyboard& operator=(const Keyboard&) = delete;
  ~Keyboard() {
    if (is_ours_) tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  }
  /// Waits; whether q was pressed.
  bool wait(double seconds) const {
    pollfd keys{.fd = is_ours_ ? STDIN_FILENO : -1, .events = POLLIN, .revents = 0};
    if (poll(&keys, 1, static_cast<int>(seconds * 1000)) <= 0) return false;
    char key = 0;
    return read(STDIN_FILENO, &key, 1) <= 0 || key == 'q' || key == 'Q';
  }

 private:
  termios before_{};
  bool is_ours_ = false;
};

struct Screen {
  std::size_t columns = kWidthWithoutTerminal;
  std::size_t rows = 0;  ///< 0: any number
};

Screen screen() {
  winsize size{};
  if (isatty(STDOUT_FILENO) == 0 || ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0)
    return {};
  return {.columns = size.ws_col, .rows = size.ws_row};
}

/// What the runs say; one that ends while it is asked is left out, unless it was named.
Expected<json> look(const TopRequest& request) {
  std::vector<LiveRun> runs;
  for (const std::string& name : request.runs) {
    COMRAD_TRY_ASSIGN(LiveRun run, find_live_run(name, request.train_dir));
    runs.push_back(std::move(run));
  }
  if (request.runs.empty()) runs = live_runs(request.train_dir);
  json all = json::array();
  for (const LiveRun& run : runs) {
    Expected<json> said = ask(run, {{"do", "status"}});
    if (said)
      all.push_back(std::move(said).value());
    else if (!request.runs.empty())
      return said.error();
    else
      all.push_back({{"run", run.name}, {"state", said.error().message}});
  }
  return all;
}

std::vector<std::string> lines_of(const json& runs, const TopRequest& request, const Screen& size) {
  std::vector<std::string> lines;
  const auto append = [&](const std::vector<std::string>& more) {
    lines.insert(lines.end(), more.begin(), more.end());
  };
  if (runs.empty()) lines.push_back(fitted("no run is alive in " + request.train_dir, size.columns));
  for (const json& run : runs) {
    if (!lines.empty()) lines.emplace_back();
    if (!run.contains("workers")) {
      lines.push_back(fitted(run.value("run", "") + ": " + run.value("state", ""), size.columns));
      continue;
    }
    append(run_lines(run, size.columns));
    append(host_table(run, size.columns));
    append(worker_table(run, size.columns));
  }
  if (size.rows > 1 && lines.size() >= size.rows) {
    const std::size_t kept = size.rows - 2, left = lines.size() - kept;
    lines.resize(kept);
    lines.push_back(fitted(fmt::format("... {} more lines", left), size.columns));
  }
  return lines;
}

Expected<int> watch(const TopRequest& request) {
  const bool is_remote = !request.remote.address.empty();
  if (is_remote && !request.runs.empty())
    return Error{ErrorCode::kBadInput,
                 "--remote looks at one run of another host; leave " + request.runs[0] + " out, or --remote"};
  if (!(request.interval_s >= 0.1 && request.interval_s <= 3600))
    return Error{ErrorCode::kBadInput, "--interval must be 0.1 to 3600 s"};
  const bool is_terminal = isatty(STDOUT_FILENO) != 0;
  struct sigaction on_end {};
  on_end.sa_handler = [](int) { has_ended = 1; };
  const sigset_t heard = heard_of({SIGINT, SIGTERM, SIGHUP});
  for (const int number : {SIGINT, SIGTERM, SIGHUP})
    if (sigismember(&heard, number) == 1) sigaction(number, &on_end, nullptr);
  std::optional<RemoteRun> remote;
  if (is_remote) {
    COMRAD_TRY_ASSIGN(remote, RemoteRun::open(request.remote));
  }
  const Keyboard keyboard;
  while (has_ended == 0) {
    json runs;
    if (remote) {
      runs = json::array({remote->look()});
    } else {
      COMRAD_TRY_ASSIGN(runs, look(request));
    }
    std::string page;
    if (request.as_json) {
      page = json{{"runs", runs}}.dump() + "\n";
    } else {
      const bool redraws = is_terminal && !request.once;
      Screen size = screen();
      if (request.once) size.rows = 0;
      if (redraws) page = "\x1b[H";
      for (const std::string& line : lines_of(runs, request, size))
        page += line + (redraws ? "\x1b[K\n" : "\n");
      if (redraws) page += "\x1b[J";
    }
    COMRAD_TRY(write_all(STDOUT_FILENO, page, "standard output"));
    if (request.once || (remote && remote->has_ended()) || keyboard.wait(request.interval_s)) break;
  }
  return kExitDone;
}

}  // namespace

int top_command(Arguments arguments) {
  TopRequest request;
  CommandLine line(
      "top [RUN... | --remote ADDRESS] [--once] [--json]",
      "Shows the runs of this host that are alive and your own: rates, lag, queues, credits, restarts, "
      "hosts, workers; q or\n"
      "Ctrl-C ends it. Without RUN all runs below --train_dir. --json: one object a look on one line.\n"
      "--remote: a run of another host that was started with --publish and prints this ADDRESS; ends with "
      "the run.");
  line.add_words("RUN", request.runs, "run directories, or experiments below --train_dir");
  line.add_option("train_dir", request.train_dir, "DIR", "folder that holds the runs (default train_dir)");
  line.add_option("interval", request.interval_s, "SECONDS", "between two looks (default 1)");
  line.add_option("remote", request.remote.address, "ADDRESS", "a run of another host, which publishes");
  line.add_option("keys", request.remote.key_folder, "FOLDER",
                  "remote: this host's keys, which `comrad keys` made, for a network");
  std::string interface;
  line.add_option("interface", interface, "NAME",
                  "remote: network interface; default: the one that leads there");
  line.add_switch("insecure_network", request.remote.hosts.insecure_network,
                  "remote: look over a network without keys");
  line.add_option("wait_s", request.remote.wait_s, "SECONDS",
                  "remote: how long to wait for the run's first report (default 10)");
  line.add_switch("once", request.once, "look once");
  line.add_switch("json", request.as_json, "print JSON");
  return run_command("top", line, arguments, [&] {
    if (!interface.empty()) request.remote.hosts.interface = interface;
    return watch(request);
  });
}

}  // namespace comrad::deploy
