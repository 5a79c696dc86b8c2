#include "rollout_buffer/core/log.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <map>

#include "tests/support/scratch_folder.h"

namespace comrad {
namespace log_test {

namespace fs = std::filesystem;
using ::testing::HasSubstr;
using ::testing::MatchesRegex;

std::string text_of(const std::string& path) {
  std::ifstream file(path);
  return {std::istreambuf_iterator<char>(file), {}};
}

TEST(Log, ALineNamesRunHostAndWorker) {
  const test::ScratchFolder scratch;
  const std::string path = scratch / "run 100%n/logs/sim-3.log";  // as an experiment may be called
  ASSERT_TRUE(init_log("sim-3", path));
  spdlog::info("began");
  EXPECT_THAT(text_of(path), MatchesRegex("[-0-9]+T[:.0-9]+ I run 100%n@[^ ]+ sim-3: began\n"));
  ASSERT_TRUE(init_log("test", ""));
}

TEST(Log, OfALongRunTheNewestIsKeptAndNoMore) {
  const test::ScratchFolder scratch;
  ASSERT_TRUE(init_log("learner", scratch / "run/logs/learner-0.log"));
  const std::string words(1000, 'x');
  for (int line = 0; line < 60'000; ++line) spdlog::info("line {} {}", line, words);
  ASSERT_TRUE(init_log("test", ""));
  std::map<std::string, std::uintmax_t> files;
  std::uintmax_t bytes = 0;
  for (const auto& entry : fs::directory_iterator(scratch / "run/logs")) {
    files[entry.path().filename()] = entry.file_size();
    bytes += entry.file_size();
  }
  EXPECT_EQ(files.size(), 4u);
  EXPECT_LE(bytes, std::uintmax_t{32} << 20);
  EXPECT_GT(bytes, std::uintmax_t{24} << 20);
  EXPECT_NE(text_of(scratch / "run/logs/learner-0.log").find("line 59999 "), std::string::npos);
  EXPECT_NE(text_of(scratch / "run/logs/learner-0.3.log").find("line 35000 "), std::string::npos);
}

TEST(Log, AFolderThatCannotBeMadeIsAnError) {
  const Status opened = init_log("sim-0", "/dev/null/logs/sim-0.log");
  ASSERT_FALSE(opened);
  EXPECT_THAT(opened.error().message, HasSubstr("/dev/null/logs/sim-0.log"));
}

}  // namespace log_test
}  // namespace comrad
