// When a dead worker is started again, and when it is hopeless.
#pragma once

#include <algorithm>
#include <deque>
#include <optional>

namespace comrad::deploy {

struct RestartLimits {
  double first_delay_s = 0.2;  ///< doubled with every death inside the window
  double max_delay_s = 10.0;
  double window_s = 60.0;
  int deaths = 10;  ///< so many inside the window, or in a row without any work done: give up
};

/// Deaths of one worker.
class RestartHistory {
 public:
  explicit RestartHistory(RestartLimits limits = {}) : limits_(limits) {}

  /// Notes a death at `now_s`; `did_work` if the worker made progress in its life. Seconds to wait before the
  /// next start, or nothing: give up.
  std::optional<double> next_delay_s(double now_s, bool did_work) {
    while (!deaths_s_.empty() && now_s - deaths_s_.front() >= limits_.window_s) deaths_s_.pop_front();
    deaths_s_.push_back(now_s);
    idle_deaths_ = did_work ? 0 : idle_deaths_ + 1;
    // A worker that needs long to start and then dies would never fill the window; the second count
    // catches it.
    if (static_cast<int>(deaths_s_.size()) >= limits_.deaths || idle_deaths_ >= limits_.deaths)
      return std::nullopt;
    double delay_s = limits_.first_delay_s;
    for (std::size_t death = 1; death < deaths_s_.size() && delay_s < limits_.max_delay_s; ++death)
      delay_s *= 2;
    return std::min(delay_s, limits_.max_delay_s);
  }

 private:
  RestartLimits limits_;
  std::deque<double> deaths_s_;
  int idle_deaths_ = 0;
};

}  // namespace comrad::deploy
