// The windows of a bench: rates of equal stretches of one measurement, their median and spread. One number hides a host
// that was slow for a moment; several show it.
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

namespace comrad {

/// The middle value, or the mean of the two in the middle; 0 of nothing.
inline double median_of(std::vector<double> values) {
  if (values.empty()) return 0;
  std::ranges::sort(values);
  const std::size_t half = values.size() / 2;
  return values.size() % 2 == 1 ? values[half] : (values[half - 1] + values[half]) / 2;
}

/// (largest - smallest) / median; 0 of fewer than two values, and where the median is 0.
inline double spread_of(const std::vector<double>& values) {
  const double middle = median_of(values);
  if (values.size() < 2 || middle == 0) return 0;
  const auto [smallest, largest] = std::ranges::minmax(values);
  return (largest - smallest) / middle;
}

/// Cuts `seconds` into `count` windows. A window closes at the first see() at or after its end, so that it holds whole units of
/// work; where one unit takes longer than a window there are fewer.
class BenchWindows {
 public:
  static constexpr int kCount = 5;

  explicit BenchWindows(double seconds, int count = kCount)
      : seconds_(seconds), length_(seconds / count), next_end_(std::min(length_, seconds)) {}

  /// So much is done `elapsed_s` seconds after the beginning, at which nothing was. True once the last window is over.
  bool see(double done, double elapsed_s) {
    if (elapsed_s < next_end_ || elapsed_s <= began_) return false;
    rates_.push_back((done - done_before_) / (elapsed_s - began_));
    done_before_ = done;
    began_ = elapsed_s;
    next_end_ = std::min(seconds_, (std::floor(elapsed_s / length_ + 1e-9) + 1) * length_);
    return elapsed_s >= seconds_;
  }

  /// Units a second, by window.
  const std::vector<double>& rates() const { return rates_; }
  double median() const { return median_of(rates_); }
  double spread() const { return spread_of(rates_); }

 private:
  double seconds_, length_, next_end_;
  double done_before_ = 0, began_ = 0;
  std::vector<double> rates_;
};

}  // namespace comrad
