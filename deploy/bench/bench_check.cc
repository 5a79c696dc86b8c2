#include "deploy/bench/bench_check.h"

#include <algorithm>
#include <cstdio>
#include <utility>

#include "rollout_buffer/core/bench_windows.h"

namespace comrad::deploy {
namespace {

using nlohmann::ordered_json;

// Shares of BenchRequest::seconds, which is the pipeline's own window.
constexpr double kPartShare = 0.3, kTeamShare = 0.25;

double cost_of(const ordered_json& bench) {
  return bench["cpu_seconds_per_1000_decisions"]["all"].get<double>();
}

/// What one round measured, in the order of bench_bounds().
Expected<std::vector<double>> measure_round(const BenchRequest& request, ordered_json& train) {
  const auto measured = [&](const std::string& what, double share, const UserSettings& user) {
    return measure_bench({.what = what, .user = user, .seconds = share * request.seconds, .is_quiet = true});
  };
  std::vector<ordered_json> parts;
  for (const char* part : {"sim", "inference", "learner"}) {
    COMRAD_TRY_ASSIGN(ordered_json one, measured(part, kPartShare, request.user));
    parts.push_back(std::move(one));
  }
  COMRAD_TRY_ASSIGN(train, measured("train", 1, request.user));
  const auto of_team = [&](const std::string& agents) {
    return measured("sim", kTeamShare,
                    user_with(request.user, {{"scenario", "armory_siege"}, {"num_agents", agents}}));
  };
  COMRAD_TRY_ASSIGN(const ordered_json two, of_team("2"));
  COMRAD_TRY_ASSIGN(const ordered_json eight, of_team("8"));
  return std::vector<double>{share_of_limit(parts, train), cost_of(eight) / cost_of(two),
                             train["bytes_copied_per_decision"].get<double>(),
                             parts.back()["host_waits_per_step"]["all"].get<double>()};
}

}  // namespace

double share_of_limit(const std::vector<ordered_json>& parts, const ordered_json& train) {
  double parts_s = 0;
  for (const ordered_json& part : parts) parts_s += cost_of(part);
  const double free_s = train["cores"].get<double>() * train["seconds"].get<double>() *
                        (1 - train["other_programs_busy"].get<double>());
  return parts_s * train["decisions"].get<double>() / 1000 / free_s;
}

double BenchBound::value() const { return median_of(measured); }

bool BenchBound::holds() const {
  return !measured.empty() && (is_at_most ? value() <= bound : value() >= bound);
}

std::vector<BenchBound> bench_bounds(double frame_bytes) {
  return {{"pipeline over its limit", 0.85, false,
           "bench train's decisions times the processor seconds that sim, inference and learner take for one "
           "alone, over the "
           "core seconds that other programs left free"},
          {"cost of one of 8 agents over one of 2", 1.15, true,
           "processor seconds a decision of bench sim on armory_siege"},
          {"bytes copied a decision", 3 * frame_bytes, true,
           "the picture once into a batch, the last row of a rollout into the next, states, weights"},
          {"host waits within an optimizer step", 0, true,
           "numbers read out of tensors, positions of what is not zero, copies to the host"}};
}

Expected<ordered_json> measure_checks(const BenchRequest& request, int rounds_min, int rounds_max) {
  constexpr double kFrameBytes = 3 * 72 * 128;
  std::vector<BenchBound> bounds = bench_bounds(kFrameBytes);
  ordered_json train;
  const auto all_hold = [&] { return std::ranges::all_of(bounds, &BenchBound::holds); };
  for (int round = 0; round < rounds_max && (round < rounds_min || !all_hold()); ++round) {
    COMRAD_TRY_ASSIGN(const std::vector<double> values, measure_round(request, train));
    for (std::size_t i = 0; i < bounds.size(); ++i) bounds[i].measured.push_back(values[i]);
    if (request.is_quiet) continue;
    std::fprintf(stderr, "comrad bench check: round %d:", round + 1);
    for (const double value : values) std::fprintf(stderr, " %.3f", value);
    std::fprintf(stderr, "\n");
  }
  ordered_json summary, rows = ordered_json::array();
  for (const char* key :
       {"bench", "scenario", "algo", "num_agents", "cores", "seconds", "decisions_per_s", "env_frames_per_s"})
    summary[key] = train[key];
  summary["bench"] = "check";
  for (const BenchBound& bound : bounds)
    rows.push_back({{"check", bound.name},
                    {"measured", bound.value()},
                    {"must_be", bound.is_at_most ? "at most" : "at least"},
                    {"bound", bound.bound},
                    {"holds", bound.holds() ? "yes" : "no"},
                    {"rounds", bound.measured},
                    {"how", bound.how}});
  summary["holds"] = all_hold();
  summary["checks"] = rows;
  return summary;
}

}  // namespace comrad::deploy
