// A video, H.264 in an .mp4 or .mkv file, written frame by frame. FFmpeg's libraries have their home here. Stage: beside
// render, for eyes.
#pragma once

#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <string>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/video/video_sink.h"

struct AVCodecContext;
struct AVFormatContext;
struct AVFrame;
struct AVPacket;

namespace comrad::sim {

/// Tics that a frame stands for: every second one is shown. Half of the frames are half of the work and of the file.
constexpr int64_t kTicsPerFrame = 2;

/// 17.5 frames a second. Frames are compressed by threads of the encoder. Threads: one.
class VideoFile final : public VideoSink {
 public:
  /// `size`: even numbers of pixels. Errors: kUnsupported where FFmpeg has no H.264 encoder or refuses the size, kSystem
  /// where the file cannot be made.
  static Expected<std::unique_ptr<VideoFile>> create(const std::string& path, cv::Size size);
  ~VideoFile() override;

  Status add(const cv::Mat& picture, int64_t tics) override;
  Status finish() override;

 private:
  explicit VideoFile(std::string path) : path_(std::move(path)) {}
  Status open(cv::Size size);
  /// Encodes a frame, or what is left for none, and writes what comes out. An FFmpeg code, negative where it failed.
  int encode(const AVFrame* frame);
  Error error(ErrorCode code, const std::string& what, int ffmpeg_code) const;

  const std::string path_;
  AVFormatContext* format_ = nullptr;
  AVCodecContext* encoder_ = nullptr;
  int64_t tics_ = 0;  // added
  cv::Mat planes_;    // of a picture: luminance, then blue and red at half the size
  AVFrame* frame_ = nullptr;
  AVPacket* packet_ = nullptr;
};

}  // namespace comrad::sim
