#include "deploy/launch/progress.h"

#include <spdlog/fmt/fmt.h>

#include <fcntl.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <cerrno>
#include <cstdio>
#include <utility>

#include "rollout_buffer/core/score_text.h"
#include "rollout_buffer/core/text.h"

namespace comrad::deploy {
namespace {

template <typename... Values>
std::string format(const char* pattern, Values... values) {
  char text[256];
  std::snprintf(text, sizeof text, pattern, values...);
  return text;
}

}  // namespace

std::string next_commands(const std::string& run_dir) {
  const std::string run = shell_word(run_dir);
  return "next, to evaluate it:   comrad eval --policy " + run + " --episodes 100\n" +
         "      to make a video:  comrad eval --policy " + run + " --save_video " +
         shell_word(run_dir + "/video.mp4") + "\n" + "      to plot it:       comrad plot " + run +
         " --output " + shell_word(run_dir + "/curves.png");
}

std::string count_text(double count) {
  const struct {
    double unit;
    const char* name;
  } units[] = {{1e9, "G"}, {1e6, "M"}, {1e3, "k"}};
  for (const auto& [unit, name] : units) {
    if (count < 0.9995 * unit) continue;  // 999 500 would round to "1000k"; it belongs to the unit above
    const double value = count / unit;
    std::string text = format(value < 99.95 ? "%.1f" : "%.0f", value);
    if (text.ends_with(".0")) text.resize(text.size() - 2);
    return text + name;
  }
  return format("%.0f", count);
}

std::string whole_text(int64_t count) {
  std::string text = std::to_string(count);
  for (std::size_t place = text.size(); place > 3;) text.insert(place -= 3, " ");
  return text;
}

std::string duration_text(double seconds) {
  if (!(seconds >= 0) || seconds > 1e9) return "?";
  const long long s = std::llround(seconds);
  if (s < 60) return format("%llds", s);
  if (s < 3600) return format("%lldm%02llds", s / 60, s % 60);
  if (s < 86400) return format("%lldh%02lldm", s / 3600, s / 60 % 60);
  return format("%lldd%02lldh", s / 86400, s / 3600 % 24);
}

std::string training_line(const TrainingProgress& p) {
  std::string text;
  if (p.replay_filled < 1)
    text = fmt::format("filling the replay, {} % | ", static_cast<int>(100 * p.replay_filled));
  text += count_text(p.env_frames);
  if (p.env_frames_total > 0) {
    text += "/" + count_text(p.env_frames_total) + " env frames" +
            format(" (%.1f%%)", 100.0 * p.env_frames / p.env_frames_total);
    const double left = p.env_frames_total - p.env_frames;
    if (p.env_frames_per_s > 0) text += ", ETA " + duration_text(left > 0 ? left / p.env_frames_per_s : 0);
  } else {
    text += " env frames";
  }
  text += format(" | %.0f env frames/s, %.0f decisions/s", p.env_frames_per_s, p.decisions_per_s);
  if (std::isfinite(p.score_mean)) text += " | J " + score_text(p.score_mean);
  if (std::isfinite(p.return_mean))
    text += format("%s return %.3g", std::isfinite(p.score_mean) ? "," : " |", p.return_mean);
  if (p.decision_limit >= 0)
    text += " | no episode ended yet" +
            (p.decision_limit > 0 ? " (limit " + whole_text(p.decision_limit) + " decisions)" : "");
  if (!p.evaluated.empty()) text += " | " + p.evaluated;
  if (std::isfinite(p.lag_mean)) text += format(" | lag %.1f (max %u)", p.lag_mean, p.lag_max);
  if (!p.hosts.empty()) text += " | " + p.hosts;
  if (!p.silence.empty()) text += " | " + p.silence;
  if (p.env_frames_lost > 0) text += " | learner went back " + count_text(p.env_frames_lost) + " env frames";
  return text;
}

ProgressPrinter::ProgressPrinter(int descriptor, bool show)
    : descriptor_(descriptor), show_(show), is_terminal_(isatty(descriptor) == 1) {
  // O_NONBLOCK belongs to the open file, which others share (the shell's terminal); so one of our own is needed.
  // A plain file never blocks for long and would be written from its beginning.
  struct stat kind {};
  if (fstat(descriptor, &kind) != 0 || !(S_ISFIFO(kind.st_mode) || S_ISCHR(kind.st_mode))) return;
  const std::string path = fmt::format("/proc/self/fd/{}", descriptor);
  own_descriptor_ = open(path.c_str(), O_WRONLY | O_NONBLOCK | O_NOCTTY | O_CLOEXEC);
}

ProgressPrinter::~ProgressPrinter() {
  if (own_descriptor_ >= 0) close(own_descriptor_);
}

void ProgressPrinter::line(const std::string& text) {
  if (!show_) return;
  if (!is_terminal_) {
    put(text + "\n");
    return;
  }
  standing_ = text;
  winsize size{};
  std::string cut = text;
  // A line that wraps could not be rewritten in place.
  if (ioctl(descriptor_, TIOCGWINSZ, &size) == 0 && size.ws_col > 1 && cut.size() >= size.ws_col) {
    cut.resize(size.ws_col - 1u);
  }
  put("\r\x1b[K" + cut);
}

void ProgressPrinter::note(const std::string& text) {
  const std::string under = standing_;
  if (!standing_.empty()) put("\r\x1b[K");
  put(text + "\n");
  if (!under.empty()) line(under);
}

void ProgressPrinter::end() {
  if (!standing_.empty()) put("\n");
  standing_.clear();
}

void ProgressPrinter::put(const std::string& text) {
  if (!write_some(rest_)) {
    ++dropped_;
    return;
  }
  rest_ = text;
  if (dropped_ > 0)
    rest_ = fmt::format("({} lines dropped: the terminal did not read them)\n{}", std::exchange(dropped_, 0),
                        text);
  write_some(rest_);
}

bool ProgressPrinter::write_some(std::string& text) {
  const int descriptor = own_descriptor_ >= 0 ? own_descriptor_ : descriptor_;
  while (!text.empty()) {
    pollfd ready{.fd = descriptor, .events = POLLOUT, .revents = 0};
    // A pipe or terminal that could not be opened anew: at least not while it is full.
    if (own_descriptor_ < 0 && poll(&ready, 1, 0) == 0) return false;
    const ssize_t written = write(descriptor, text.data(), text.size());
    if (written > 0) text.erase(0, static_cast<std::size_t>(written));
    if (written < 0 && (errno == EAGAIN || errno == EWOULDBLOCK)) return false;
    if (written < 0 && errno != EINTR) text.clear();  // no reader is left: the run continues without
  }
  return true;
}

}  // namespace comrad::deploy
