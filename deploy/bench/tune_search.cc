#include "deploy/bench/tune_search.h"

#include <algorithm>

#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {

Expected<TuneResult> tune(const std::vector<TuneAxis>& axes,
                          const std::function<Expected<double>(const TunedSettings&)>& measure,
                          const std::function<bool()>& has_time) {
  TuneResult result;
  const auto measured = [&](const TunedSettings& settings, double best_rate) {
    TuneTry one{.settings = settings, .rate = 0, .ratio = 0, .failure = {}};
    const Expected<double> rate = measure(settings);
    if (rate) {
      one.rate = *rate;
      one.ratio = best_rate > 0 ? *rate / best_rate : 1;
    } else {
      one.failure = rate.error().message;
    }
    result.tries.push_back(one);
    return one;
  };
  for (const TuneAxis& axis : axes) {
    if (!has_time()) {
      result.is_whole = false;
      break;
    }
    const TuneTry begin = measured(result.best, 0);
    if (begin.rate <= 0) return Error{ErrorCode::kBadInput, begin.failure};
    TuneTry fastest = begin;
    for (const TunedSettings& alternative : axis) {
      const TuneTry one = measured(with_settings(result.best, alternative), begin.rate);
      if (one.rate > fastest.rate) fastest = one;
    }
    if (fastest.ratio < 1 + kLeastGain || fastest.settings == begin.settings) continue;
    // Once more, the best so far beside it: one lucky moment decides nothing.
    const TuneTry again = measured(result.best, 0);
    const TuneTry confirmed = measured(fastest.settings, again.rate);
    if (again.rate <= 0 || confirmed.ratio < 1 + kLeastGain) continue;
    result.best = fastest.settings;
    result.ratio *= (fastest.rate + confirmed.rate) / (begin.rate + again.rate);
  }
  return result;
}

std::string toml_of(const TunedSettings& settings) {
  std::string text;
  for (const auto& [setting, value] : settings) text += setting_toml(*find_setting(setting), value);
  return text;
}

std::vector<TuneAxis> tune_axes(const RunConfig& config, int cores) {
  std::vector<TuneAxis> axes;
  const auto add = [&](const std::string& setting, const std::vector<int64_t>& values) {
    TuneAxis axis;
    const std::string now = setting_text(config, setting);
    for (const int64_t value : values) {
      const TunedSettings alternative = {{setting, std::to_string(value)}};
      if (value >= 1 && alternative.front().second != now &&
          std::ranges::find(axis, alternative) == axis.end())
        axis.push_back(alternative);
    }
    if (!axis.empty()) axes.push_back(std::move(axis));
  };
  const CollectionSettings& now = config.collection;
  axes.push_back({{{"precision", now.precision == Precision::kBf16 ? "fp32" : "bf16"}}});
  add("num_workers", {cores / 2, cores, 3 * cores / 2});
  // Halves of a worker's environments take turns, so their number stays even.
  add("num_envs_per_worker", {now.num_envs_per_worker / 2 / 2 * 2, 2 * now.num_envs_per_worker});
  add("learner_threads", {cores / 2, cores});
  add("policy_threads", {1, std::min(2, cores)});
  if (cores >= 8) add("policy_workers", {1, 2, cores / 5, cores / 3});
  // Nothing waits for larger batches but simulators: where the learner has the cores busy, that costs little. Without
  // splits all of a policy worker's environments can be one batch.
  const int64_t served = now.num_workers * now.num_envs_per_worker / std::max<int64_t>(1, now.policy_workers);
  add("min_batch", {now.min_batch / 2, 2 * now.min_batch});
  TuneAxis splits = {{{"worker_num_splits", now.worker_num_splits == 1 ? "2" : "1"}}};
  if (now.worker_num_splits != 1 || now.min_batch != served)
    splits.push_back({{"worker_num_splits", "1"}, {"min_batch", std::to_string(served)}});
  axes.push_back(std::move(splits));
  return axes;
}

}  // namespace comrad::deploy
