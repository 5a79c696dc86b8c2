#include "deploy/run/run_client.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <poll.h>
#include <pwd.h>
#include <sys/file.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <filesystem>

#include "deploy/process/reply_server.h"
#include "deploy/settings/existing_run.h"
#include "rollout_buffer/core/abstract_address.h"
#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/host_name.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::size_t kLongestAnswer = std::size_t{16} << 20;  // of a run with thousands of workers

/// Whether a supervisor, or a learner that outlived it, holds the run.
bool is_held(const std::string& run_dir) {
  const Descriptor lock(open((run_dir + "/.lock").c_str(), O_RDONLY | O_CLOEXEC));
  if (!lock.is_open()) return false;
  if (flock(lock.get(), LOCK_SH | LOCK_NB) != 0) return errno == EWOULDBLOCK;
  flock(lock.get(), LOCK_UN);
  return false;
}

std::string user_name(int64_t user) {
  const passwd* entry = user >= 0 ? getpwuid(static_cast<uid_t>(user)) : nullptr;
  return entry != nullptr ? entry->pw_name : std::to_string(user);
}

std::string state_of(const std::string& run_dir) {
  const std::optional<std::string> text = read_file(run_dir + "/status.json");
  const json status = json::parse(text.value_or(""), nullptr, false);
  return status.is_object() && status.contains("state") && status["state"].is_string()
             ? ", its last state is " + status["state"].get<std::string>()
             : "";
}

Error not_running(const LiveRun& run) {
  return {ErrorCode::kNotFound, "run '" + run.name + "' is not running" + state_of(run.dir) +
                                    "; comrad train --experiment " + run.name + " continues with it"};
}

}  // namespace

Expected<LiveRun> find_live_run(const std::string& name, const std::string& train_dir) {
  LiveRun run;
  COMRAD_TRY_ASSIGN(run.dir, find_run(name, train_dir));
  run.name = fs::path(run.dir).filename().string();
  const std::optional<ControlAddress> address = read_control_address(run.dir);
  if (!address) {
    if (access((run.dir + "/.lock").c_str(), F_OK) == 0 && access((run.dir + "/.lock").c_str(), R_OK) != 0)
      return Error{ErrorCode::kBadInput,
                   "run '" + run.name + "' may not be read by this user: " + run.dir + "/.lock"};
    return not_running(run);
  }
  run.control = *address;
  if (!run.control.host.empty() && run.control.host != host_name() && !is_held(run.dir)) {
    // A lock of another host shows here only where the file system passes locks on.
    return Error{ErrorCode::kBadInput, "run '" + run.name + "' was started on host " + run.control.host +
                                           "; if it runs, send the command there" + state_of(run.dir)};
  }
  if (!is_held(run.dir)) return not_running(run);
  if (!run.control.host.empty() && run.control.host != host_name())
    return Error{ErrorCode::kBadInput,
                 "run '" + run.name + "' runs on host " + run.control.host + "; send the command there"};
  if (run.control.socket.empty())
    return Error{ErrorCode::kBadInput, fmt::format("run '{}' (pid {}) has no control socket: it is still "
                                                   "starting, or another build of comrad runs it",
                                                   run.name, run.control.pid)};
  return run;
}

std::vector<LiveRun> live_runs(const std::string& train_dir) {
  std::vector<LiveRun> runs;
  std::error_code failed;
  for (const auto& entry : fs::directory_iterator(train_dir, failed)) {
    if (!fs::is_regular_file(entry.path() / "config.toml", failed)) continue;
    if (Expected<LiveRun> run = find_live_run(entry.path().string(), train_dir))
      runs.push_back(std::move(run).value());
  }
  std::ranges::sort(runs, {}, &LiveRun::name);
  return runs;
}

Expected<json> ask(const LiveRun& run, const json& request, double timeout_s) {
  const double deadline_s = monotonic_s() + timeout_s;
  const std::string who = "run '" + run.name + "'";
  Expected<Descriptor> connected = connect_to_name(run.control.socket);
  if (!connected) {
    if (connected.error().code != ErrorCode::kNotFound) return connected.error();
    if (!is_held(run.dir)) return not_running(run);
    return Error{ErrorCode::kPeerLost,
                 fmt::format("{} (pid {}) does not answer here: it is ending, or runs in another container "
                             "or network namespace, and is asked there",
                             who, run.control.pid)};
  }
  const Descriptor& socket = *connected;
  const Peer peer = peer_of(socket.get());
  const auto us = static_cast<int64_t>(geteuid());
  if (peer.user != us && us != 0)
    return Error{ErrorCode::kBadInput, who + " belongs to user " + user_name(peer.user) + ", you are " +
                                           user_name(us) + "; ask as that user"};
  const std::string line = request.dump() + "\n";
  if (send(socket.get(), line.data(), line.size(), MSG_NOSIGNAL) != static_cast<ssize_t>(line.size()))
    return system_error("asking " + who);
  std::string answer;
  for (;;) {
    pollfd readable{.fd = socket.get(), .events = POLLIN, .revents = 0};
    const double left_s = deadline_s - monotonic_s();
    if (left_s <= 0 || poll(&readable, 1, static_cast<int>(left_s * 1000) + 1) == 0)
      return Error{ErrorCode::kTimeout,
                   fmt::format("{} (pid {}) does not answer; is its supervisor stopped (SIGSTOP)?", who,
                               run.control.pid)};
    char bytes[16384];
    const ssize_t size = recv(socket.get(), bytes, sizeof bytes, MSG_DONTWAIT);
    if (size < 0 && (errno == EAGAIN || errno == EINTR)) continue;
    if (size <= 0) break;
    answer.append(bytes, static_cast<std::size_t>(size));
    if (answer.size() > kLongestAnswer) break;
  }
  const json said = json::parse(answer, nullptr, false);
  if (!said.is_object())
    return Error{ErrorCode::kPeerLost,
                 who + (answer.empty() ? " ended while it was asked" : " gave no answer that can be read")};
  if (said.contains("error") && said["error"].is_string())
    return Error{ErrorCode::kBadInput, who + ": " + said["error"].get<std::string>()};
  return said;
}

}  // namespace comrad::deploy
