#include "deploy/run/run_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace comrad::deploy {
namespace run_table_test {

using nlohmann::json;
using ::testing::ElementsAre;
using ::testing::HasSubstr;
using ::testing::Not;

json a_run() {
  json run = {
      {"run", "lava"},          {"state", "running"},  {"host", "box"},          {"pid", 77},
      {"elapsed_s", 65},        {"env_frames", 1.5e6}, {"env_frames_goal", 1e8}, {"env_frames_per_s", 3512},
      {"decisions_per_s", 878}, {"env_frameskip", 4},  {"J_mean", nullptr},      {"policy_lag_mean", 2.5},
      {"policy_lag_max", 9},    {"replay_filled", 1},  {"restarts", 3},          {"silence", ""}};
  run["slabs"] = {{"free", 12}, {"filling", 30}, {"sealed", 4}, {"learning", 2}};
  run["decisions_account"] = {
      {"made", 1000}, {"trained", 900}, {"lost_with_simulators", 60}, {"waiting", 40}};
  run["checkpoint"] = {{"path", "/runs/lava/checkpoint/checkpoint_9_8.pt"}, {"failed", 2}};
  run["hosts"] = json::array(
      {{{"host", "box"}, {"workers", 4}, {"decisions_per_s", 900}, {"credits", 12}, {"restarts", 3}}});
  for (int sim = 0; sim < 3; ++sim)
    run["workers"].push_back({{"worker", "sim-" + std::to_string(sim)},
                              {"host", "box"},
                              {"state", "running"},
                              {"pid", 1234},
                              {"decisions_per_s", 440.4},
                              {"busy", 0.815},
                              {"silent_s", sim == 1 ? 75 : 0.2},
                              {"restarts", sim},
                              {"cpu_s", 3700},
                              {"resident_bytes", 80'000'000}});
  return run;
}

TEST(RunTable, FitsATerminalOfAnyWidth) {
  const json run = a_run();
  for (std::size_t width = 1; width < 220; ++width)
    for (const auto& lines : {run_lines(run, width), host_table(run, width), worker_table(run, width)})
      for (const std::string& line : lines) EXPECT_LE(line.size(), width) << line;
  EXPECT_THAT(worker_table(run, 220)[0], HasSubstr("MEMORY"));
  EXPECT_THAT(worker_table(run, 60)[0], Not(HasSubstr("MEMORY")));
  EXPECT_THAT(worker_table(run, 10)[1], HasSubstr("sim-0"));
}

TEST(RunTable, PrintsWhatTheRunPrinted) {
  std::string all;
  for (const std::string& line : run_lines(a_run(), 200)) all += line + "\n";
  for (const char* words : {"lava: running for 1m05s on box (pid 77)",
                            "1.5M/100M env frames (1.5%) | 3512 env frames/s, 878 decisions/s",
                            "lag 2.5 (max 9)", "12 free (credits)", "4 wait for the learner", "restarts 3",
                            "1k made, 900 trained on, 60 lost with simulators, 40 on their way",
                            "checkpoint_9_8.pt, 2 could not be written"})
    EXPECT_THAT(all, HasSubstr(words));
  EXPECT_THAT(all, Not(HasSubstr("J ")));
  json scored = a_run();
  scored["J_mean"] = 0.0085;
  EXPECT_THAT(run_lines(scored, 200)[1], HasSubstr("| J 0.0085 |"));
  EXPECT_THAT(host_table(a_run(), 200)[1], HasSubstr("3600")) << "env frames/s";
  EXPECT_THAT(worker_table(a_run(), 200)[2], HasSubstr("1m15s")) << "silent";
}

TEST(RunTable, TheLightestColumnsGoFirst) {
  const std::vector<TableColumn> columns = {{"A", 0, false}, {"BB", 2}, {"CC", 1}};
  EXPECT_THAT(table_lines(columns, {{"x", "1", "2"}}, 9), ElementsAre("A  BB  CC", "x   1   2"));
  EXPECT_THAT(table_lines(columns, {{"x", "1", "2"}}, 8), ElementsAre("A  BB", "x   1"));
  EXPECT_THAT(table_lines(columns, {{"xyz", "1", "2"}}, 2), ElementsAre("A", "xy"));
}

TEST(RunTable, NothingThatARunPrintsDrivesTheTerminal) {
  EXPECT_EQ(fitted("a\x1b[2Jb\r\n\x7f", 80), "a?[2Jb???");
  EXPECT_EQ(fitted("\xC2\x9B"
                   "31m",
                   80),
            "?31m");
  EXPECT_EQ(fitted("h\xC3\xA9llo", 3), "h\xC3\xA9l") << "letters, not bytes";
  EXPECT_EQ(fitted("\xFF\xFE", 80), "??");
}

TEST(RunTable, AnAnswerWithoutItsPartsIsNoHarm) {
  for (const json& run : {json::object(), json({{"hosts", 7}, {"workers", "x"}, {"slabs", nullptr}})})
    EXPECT_FALSE(run_lines(run, 80).empty());
}

}  // namespace run_table_test
}  // namespace comrad::deploy
