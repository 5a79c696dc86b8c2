// `comrad bench scaling`: how rates change with workers, environments, agents and scenarios.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "deploy/bench/bench_parts.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

/// What is varied; an empty list: as the settings have it.
struct ScalingGrid {
  std::vector<std::string> benches = {"sim"};  ///< which bench measures every point
  std::vector<std::string> scenarios = {}, agents = {}, workers = {}, envs = {};

  /// One point: settings on top of the others.
  struct Point {
    std::string bench;
    SettingValues settings;
  };
  /// Every combination, the last list changing first. A simulator's bench is one process, so `workers` varies for train alone.
  std::vector<Point> points() const;
};

/// Errors: kBadInput for an unknown bench or a list with an empty word; those of measure_bench(), naming the point.
Expected<nlohmann::ordered_json> measure_scaling(const ScalingGrid& grid, const BenchRequest& request);

/// Adds `cost_of_an_agent` to every row: its seconds a decision over those of the first row of the same bench, scenario,
/// workers and environments.
void compare_costs(nlohmann::ordered_json& rows);

}  // namespace comrad::deploy
