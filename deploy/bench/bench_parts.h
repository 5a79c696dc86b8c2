// Each bench as one JSON object: what `comrad bench` prints, and what scaling, check and report are made from.
#pragma once

#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "deploy/settings/merged_settings.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

struct BenchRequest {
  std::string what;       ///< among kStageBenches, or "train"
  UserSettings user;      ///< on top of the built-in settings and endless_settings()
  double seconds = 20;    ///< measured, cut into windows
  bool is_quiet = false;  ///< no progress and no notes
};

/// Stages that worker programs measure alone.
inline const std::vector<std::string> kStageBenches = {"engine", "render", "sim", "inference", "learner"};

/// Merges the settings, measures in a temporary run, and gives the object with the common keys first:
///
///   bench, scenario, algo, num_agents, cores, seconds, decisions_per_s (median of windows), env_frames_per_s
///
/// Errors: those of merge_new(), TemporaryRun::create(), bench_pipeline(); kPeerLost where the worker failed; kSystem "interrupted".
Expected<nlohmann::ordered_json> measure_bench(const BenchRequest& request);

/// `bench learner` of every algorithm: the object of the first with a table `algorithms`. The algorithm is not among
/// request.user. Errors: those of measure_bench().
Expected<nlohmann::ordered_json> measure_all_algorithms(const BenchRequest& request);

/// A program beside ours that prints one JSON object for `--json`: comrad-bench-transport. Errors: kPeerLost, kBadFormat.
Expected<nlohmann::ordered_json> measure_with_program(std::vector<std::string> command, double seconds);

/// Settings on top of others: the later of two wins.
UserSettings user_with(UserSettings user, const SettingValues& settings);

}  // namespace comrad::deploy
