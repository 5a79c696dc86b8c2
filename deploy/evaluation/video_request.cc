#include "deploy/evaluation/video_request.h"

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <charconv>
#include <filesystem>
#include <utility>

#include "deploy/settings/output_check.h"
#include "rollout_buffer/core/files.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr const char* kDefaultSize = "640x360";
constexpr int kWidthMin = 128, kHeightMin = 72, kWidthMax = 1920, kHeightMax = 1080;
constexpr double kSecondsMax = 1e6;

Expected<double> check_seconds(const std::string& text) {
  double seconds = 0;
  const char* const end = text.data() + text.size();
  const auto [stop, failure] = std::from_chars(text.data(), end, seconds);
  if (failure == std::errc() && stop == end && seconds > 0 && seconds <= kSecondsMax) return seconds;
  return bad_value("seconds", text, "write how long the video is, in seconds above 0, for example 20");
}

}  // namespace

Status check_view_size(const std::string& text) {
  int width = 0, height = 0;
  const char* const end = text.data() + text.size();
  const auto first = std::from_chars(text.data(), end, width);
  if (first.ec == std::errc() && first.ptr != end && *first.ptr == 'x') {
    const auto second = std::from_chars(first.ptr + 1, end, height);
    if (second.ec == std::errc() && second.ptr == end && width >= kWidthMin && width <= kWidthMax &&
        height >= kHeightMin && height <= kHeightMax)
      return {};
  }
  return bad_value("size", text,
                   "write WIDTHxHEIGHT of one agent's view, from 128x72 to 1920x1080, for example 640x360");
}

Expected<VideoPlan> check_videos(const VideoRequest& request) {
  VideoPlan plan;
  if (request.video.empty() && request.frames.empty()) {
    if (!request.size.empty())
      return bad_value("size", request.size,
                       "it is the size of videos; add --save_video FILE or --frames DIR");
    if (!request.seconds.empty())
      return bad_value("seconds", request.seconds,
                       "it is the length of videos; add --save_video FILE or --frames DIR");
    return plan;
  }
  plan.size = request.size.empty() ? kDefaultSize : request.size;
  COMRAD_TRY(check_view_size(plan.size));
  if (!request.seconds.empty()) {
    COMRAD_TRY_ASSIGN(plan.seconds, check_seconds(request.seconds));
  }
  if (!request.video.empty()) {
    COMRAD_TRY_ASSIGN(plan.video, check_output_file("save_video", request.video, {".mp4", ".mkv", ".gif"}));
  }
  if (!request.frames.empty()) {
    COMRAD_TRY_ASSIGN(plan.frames, check_new_folder("frames", request.frames,
                                                    ", which pictures of this video would mix with"));
  }
  return plan;
}

HalfWrittenVideo::HalfWrittenVideo(const std::string& video) : video_(video) {
  const fs::path path = video;
  if (video.empty()) return;
  // The name's end selects the container.
  const auto hidden = [&path](const char* state) {
    return path.parent_path() /
           (fmt::format("{}{}{}-{}", kHalfWrittenMark, getpid(), state, path.filename().string()));
  };
  name_ = hidden(""), finished_name_ = hidden("-finished");
  signals_.emplace();
}

HalfWrittenVideo::~HalfWrittenVideo() {
  std::error_code ignored;
  for (const fs::path& name : {name_, finished_name_})
    if (!name.empty()) fs::remove(name, ignored);
}

Status HalfWrittenVideo::finish() {
  std::error_code failed;
  if (!video_.empty()) fs::rename(finished_name_, video_, failed);
  return failed
             ? file_error(video_ + " was not finished (what the simulator said stands above)", failed.value())
             : Status();
}

}  // namespace comrad::deploy
