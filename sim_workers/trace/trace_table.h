// The rows of a trace as CSV. Columns, units and rounding are those of the reference traces: t, map_tic, the
// actions, the state after the tic, the reward. Stage: step.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/trace/trace_actions.h"
#include "sim_workers/trace/trace_game.h"

namespace comrad::trace {

class TraceTable {
 public:
  /// With game variables called `variables` as further columns, and with the world's hash as last column, in 16
  /// hexadecimal digits, where `with_hash`. Errors: kBadInput for a name that is no game variable.
  static Expected<TraceTable> create(const ActionTable& actions, const std::vector<std::string>& variables,
                                     bool with_hash);

  std::string header() const;
  /// The row after tic `t`; 0 is before the first.
  std::string row(TraceGame& game, int64_t t, double reward, double total_reward) const;

 private:
  TraceTable(const ActionTable& actions, bool with_hash) : actions_(actions), with_hash_(with_hash) {}

  const ActionTable& actions_;
  std::vector<std::string> variable_names_;
  std::vector<scenarios::GameVariable> variables_;  // parallel
  bool with_hash_;
};

}  // namespace comrad::trace
