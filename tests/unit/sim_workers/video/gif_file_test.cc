#include "sim_workers/video/gif_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <filesystem>
#include <opencv2/videoio.hpp>

#include "tests/support/gif_seconds.h"
#include "tests/support/scratch_folder.h"

namespace comrad::sim {
namespace gif_file_test {

using ::testing::HasSubstr;
using ::testing::UnorderedElementsAre;

constexpr std::size_t kCounted = 1 << 15;

std::size_t counted(int blue, int green, int red) {
  return static_cast<std::size_t>(blue >> 3 << 10 | green >> 3 << 5 | red >> 3);
}

TEST(Palette, HasTheColoursThatAreThereAndNoMoreThanAsked) {
  std::vector<uint32_t> counts(kCounted);
  EXPECT_TRUE(choose_palette(counts, 16).empty());
  counts[counted(8, 16, 248)] = 5;
  counts[counted(200, 0, 0)] = 1000;
  EXPECT_THAT(choose_palette(counts, 16), UnorderedElementsAre(cv::Vec3b(12, 20, 252), cv::Vec3b(204, 4, 4)));
  EXPECT_THAT(choose_palette(counts, 1), UnorderedElementsAre(cv::Vec3b(203, 4, 5)))
      << "the mean of the pixels";
  std::ranges::fill(counts, 1u);
  EXPECT_EQ(choose_palette(counts, 127).size(), 127u);
}

class GifFileTest : public ::testing::Test {
 protected:
  /// Writes the pictures and reads them again.
  std::vector<cv::Mat> written(const std::vector<cv::Mat>& pictures, int tics) {
    auto gif = GifFile::create(path_, pictures.front().size());
    EXPECT_TRUE(gif) << gif.error().message;
    for (const cv::Mat& picture : pictures) EXPECT_TRUE((*gif)->add(picture, tics));
    EXPECT_TRUE((*gif)->finish());
    std::vector<cv::Mat> read;
    cv::VideoCapture file(path_);
    for (cv::Mat picture; file.read(picture);) read.push_back(picture.clone());
    return read;
  }
  const test::ScratchFolder folder_;
  const std::string path_ = (folder_ / "a.gif").string();
};

/// A red square that moves to the right over blue stripes.
std::vector<cv::Mat> moving_square(int count) {
  std::vector<cv::Mat> pictures;
  for (int i = 0; i < count; ++i) {
    cv::Mat picture(60, 100, CV_8UC3, cv::Scalar(200, 40, 0));
    for (int y = 0; y < 60; y += 2) picture.row(y).setTo(cv::Scalar(120, 40, 0));
    picture(cv::Rect(2 * i, 20, 16, 16)).setTo(cv::Scalar(10, 20, 240));
    pictures.push_back(picture);
  }
  return pictures;
}

TEST_F(GifFileTest, PicturesComeBackInAlmostTheirColoursAtTheGamesSpeed) {
  const std::vector<cv::Mat> pictures = moving_square(35), read = written(pictures, 4);
  ASSERT_EQ(read.size(), pictures.size());
  EXPECT_NEAR(test::gif_seconds(path_), 35 * 4 / 35.0, 0.02);
  for (std::size_t i = 0; i < read.size(); ++i)
    EXPECT_LE(cv::norm(read[i], pictures[i], cv::NORM_INF), 28) << "picture " << i;
}

TEST_F(GifFileTest, OthersMayReadIt) {
  const mode_t mask = umask(022);
  written(moving_square(1), 4);
  umask(mask);
  EXPECT_EQ(std::filesystem::status(path_).permissions(), std::filesystem::perms{0644});
}

TEST_F(GifFileTest, WhatStandsStillCostsAlmostNothing) {
  const std::vector<cv::Mat> pictures = moving_square(1);
  written(pictures, 4);
  const auto one = std::filesystem::file_size(path_);
  written(std::vector<cv::Mat>(50, pictures.front()), 4);
  EXPECT_LT(std::filesystem::file_size(path_), one + 50 * 150);
}

TEST_F(GifFileTest, LongVideosHaveAPaletteForEveryGroup) {
  std::vector<cv::Mat> pictures;
  for (int i = 0; i < 24; ++i)  // 7 MB each; the first group holds 10
    pictures.emplace_back(1500, 1500, CV_8UC3,
                          i < 12 ? cv::Scalar(200, 10 * i, 0) : cv::Scalar(0, 10 * i, 200));
  const std::vector<cv::Mat> read = written(pictures, 4);
  ASSERT_EQ(read.size(), pictures.size());
  for (std::size_t i = 0; i < read.size(); ++i)
    EXPECT_LE(cv::norm(read[i], pictures[i], cv::NORM_INF), 28) << "picture " << i;
}

TEST_F(GifFileTest, AFullDiskIsReported) {
  auto gif = GifFile::create("/dev/full", {640, 360});
  ASSERT_TRUE(gif) << gif.error().message;
  cv::Mat noise(360, 640, CV_8UC3);
  cv::randu(noise, 0, 255);
  ASSERT_TRUE((*gif)->add(noise, 4)) << "pictures are gathered first";
  const Status done = (*gif)->finish();
  ASSERT_FALSE(done);
  EXPECT_THAT(done.error().message, HasSubstr("is the disk full?"));
  EXPECT_FALSE(GifFile::create((folder_ / "no/a.gif").string(), {16, 16}));
}

}  // namespace gif_file_test
}  // namespace comrad::sim
