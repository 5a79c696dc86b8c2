// A video of one environment: every second tic as a frame of a video, every decision as a picture in a folder.
// Stage: beside step, for eyes.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/video/video_frame.h"
#include "sim_workers/video/video_sink.h"

namespace comrad::sim {

struct VideoOptions {
  std::string video = {};  ///< file .mp4 or .mkv, H.264, or .gif with a picture a decision; empty: none
  std::string finished_video = {};  ///< what `video` is renamed to once it is whole; empty: it keeps its name
  std::string frames = {};          ///< folder of episode_<n>_decision_<n>.png; empty: none
  ViewSize size{640, 360};          ///< of one agent's view
  double seconds = 0;               ///< of video after which nothing is drawn; 0: no limit
};

/// The views are drawn once more for the video, at its own size; what the network sees is not touched. Threads: the environment's.
class VideoRecorder final : public TicWatcher {
 public:
  /// `first` is the game that the environments begin with; `environments` names the maps.
  /// Errors: kUnsupported where FFmpeg has no H.264 or the view is larger than can be drawn, kSystem and kNoSpace for
  /// files, those of ArtArchive::open and Renderer::create.
  static Expected<std::unique_ptr<VideoRecorder>> create(const VideoOptions& options,
                                                         const EnvironmentOptions& environments,
                                                         const DoomGame& first);
  ~VideoRecorder() override;

  void began(const DoomEnvironment& environment) override;
  void ticked(const DoomEnvironment& environment) override;
  /// Ends the video. Errors: the first that came meanwhile; kNoSpace.
  Status finish();

 private:
  VideoRecorder(const VideoOptions& options, VideoFrame frame);
  void record(const DoomEnvironment& environment, bool ends_a_decision);
  void read_captions(const DoomEnvironment& environment);
  const cv::Mat& draw(const DoomEnvironment& environment);
  Status write_picture(const cv::Mat& picture, uint32_t decision);

  const VideoOptions options_;
  VideoFrame frame_;
  std::unique_ptr<doom::Renderer> renderer_;
  std::unique_ptr<VideoSink> file_;  // null: none
  bool is_gif_ = false;              // one picture a decision
  int64_t shown_tics_ = 0;           // that the last frame of a video still stands for
  int64_t tics_left_;                // until the video is complete
  uint64_t episodes_ = 0;
  std::vector<std::vector<uint8_t>> views_;  // [N][3, height, width]
  std::vector<uint8_t> planes_;              // of a picture
  VideoCaption caption_;
  Status status_;
};

}  // namespace comrad::sim
