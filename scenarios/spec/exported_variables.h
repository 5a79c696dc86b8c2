// What a scenario's script exports: its global variables 1 to 60, which ViZDoom calls USER1 to USER60,
// with the names that [exports] of scenario.toml gives them, and what reads them.
#pragma once

#include <string>
#include <vector>

#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

struct ExportedVariable {
  int user = 0;         ///< 1..60
  std::string name;     ///< of [exports]; empty where it is read by its number alone
  std::string meaning;  ///< the comment behind its row, or empty
  /// "score", "score_divisor", "measurement 0", names of reward terms.
  std::vector<std::string> read_by = {};
};

/// The exports, and what the score, measurements and rewards of `num_agents` agents read besides, in order of their numbers.
std::vector<ExportedVariable> exported_variables(const ScenarioSpec& spec, int num_agents);

}  // namespace comrad::scenarios
