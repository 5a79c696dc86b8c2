#include "rollout_buffer/core/files.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/resource.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>

#include "tests/support/scratch_folder.h"

namespace comrad {
namespace files_test {

namespace fs = std::filesystem;
using testing::HasSubstr;
using testing::Optional;

class FilesTest : public testing::Test {
 protected:
  std::ptrdiff_t files() const {
    return std::distance(fs::directory_iterator(folder_), fs::directory_iterator());
  }

  const test::ScratchFolder scratch_;
  const std::string folder_ = scratch_.string(), path_ = folder_ + "/config.toml";
};

TEST_F(FilesTest, EveryByteIsReadBack) {
  std::string bytes;
  for (int i = 0; i < 100000; ++i) bytes.push_back(static_cast<char>(i * 7 + i / 256));
  ASSERT_TRUE(write_file_atomically(path_, bytes, false));
  EXPECT_THAT(read_file(path_), Optional(bytes));
}

TEST_F(FilesTest, WhatCannotBeReadOrIsEmptyGivesNothing) {
  EXPECT_FALSE(read_file(path_)) << "missing";
  EXPECT_FALSE(read_file(folder_)) << "a folder";
  ASSERT_TRUE(write_file_atomically(path_, "", false));
  ASSERT_TRUE(fs::is_regular_file(path_));
  EXPECT_FALSE(read_file(path_)) << "empty";
}

TEST_F(FilesTest, AWriteReplacesTheOldFileAndLeavesNothingBeside) {
  for (const bool durable : {true, false}) {
    ASSERT_TRUE(write_file_atomically(path_, "a long old text", durable));
    ASSERT_TRUE(write_file_atomically(path_, "new", durable));
    EXPECT_THAT(read_file(path_), Optional(std::string("new")));
    EXPECT_EQ(files(), 1);
  }
}

TEST_F(FilesTest, AWriteIntoAMissingFolderNamesIt) {
  const Status written = write_file_atomically(folder_ + "/missing/config.toml", "text", false);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::kNotFound);
  EXPECT_THAT(written.error().message, HasSubstr(folder_ + "/missing/config.toml"));
}

TEST_F(FilesTest, AWriteThatFailsHalfWayKeepsTheOldFile) {
  ASSERT_TRUE(write_file_atomically(path_, "old", true));
  // A limit on the file size replaces a full disk.
  signal(SIGXFSZ, SIG_IGN);
  rlimit before{}, small{};
  getrlimit(RLIMIT_FSIZE, &before);
  small = before;
  small.rlim_cur = 1000;
  setrlimit(RLIMIT_FSIZE, &small);
  const Status written = write_file_atomically(path_, std::string(5000, 'x'), true);
  setrlimit(RLIMIT_FSIZE, &before);
  ASSERT_FALSE(written);
  EXPECT_THAT(written.error().message, HasSubstr(path_));
  std::string text;
  std::getline(std::ifstream(path_), text);
  EXPECT_EQ(text, "old");
  EXPECT_EQ(files(), 1);
}

TEST_F(FilesTest, AFullDiskIsCalledThat) {
  if (access("/dev/full", W_OK) != 0) GTEST_SKIP() << "no /dev/full here";
  fs::create_symlink("/dev/full", folder_ + "/.tmp-" + std::to_string(getpid()) + "-config.toml");
  const Status written = write_file_atomically(path_, "text", false);
  ASSERT_FALSE(written);
  EXPECT_EQ(written.error().code, ErrorCode::kNoSpace);
  EXPECT_THAT(written.error().message, HasSubstr("free disk space"));
}

}  // namespace files_test
}  // namespace comrad
