#include "deploy/launch/run_directory.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <signal.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <utility>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/settings/encoder_layers.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr double kOrphanWaitS =
    12.0;  // a learner without its supervisor has 10 s to write its last checkpoint
constexpr int kMaxOldRuns = 9999;
constexpr int kMaxRunsOfAName = 9999;
constexpr const char* kEncoderFile = "encoder.pt";

Status check_name(const std::string& experiment) {
  bool is_good = !experiment.empty() && experiment.size() <= 200 && experiment[0] != '.';
  for (const char c : experiment)
    is_good = is_good && c != '/' && static_cast<unsigned char>(c) >= 0x20 && c != 0x7F;
  if (is_good) return {};
  return Error{ErrorCode::kBadInput,
               "experiment '" + experiment +
                   "' cannot name a run: 1 to 200 characters, no '/', not starting with '.' "
                   "(use --train_dir for the folder)"};
}

/// The pid that is in a lock file; 0 if none.
pid_t owner_of(int lock) {
  char text[32] = {};
  if (pread(lock, text, sizeof text - 1, 0) <= 0) return 0;
  return static_cast<pid_t>(std::strtol(text, nullptr, 10));
}

bool is_alive(pid_t pid) { return pid > 0 && (kill(pid, 0) == 0 || errno == EPERM); }

/// Takes the lock of `folder`. The file that was locked must still be the one under that name afterwards: a
/// run that restarts renames the folder away under us.
Expected<int> lock_folder(const std::string& folder) {
  const std::string path = folder + "/.lock";
  for (const double give_up_s = monotonic_s() + kOrphanWaitS;;) {
    const int lock = ::open(path.c_str(), O_RDWR | O_CREAT | O_CLOEXEC, 0644);
    if (lock < 0) return file_error("run directory " + folder, errno);
    if (flock(lock, LOCK_EX | LOCK_NB) == 0) {
      struct stat locked {
      }, named{};
      if (fstat(lock, &locked) == 0 && stat(path.c_str(), &named) == 0 && locked.st_ino == named.st_ino) {
        const std::string pid = fmt::format("{}\n", getpid());
        if (ftruncate(lock, 0) != 0 ||
            pwrite(lock, pid.data(), pid.size(), 0) != static_cast<ssize_t>(pid.size())) {
          const Error failed = file_error(path, errno);
          close(lock);
          return failed;
        }
        return lock;
      }
      close(lock);
      continue;
    }
    const int code = errno;
    const pid_t owner = owner_of(lock);
    close(lock);
    if (code != EWOULDBLOCK) return file_error("cannot lock " + path, code);
    if (is_alive(owner)) {
      return Error{ErrorCode::kBadInput, fmt::format("run directory {} is used by a live run (pid {}); stop "
                                                     "that one or choose another --experiment or --train_dir",
                                                     folder, owner)};
    }
    if (monotonic_s() > give_up_s) {
      return Error{ErrorCode::kBadInput,
                   "run directory " + folder +
                       " is still held by a process of a run whose supervisor died (see `fuser " + path +
                       "`); end it or choose another --experiment"};
    }
    usleep(100'000);
  }
}

Expected<std::string> rename_away(const std::string& folder) {
  for (int number = 1; number <= kMaxOldRuns; ++number) {
    char suffix[16];
    std::snprintf(suffix, sizeof suffix, "_old%04d", number);
    const std::string old = folder + suffix;
    struct stat there {};
    if (lstat(old.c_str(), &there) == 0) continue;
    if (rename(folder.c_str(), old.c_str()) != 0)
      return file_error("cannot rename " + folder + " to " + old, errno);
    return old;
  }
  return Error{ErrorCode::kBadInput, folder + ": 9999 old runs of this name exist; delete some"};
}

}  // namespace

Expected<RunDirectory> RunDirectory::open(const std::string& train_dir, const std::string& experiment,
                                          RestartBehavior restart_behavior) {
  COMRAD_TRY(check_name(experiment));
  const std::string path = (fs::path(train_dir) / experiment).lexically_normal().string();
  std::error_code failed;
  const auto make = [&]() -> Expected<RunDirectory> {
    fs::create_directories(path, failed);
    if (failed) return file_error("cannot make run directory " + path, failed.value());
    COMRAD_TRY_ASSIGN(const int lock, lock_folder(path));
    return RunDirectory(path, lock);
  };
  COMRAD_TRY_ASSIGN(RunDirectory directory, make());

  const bool exists = fs::exists(path + "/config.toml", failed);
  if (restart_behavior == RestartBehavior::kRestart && exists) {
    COMRAD_TRY(rename_away(path));
    COMRAD_TRY_ASSIGN(directory, make());
  } else if (restart_behavior == RestartBehavior::kOverwrite) {
    for (const fs::directory_entry& entry : fs::directory_iterator(path, failed)) {
      if (entry.path().filename() == ".lock") continue;
      if (!exists) {
        return Error{ErrorCode::kBadInput,
                     "--restart_behavior=overwrite: " + path +
                         " holds files but no config.toml, so it is no run; nothing was deleted"};
      }
      fs::remove_all(entry.path(), failed);
      if (failed) return file_error("cannot delete " + entry.path().string(), failed.value());
    }
  } else {
    directory.is_resumed_ = exists;
  }
  for (const char* folder : {"logs", "checkpoint"}) {
    fs::create_directories(fs::path(path) / folder, failed);
    if (failed) return file_error("cannot make " + path + "/" + folder, failed.value());
  }
  return directory;
}

Expected<RunDirectory> RunDirectory::open_new(const std::string& train_dir, const std::string& name) {
  COMRAD_TRY(check_name(name));
  std::error_code failed;
  fs::create_directories(train_dir, failed);
  if (failed) return file_error("cannot make " + train_dir, failed.value());
  for (int number = 1; number <= kMaxRunsOfAName; ++number) {
    const std::string experiment = number == 1 ? name : fmt::format("{}_{}", name, number);
    const std::string path = (fs::path(train_dir) / experiment).string();
    // One of several starts makes the folder; the others see that it is there.
    if (mkdir(path.c_str(), 0777) == 0) return open(train_dir, experiment, RestartBehavior::kResume);
    if (errno != EEXIST) return file_error("cannot make run directory " + path, errno);
  }
  return Error{ErrorCode::kBadInput, fmt::format("{}/{}: {} runs of this name exist; choose an --experiment",
                                                 train_dir, name, kMaxRunsOfAName)};
}

RunDirectory::RunDirectory(RunDirectory&& other) noexcept
    : path_(std::move(other.path_)),
      lock_descriptor_(std::exchange(other.lock_descriptor_, -1)),
      is_resumed_(other.is_resumed_) {}

RunDirectory& RunDirectory::operator=(RunDirectory&& other) noexcept {
  std::swap(path_, other.path_);
  std::swap(lock_descriptor_, other.lock_descriptor_);
  std::swap(is_resumed_, other.is_resumed_);
  return *this;
}

RunDirectory::~RunDirectory() {
  if (lock_descriptor_ >= 0)
    close(lock_descriptor_);  // the file stays: deleting it would race with the next owner
}

Status RunDirectory::write_config(
    const RunConfig& config, const std::vector<std::pair<std::string, std::string>>& explicit_values) const {
  RunConfig written = config;
  if (is_encoder_file(config.network.encoder)) {
    written.network.encoder = kEncoderFile;  // the run's own copy, which config.toml names beside itself
    COMRAD_TRY_ASSIGN(const std::string module, read_encoder_file(config.network.encoder));
    COMRAD_TRY(write_file_atomically(path_ + "/" + kEncoderFile, module, /*durable=*/true));
  }
  return write_file_atomically(path_ + "/config.toml", settings_to_toml(written, explicit_values),
                               /*durable=*/true);
}

nlohmann::ordered_json account_json(const DecisionAccounts& accounts) {
  return {{"made", accounts.made},
          {"trained", accounts.trained},
          {"forgotten", accounts.forgotten},
          {"lost_with_simulators", accounts.lost_with_simulators},
          {"lost_with_learners", accounts.lost_with_learners},
          {"lost_in_restarts", accounts.lost_in_restarts},
          {"lost_on_the_way", accounts.lost_on_the_way},
          {"left", accounts.left},
          {"waiting", accounts.waiting}};
}

Status write_status(const std::string& run_dir, const RunStatus& status) {
  nlohmann::ordered_json json;
  json["state"] = status.state;
  json["env_frames"] = status.env_frames;
  json["decisions"] = status.decisions;
  json["learner_version"] = status.learner_version;
  json["J_mean"] = std::isfinite(status.score_mean) ? nlohmann::ordered_json(status.score_mean) : nullptr;
  json["env_frames_per_s"] = std::isfinite(status.env_frames_per_s) ? status.env_frames_per_s : 0.0;
  json["elapsed_s"] = status.elapsed_s;
  json["cpu_s"] = nlohmann::ordered_json::object();
  for (const auto& [role, seconds] : status.cpu_s) json["cpu_s"][role] = seconds;
  if (status.accounts) json["decisions_account"] = account_json(*status.accounts);
  for (const link::PeerRecord& peer : status.peers)
    json["hosts"].push_back({{"host", peer.host},
                             {"is_here", peer.is_here},
                             {"workers", peer.workers},
                             {"played", peer.played_there},
                             {"delivered", peer.decisions},
                             {"lost", peer.lost_there}});
  if (status.frames)
    json["frame_link"] = {{"latency_us_p50", status.frames->latency_us_p50},
                          {"latency_us_p90", status.frames->latency_us_p90},
                          {"latency_us_p99", status.frames->latency_us_p99},
                          {"is_compressed", status.frames->is_compressed}};
  json["message"] = status.message;
  const std::string text = json.dump(2, ' ', false, nlohmann::json::error_handler_t::replace) + "\n";
  return write_file_atomically(run_dir + "/status.json", text, /*durable=*/false);
}

}  // namespace comrad::deploy
