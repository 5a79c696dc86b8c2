#include "deploy/settings/existing_run.h"

#include <cstdlib>
#include <filesystem>
#include <limits>
#include <string_view>

#include "rollout_buffer/core/text.h"

namespace comrad::deploy {

namespace fs = std::filesystem;

Expected<std::string> find_run(const std::string& name, const std::string& train_dir) {
  std::error_code error;
  for (const fs::path& path : {fs::path(name), fs::path(train_dir) / name})
    if (fs::is_regular_file(path / "config.toml", error)) {
      const fs::path whole = fs::absolute(path, error).lexically_normal();
      return (whole.has_filename() ? whole : whole.parent_path()).string();
    }
  std::vector<std::string> experiments;
  for (const auto& entry : fs::directory_iterator(train_dir, error))
    if (fs::exists(entry.path() / "config.toml", error))
      experiments.push_back(entry.path().filename().string());
  return Error{ErrorCode::kNotFound, "no run '" + name + "' (neither a folder with config.toml nor in " +
                                         train_dir + ")" + did_you_mean(name, experiments)};
}

Expected<std::string> find_checkpoint(const std::string& run_dir, CheckpointKind kind) {
  const std::string prefix = kind == CheckpointKind::kBest ? "best_" : "checkpoint_";
  std::string chosen;
  double highest = -std::numeric_limits<double>::infinity();
  std::error_code error;
  for (const auto& entry : fs::directory_iterator(fs::path(run_dir) / "checkpoint", error)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(prefix) || entry.path().extension() != ".pt") continue;
    const double rank = std::strtod(name.c_str() + prefix.size(), nullptr);  // version, or score
    if (chosen.empty() || rank > highest) {
      highest = rank;
      chosen = entry.path().string();
    }
  }
  if (chosen.empty())
    return Error{ErrorCode::kNotFound,
                 run_dir + "/checkpoint holds no " + prefix + "*.pt" +
                     (kind == CheckpointKind::kBest ? "; try --load_checkpoint_kind latest" : "")};
  return chosen;
}

}  // namespace comrad::deploy
