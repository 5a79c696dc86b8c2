// The videos that a user requests, checked before anything starts.
#pragma once

#include <filesystem>
#include <optional>
#include <string>

#include "deploy/launch/launch_plan.h"
#include "deploy/launch/signal_queue.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// As typed; empty where it was not.
struct VideoRequest {
  std::string video = {}, frames = {}, size = {}, seconds = {};
};

/// The size of an agent's view in videos and on pages: from 128x72 to 1920x1080. Errors: kBadInput, naming --size.
Status check_view_size(const std::string& text);

/// The videos to make, with absolute paths: a video's name ends in .mp4, .mkv or .gif and its folder is there and may be
/// written to; a folder of pictures is new or empty; the size lies between 128x72 and 1920x1080, 640x360 where none was
/// typed; the seconds are above 0.
/// Errors: kBadInput, naming the flag.
Expected<VideoPlan> check_videos(const VideoRequest& request);

/// The file of a video while it is made. It comes to its name when it is whole, and is removed when it never is: signals
/// that would end the program meanwhile wait for the supervisor, or are dropped once the video is finished.
class HalfWrittenVideo {
 public:
  /// `video` empty: there is none.
  explicit HalfWrittenVideo(const std::string& video);
  HalfWrittenVideo(const HalfWrittenVideo&) = delete;
  HalfWrittenVideo& operator=(const HalfWrittenVideo&) = delete;
  ~HalfWrittenVideo();
  /// What it is called while it is written.
  std::string name() const { return name_.string(); }
  /// What the simulator calls it once it is whole: a simulator that is killed leaves none of this name.
  std::string finished_name() const { return finished_name_.string(); }
  /// Errors: as file_error, also where the simulator finished no video.
  Status finish();

 private:
  std::string video_;
  std::filesystem::path name_, finished_name_;
  std::optional<SignalQueue> signals_;
};

}  // namespace comrad::deploy
