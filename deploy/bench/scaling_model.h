// How fast the pipeline would be on more cores: a model of four limits, computed from one `comrad bench train --json`.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::deploy {

/// Processor seconds of one decision.
struct DecisionCosts {
  std::array<double, kStageCount> stage_s{};
  double other_s = 0;

  double of(Stage stage) const { return stage_s[static_cast<std::size_t>(stage)]; }
  double simulators_s() const { return of(Stage::kTic) + of(Stage::kRender) + of(Stage::kHandOver); }
  double policy_workers_s() const { return policy_thread_s() + of(Stage::kForward); }
  /// What one thread of a policy worker does alone.
  double policy_thread_s() const {
    return of(Stage::kGather) + of(Stage::kWeights) + of(Stage::kPack) + of(Stage::kScatter);
  }
  double all_s() const;
  /// Errors: kBadFormat where a number is missing or below 0, or all are 0.
  static Expected<DecisionCosts> from(const nlohmann::ordered_json& bench_train);
};

/// Decisions a second that one part could make if the others cost nothing.
struct ModelRow {
  int64_t cores = 1, num_workers = 1, policy_workers = 1, learner_threads = 1;
  double simulators = 0;           ///< num_workers cores at most, one process each
  double policy_workers_rate = 0;  ///< policy_workers processes; the forward pass on policy_threads each
  double learner =
      0;  ///< both passes on learner_threads; the optimizer's step and publishing on one, after them
  double all_cores = 0;   ///< every core always busy
  double rate = 0;        ///< the least of them, and
  std::string saturates;  ///< whose it is
};

/// `config`: resolved for `cores`. Threads: pure function.
ModelRow model_row(const DecisionCosts& costs, const RunConfig& config, int64_t cores);

/// The rows of `cores` as a table: the settings that `auto` chooses on so many, the limits, env frames a second.
/// `settings_on` gives the resolved settings of so many cores. Errors: those of settings_on.
Expected<nlohmann::ordered_json> model_table(const DecisionCosts& costs, const std::vector<int64_t>& cores,
                                             const std::function<Expected<RunConfig>(int)>& settings_on);

}  // namespace comrad::deploy
