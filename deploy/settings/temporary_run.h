// A run directory that lives as long as one command: benches and evaluations run in one, so that they write
// nothing into the run they look at.
#pragma once

#include <string>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// Made below $TMPDIR (or /tmp), removed with everything in it by the destructor. Move-only.
class TemporaryRun {
 public:
  /// Makes the folder, its map or pool (unless config.environment.wad is set) and config.toml; `config.environment.wad` then names
  /// the map. Errors: kSystem (folder, disk), those of find_iwad(), ensure_layout() and ensure_layout_pool().
  static Expected<TemporaryRun> create(RunConfig& config);
  TemporaryRun(TemporaryRun&& other) noexcept;
  TemporaryRun& operator=(TemporaryRun&&) = delete;
  ~TemporaryRun();

  const std::string& path() const { return path_; }

 private:
  explicit TemporaryRun(std::string path) : path_(std::move(path)) {}
  std::string path_;
};

}  // namespace comrad::deploy
