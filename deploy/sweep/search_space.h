// What a sweep with [search] looks for: which settings, between which values, and how. sweep_file.h reads it, sweep.json keeps
// it, search.py (Optuna) and population.h choose from it. Stage: before a run.
#pragma once

#include <cstdint>
#include <nlohmann/json_fwd.hpp>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad::deploy {

/// A setting that is searched: some values, or a range of numbers with both ends.
struct SearchedSetting {
  std::string setting;               ///< canonical name
  int line = 0;                      ///< in the sweep's file
  std::vector<std::string> choices;  ///< as config.toml has them; none: a range
  double low = 0, high = 0;
  double step = 0;        ///< between neighbours, from `low`; 0: every number
  bool is_log = false;    ///< as likely between 1 and 10 as between 10 and 100
  bool is_whole = false;  ///< whole numbers

  /// "1e-05 to 0.001 (log)", "16 to 64 in steps of 16", "entropy or symmetric_kl".
  std::string words() const;
  /// A number of the range as config.toml has it: clamped, and on a step.
  std::string text(double value) const;
  /// Whether a value, as config.toml has it, is one of these.
  bool holds(const std::string& value) const;
  /// The ends of the range, or every choice.
  std::vector<std::string> extremes() const;
};

enum class SearchMethod { kNone, kRandom, kTpe, kHalving, kPbt };

struct SweepSearch {
  SearchMethod method = SearchMethod::kNone;
  int line = 0;
  int64_t runs = 0;  ///< trials or members of each study
  int64_t seed = 0;
  std::vector<SearchedSetting> space;
  // Successive halving.
  double first_env_frames = 0;  ///< of the first rung
  int64_t reduction = 3;        ///< one of so many continues, for so many times the env frames
  // Population-based training.
  double every_env_frames = 0;  ///< of a generation
  double quantile = 0.25;       ///< share of the members that copy, and of those that are copied
  std::vector<double> perturb = {0.8, 1.2};
  double resample_probability = 0.25;

  bool is_on() const { return method != SearchMethod::kNone; }
  /// Optuna chooses the settings; each run is one trial.
  bool has_trials() const { return is_on() && method != SearchMethod::kPbt; }
  /// Runs are trained in steps, with a decision after each.
  bool is_stepwise() const { return method == SearchMethod::kHalving || method == SearchMethod::kPbt; }
  /// Env frames at which the step ends that begins after `steps` of them; `goal` at most.
  double end_of_step(int64_t steps, double goal) const;
  /// "trial", "member".
  const char* run_word() const { return has_trials() ? "trial" : "member"; }
};

/// random, tpe, halving, pbt.
const std::vector<std::string>& search_methods();
const char* word_of(SearchMethod method);
/// The method of a word; none for one that is no method's.
std::optional<SearchMethod> search_method(std::string_view word);

/// The values are those of the space, each setting once. `origin` is named in messages. Errors: kBadFormat.
Status check_in_space(const SweepSearch& search, const SettingValues& values, const std::string& origin);

/// As sweep.json has it; null without a search.
nlohmann::ordered_json to_json(const SweepSearch& search);
/// Errors: kBadFormat without a reason; the caller names the file.
Expected<SweepSearch> search_from_json(const nlohmann::ordered_json& json);

/// {"name": "value"}, and back. Errors: kBadFormat without a reason.
nlohmann::ordered_json to_json(const SettingValues& values);
Expected<SettingValues> setting_values_from_json(const nlohmann::ordered_json& json);

}  // namespace comrad::deploy
