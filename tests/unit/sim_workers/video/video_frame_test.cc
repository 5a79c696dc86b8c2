#include "sim_workers/video/video_frame.h"

#include <gtest/gtest.h>

namespace comrad::sim {
namespace video_frame_test {

const std::vector<std::vector<std::string>> kButtons = {
    {"MOVE_FORWARD", "MOVE_BACKWARD"}, {"TURN_LEFT", "TURN_RIGHT"}, {"ATTACK"}};

VideoCaption caption_of(int agents) {
  VideoCaption caption;
  caption.scenario = "lava_pit";
  caption.limit_tics = 2100;
  caption.agents.resize(static_cast<std::size_t>(agents));
  for (AgentCaption& agent : caption.agents) agent.choice = {0, 0, 0};
  return caption;
}

/// Views of one colour each: agent i is red i, green 10 + i, blue 20 + i.
std::vector<std::vector<uint8_t>> views_of(int agents, ViewSize size) {
  std::vector<std::vector<uint8_t>> views;
  const auto plane = static_cast<std::size_t>(size.width) * static_cast<std::size_t>(size.height);
  for (int agent = 0; agent < agents; ++agent) {
    std::vector<uint8_t>& view = views.emplace_back(3 * plane);
    for (std::size_t i = 0; i < 3; ++i)
      std::fill_n(view.begin() + static_cast<std::ptrdiff_t>(i * plane), plane,
                  static_cast<uint8_t>(10 * static_cast<int>(i) + agent));
  }
  return views;
}

int pixels_that_differ(const cv::Mat& a, const cv::Mat& b) {
  int count = 0;
  for (int y = 0; y < a.rows; ++y)
    for (int x = 0; x < a.cols; ++x) count += a.at<cv::Vec3b>(y, x) != b.at<cv::Vec3b>(y, x);
  return count;
}

TEST(VideoFrame, ShowsEveryViewWholeAndInItsColours) {
  for (const ViewSize size : {ViewSize{128, 72}, ViewSize{320, 180}, ViewSize{641, 361}})
    for (const int agents : {1, 2, 3, 4, 5, 8}) {
      VideoFrame frame(size, agents, kButtons);
      const cv::Mat picture = frame.draw(views_of(agents, size), caption_of(agents));
      EXPECT_EQ(picture.cols % 2, 0);
      EXPECT_EQ(picture.rows % 2, 0);
      std::vector<int> found(static_cast<std::size_t>(agents));
      for (int y = 0; y < picture.rows; ++y)
        for (int x = 0; x < picture.cols; ++x)
          for (int agent = 0; agent < agents; ++agent)
            found[static_cast<std::size_t>(agent)] +=
                picture.at<cv::Vec3b>(y, x) == cv::Vec3b(static_cast<uint8_t>(20 + agent),
                                                         static_cast<uint8_t>(10 + agent),
                                                         static_cast<uint8_t>(agent));
      for (const int count : found) EXPECT_GE(count, size.width * size.height) << agents << " agents";
    }
}

TEST(VideoFrame, FewAgentsAreInOneRowManyInTwo) {
  const ViewSize size{128, 72};
  EXPECT_GT(VideoFrame(size, 4, kButtons).size().width, 4 * size.width);
  EXPECT_LT(VideoFrame(size, 5, kButtons).size().width, 4 * size.width);
  EXPECT_GT(VideoFrame(size, 8, kButtons).size().width, 4 * size.width);
  EXPECT_LT(VideoFrame(size, 8, kButtons).size().width, 5 * size.width);
}

TEST(VideoFrame, WhatIsPressedEarnedAndOverShows) {
  const ViewSize size{320, 180};
  VideoFrame frame(size, 2, kButtons);
  const auto views = views_of(2, size);
  VideoCaption caption = caption_of(2);
  const cv::Mat before = frame.draw(views, caption).clone();
  EXPECT_EQ(pixels_that_differ(before, frame.draw(views, caption)), 0) << "a picture shows its caption alone";

  const auto change = [&](auto&& edit) {
    VideoCaption other = caption;
    edit(other);
    return pixels_that_differ(before, frame.draw(views, other));
  };
  EXPECT_GT(change([](VideoCaption& c) { c.agents[0].choice[0] = 1; }), 500)
      << "a lit button is a filled box";
  EXPECT_GT(change([](VideoCaption& c) { c.agents[1].return_so_far = 17; }), 5);
  EXPECT_GT(change([](VideoCaption& c) { c.agents[1].is_alive = false; }), 20);
  EXPECT_GT(change([](VideoCaption& c) { c.score = 8; }), 5);
  EXPECT_GT(change([](VideoCaption& c) { c.score = 0.0085; }), 5) << "no score is too small to show";
  EXPECT_GT(change([](VideoCaption& c) { c.agents[0].score = 0.0085; }), 5);
  EXPECT_GT(change([](VideoCaption& c) { c.ending = "over"; }), 20);
  EXPECT_GT(change([](VideoCaption& c) { c.tics = 1050; }), 300) << "the clock's line";
  EXPECT_EQ(change([](VideoCaption& c) { c.agents[0].choice = {9, -1}; }), 0) << "no such button";
}

}  // namespace video_frame_test
}  // namespace comrad::sim
