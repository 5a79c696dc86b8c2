#include "deploy/bench/scaling_model.h"

#include <algorithm>
#include <numeric>
#include <utility>

namespace comrad::deploy {

using nlohmann::ordered_json;

double DecisionCosts::all_s() const { return std::accumulate(stage_s.begin(), stage_s.end(), other_s); }

Expected<DecisionCosts> DecisionCosts::from(const ordered_json& bench_train) {
  DecisionCosts costs;
  const auto found =
      bench_train.is_object() ? bench_train.find("cpu_seconds_per_1000_decisions") : bench_train.end();
  const auto number = [&](const std::string& name) -> Expected<double> {
    if (found == bench_train.end() || !found->is_object() || !found->contains(name) ||
        !(*found)[name].is_number() || !((*found)[name].get<double>() >= 0))
      return Error{ErrorCode::kBadFormat, "cpu_seconds_per_1000_decisions has no " + name +
                                              "; give what `comrad bench train --json` printed"};
    return (*found)[name].get<double>() / 1000;
  };
  for (std::size_t i = 0; i < kStageCount; ++i) {
    COMRAD_TRY_ASSIGN(costs.stage_s[i], number(name_of(static_cast<Stage>(i))));
  }
  COMRAD_TRY_ASSIGN(costs.other_s, number("other"));
  if (costs.all_s() <= 0) return Error{ErrorCode::kBadFormat, "cpu_seconds_per_1000_decisions: all are 0"};
  return costs;
}

ModelRow model_row(const DecisionCosts& costs, const RunConfig& config, int64_t cores) {
  const CollectionSettings& settings = config.collection;
  const auto at_most_cores = [&](int64_t threads) { return static_cast<double>(std::min(threads, cores)); };
  const auto rate = [](double seconds) { return seconds > 0 ? 1 / seconds : 1e12; };
  ModelRow row{.cores = cores,
               .num_workers = settings.num_workers,
               .policy_workers = settings.policy_workers,
               .learner_threads = settings.learner_threads,
               .saturates = {}};
  row.simulators = at_most_cores(settings.num_workers) * rate(costs.simulators_s());
  row.policy_workers_rate =
      at_most_cores(settings.policy_workers) *
      rate(costs.policy_thread_s() + costs.of(Stage::kForward) / at_most_cores(settings.policy_threads));
  row.learner = std::min(rate(costs.of(Stage::kForwardBackward) / at_most_cores(settings.learner_threads) +
                              costs.of(Stage::kOptimizer) + costs.of(Stage::kPublish)),
                         rate(costs.of(Stage::kCollate)));
  row.all_cores = static_cast<double>(cores) * rate(costs.all_s());
  const std::array<std::pair<double, const char*>, 4> limits = {{{row.all_cores, "all cores"},
                                                                 {row.learner, "learner"},
                                                                 {row.policy_workers_rate, "policy workers"},
                                                                 {row.simulators, "simulators"}}};
  const auto least = std::ranges::min_element(limits, {}, &std::pair<double, const char*>::first);
  row.rate = least->first;
  row.saturates = least->second;
  return row;
}

Expected<ordered_json> model_table(const DecisionCosts& costs, const std::vector<int64_t>& cores,
                                   const std::function<Expected<RunConfig>(int)>& settings_on) {
  ordered_json rows = ordered_json::array();
  for (const int64_t count : cores) {
    COMRAD_TRY_ASSIGN(const RunConfig config, settings_on(static_cast<int>(count)));
    const ModelRow row = model_row(costs, config, count);
    rows.push_back({{"cores", row.cores},
                    {"num_workers", row.num_workers},
                    {"policy_workers", row.policy_workers},
                    {"learner_threads", row.learner_threads},
                    {"simulators", row.simulators},
                    {"policy_workers_rate", row.policy_workers_rate},
                    {"learner", row.learner},
                    {"all_cores", row.all_cores},
                    {"decisions_per_s", row.rate},
                    {"env_frames_per_s", row.rate * static_cast<double>(config.environment.env_frameskip)},
                    {"saturates", row.saturates}});
  }
  return rows;
}

}  // namespace comrad::deploy
