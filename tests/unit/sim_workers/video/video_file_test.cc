#include "sim_workers/video/video_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <opencv2/videoio.hpp>

#include "tests/support/scratch_folder.h"

namespace comrad::sim {
namespace video_file_test {

using ::testing::HasSubstr;

TEST(VideoFile, FramesComeBackInTheirOrderAndColours) {
  const test::ScratchFolder folder;
  for (const std::string name : {"a.mp4", "a.mkv"}) {
    const std::string path = (folder / name).string();
    auto video = VideoFile::create(path, {128, 96});
    ASSERT_TRUE(video) << video.error().message;
    for (int i = 0; i < 50; ++i)
      ASSERT_TRUE((*video)->add(cv::Mat(96, 128, CV_8UC3, cv::Scalar(200, 40 + 3 * i, 20)), 2));
    ASSERT_TRUE((*video)->finish());
    cv::VideoCapture file(path);
    EXPECT_DOUBLE_EQ(file.get(cv::CAP_PROP_FPS), 17.5);
    int count = 0;
    for (cv::Mat frame; file.read(frame); ++count)
      EXPECT_LE(cv::norm(frame, cv::Mat(96, 128, CV_8UC3, cv::Scalar(200, 40 + 3 * count, 20)), cv::NORM_INF),
                10)
          << name << ", frame " << count;
    EXPECT_EQ(count, 50) << name;
  }
}

TEST(VideoFile, WhatCannotBeWrittenIsReported) {
  const test::ScratchFolder folder;
  const auto nowhere = VideoFile::create((folder / "no/a.mp4").string(), {128, 96});
  ASSERT_FALSE(nowhere);
  EXPECT_THAT(nowhere.error().message, HasSubstr("a.mp4: cannot be made; is the folder writable?"));
  EXPECT_EQ(VideoFile::create((folder / "a.txt").string(), {128, 96}).error().code, ErrorCode::kUnsupported);

  std::filesystem::create_symlink("/dev/full", folder / "full.mkv");
  auto video = VideoFile::create((folder / "full.mkv").string(), {128, 96});
  Status done = video ? Status() : video.error();
  for (int i = 0; done && i < 200; ++i) {
    cv::Mat noise(96, 128, CV_8UC3);
    cv::randu(noise, 0, 255);
    done = (*video)->add(noise, 2);
  }
  if (done) done = (*video)->finish();
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, HasSubstr("is the disk full?"));
}

}  // namespace video_file_test
}  // namespace comrad::sim
