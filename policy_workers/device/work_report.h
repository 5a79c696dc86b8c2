// Counted work as benches print it. Stage: beside the flow.
#pragma once

#include <algorithm>
#include <cstdint>
#include <nlohmann/json.hpp>

#include "policy_workers/device/work_counter.h"

namespace comrad::device {

/// Work of so many decisions in so many passes: {"flop_per_decision", "bytes_per_decision", "launches_per_pass",
/// "decisions_per_pass"}.
inline nlohmann::ordered_json work_of(const Work& work, int64_t decisions, int64_t passes) {
  const auto by = [](int64_t sum, int64_t count) {
    return static_cast<double>(sum) / static_cast<double>(std::max<int64_t>(1, count));
  };
  return {{"flop_per_decision", by(work.flop, decisions)},
          {"bytes_per_decision", by(work.bytes, decisions)},
          {"launches_per_pass", by(work.launches, passes)},
          {"decisions_per_pass", by(decisions, passes)}};
}

}  // namespace comrad::device
