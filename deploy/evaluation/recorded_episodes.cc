#include "deploy/evaluation/recorded_episodes.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <set>
#include <system_error>

#include "deploy/evaluation/statistics.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

constexpr int kFormatVersion = 1;
constexpr std::size_t kHeadBytesMax = 1 << 20;

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
    Json head = {
        {"format", "comrad-episode"},        {"version", kFormatVersion},
        {"scenario", config.run.scenario},   {"scenario_version", config.environment.scenario_version},
        {"heads", config.environment.heads}, {"map", map_name},
        {"map_hash", game.map_hashes[map]},  {"policy", played.team->name},
        {"episode", episode.episode_id}};
    head.update(own);
    COMRAD_TRY(write_file_atomically(folder + "/" + file_name(episode.episode_id),
                                     head.dump() + "\n" + text.substr(end + 1), /*durable=*/false));
  }
  return {};
}

Expected<Json> summarise_recorded(const std::string& folder, bool each) {
  COMRAD_TRY_ASSIGN(const std::vector<std::string> paths, files_with_extension(folder, ".comrad"));
  if (paths.empty())
    return Error{
        ErrorCode::kNotFound,
        folder + ": no episodes (*.comrad); comrad eval --episodes_dir and comrad play --save write them"};
  std::vector<double> scores, returns, lengths;
  std::set<std::string> players;
  Json summary, all = Json::array();
  for (const std::string& path : paths) {
    std::string line;
    std::ifstream file(path, std::ios::binary);
    for (char letter; line.size() < kHeadBytesMax && file.get(letter) && letter != '\n';) line += letter;
    const Json head = Json::parse(line, nullptr, /*allow_exceptions=*/false);
    const auto is = [&head](const char* key, auto kind) { return head.contains(key) && (head[key].*kind)(); };
    if (!head.is_object() || head.value("format", Json()) != "comrad-episode" ||
        !is("scenario", &Json::is_string) || !is("policy", &Json::is_string) ||
        !is("score", &Json::is_number) || !is("num_agents", &Json::is_number) ||
        !is("length_tics", &Json::is_number) || !is("returns", &Json::is_array))
      return Error{ErrorCode::kBadFormat, path + ": it is no episode of comrad eval --episodes_dir"};
    for (const char* key : {"scenario", "num_agents"}) {
      if (!summary.contains(key)) summary[key] = head[key];
      if (summary[key] != head[key])
        return Error{ErrorCode::kBadInput, path + ": its " + key + " is " + head[key].dump() +
                                               ", that of the first is " + summary[key].dump() +
                                               "; keep them in different folders"};
    }
    scores.push_back(head["score"].get<double>());
    lengths.push_back(head["length_tics"].get<double>());
    double sum = 0;
    for (const Json& one : head["returns"]) sum += one.is_number() ? one.get<double>() : 0;
    returns.push_back(sum);
    players.insert(head["policy"].get<std::string>());
    if (each)
      all.push_back({{"file", fs::path(path).filename().string()},
                     {"policy", head["policy"]},
                     {"J", scores.back()},
                     {"return", sum},
                     {"length_tics", head["length_tics"]}});
  }
  const double half_width = confidence_95(scores);
  summary["policy"] = joined(players, " | ");
  summary["episodes"] = scores.size();
  summary["J_mean"] = mean(scores);
  summary["J_ci95"] = std::isfinite(half_width) ? Json(half_width) : Json();
  summary["return_mean"] = mean(returns);
  summary["length_tics_mean"] = mean(lengths);
  if (each) summary["each"] = std::move(all);
  return summary;
}

}  // namespace comrad::deploy
