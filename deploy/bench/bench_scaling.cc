#include "deploy/bench/bench_scaling.h"

#include <algorithm>
#include <cstdio>

#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

std::string text_of(const ScalingGrid::Point& point) {
  std::vector<std::string> words = {point.bench};
  for (const auto& [setting, value] : point.settings) words.push_back("--" + setting + " " + value);
  return joined(words, " ");
}

}  // namespace

std::vector<ScalingGrid::Point> ScalingGrid::points() const {
  std::vector<Point> points;
  for (const std::string& bench : benches) points.push_back({bench, {}});
  const auto vary = [&](const std::string& setting, const std::vector<std::string>& values) {
    if (values.empty()) return;
    std::vector<Point> varied;
    for (const Point& point : points) {
      if (setting == "num_workers" && point.bench != "train") {
        varied.push_back(point);
        continue;
      }
      for (const std::string& value : values) {
        varied.push_back(point);
        varied.back().settings.emplace_back(setting, value);
      }
    }
    points = std::move(varied);
  };
  vary("scenario", scenarios);
  vary("num_workers", workers);
  vary("num_envs_per_worker", envs);
  vary("num_agents", agents);
  return points;
}

void compare_costs(ordered_json& rows) {
  const auto is_same = [](const ordered_json& a, const ordered_json& b) {
    for (const char* key : {"bench", "scenario", "num_workers", "num_envs_per_worker"})
      if (a[key] != b[key]) return false;
    return true;
  };
  for (ordered_json& row : rows) {
    const auto first =
        std::ranges::find_if(rows, [&](const ordered_json& other) { return is_same(row, other); });
    row["cost_of_an_agent"] =
        (*first)["decisions_per_s"].get<double>() / row["decisions_per_s"].get<double>();
  }
}

Expected<ordered_json> measure_scaling(const ScalingGrid& grid, const BenchRequest& request) {
  for (const std::string& bench : grid.benches)
    if (bench != "train" && std::ranges::find(kStageBenches, bench) == kStageBenches.end())
      return Error{ErrorCode::kBadInput, "--parts: '" + bench + "' is no bench that scaling can use (" +
                                             joined(kStageBenches) + ", train)"};
  const std::vector<ScalingGrid::Point> points = grid.points();
  ordered_json summary, rows = ordered_json::array();
  for (std::size_t i = 0; i < points.size(); ++i) {
    const ScalingGrid::Point& point = points[i];
    if (!request.is_quiet)
      std::fprintf(stderr, "comrad bench scaling: %zu of %zu: %s\n", i + 1, points.size(),
                   text_of(point).c_str());
    BenchRequest one = request;
    one.what = point.bench;
    one.user = user_with(request.user, point.settings);
    one.is_quiet = true;
    const Expected<ordered_json> measured = measure_bench(one);
    if (!measured) return Error{measured.error().code, text_of(point) + ": " + measured.error().message};
    if (summary.empty()) summary = *measured;
    const auto setting_of = [&](const std::string& setting) -> ordered_json {
      for (const auto& [name, value] : point.settings)
        if (name == setting) return ordered_json::parse(value, nullptr, /*allow_exceptions=*/false);
      return measured->value(setting, ordered_json("auto"));
    };
    rows.push_back({{"bench", point.bench},
                    {"scenario", (*measured)["scenario"]},
                    {"num_agents", (*measured)["num_agents"]},
                    {"num_workers", setting_of("num_workers")},
                    {"num_envs_per_worker", setting_of("num_envs_per_worker")},
                    {"decisions_per_s", (*measured)["decisions_per_s"]},
                    {"env_frames_per_s", (*measured)["env_frames_per_s"]},
                    {"spread", (*measured)["spread"]}});
  }
  compare_costs(rows);
  ordered_json all;
  for (const char* key :
       {"bench", "scenario", "algo", "num_agents", "cores", "seconds", "decisions_per_s", "env_frames_per_s"})
    all[key] = summary[key];
  all["bench"] = "scaling";
  all["points"] = rows;
  return all;
}

}  // namespace comrad::deploy
