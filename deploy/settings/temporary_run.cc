#include "deploy/settings/temporary_run.h"

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <utility>

#include "deploy/settings/game_files.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {

Expected<TemporaryFolder> TemporaryFolder::create() {
  const char* parent = std::getenv("TMPDIR");
  std::string path = std::string(parent != nullptr && *parent != '\0' ? parent : "/tmp") + "/comrad-XXXXXX";
  if (mkdtemp(path.data()) == nullptr)
    return system_error("cannot make " + path + " (TMPDIR names another place)");
  return TemporaryFolder(std::move(path));
}

TemporaryFolder::TemporaryFolder(TemporaryFolder&& other) noexcept : path_(std::exchange(other.path_, {})) {}

TemporaryFolder::~TemporaryFolder() {
  std::error_code error;
  if (!path_.empty()) std::filesystem::remove_all(path_, error);
}

Expected<TemporaryRun> TemporaryRun::create(RunConfig& config, std::string layout_list) {
  COMRAD_TRY(find_iwad());
  COMRAD_TRY_ASSIGN(TemporaryFolder folder, TemporaryFolder::create());
  TemporaryRun run(std::move(folder));
  const std::string& path = run.path();
  if (config.environment.layout_pool.empty()) {
    COMRAD_TRY_ASSIGN(config.environment.wad, ensure_layout(config, path + "/layouts"));
  } else {
    if (layout_list.empty()) {
      COMRAD_TRY_ASSIGN(layout_list, ensure_layout_pool(config, path + "/layouts", /*for_training=*/false));
    }
    COMRAD_TRY(write_layout_list(path, layout_list));
  }
  config.run.train_dir = std::filesystem::path(path).parent_path().string();
  config.run.experiment = std::filesystem::path(path).filename().string();
  for (const char* name : {"/logs", "/checkpoint"}) {
    std::error_code error;
    std::filesystem::create_directories(path + name, error);
    if (error) return Error{ErrorCode::kSystem, path + name + ": cannot be made: " + error.message()};
  }
  std::ofstream file(path + "/config.toml");
  file << settings_to_toml(config);
  if (!file.flush())
    return Error{ErrorCode::kSystem, path + "/config.toml: cannot be written; is the disk full?"};
  return run;
}

}  // namespace comrad::deploy
