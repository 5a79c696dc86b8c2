// An animated GIF, written picture by picture with colours chosen from the pictures. Stage: beside render, for eyes.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/video/video_sink.h"

struct GifFileType;
struct ColorMapObject;

namespace comrad::sim {

/// At most `colours_max` colours (BGR) for pixels that are counted by their upper five bits: index blue << 10 | green << 5 |
/// red. Source: Heckbert 1982, "Color image quantization for frame buffer display", median cut.
std::vector<cv::Vec3b> choose_palette(std::span<const uint32_t> counts, std::size_t colours_max);

/// Pictures are gathered in groups with one palette each, so that a video of any length needs little memory. A pixel that
/// is still close to the one shown is left as it is: that keeps what moves little small. Threads: one.
class GifFile final : public VideoSink {
 public:
  /// Errors: kSystem where the file cannot be made.
  static Expected<std::unique_ptr<GifFile>> create(const std::string& path, cv::Size size);
  ~GifFile() override;

  Status add(const cv::Mat& picture, int64_t tics) override;
  Status finish() override;

 private:
  struct Shown {
    cv::Mat picture;
    int delay_centiseconds = 0;
  };
  GifFile(std::string path, cv::Size size, GifFileType* file);
  Status write_group();
  bool write_head(const ColorMapObject* colours);
  bool write_picture(const Shown& shown, const std::vector<cv::Vec3b>& palette,
                     const ColorMapObject* own_colours);
  int index_of(const cv::Vec3b& colour, const std::vector<cv::Vec3b>& palette);
  Error failure(int giflib_code) const;

  const std::string path_;
  const cv::Size size_;
  GifFileType* file_;
  bool has_head_ = false;
  int64_t tics_ = 0;
  std::vector<Shown> group_;
  cv::Mat canvas_;                // what a viewer sees after the last picture; empty before the first
  std::vector<int16_t> nearest_;  // of the group's palette, by counted colour; -1: not looked for yet
  std::vector<uint8_t> row_;
};

}  // namespace comrad::sim
