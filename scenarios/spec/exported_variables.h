// What a scenario's script tells the world outside: its global variables 1 to 60, which ViZDoom and we call USER1 to
// USER60, with the names and comments that the script gives them, and what scenario.toml reads of them.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

struct ExportedVariable {
  int user = 0;         ///< 1..60
  std::string name;     ///< the script's; empty where there is no script.acs
  std::string meaning;  ///< the comment behind its declaration, or empty
  std::vector<std::string> read_by =
      {};  ///< "score", "score_divisor", "measurement 0", names of reward terms
};

/// Reads `global int 24:cleared;  // what it means` of an ACS source; one declaration a line, in order of their numbers.
std::vector<ExportedVariable> declared_globals(std::string_view script);

/// The script's declarations and what reads them, in order of their numbers. A scenario without script.acs has those that
/// its scenario.toml reads. Errors: kSystem, kBadFormat where script.acs cannot be read.
Expected<std::vector<ExportedVariable>> exported_variables(const ScenarioSpec& spec, int num_agents);

}  // namespace comrad::scenarios
