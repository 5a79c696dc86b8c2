#include "rollout_buffer/settings/schedule.h"

#include <algorithm>
#include <cmath>
#include <optional>

#include "rollout_buffer/core/text.h"

namespace comrad {
namespace {

constexpr std::size_t kMostPoints = 64;
constexpr double kEnvFramesMax = 1e15;
constexpr std::string_view kLine = "..";

/// A point's number as people write it: 1, 2e7, 4e-4, where real_text() has 1.0, 2e+07, 4e-04.
std::string short_text(double number) {
  std::string text = real_text(number);
  if (text.ends_with(".0")) text.resize(text.size() - 2);
  const std::size_t exponent = text.find('e');
  if (exponent == std::string::npos) return text;
  std::size_t digits = exponent + 2;
  while (digits + 1 < text.size() && text[digits] == '0') ++digits;
  return text.substr(0, exponent + 1) + (text[exponent + 1] == '-' ? "-" : "") + text.substr(digits);
}

}  // namespace

Schedule Schedule::line(double start, double end, double env_frames) {
  Schedule schedule(start);
  schedule.points_.push_back({.value = end, .env_frames = env_frames, .ends_a_line = true});
  return schedule;
}

Expected<Schedule> Schedule::parse(std::string_view text) {
  const auto refused = [text] {
    return Error{ErrorCode::kBadInput,
                 "'" + std::string(text) +
                     "' is neither a number nor a schedule over env frames: values at growing env frames, as "
                     "1e-3@0,1e-4@2e6 (steps) or 1e-3@0..1e-4@2e6 (a line)"};
  };
  Schedule schedule;
  schedule.points_.clear();
  std::string_view rest = text;
  for (bool ends_a_line = false, is_last = false; !is_last;) {
    const std::size_t comma = std::min(rest.find(','), rest.size()),
                      dots = std::min(rest.find(kLine), rest.size());
    const std::size_t end = std::min(comma, dots);
    const std::string_view one = rest.substr(0, end);
    const std::size_t mark = one.find('@');
    is_last = end == rest.size();
    const bool stands_alone = is_last && schedule.points_.empty();
    const std::optional<double> value = read_real(one.substr(0, mark));
    std::optional<double> env_frames;
    if (mark != std::string_view::npos)
      env_frames = read_real(one.substr(mark + 1));
    else if (stands_alone)
      env_frames = 0;
    const double before = schedule.points_.empty() ? -1 : schedule.points_.back().env_frames;
    if (!value || !env_frames || *env_frames < 0 || *env_frames <= before || *env_frames > kEnvFramesMax ||
        schedule.points_.size() == kMostPoints)
      return refused();
    schedule.points_.push_back({*value, *env_frames, ends_a_line});
    ends_a_line = dots < comma;
    if (!is_last) rest.remove_prefix(end + (ends_a_line ? kLine.size() : 1));
  }
  if (schedule.is_constant()) schedule.points_.front().env_frames = 0;  // 3@2e6 alone is 3
  return schedule;
}

double Schedule::at(double env_frames) const {
  const auto next = std::ranges::upper_bound(points_, env_frames, {}, &Point::env_frames);
  if (next == points_.begin()) return next->value;
  const Point& before = *(next - 1);
  if (next == points_.end() || !next->ends_a_line) return before.value;
  const double way = (env_frames - before.env_frames) / (next->env_frames - before.env_frames);
  return before.value + way * (next->value - before.value);
}

int64_t Schedule::rounded_at(double env_frames) const { return std::llround(at(env_frames)); }

std::string Schedule::text() const {
  if (is_constant()) return real_text(points_.front().value);
  std::string text;
  for (const Point& point : points_) {
    if (!text.empty()) text += point.ends_a_line ? kLine : std::string_view(",");
    text += short_text(point.value) + "@" + short_text(point.env_frames);
  }
  return text;
}

}  // namespace comrad
