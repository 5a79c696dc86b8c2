#include "deploy/evaluation/video_request.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <fstream>

#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace video_request_test {

using ::testing::HasSubstr;

TEST(VideoRequest, WithoutARequestThereIsNoVideo) {
  const Expected<VideoPlan> plan = check_videos({});
  ASSERT_TRUE(plan);
  EXPECT_FALSE(plan->is_wanted());
}

TEST(VideoRequest, PathsBecomeAbsoluteAndTheSizeHasADefault) {
  const test::ScratchFolder folder;
  const Expected<VideoPlan> plan =
      check_videos({.video = (folder / "a.MP4").string(), .frames = (folder / "new/").string(), .size = ""});
  ASSERT_TRUE(plan) << plan.error().message;
  EXPECT_TRUE(plan->is_wanted());
  EXPECT_EQ(plan->video, (folder / "a.MP4").string());
  EXPECT_EQ(plan->frames, (folder / "new").string());
  EXPECT_EQ(plan->size, "640x360");
  EXPECT_FALSE(std::filesystem::exists(folder / "new")) << "nothing is made yet";
  EXPECT_TRUE(std::filesystem::path(check_videos({.video = "b.mkv"})->video).is_absolute());
}

TEST(VideoRequest, AVideoMayBeAGifAndEndEarly) {
  const test::ScratchFolder folder;
  const Expected<VideoPlan> plan = check_videos({.video = (folder / "a.GIF").string(), .seconds = "2.5"});
  ASSERT_TRUE(plan) << plan.error().message;
  EXPECT_EQ(plan->seconds, 2.5);
  EXPECT_EQ(check_videos({.video = "b.mkv"})->seconds, 0);
}

TEST(HalfWrittenVideo, IsRemovedWhereASignalComesBeforeItIsWhole) {
  const test::ScratchFolder folder;
  const auto interrupt = [&] {
    {
      const HalfWrittenVideo half((folder / "a.mp4").string());
      std::ofstream(half.name()) << "1";
      raise(SIGTERM);
    }
    std::exit(std::filesystem::is_empty(folder / "") ? 7 : 8);
  };
  EXPECT_EXIT(interrupt(), testing::ExitedWithCode(7), "");
}

TEST(HalfWrittenVideo, ComesToItsNameOnlyWhereTheSimulatorFinishedIt) {
  const test::ScratchFolder folder;
  const std::string video = (folder / "a.mp4").string();
  {
    HalfWrittenVideo half(video);
    std::ofstream(half.name()) << "half of it";
    const Status finished = half.finish();
    ASSERT_FALSE(finished);
    EXPECT_THAT(finished.error().message, HasSubstr("a.mp4 was not finished"));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder / ""));
  HalfWrittenVideo half(video);
  std::ofstream(half.finished_name()) << "all of it";
  EXPECT_TRUE(half.finish());
  EXPECT_TRUE(std::filesystem::exists(video));
}

TEST(VideoRequest, WhatCannotBeWrittenIsRefusedByFlag) {
  const test::ScratchFolder folder;
  std::filesystem::create_directory(folder / "x.mp4");
  std::ofstream(folder / "file") << "1";
  const std::string good = (folder / "a.mp4").string();
  for (const auto& [request, words] : std::vector<std::pair<VideoRequest, std::string>>{
           {{.video = (folder / "a.avi").string()}, "--save_video="},
           {{.video = (folder / "a").string()}, ".mp4, .mkv, .gif"},
           {{.video = (folder / "x.mp4").string()}, "a folder of that name"},
           {{.video = (folder / "nowhere/a.mp4").string()}, "nowhere is no folder"},
           {{.frames = (folder / "nowhere/frames").string()}, "--frames="},
           {{.frames = folder.string()}, "holds files already"},
           {{.frames = (folder / "file").string()}, "is no folder"},
           {{.video = good, .size = "640"}, "--size=640:"},
           {{.video = good, .size = "640x"}, "WIDTHxHEIGHT"},
           {{.video = good, .size = "640x360x3"}, "WIDTHxHEIGHT"},
           {{.video = good, .size = "127x72"}, "from 128x72 to 1920x1080"},
           {{.video = good, .size = "1920x1081"}, "from 128x72 to 1920x1080"},
           {{.video = good, .size = "-640x-360"}, "--size"},
           {{.video = good, .seconds = "0"}, "--seconds=0:"},
           {{.video = good, .seconds = "-3"}, "in seconds above 0"},
           {{.video = good, .seconds = "nan"}, "in seconds above 0"},
           {{.video = good, .seconds = "20s"}, "in seconds above 0"},
           {{.seconds = "20"}, "--seconds=20: it is the length of videos; add --save_video"},
           {{.size = "640x360"}, "add --save_video FILE or --frames DIR"}}) {
    const Expected<VideoPlan> plan = check_videos(request);
    ASSERT_FALSE(plan) << words;
    EXPECT_EQ(plan.error().code, ErrorCode::kBadInput);
    EXPECT_THAT(plan.error().message, HasSubstr(words));
  }
}

}  // namespace video_request_test
}  // namespace comrad::deploy
