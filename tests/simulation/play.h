// Plays schedules: from a seed, from text, and ever shorter ones of a schedule that broke a rule.
#pragma once

#include <cstdint>
#include <optional>
#include <string>

#include "tests/simulation/schedule.h"
#include "tests/simulation/simulated_run.h"

namespace comrad::simulation {

struct Played {
  Schedule schedule;  ///< the steps that were taken
  std::optional<Failure> failure;
  deploy::RunEnding ending;
};

/// Draws the steps of a run from `seed`, each of those that may come next, and plays it to its end.
Played play_seed(uint64_t seed, Fault fault = Fault::kNone);

/// Plays a schedule to its end. Errors: kBadInput for the first step that cannot come where it stands, by number and name.
Expected<Played> play(const Schedule& schedule, Fault fault = Fault::kNone);

/// The shortest schedule found that breaks the same rule: steps are left out while it still does (Zeller, Hildebrandt 2002,
/// "Simplifying and isolating failure-inducing input"), with those that cannot come any more.
Played shrink(const Played& broken, Fault fault = Fault::kNone);

/// What a failed test prints.
std::string report_of(const Played& played);

}  // namespace comrad::simulation
