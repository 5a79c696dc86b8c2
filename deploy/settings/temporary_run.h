// A run directory that lives as long as one command: benches and evaluations run in one, so that they write
// nothing into the run they look at.
#pragma once

#include <string>
#include <utility>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// Made below $TMPDIR (or /tmp), removed with everything in it by the destructor. Move-only.
class TemporaryFolder {
 public:
  /// Errors: kSystem.
  static Expected<TemporaryFolder> create();
  TemporaryFolder(TemporaryFolder&& other) noexcept;
  TemporaryFolder& operator=(TemporaryFolder&&) = delete;
  ~TemporaryFolder();

  const std::string& path() const { return path_; }

 private:
  explicit TemporaryFolder(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

/// A temporary folder that is a run directory.
class TemporaryRun {
 public:
  /// Makes the folder, its map or pool (unless config.environment.wad is set) and config.toml; `config.environment.wad` then names
  /// the map. `layout_list` is the text of a pool's list that is known already; empty: the pool is drawn or checked.
  /// Errors: kSystem (folder, disk), those of find_iwad(), ensure_layout() and ensure_layout_pool().
  static Expected<TemporaryRun> create(RunConfig& config, std::string layout_list = "");

  const std::string& path() const { return folder_.path(); }

 private:
  explicit TemporaryRun(TemporaryFolder folder) : folder_(std::move(folder)) {}
  TemporaryFolder folder_;
};

}  // namespace comrad::deploy
