#include "deploy/settings/game_files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>

#include "rollout_buffer/core/layout_list.h"
#include "tests/support/scratch_folder.h"

namespace comrad::deploy {
namespace game_files_test {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

std::string number(int32_t value) {
  std::string bytes;
  for (int i = 0; i < 4; ++i) bytes += static_cast<char>(value >> (8 * i));
  return bytes;
}

/// A PWAD of one lump of 5 bytes: header, lump, directory.
std::string small_wad() {
  return "PWAD" + number(1) + number(17) + "hello" + number(12) + number(5) + std::string("LUMP\0\0\0\0", 8);
}

class GameFiles : public ::testing::Test {
 protected:
  ~GameFiles() override { unsetenv("COMRAD_IWAD"); }
  std::string write(const std::string& name, const std::string& bytes) { return folder_.write(name, bytes); }
  test::ScratchFolder folder_;
};

TEST_F(GameFiles, AWholeWadPasses) { EXPECT_TRUE(check_wad(write("a.wad", small_wad()))); }

TEST_F(GameFiles, EveryTruncationIsNamed) {
  const std::string whole = small_wad();
  for (size_t length = 0; length < whole.size(); ++length) {
    const Status status = check_wad(write("cut.wad", whole.substr(0, length)));
    ASSERT_FALSE(status) << length;
    EXPECT_EQ(status.error().code, ErrorCode::kBadFormat);
    EXPECT_THAT(status.error().message, HasSubstr("cut.wad"));
  }
}

TEST_F(GameFiles, HostileNumbersAreNamed) {
  const std::string tail = "hello" + number(12) + number(5) + std::string(8, 'A');
  EXPECT_FALSE(check_wad(write("b.wad", "PWAD" + number(-1) + number(17) + tail)));
  EXPECT_FALSE(check_wad(write("b.wad", "PWAD" + number(0x7FFFFFFF) + number(17) + tail)));
  EXPECT_FALSE(check_wad(write("b.wad", "PWAD" + number(1) + number(-16) + tail)));
  EXPECT_FALSE(check_wad(write("b.wad", "PK\3\4" + number(1) + number(17) + tail)));
  const std::string outside = "hello" + number(12) + number(0x7FFFFFFF) + std::string(8, 'A');
  EXPECT_FALSE(check_wad(write("b.wad", "PWAD" + number(1) + number(17) + outside)));
}

TEST_F(GameFiles, AMissingFileIsNotFound) {
  const Status status = check_wad((folder_ / "none.wad").string());
  ASSERT_FALSE(status);
  EXPECT_EQ(status.error().code, ErrorCode::kNotFound);
}

TEST_F(GameFiles, TheIwadComesFromTheEnvironmentFirst) {
  const std::string path = write("iwad.wad", small_wad());
  setenv("COMRAD_IWAD", path.c_str(), 1);
  ASSERT_TRUE(find_iwad());
  EXPECT_EQ(*find_iwad(), path);
  setenv("COMRAD_IWAD", "/nonexistent.wad", 1);
  const auto missing = find_iwad();
  ASSERT_FALSE(missing);
  EXPECT_THAT(missing.error().message, HasSubstr("COMRAD_IWAD"));
}

TEST_F(GameFiles, AUsersWadIsTakenAsItIs) {
  RunConfig config;
  config.environment.wad = write("mine.wad", small_wad());
  const auto layout = ensure_layout(config, (folder_ / "layouts").string());
  ASSERT_TRUE(layout) << layout.error().message;
  EXPECT_EQ(*layout, config.environment.wad);
  EXPECT_EQ(layout_text(config), config.environment.wad);
  EXPECT_FALSE(fs::exists(folder_ / "layouts"));
}

TEST(Layouts, AGeneratedOneIsRecognisedByItsNameAndFolder) {
  RunConfig config;
  config.run.scenario = "two_rooms";
  config.environment.layout_seed = 7;
  config.environment.wad = "/runs/a/layouts/two_rooms_7.wad";
  EXPECT_TRUE(is_generated_layout(config));
  EXPECT_EQ(layout_text(config), "seed 7");
  config.environment.wad = "/home/me/two_rooms_7.wad";
  EXPECT_FALSE(is_generated_layout(config));
}

TEST_F(GameFiles, ANewLayoutSeedOrAMovedRunForgetsTheGeneratedMap) {
  fs::create_directories(folder_ / "layouts");
  RunConfig run;
  run.environment.layout_seed = 42;
  run.environment.wad = write("layouts/" + run.run.scenario + "_42.wad", small_wad());
  RunConfig same = run;
  forget_stale_layout(run, same);
  EXPECT_EQ(same.environment.wad, run.environment.wad);
  RunConfig reseeded = run;
  reseeded.environment.layout_seed = 43;
  forget_stale_layout(run, reseeded);
  EXPECT_EQ(reseeded.environment.wad, "");
  RunConfig chosen = run;
  chosen.environment.layout_seed = 43;
  chosen.environment.wad = "/home/me/mine.wad";
  forget_stale_layout(run, chosen);
  EXPECT_EQ(chosen.environment.wad, "/home/me/mine.wad");
  fs::remove(run.environment.wad);
  forget_stale_layout(run, same);
  EXPECT_EQ(same.environment.wad, "");
}

TEST(LayoutPools, OnesToDrawAreDistinguishedFromFolders) {
  for (const char* pool : {"train:3", "eval:20", "train:many", "curriculum"})
    EXPECT_TRUE(is_pool_to_draw(pool)) << pool;
  for (const char* pool : {"", "pool", "train", "/data/train:3", "trains:3", "curriculum:3", "./curriculum"})
    EXPECT_FALSE(is_pool_to_draw(pool)) << pool;
}

TEST(LayoutPools, WhatCannotBeMeantIsRefusedWithoutAskingTheGenerator) {
  RunConfig config;
  config.run.scenario = "lava_pit";
  const auto error = [&](const char* pool, bool for_training) {
    config.environment.layout_pool = pool;
    const auto list = ensure_layout_pool(config, "/nowhere", for_training);
    return list ? std::string("no error") : list.error().message;
  };
  EXPECT_THAT(error("train:0", true), HasSubstr("1 to 100000"));
  EXPECT_THAT(error("train:9x", true), HasSubstr("1 to 100000"));
  EXPECT_THAT(error("train:99999999999999999999", true), HasSubstr("1 to 100000"));
  EXPECT_THAT(error("eval:5", true), HasSubstr("train on train:5"));
  EXPECT_THAT(error("/nowhere/pool", false), HasSubstr("comrad doomgen lava_pit --pool train"));
}

TEST_F(GameFiles, ALayoutListLiesWhereWorkersReadIt) {
  const LayoutList list{.layouts = {{"a", "/x/a.wad"}}, .interestingness_graph = ""};
  ASSERT_TRUE(write_layout_list(folder_.string(), layout_list_text(list)));
  const auto read = read_layout_list(folder_.string());
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(read->layouts[0].path, "/x/a.wad");
  EXPECT_FALSE(write_layout_list("/proc/nowhere", "x"));
}

}  // namespace game_files_test
}  // namespace comrad::deploy
