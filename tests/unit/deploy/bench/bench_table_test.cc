#include "deploy/bench/bench_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

namespace comrad::deploy {
namespace bench_table_test {

using nlohmann::ordered_json;

TEST(BenchCell, KeepsThreeDigitsAndWholeNumbersWhole) {
  EXPECT_EQ(bench_cell("vdn"), "vdn");
  EXPECT_EQ(bench_cell(12345), "12345");
  EXPECT_EQ(bench_cell(12345.678), "12346");
  EXPECT_EQ(bench_cell(45.678), "45.7");
  EXPECT_EQ(bench_cell(0.98765), "0.99");
  EXPECT_EQ(bench_cell(0.012345), "0.0123");
  EXPECT_EQ(bench_cell(-45.678), "-45.7");
  EXPECT_EQ(bench_cell(ordered_json({100.4, 2.0})), "100, 2.00");
}

TEST(BenchTable, NumbersComeFirstAndRowsOfObjectsBehindThem) {
  const ordered_json summary = {
      {"bench", "scaling"},
      {"points", {{{"agents", 2}, {"rate", 1000.0}}, {{"agents", 8}, {"rate", 90.5}}}},
      {"latency", {{"p50", 3.25}}}};
  EXPECT_EQ(bench_table(summary),
            "bench                                    scaling\n"
            "latency.p50                              3.25\n"
            "\n"
            "points\n"
            "  agents rate\n"
            "       2 1000\n"
            "       8 90.5\n");
}

TEST(BenchTable, ARowMayLackAKey) {
  const ordered_json summary = {{"rows", {{{"a", 1}, {"b", "x"}}, {{"a", 2}}}}};
  EXPECT_EQ(bench_table(summary), "\nrows\n  a b\n  1 x\n  2\n");
}

TEST(BenchTable, AnEmptyListIsALineAndNotATable) {
  EXPECT_EQ(bench_table({{"windows", ordered_json::array()}}), "windows                                  \n");
}

}  // namespace bench_table_test
}  // namespace comrad::deploy
