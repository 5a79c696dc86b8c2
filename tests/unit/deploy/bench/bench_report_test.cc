#include "deploy/bench/bench_report.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace bench_report_test {

using nlohmann::ordered_json;
using ::testing::AllOf;
using ::testing::HasSubstr;

TEST(WithTables, ReplacesWhatStandsBetweenTheMarksAndNothingElse) {
  const std::string text = "# Title\n" + kReportBegin + "\nold\n" + kReportEnd + "\nrest\n";
  const auto once = with_tables(text, "new\n");
  ASSERT_TRUE(once);
  EXPECT_EQ(*once, "# Title\n" + kReportBegin + "\nnew\n" + kReportEnd + "\nrest\n");
  EXPECT_EQ(*with_tables(*once, "new\n"), *once);
}

TEST(WithTables, RefusesAFileWithoutBothMarksInOrder) {
  for (const std::string& text :
       {std::string("nothing"), kReportBegin, kReportEnd, kReportEnd + kReportBegin,
        kReportBegin + kReportEnd + kReportBegin, kReportBegin + kReportEnd + kReportEnd})
    EXPECT_FALSE(with_tables(text, "new\n")) << text;
}

TEST(MachineText, NamesTheProcessorItsCoresAndWhatItMultipliesWith) {
  const std::string cpuinfo =
      "processor\t: 0\nmodel name\t: Quick CPU @ 2\nflags\t\t: sse avx2 avx512f avx512_bf16\n\n"
      "processor\t: 1\nmodel name\t: Quick CPU @ 2\nflags\t\t: sse avx2 avx512f avx512_bf16\n";
  EXPECT_EQ(machine_text(cpuinfo, 1), "Quick CPU @ 2, 1 of 2 cores, AVX2, AVX-512, AVX-512 BF16");
  EXPECT_EQ(machine_text("", 3), "unknown processor, 3 of 0 cores");
}

TEST(ReportTables, HaveARowForEveryBenchAndSayWhereTheyAreFrom) {
  const ordered_json sim = {{"bench", "sim"},
                            {"scenario", "lava_pit"},
                            {"algo", "ippo"},
                            {"decisions_per_s", 1234.5},
                            {"env_frames_per_s", 4938.0},
                            {"spread", 0.125}};
  ordered_json train = sim;
  train["bench"] = "train";
  train["precision"] = "bf16";
  train["bottleneck"] = "drawing takes it all.";
  train["cpu_seconds_per_1000_decisions"] = {{"tic", 0.5}, {"all", 1.5}};
  train["bytes_copied_per_decision"] = 30000;
  train["cores_busy"] = {0.99, 0.5};
  ordered_json inference = sim;
  inference["bench"] = "inference";
  inference["batches"] = {{{"batch_rows", 2}, {"rows_per_s", 900.0}},
                          {{"batch_rows", 4}, {"rows_per_s", 1500.0}}};
  const std::string text = report_tables({sim, inference, train},
                                         {.commit = "abc1234", .machine = "a machine", .date = "2026-11-24"});
  EXPECT_THAT(text, AllOf(HasSubstr("abc1234"), HasSubstr("a machine"), HasSubstr("2026-11-24")));
  EXPECT_THAT(text, HasSubstr("| sim | `./comrad bench sim --scenario lava_pit` | 1234 | 4938 | 0.12 |\n"));
  EXPECT_THAT(text, HasSubstr("`./comrad bench train --scenario lava_pit --algo ippo --precision bf16`"));
  EXPECT_THAT(text, HasSubstr("| batch_rows | rows_per_s |\n| --- | --- |\n| 2 | 900 |\n| 4 | 1500 |\n"));
  EXPECT_THAT(text,
              HasSubstr("drawing takes it all. Bytes copied a decision: 30000. Cores busy: 0.99, 0.50."));
}

}  // namespace bench_report_test
}  // namespace comrad::deploy
