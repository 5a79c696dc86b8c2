// The folder of one run: which process may use it, what happens to an older run of the same name, and the small
// files that the supervisor keeps in it (config.toml, status.json). Checkpoints and logs are written there
// by the workers.
#pragma once

#include <cmath>
#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "deploy/launch/run_accounts.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/link/session/accounts.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// A run directory, locked against a second live run for as long as this object (or a child that inherited
/// the lock) lives. The lock is an flock on `<run_dir>/.lock`, which holds the owner's pid; the kernel drops
/// it with the process, so a crash leaves nothing to clean up.
class RunDirectory {
 public:
  /// Makes or takes `<train_dir>/<experiment>` with its logs/ and checkpoint/ folders. If the run exists:
  ///
  ///   resume     continue in it; a fresh name just starts
  ///   restart    rename it to <experiment>_old0001 (the next free number), start afresh
  ///   overwrite  delete what is in it, start afresh; refused where there is no config.toml, so that a
  ///   mistyped
  ///              name never empties a folder that is no run
  ///
  /// A lock whose owner died is waited for up to 12 s: its learner may still be writing the last checkpoint.
  /// Errors: kBadInput (name, behaviour, another live run, with its pid), kNoSpace, kSystem.
  static Expected<RunDirectory> open(const std::string& train_dir, const std::string& experiment,
                                     RestartBehavior restart_behavior);

  /// Creates a folder for this run alone: `<train_dir>/<name>`, or with _2, _3, ... behind the name where that is taken.
  /// Starts at the same time get different ones. Errors: as open().
  static Expected<RunDirectory> open_new(const std::string& train_dir, const std::string& name);

  RunDirectory(RunDirectory&& other) noexcept;
  RunDirectory& operator=(RunDirectory&& other) noexcept;
  ~RunDirectory();

  const std::string& path() const { return path_; }
  bool is_resumed() const { return is_resumed_; }  ///< an earlier run's config.toml lies in it
  int lock_descriptor() const { return lock_descriptor_; }

  /// Writes config.toml atomically and durably; `explicit_values` as settings_to_toml() has it.
  Status write_config(const RunConfig& config,
                      const std::vector<std::pair<std::string, std::string>>& explicit_values = {}) const;

 private:
  RunDirectory(std::string path, int lock_descriptor)
      : path_(std::move(path)), lock_descriptor_(lock_descriptor) {}
  std::string path_;
  int lock_descriptor_ = -1;
  bool is_resumed_ = false;
};

/// What status.json states.
struct RunStatus {
  std::string state;  ///< starting, running, paused, finished, failed
  uint64_t env_frames = 0;
  uint64_t decisions = 0;
  uint32_t learner_version = 0;
  double score_mean = std::nan("");  ///< J; null in the file while there is none
  double env_frames_per_s = 0;
  double elapsed_s = 0;                               ///< of this process's run, its start included
  std::vector<std::pair<std::string, double>> cpu_s;  ///< CPU seconds in that time, by role
  std::optional<DecisionAccounts> accounts;           ///< of training
  std::string message;
  std::vector<link::PeerRecord> peers = {};  ///< hosts that feed this run, or did
  std::optional<link::FrameAccount> frames =
      {};  ///< of a host that plays with another one's policy, frame by frame
};

/// Decisions by where they went, as status.json has them.
nlohmann::ordered_json account_json(const DecisionAccounts& accounts);

/// Replaces `<run_dir>/status.json` atomically. Errors: kNoSpace, kSystem.
Status write_status(const std::string& run_dir, const RunStatus& status);

}  // namespace comrad::deploy
