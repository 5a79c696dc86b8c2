// The file that a video is written to, picture by picture: a video or a GIF. Stage: beside render, for eyes.
#pragma once

#include <opencv2/core.hpp>

#include "rollout_buffer/core/expected.h"

namespace comrad::sim {

/// Destroying it without `finish` leaves a file that may be cut off. Threads: one.
class VideoSink {
 public:
  VideoSink() = default;
  VideoSink(const VideoSink&) = delete;
  VideoSink& operator=(const VideoSink&) = delete;
  virtual ~VideoSink() = default;

  /// Adds a BGR picture of the file's size that is shown for `tics` (35ths of a second). Errors: kNoSpace.
  virtual Status add(const cv::Mat& picture, int64_t tics) = 0;
  /// Writes what is left and closes the file. Errors: kNoSpace.
  virtual Status finish() = 0;
};

}  // namespace comrad::sim
