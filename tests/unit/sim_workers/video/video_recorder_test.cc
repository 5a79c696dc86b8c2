#include "sim_workers/video/video_recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <opencv2/videoio.hpp>

#include "rollout_buffer/core/files.h"
#include "scenarios/spec/registry.h"
#include "sim_workers/engine/render/png_image.h"
#include "tests/support/gif_seconds.h"
#include "tests/support/scratch_folder.h"

namespace comrad::sim {
namespace video_recorder_test {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

/// A generated map on disk, its game, and a video of two episodes of three decisions.
class VideoRecorderTest : public ::testing::Test {
 protected:
  void SetUp() override {
    const auto layout = scenarios::generate_layout("coop_health_gathering", {});
    ASSERT_TRUE(layout) << layout.error().message;
    options_.scenario = "coop_health_gathering";
    options_.wad_path = folder_.write("map.wad", layout->wad);
    const auto game = load_doom_game(options_);
    ASSERT_TRUE(game) << game.error().message;
    game_ = *game;
  }
  Status play(const VideoOptions& videos) {
    auto recorder = VideoRecorder::create(videos, options_, *game_);
    if (!recorder) return recorder.error();
    DoomEnvironment environment(game_);
    environment.show_to(recorder->get());
    const std::vector<int32_t> forward(
        static_cast<std::size_t>(environment.shape().num_agents * environment.shape().head_count), 1);
    for (uint64_t episode = 0; episode < 2; ++episode) {
      environment.reset(episode);
      for (int decision = 0; decision < 3; ++decision) environment.step(forward);
    }
    return (*recorder)->finish();
  }
  std::vector<std::string> names(const fs::path& folder) const {
    std::vector<std::string> found;
    for (const auto& entry : fs::directory_iterator(folder)) found.push_back(entry.path().filename());
    std::ranges::sort(found);
    return found;
  }

  const test::ScratchFolder folder_;
  EnvironmentOptions options_;
  std::shared_ptr<const DoomGame> game_;
};

TEST_F(VideoRecorderTest, AVideoHasAFrameForEverySecondTicAndAPictureForEveryDecision) {
  const std::string video = (folder_ / "video.mp4").string();
  const Status done = play({.video = video, .frames = (folder_ / "frames").string(), .size = {160, 90}});
  ASSERT_TRUE(done) << done.error().message;
  cv::VideoCapture read(video);
  ASSERT_TRUE(read.isOpened());
  EXPECT_DOUBLE_EQ(read.get(cv::CAP_PROP_FPS), 17.5);
  int frames = 0;
  cv::Mat frame;
  while (read.read(frame)) ++frames;
  EXPECT_EQ(frames, (2 * (1 + 3 * 4) + 1) / 2) << "of an episode's beginning and its tics";
  EXPECT_THAT(names(folder_ / "frames"),
              ::testing::ElementsAre("episode_000_decision_00000.png", "episode_000_decision_00001.png",
                                     "episode_000_decision_00002.png", "episode_000_decision_00003.png",
                                     "episode_001_decision_00000.png", "episode_001_decision_00001.png",
                                     "episode_001_decision_00002.png", "episode_001_decision_00003.png"));
  const std::string png =
      read_file((folder_ / "frames/episode_000_decision_00003.png").string()).value_or("");
  const auto image =
      doom::decode_png({reinterpret_cast<const uint8_t*>(png.data()), png.size()}, "a picture of the video");
  ASSERT_TRUE(image) << image.error().message;
  EXPECT_GE(image->width, 2 * 160);
}

TEST_F(VideoRecorderTest, AVideoEndsAfterItsSeconds) {
  const std::string video = (folder_ / "video.mp4").string();
  const Status done =
      play({.video = video, .frames = (folder_ / "frames").string(), .size = {160, 90}, .seconds = 0.2});
  ASSERT_TRUE(done) << done.error().message;
  EXPECT_DOUBLE_EQ(cv::VideoCapture(video).get(cv::CAP_PROP_FRAME_COUNT), 4);
  EXPECT_THAT(names(folder_ / "frames"),
              ::testing::ElementsAre("episode_000_decision_00000.png", "episode_000_decision_00001.png"));
}

TEST_F(VideoRecorderTest, AGifHasAPictureForEveryDecision) {
  const std::string video = (folder_ / "video.gif").string();
  const Status done = play({.video = video, .size = {160, 90}});
  ASSERT_TRUE(done) << done.error().message;
  cv::VideoCapture read(video);
  ASSERT_TRUE(read.isOpened());
  int pictures = 0;
  cv::Mat picture;
  while (read.read(picture)) ++pictures;
  EXPECT_EQ(pictures, 2 * (1 + 3));
  EXPECT_NEAR(test::gif_seconds(video), pictures / 8.75, 0.02);
}

TEST_F(VideoRecorderTest, AVideoGetsItsNameOnceItIsWhole) {
  const fs::path half = folder_ / "half.mp4", whole = folder_ / "whole.mp4";
  ASSERT_TRUE(play({.video = half.string(), .finished_video = whole.string(), .size = {160, 90}}));
  EXPECT_FALSE(fs::exists(half));
  EXPECT_TRUE(cv::VideoCapture(whole.string()).isOpened());
}

TEST_F(VideoRecorderTest, TheVideoDoesNotChangeWhatIsPlayed) {
  DoomEnvironment alone(game_), recorded(game_);
  auto recorder =
      VideoRecorder::create({.frames = (folder_ / "frames").string(), .size = {128, 72}}, options_, *game_);
  ASSERT_TRUE(recorder);
  recorded.show_to(recorder->get());
  const std::vector<int32_t> forward(
      static_cast<std::size_t>(alone.shape().num_agents * alone.shape().head_count), 1);
  for (DoomEnvironment* environment : {&alone, &recorded}) {
    environment->reset(7);
    for (int decision = 0; decision < 5; ++decision) environment->step(forward);
  }
  EXPECT_EQ(alone.state_hash(), recorded.state_hash());
}

TEST_F(VideoRecorderTest, WhatCannotBeWrittenIsSaidAtOnceOrAtTheEnd) {
  const Status nowhere = play({.video = (folder_ / "no/folder/video.mp4").string(), .size = {160, 90}});
  ASSERT_FALSE(nowhere);
  EXPECT_THAT(nowhere.error().message, HasSubstr("video.mp4"));
  std::ofstream(folder_ / "file") << "1";
  EXPECT_FALSE(play({.frames = (folder_ / "file/frames").string(), .size = {160, 90}}));
}

}  // namespace video_recorder_test
}  // namespace comrad::sim
