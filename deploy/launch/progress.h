// What the user sees of a run: one line that is rewritten in place on a terminal, plain lines when piped,
// and notes (a worker died, a warning) that scroll by above it. Every rate is given twice: env frames/s
// and decisions/s.
#pragma once

#include <cmath>
#include <cstdint>
#include <string>

namespace comrad::deploy {

/// Numbers of a training line. NaN: not known yet, left out.
struct TrainingProgress {
  double env_frames = 0;
  double env_frames_total = 0;  ///< 0: no limit, so neither per cent nor ETA
  double env_frames_per_s = 0;
  double decisions_per_s = 0;
  double score_mean = std::nan("");  ///< J
  double return_mean = std::nan("");
  int64_t decision_limit =
      -1;  ///< no episode has ended yet, and each ends after so many at the latest; 0: no limit
  std::string evaluated = {};  ///< the last evaluation; empty is left out
  double lag_mean = std::nan("");
  uint32_t lag_max = 0;
  double replay_filled = 1;    ///< share of the decisions that learning waits for; 1 is left out
  std::string hosts = {};      ///< that feed this run; empty is left out
  std::string silence = {};    ///< workers that stand still; empty is left out
  double env_frames_lost = 0;  ///< forgotten when the learner went back to a checkpoint; 0 is left out
};

/// `1.2M/100M env frames (1.2%), ETA 7h48m | 3512 env frames/s, 878 decisions/s | J 412.3, return 1.23 |
/// eval J 455.0 at 1M | lag 3.2 (max 9) | learner went back 205k env frames`; while learning waits it begins with
/// `filling the replay, 61 % | `
std::string training_line(const TrainingProgress& progress);

/// What is done next with a run that has a checkpoint, as commands with its folder: evaluate, make a video, plot.
std::string next_commands(const std::string& run_dir);

/// 950 -> "950", 12'345 -> "12.3k", 1e8 -> "100M".
std::string count_text(double count);
/// 950 -> "950", 21'000 -> "21 000".
std::string whole_text(int64_t count);
/// 5 -> "5s", 65 -> "1m05s", 3'660 -> "1h01m", 90'000 -> "1d01h".
std::string duration_text(double seconds);

/// Writes progress to a descriptor, and never blocks on its reader: while a pipe is full or a terminal stands
/// still (Ctrl-S), what is written is dropped and counted. Threads: one.
class ProgressPrinter {
 public:
  /// `show` false keeps progress lines back; notes and the summary are still written.
  ProgressPrinter(int descriptor, bool show);
  ProgressPrinter(const ProgressPrinter&) = delete;
  ProgressPrinter& operator=(const ProgressPrinter&) = delete;
  ~ProgressPrinter();

  /// Replaces the line on a terminal; elsewhere appends it.
  void line(const std::string& text);
  /// Something that must stay to be read.
  void note(const std::string& text);
  /// Ends the line in place, if one stands.
  void end();

 private:
  void put(const std::string& text);
  /// Writes what it can; the rest stays in `text`. False where the reader takes no more now.
  bool write_some(std::string& text);
  int descriptor_;
  int own_descriptor_ = -1;  ///< the same pipe or terminal, opened anew so that writes do not block
  bool show_;
  bool is_terminal_;
  std::string standing_;  ///< the line in place
  std::string rest_;      ///< what of the last text was not taken yet
  int dropped_ = 0;       ///< texts since the reader took one
};

}  // namespace comrad::deploy
