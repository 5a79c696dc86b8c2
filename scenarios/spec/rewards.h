// Turns what the game counts into rewards, by the [[rewards]] terms of a scenario. Stage: step.
//
//   kind     amount of one decision
//   delta    now - before
//   rise     max(0, now - before)
//   fall     max(0, before - now)
//   new_max  max(0, now - best so far); the best starts at the variable's value at reset
//   value    now
//   event    1 where now > before, else 0
//
//   reward += weight * clip(amount, +-cap)      (cap 0: no clip; per_agent: weight / N)
//
// A term with `when` or `unless` pays only in decisions that these variables allow; what it remembers continues
// all the same.
//
// "Before" starts at the true value at reset, so the first decision pays for what happened in it and
// nothing else.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/settings/reward_weights.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

/// The kinds that a term may have, and its scopes.
std::vector<std::string> reward_kinds();
std::vector<std::string> reward_scopes();

/// Gives reward terms of `spec` other weights. Where the score is the return, its ceiling is not known then.
/// Errors: kBadInput for a term that the scenario does not have, with the nearest name.
Status change_weights(ScenarioSpec& spec, const std::vector<RewardWeight>& weights);

/// The reward terms of one environment, with what they remember of the episode.
class RewardTracker {
 public:
  /// `terms` must come from load_scenario(): kinds and scopes are known ones.
  RewardTracker(const std::vector<RewardTerm>& terms, int num_agents);

  /// Starts an episode. `value` [term, N]: each term's variable as each agent sees it; a team term's row
  /// holds the same number N times.
  void reset(std::span<const double> value);

  /// From now on weights are those of a run that has made so many env frames. Before the first call: of none.
  void set_env_frames(double env_frames);

  /// Adds nothing up from before: writes the rewards of one decision.
  ///   value   [term, N]  variables after the decision
  ///   reward  [N]        written
  ///   pays    [term, N]  0 where the term's `when` or `unless` shuts it; empty: every term pays
  void step(std::span<const double> value, std::span<double> reward, std::span<const uint8_t> pays = {});
  /// What each term added to the last decision's rewards [term, N].
  std::span<const double> parts() const { return parts_; }

 private:
  enum class Kind { kDelta, kRise, kFall, kNewMax, kValue, kEvent };
  struct Term {
    Kind kind;
    double weight;  ///< of now, for one agent
    double cap;
    Schedule schedule;
    int shared_by;
  };
  int num_agents_;
  std::vector<Term> terms_;
  std::vector<double> before_;  ///< [term, N]; the best so far for new_max
  std::vector<double> parts_;
};

}  // namespace comrad::scenarios
