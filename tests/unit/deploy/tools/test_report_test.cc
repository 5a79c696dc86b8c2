#include "deploy/tools/test_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <optional>
#include <string>
#include <vector>

namespace comrad::deploy {
namespace test_report_test {

using ::testing::ElementsAre;

// As ctest 3.25 writes it.
const char* kLog = R"(Start testing: Nov 21 09:49 UTC
----------------------------------------------------------
1/3 Testing: shell_test
1/3 Test: shell_test
Command: "/usr/bin/sh"
Directory: /tmp
"shell_test" start time: Nov 21 09:49 UTC
Output:
----------------------------------------------------------
hello
needs a GPU: none here
<end of output>
Test time =   0.00 sec
----------------------------------------------------------
Test Passed.

2/3 Testing: arena_test
2/3 Test: arena_test
Command: "arena_test"
Output:
----------------------------------------------------------
[ RUN      ] Arena.Large
x.cc:1: Skipped
needs 64 GB of memory,
there are 24

[  SKIPPED ] Arena.Large (0 ms)
[ RUN      ] Arena.Small
[       OK ] Arena.Small (0 ms)
[ RUN      ] Arena.Wide
x.cc:9: Skipped

[  SKIPPED ] Arena.Wide (0 ms)
[  SKIPPED ] 2 tests, listed below:
[  SKIPPED ] Arena.Large
[  SKIPPED ] Arena.Wide
<end of output>
Test time =   0.00 sec
3/3 Testing: silent_test
3/3 Test: silent_test
Output:
----------------------------------------------------------
<end of output>
)";

TEST(SkipReasons, TellEveryCaseThatSkipped) {
  EXPECT_THAT(skip_reasons(kLog, "arena_test"),
              ElementsAre("Arena.Large: needs 64 GB of memory, there are 24", "Arena.Wide: no reason given"));
}

TEST(SkipReasons, AreTheLastLineOfOtherPrograms) {
  EXPECT_THAT(skip_reasons(kLog, "shell_test"), ElementsAre("needs a GPU: none here"));
  EXPECT_THAT(skip_reasons(kLog, "silent_test"), ElementsAre("no reason given"));
  EXPECT_THAT(skip_reasons("", "absent_test"), ElementsAre("no reason given"));
}

TEST(SkipReasons, FindTestsWhoseNumberIsPadded) {
  const std::string log =
      " 7/63 Testing: early_test\n 7/63 Test: early_test\nOutput:\n-----\nno PyTorch here\n<end of output>\n";
  EXPECT_THAT(skip_reasons(log, "early_test"), ElementsAre("no PyTorch here"));
}

TEST(SkippedTest, ReadsTheNameOfASkippedTestOnly) {
  EXPECT_EQ(skipped_test(" 2/10 Test  #2: arena_test .......................***Skipped   0.00 sec"),
            "arena_test");
  EXPECT_EQ(skipped_test(" 3/10 Test #12: clock_test .......................   Passed    0.00 sec"), "");
  EXPECT_EQ(skipped_test("***Skipped"), "");
  EXPECT_EQ(skipped_test(""), "");
}

TEST(IsClosingLine, ReadsTheSummaryOfCtest) {
  EXPECT_TRUE(is_closing_line("100% tests passed, 0 tests failed out of 5"));
  EXPECT_TRUE(is_closing_line("75% tests passed, 1 tests failed out of 4"));
  EXPECT_TRUE(is_closing_line("No tests were found!!!"));
  EXPECT_FALSE(is_closing_line("all tests passed"));
  EXPECT_FALSE(is_closing_line(""));
}

TEST(TestTime, ReadsNameAndSecondsOfATestThatHasRun) {
  const std::optional<TestTime> time =
      test_time("  3/210 Test  #12: clock_test .......................   Passed   12.34 sec");
  ASSERT_TRUE(time);
  EXPECT_EQ(time->name, "clock_test");
  EXPECT_EQ(time->seconds, 12.34);
  EXPECT_EQ(test_time("4/9 Test #2: lost_test ....***Timeout 120.01 sec")->seconds, 120.01);
  EXPECT_FALSE(test_time("      Start  12: clock_test"));
  EXPECT_FALSE(test_time("Total Test time (real) =   0.04 sec"));
  EXPECT_FALSE(test_time(""));
}

TEST(AllowedWords, AreInBackquotesInTheLastColumn) {
  const std::vector<std::string> words = allowed_words(
      "# Page with `code`\n| test | words |\n|---|---|\n| `a` | `no disk`, `no root` |\n| b | none |\n| c | "
      "`open |\n");
  EXPECT_THAT(words, ElementsAre("no disk", "no root", "open "));
  EXPECT_TRUE(is_allowed("Chaos.Disk: there is no disk here", words));
  EXPECT_FALSE(is_allowed("clang++ is not installed", words));
  EXPECT_FALSE(is_allowed("", words));
  EXPECT_FALSE(is_allowed("anything", allowed_words("")));
}

}  // namespace test_report_test
}  // namespace comrad::deploy
