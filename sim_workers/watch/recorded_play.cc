#include "sim_workers/watch/recorded_play.h"

#include <algorithm>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <system_error>

#include "rollout_buffer/core/files.h"

namespace comrad::sim {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;

constexpr std::uintmax_t kFileBytesMax = 64u << 20;
constexpr int kAgentsMax = 8, kHeadsMax = 64, kFrameSkipMax = 100;

Error bad(const std::string& path, const std::string& why) {
  return Error{ErrorCode::kBadFormat, path + ": " + why + "; comrad eval --episodes_dir writes such files"};
}

Expected<RecordedEpisode> read_head(const std::string& path, const json& head, std::string_view choices) {
  RecordedEpisode episode;
  episode.file = path;
  episode.scenario = head.at("scenario").get<std::string>();
  episode.heads = head.at("heads").get<std::string>();
  episode.num_agents = head.at("num_agents").get<int>();
  episode.frame_skip = head.at("frame_skip").get<int>();
  episode.seed = head.at("episode_seed").get<uint64_t>();
  episode.decisions = head.at("decisions").get<uint32_t>();
  const auto sizes = head.at("head_sizes").get<std::vector<int>>();
  if (episode.num_agents < 1 || episode.num_agents > kAgentsMax || sizes.empty() ||
      sizes.size() > kHeadsMax || episode.frame_skip < 1 || episode.frame_skip > kFrameSkipMax)
    return bad(path, "its team, heads or frame skip cannot be played");
  const std::size_t per_decision = sizes.size() * static_cast<std::size_t>(episode.num_agents);
  if (choices.size() != per_decision * episode.decisions)
    return bad(path, "it holds " + std::to_string(choices.size()) + " bytes of actions instead of " +
                         std::to_string(per_decision * episode.decisions) + ", it is cut off");
  for (std::size_t i = 0; i < choices.size(); ++i) {
    const auto choice = static_cast<unsigned char>(choices[i]);
    if (choice >= sizes[i % sizes.size()]) return bad(path, "an action lies outside its head");
    episode.choices.push_back(choice);
  }
  const fs::path map = head.at("map").get<std::string>();
  if (map.is_absolute() || std::ranges::find(map, fs::path("..")) != map.end())
    return bad(path, "its map lies outside its folder");
  episode.wad = (fs::path(path).parent_path() / map).string();
  return episode;
}

}  // namespace

Expected<RecordedEpisode> read_recorded_episode(const std::string& path) {
  std::error_code failed;
  const std::uintmax_t bytes = fs::file_size(path, failed);
  if (failed) return file_error(path, failed.value());
  if (bytes > kFileBytesMax) return bad(path, "it is larger than any episode");
  const std::string text = read_file(path).value_or("");
  const std::size_t end = text.find('\n');
  if (end == std::string::npos) return bad(path, "it is no episode");
  const json head = json::parse(text.substr(0, end), nullptr, /*allow_exceptions=*/false);
  if (!head.is_object() || head.value("format", json()) != "comrad-episode")
    return bad(path, "it is no episode");
  if (head.value("version", json()) != 1) return bad(path, "its format version is not 1");
  try {
    return read_head(path, head, std::string_view(text).substr(end + 1));
  } catch (const json::exception&) {  // the library's way to say that a key is missing or of another kind
    return bad(path, "its first line lacks a key of an episode");
  }
}

Expected<std::vector<RecordedEpisode>> read_recorded_episodes(const std::string& folder) {
  COMRAD_TRY_ASSIGN(const std::vector<std::string> paths, files_with_extension(folder, ".comrad"));
  if (paths.empty())
    return Error{ErrorCode::kNotFound,
                 folder + ": no episodes (*.comrad); comrad eval --episodes_dir writes them"};
  std::vector<RecordedEpisode> episodes;
  for (const std::string& path : paths) {
    COMRAD_TRY_ASSIGN(RecordedEpisode episode, read_recorded_episode(path));
    const RecordedEpisode& first = episodes.empty() ? episode : episodes.front();
    if (episode.scenario != first.scenario || episode.heads != first.heads ||
        episode.num_agents != first.num_agents || episode.frame_skip != first.frame_skip)
      return Error{ErrorCode::kBadInput, path + ": an episode of another game or team than " + first.file +
                                             "; keep them in different folders"};
    episodes.push_back(std::move(episode));
  }
  return episodes;
}

EnvironmentOptions options_of(const std::vector<RecordedEpisode>& episodes) {
  EnvironmentOptions options{.scenario = episodes.front().scenario,
                             .wad_path = episodes.front().wad,
                             .num_agents = episodes.front().num_agents,
                             .count = 1,
                             .frame_skip = episodes.front().frame_skip,
                             .heads = episodes.front().heads};
  for (const RecordedEpisode& episode : episodes)
    if (std::ranges::find(options.layouts, episode.wad) == options.layouts.end())
      options.layouts.push_back(episode.wad);
  return options;
}

}  // namespace comrad::sim
