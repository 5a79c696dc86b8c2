// One picture of a video: the views of all agents side by side, below each what the agent presses and has earned, below
// all the episode's score and clock. Stage: beside render, for eyes.
#pragma once

#include <cstdint>
#include <opencv2/core.hpp>
#include <span>
#include <string>
#include <vector>

#include "sim_workers/env/observation.h"

namespace comrad::sim {

/// What stands below an agent's view.
struct AgentCaption {
  std::vector<int32_t> choice;  ///< [heads]: 0 for nothing, k for the k-th button of its head
  double return_so_far = 0;     ///< its own rewards, raw
  double score = 0;             ///< its own share of J, as if the episode ended now
  bool is_alive = true;
  friend bool operator==(const AgentCaption&, const AgentCaption&) = default;
};

/// What stands below all views.
struct VideoCaption {
  std::string scenario;
  uint64_t episode = 0;  ///< from 0
  uint32_t tics = 0, decisions = 0;
  uint32_t limit_tics = 0;  ///< when the episode is cut off
  double score = 0;         ///< J as if the episode ended now
  double ceiling = 0;       ///< the best J of the map; 0: not known
  std::string ending;       ///< how the episode ended; empty while it continues
  std::vector<AgentCaption> agents;
  friend bool operator==(const VideoCaption&, const VideoCaption&) = default;
};

/// Draws pictures of one size. Text and boxes grow with the views. Threads: one.
class VideoFrame {
 public:
  /// `buttons` [heads]: the names of each action head's buttons.
  VideoFrame(ViewSize view, int num_agents, const std::vector<std::vector<std::string>>& buttons);

  /// Even numbers of pixels, as video requires them.
  cv::Size size() const { return picture_.size(); }
  /// The picture [height, width] BGR u8, until the next call. `views` [N][3, view height, view width] u8, planar RGB;
  /// as many captions as agents.
  const cv::Mat& draw(std::span<const std::vector<uint8_t>> views, const VideoCaption& caption);

 private:
  /// A button's box, relative to the caption's corner.
  struct Chip {
    int head = 0, choice = 0;
    std::string text;
    cv::Rect box;
  };
  void lay_out(const std::vector<std::vector<std::string>>& buttons);
  void draw_view(std::size_t agent, const std::vector<uint8_t>& view);
  void draw_agent(std::size_t agent, const AgentCaption& caption);
  void draw_footer(const VideoCaption& caption);
  cv::Point corner_of(std::size_t agent) const;
  int pixels(double at_640) const;
  cv::Size text_size(const std::string& text, double scale) const;
  void write(const std::string& text, cv::Point baseline, double scale, const cv::Scalar& color);

  const ViewSize view_;
  const int num_agents_;
  const int columns_;
  const double scale_;  ///< 1 for views 640 wide
  std::vector<Chip> chips_;
  int caption_height_ = 0;
  cv::Mat picture_;
  VideoCaption drawn_;  ///< what `picture_` shows; without agents before the first
  std::vector<cv::Mat> planes_;
};

}  // namespace comrad::sim
