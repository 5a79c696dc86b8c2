// How often a learner's host sends its weights to hosts that play for it: as often as there are new ones, while that
// costs little beside what the link is for. Stage: beside the flow.
#pragma once

#include <algorithm>
#include <cstddef>

namespace comrad::link {

struct WeightsLimits {
  double versions_per_s = 10;  ///< at most so many
  double bytes_per_s = 50e6;   ///< and so many bytes, to all hosts together
  double cpu_share = 0.03;     ///< and so much of one core, measured as they are sent
  double most_s = 4;  ///< but once in so many seconds, whatever they cost: older policies are discarded
};

/// Unicast sends every host all weights by itself, and each packet has its price; what that comes to depends on the
/// network, its datagrams and keys, so the pace follows what the last sending cost. Seconds are of one monotonic clock.
class WeightsPace {
 public:
  explicit WeightsPace(const WeightsLimits& limits) : limits_(limits) {}

  /// A newer version may go to `hosts` hosts, 1 or more.
  bool is_due(double now_s, std::size_t hosts) const {
    return hosts_ == 0 || now_s - sent_s_ >= interval_s(hosts);
  }
  /// `bytes` went to each of `hosts` hosts and cost `cpu_s` of processor time.
  void sent(double now_s, std::size_t bytes, std::size_t hosts, double cpu_s) {
    sent_s_ = now_s;
    bytes_ = static_cast<double>(bytes);
    hosts_ = static_cast<double>(hosts);
    cpu_s_ = cpu_s;
  }
  double interval_s(std::size_t hosts) const {
    const auto now = static_cast<double>(hosts);
    const double cpu_s = hosts_ > 0 ? cpu_s_ * now / hosts_ : 0;
    return std::max({1 / limits_.versions_per_s, bytes_ * now / limits_.bytes_per_s,
                     std::min(cpu_s / limits_.cpu_share, limits_.most_s)});
  }
  /// Since the last sending; very long before the first.
  double since_sent_s(double now_s) const { return hosts_ > 0 ? now_s - sent_s_ : 1e9; }

 private:
  WeightsLimits limits_;
  double sent_s_ = 0, bytes_ = 0, hosts_ = 0, cpu_s_ = 0;
};

}  // namespace comrad::link
