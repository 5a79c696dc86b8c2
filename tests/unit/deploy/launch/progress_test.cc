#include "deploy/launch/progress.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <pty.h>
#include <unistd.h>

namespace comrad::deploy {
namespace progress_test {

TEST(TrainingLine, ShowsEverythingOnce) {
  TrainingProgress progress;
  progress.env_frames = 1.25e6;
  progress.env_frames_total = 1e8;
  progress.env_frames_per_s = 3512.4;
  progress.decisions_per_s = 878.1;
  progress.score_mean = 412.34;
  progress.return_mean = 1.2345;
  progress.lag_mean = 3.21;
  progress.lag_max = 9;
  EXPECT_EQ(
      training_line(progress),
      "1.2M/100M env frames (1.2%), ETA 7h48m | 3512 env frames/s, 878 decisions/s | J 412.3, return 1.23 | "
      "lag 3.2 (max 9)");
  progress.env_frames_lost = 205'000;
  EXPECT_THAT(training_line(progress),
              ::testing::EndsWith("| lag 3.2 (max 9) | learner went back 205k env frames"));
}

TEST(TrainingLine, LeavesOutWhatIsNotKnownYet) {
  TrainingProgress progress;
  progress.env_frames = 512;
  EXPECT_EQ(training_line(progress), "512 env frames | 0 env frames/s, 0 decisions/s");
  progress.env_frames_total = 1000;
  EXPECT_EQ(training_line(progress), "512/1k env frames (51.2%) | 0 env frames/s, 0 decisions/s")
      << "no rate, no ETA";
  progress.env_frames = 2000;
  progress.env_frames_per_s = 10;
  EXPECT_EQ(training_line(progress), "2k/1k env frames (200.0%), ETA 0s | 10 env frames/s, 0 decisions/s");
}

TEST(TrainingLine, ReportsThatNoEpisodeHasEndedAndWhenOneMust) {
  TrainingProgress progress;
  progress.env_frames = 512;
  progress.decision_limit = 4500;
  EXPECT_EQ(training_line(progress),
            "512 env frames | 0 env frames/s, 0 decisions/s | no episode ended yet (limit 4 500 decisions)");
  progress.decision_limit = 0;
  EXPECT_THAT(training_line(progress), ::testing::EndsWith("| no episode ended yet"));
}

TEST(TrainingLine, ShowsTheLastEvaluationBehindTheTrainingScore) {
  TrainingProgress progress;
  progress.env_frames = 512;
  progress.score_mean = 3;
  progress.evaluated = "eval J 4 at 1M";
  EXPECT_THAT(training_line(progress), ::testing::EndsWith("| J 3 | eval J 4 at 1M"));
}

TEST(NextCommands, NameTheRunsFolder) {
  EXPECT_EQ(next_commands("/runs/lava"),
            "next, to evaluate it:   comrad eval --policy /runs/lava --episodes 100\n"
            "      to make a video:  comrad eval --policy /runs/lava --save_video /runs/lava/video.mp4\n"
            "      to plot it:       comrad plot /runs/lava --output /runs/lava/curves.png");
  EXPECT_THAT(next_commands("/my runs/lava"),
              ::testing::HasSubstr("plot '/my runs/lava' --output '/my runs/lava/curves.png'"));
}

TEST(TrainingLine, HidesNoSmallScore) {
  TrainingProgress progress;
  progress.score_mean = 0.0085;
  EXPECT_THAT(training_line(progress), ::testing::EndsWith("| J 0.0085"));
}

TEST(WholeText, GroupsThreeDigits) {
  EXPECT_EQ(whole_text(0), "0");
  EXPECT_EQ(whole_text(999), "999");
  EXPECT_EQ(whole_text(1000), "1 000");
  EXPECT_EQ(whole_text(4500), "4 500");
  EXPECT_EQ(whole_text(123456), "123 456");
  EXPECT_EQ(whole_text(12345678), "12 345 678");
}

TEST(TrainingLine, ReportsHowFullTheReplayIsUntilLearningBegins) {
  TrainingProgress progress;
  progress.env_frames = 24'400;
  progress.replay_filled = 0.619;
  EXPECT_EQ(training_line(progress),
            "filling the replay, 61 % | 24.4k env frames | 0 env frames/s, 0 decisions/s");
  progress.replay_filled = 0.9999;
  EXPECT_THAT(training_line(progress), ::testing::StartsWith("filling the replay, 99 % |"));
  progress.replay_filled = 1;
  EXPECT_THAT(training_line(progress), ::testing::StartsWith("24.4k env frames |"));
}

TEST(CountText, ChangesUnitWhereRoundingDoes) {
  EXPECT_EQ(count_text(0), "0");
  EXPECT_EQ(count_text(999), "999");
  EXPECT_EQ(count_text(999.6), "1k");
  EXPECT_EQ(count_text(1000), "1k");
  EXPECT_EQ(count_text(12345), "12.3k");
  EXPECT_EQ(count_text(123456), "123k");
  EXPECT_EQ(count_text(999'400), "999k");
  EXPECT_EQ(count_text(999'600), "1M");
  EXPECT_EQ(count_text(8e6), "8M");
  EXPECT_EQ(count_text(1e8), "100M");
  EXPECT_EQ(count_text(2.5e9), "2.5G");
}

TEST(DurationText, HasTwoUnitsAtMost) {
  EXPECT_EQ(duration_text(0), "0s");
  EXPECT_EQ(duration_text(59.4), "59s");
  EXPECT_EQ(duration_text(59.6), "1m00s");
  EXPECT_EQ(duration_text(65), "1m05s");
  EXPECT_EQ(duration_text(3660), "1h01m");
  EXPECT_EQ(duration_text(90'000), "1d01h");
  EXPECT_EQ(duration_text(-1), "?");
  EXPECT_EQ(duration_text(std::nan("")), "?");
}

// The next bytes of the descriptor, at most `size`: fewer once nothing more has come for two seconds. A terminal hands
// one write over in several pieces when the kernel is busy, so a single read may see less than was written.
std::string next_text(int descriptor, std::size_t size) {
  constexpr int kPatienceMs = 2000;
  std::string text(size, '\0');
  std::size_t filled = 0;
  pollfd readable{.fd = descriptor, .events = POLLIN, .revents = 0};
  while (filled < size && poll(&readable, 1, kPatienceMs) > 0) {
    const ssize_t got = read(descriptor, text.data() + filled, size - filled);
    if (got <= 0) break;
    filled += static_cast<std::size_t>(got);
  }
  text.resize(filled);
  return text;
}

void expect_next(int descriptor, const std::string& expected) {
  EXPECT_EQ(next_text(descriptor, expected.size()), expected);
}

void expect_nothing_left(int descriptor) {
  pollfd readable{.fd = descriptor, .events = POLLIN, .revents = 0};
  EXPECT_EQ(poll(&readable, 1, 0), 0) << "more was written than expected";
}

TEST(ProgressPrinter, WritesPlainLinesToAPipe) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  ProgressPrinter printer(ends[1], true);
  printer.line("one");
  printer.note("a worker died");
  printer.line("two");
  printer.end();
  expect_next(ends[0], "one\na worker died\ntwo\n");
  ProgressPrinter quiet(ends[1], false);
  quiet.line("hidden");
  quiet.note("shown");
  expect_next(ends[0], "shown\n");
  expect_nothing_left(ends[0]);
  close(ends[0]);
  close(ends[1]);
}

TEST(ProgressPrinter, RewritesOneLineOfATerminalAndNeverWraps) {
  int leader = -1, terminal = -1;
  winsize size{.ws_row = 25, .ws_col = 20, .ws_xpixel = 0, .ws_ypixel = 0};
  ASSERT_EQ(openpty(&leader, &terminal, nullptr, nullptr, &size), 0);
  ProgressPrinter printer(terminal, true);
  printer.line("first");
  expect_next(leader, "\r\x1b[Kfirst");
  printer.line("a line that is longer than the terminal");
  expect_next(leader, "\r\x1b[Ka line that is long");
  printer.line("short");
  expect_next(leader, "\r\x1b[Kshort");
  printer.note("kept");
  expect_next(leader, "\r\x1b[Kkept\r\n");
  expect_next(leader, "\r\x1b[Kshort");  // the note has scrolled by, the line stands again
  printer.end();
  expect_next(leader, "\r\n");
  expect_nothing_left(leader);
  close(leader);
  close(terminal);
}

/// Everything that lies in a pipe or behind a terminal, as long as something does. The kernel hands over what was written to
/// a terminal in its own time.
std::string read_all(int descriptor) {
  const int patience_ms = isatty(descriptor) == 1 ? 500 : 20;
  std::string text;
  char bytes[4096];
  for (pollfd readable{.fd = descriptor, .events = POLLIN, .revents = 0};
       poll(&readable, 1, patience_ms) == 1;) {
    const ssize_t size = read(descriptor, bytes, sizeof bytes);
    if (size <= 0) break;
    text.append(bytes, static_cast<std::size_t>(size));
  }
  return text;
}

/// Writes until the reader has lost lines, and checks that the reader then learns of them.
void expect_drops_and_says_so(int writer, int reader) {
  ProgressPrinter printer(writer, true);
  const std::string line(1000, 'x');
  for (int i = 0; i < 500; ++i) printer.note(line);  // half a megabyte: more than pipes and terminals hold
  const std::string before = read_all(reader);
  EXPECT_LT(before.size(), 400'000u) << "the reader was never slow enough for this test";
  printer.note("here again");
  const std::string after = read_all(reader);
  EXPECT_NE(after.find(" lines dropped: the terminal did not read them)"), std::string::npos) << after;
  EXPECT_TRUE(after.ends_with("here again\n") || after.ends_with("here again\r\n")) << after;
  const int flags = fcntl(writer, F_GETFL);
  EXPECT_EQ(flags & O_NONBLOCK, 0) << "others that share the descriptor would get EAGAIN";
}

TEST(ProgressPrinter, NeverWaitsForAReaderThatPauses) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  expect_drops_and_says_so(ends[1], ends[0]);
  close(ends[0]);
  close(ends[1]);
  int leader = -1, terminal = -1;
  ASSERT_EQ(openpty(&leader, &terminal, nullptr, nullptr, nullptr), 0);
  expect_drops_and_says_so(terminal, leader);
  close(leader);
  close(terminal);
}

TEST(ProgressPrinter, LosesItsReaderWithoutHarm) {
  int ends[2];
  ASSERT_EQ(pipe(ends), 0);
  signal(SIGPIPE, SIG_IGN);
  close(ends[0]);
  ProgressPrinter printer(ends[1], true);
  printer.line("never read");
  close(ends[1]);
}

}  // namespace progress_test
}  // namespace comrad::deploy
