// A network that loses, delays, swaps, doubles and cuts, from a seed and in simulated time.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <utility>

#include "rollout_buffer/core/rng.h"

namespace comrad::test {

struct LineTraits {
  double loss = 0, duplication = 0;  ///< shares of all messages
  double delay_s = 0.01;             ///< of each message at least,
  double jitter_s = 0;               ///< and up to so much more: messages overtake each other
};

/// One way between two ends. Threads: one.
template <typename Message>
class SimulatedLine {
 public:
  SimulatedLine(const LineTraits& traits, Rng random) : traits_(traits), random_(random) {}

  void cut(bool is_cut) { is_cut_ = is_cut; }
  void send(const Message& message, double now_s) {
    ++sent_;
    const int copies = is_cut_ || random_.uniform() < traits_.loss ? 0
                       : random_.uniform() < traits_.duplication   ? 2
                                                                   : 1;
    for (int copy = 0; copy < copies; ++copy)
      under_way_.emplace(now_s + traits_.delay_s + random_.uniform() * traits_.jitter_s, message);
  }
  /// What has arrived by now, in the order of its arrival.
  std::optional<Message> receive(double now_s) {
    if (under_way_.empty() || under_way_.begin()->first > now_s) return std::nullopt;
    Message message = std::move(under_way_.begin()->second);
    under_way_.erase(under_way_.begin());
    return message;
  }
  uint64_t sent() const { return sent_; }

 private:
  const LineTraits traits_;
  Rng random_;
  bool is_cut_ = false;
  std::multimap<double, Message> under_way_;  // by its arrival
  uint64_t sent_ = 0;
};

}  // namespace comrad::test
