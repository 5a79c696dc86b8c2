#include "deploy/evaluation/recorded_episodes.h"

#include <spdlog/fmt/fmt.h>

#include <cstdio>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kFormatVersion = 1;

std::string file_name(uint64_t episode) {
  char name[40];
  std::snprintf(name, sizeof name, "episode_%04llu.comrad", static_cast<unsigned long long>(episode));
  return name;
}

/// Copies a map unless it is there already; its path from the folder of the episodes.
Expected<std::string> keep_map(const std::string& folder, const std::string& wad, const std::string& hash) {
  const std::string name = "maps/" + hash.substr(hash.find(':') + 1) + ".wad";
  const fs::path place = fs::path(folder) / name;
  std::error_code failed;
  if (fs::exists(place, failed)) return name;
  fs::create_directories(place.parent_path(), failed);
  if (!failed) fs::copy_file(wad, place, failed);
  if (failed) return file_error("cannot write " + place.string(), failed.value());
  return name;
}

}  // namespace

Status make_episodes_folder(const LaunchPlan& plan) {
  std::error_code failed;
  fs::create_directories(plan.episodes_folder(), failed);
  return failed ? file_error("cannot make " + plan.episodes_folder(), failed.value()) : Status();
}

Status keep_episodes(const std::string& folder, const EvaluationGame& game, const LaunchPlan& plan,
                     const PlayedTeam& played) {
  const RunConfig& config = game.merged.config;
  std::error_code failed;
  fs::create_directories(folder, failed);
  if (failed) return file_error("cannot make " + folder, failed.value());
  for (const EpisodeRecord& episode : played.episodes) {
    const std::string recorded = fmt::format("{}/{}.comrad", plan.episodes_folder(), episode.episode_seed);
    const std::string text = read_file(recorded).value_or("");
    const std::size_t end = text.find('\n');
    const Json own = Json::parse(text.substr(0, end), nullptr, /*allow_exceptions=*/false);
    if (end == std::string::npos || !own.is_object())
      return Error{
          ErrorCode::kPeerLost,
          fmt::format(
              "episode {} was not recorded, because a simulator was started again; evaluate once more",
              episode.episode_id)};
    const std::size_t map = game.map_of(episode.episode_id);
    const std::string wad = game.pool.layouts.empty() ? config.environment.wad : game.pool.layouts[map].path;
    COMRAD_TRY_ASSIGN(const std::string map_name, keep_map(folder, wad, game.map_hashes[map]));
    Json head = {{"format", "comrad-episode"},
                 {"version", kFormatVersion},
                 {"scenario", config.run.scenario},
                 {"heads", config.environment.heads},
                 {"map", map_name},
                 {"map_hash", game.map_hashes[map]},
                 {"policy", played.team->name},
                 {"episode", episode.episode_id}};
    head.update(own);
    COMRAD_TRY(write_file_atomically(folder + "/" + file_name(episode.episode_id),
                                     head.dump() + "\n" + text.substr(end + 1), /*durable=*/false));
  }
  return {};
}

}  // namespace comrad::deploy
