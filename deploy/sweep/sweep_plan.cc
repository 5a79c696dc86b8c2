#include "deploy/sweep/sweep_plan.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <limits>
#include <map>
#include <set>
#include <tuple>

#include "deploy/settings/existing_run.h"
#include "deploy/settings/game_files.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

constexpr std::size_t kRunsMax = 10'000;

/// Describes once every scenario, team size, input and heads: hundreds of runs share a few.
class DescribeOnce {
 public:
  explicit DescribeOnce(const Describe& describe) : describe_(describe) {}
  Expected<ScenarioDescription> operator()(const RunConfig& config) {
    const auto key = std::tuple(config.run.scenario, config.environment.num_agents,
                                config.environment.use_additional_input, config.environment.heads);
    auto known = answers_.find(key);
    if (known == answers_.end()) known = answers_.emplace(key, describe_(config)).first;
    return known->second;
  }

 private:
  const Describe& describe_;
  std::map<std::tuple<std::string, int64_t, bool, std::string>, Expected<ScenarioDescription>> answers_;
};

bool is_word(char c) { return (lower_case(c) >= 'a' && lower_case(c) <= 'z') || c == '_'; }

/// Of the first axis, or of [search] where there is none.
int first_line(const SweepFile& file) {
  return file.axes.empty() ? file.search.line : file.axes.front().line;
}

/// The line of the setting that `message` speaks of first; that of the first axis where it names none.
int line_of(const SweepFile& file, const std::string& message) {
  int line = first_line(file);
  std::size_t first = std::string::npos;
  for (const auto& [setting, at] : file.lines)
    for (std::size_t place = message.find(setting); place != std::string::npos;
         place = message.find(setting, place + 1)) {
      const bool begins = place == 0 || !is_word(message[place - 1]);
      const std::size_t end = place + setting.size();
      if (!begins || (end < message.size() && is_word(message[end]))) continue;
      if (place < first) first = place, line = at;
      break;
    }
  return line;
}

/// Whether a run with these values of the axes has one of the values of every condition.
bool meets(const SweepFile& file, const std::vector<std::string>& values,
           const std::vector<SweepAxis>& conditions) {
  return std::ranges::all_of(conditions, [&](const SweepAxis& condition) {
    const auto axis = std::ranges::find(file.axes, condition.setting, &SweepAxis::setting);
    const std::string& value = values[static_cast<std::size_t>(axis - file.axes.begin())];
    return std::ranges::find(condition.values, value) != condition.values.end();
  });
}

bool is_excluded(const SweepFile& file, const std::vector<std::string>& values) {
  return std::ranges::any_of(file.exclusions, [&](const SweepExclusion& exclusion) {
    return meets(file, values, exclusion.settings);
  });
}

RunConfig with_scenario(const std::string& name) {
  RunConfig config;
  config.run.scenario = name;
  config.environment.use_additional_input = true;
  return config;
}

/// Every scenario that the file names is there, said with the line that names it.
Status check_scenarios(const SweepFile& file, DescribeOnce& describe) {
  for (const SweepAxis& axis : file.axes) {
    if (axis.setting != "scenario") continue;
    for (std::size_t i = 0; i < axis.values.size(); ++i)
      if (const auto known = describe(with_scenario(axis.values[i])); !known)
        return Error{known.error().code, file.at(axis.lines[i]) + known.error().message};
  }
  for (const auto& [setting, value] : file.settings.values)
    if (setting == "scenario")
      if (const auto known = describe(with_scenario(value)); !known)
        return Error{known.error().code, file.at(file.lines.at(setting)) + known.error().message};
  return {};
}

/// What a search in steps cannot do. Errors: kBadInput.
Status check_steps(const SweepSearch& search, const RunConfig& config) {
  const std::string method = word_of(search.method);
  const double step = search.end_of_step(0, std::numeric_limits<double>::infinity());
  if (search.is_stepwise() && step >= config.run.train_for_env_frames)
    return Error{ErrorCode::kBadInput, "train_for_env_frames is " +
                                           real_text(config.run.train_for_env_frames) + ", but " + method +
                                           " decides first at " + real_text(step) + "; raise it"};
  if (search.is_stepwise() && config.optimisation.lr_schedule == RateSchedule::kLinearDecay)
    return Error{ErrorCode::kBadInput,
                 "lr_schedule is linear_decay, which would reach 0 at the end of each step of " + method +
                     "; use constant or a kl_adaptive one"};
  const bool moves_rate =
      std::ranges::find(search.space, "learning_rate", &SearchedSetting::setting) != search.space.end();
  if (search.method == SearchMethod::kPbt && moves_rate &&
      config.optimisation.lr_schedule != RateSchedule::kConstant)
    return Error{
        ErrorCode::kBadInput,
        "learning_rate is searched, but with a kl_adaptive lr_schedule a member continues at the rate "
        "of its checkpoint; "
        "set lr_schedule = \"constant\""};
  if (search.method == SearchMethod::kPbt && config.collection.deterministic)
    return Error{ErrorCode::kBadInput,
                 "deterministic cannot be had with pbt: a member continues from another one's checkpoint"};
  return {};
}

/// The settings of one run, complete, with `more` behind its axes. `config`: what they make. Errors: those of merging, and of
/// the files that the settings name.
Expected<SweepRun> make_run(const SweepFile& file, const std::vector<std::string>& values,
                            const Describe& describe, int64_t cores, RunConfig& config,
                            const SettingValues& more = {}) {
  SweepRun run;
  run.name = sweep_run_name(file.axes, values);
  run.settings = file.settings;
  for (const SweepOverride& override : file.overrides)
    if (meets(file, values, override.when))
      run.settings.values = with_settings(std::move(run.settings.values), override.values);
  for (std::size_t i = 0; i < file.axes.size(); ++i)
    run.settings.values.emplace_back(file.axes[i].setting, values[i]);
  run.settings.values = with_settings(std::move(run.settings.values), more);
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_new({"", run.settings}, describe, static_cast<int>(cores)));
  config = merged.config;
  COMRAD_TRY(check_steps(file.search, config));
  // What follows from the cores and the memory of one run, not from the host that happens to make it.
  for (const char* size : {"num_workers", "learner_threads"})
    if (merged.from.at(size) == "automatic")
      run.settings.values.emplace_back(size, setting_text(config, size));
  if (file.search.is_stepwise() && config.run.algo->learns_q_values() &&
      merged.from.at("per_beta_env_frames") == "automatic")  // of the whole run, not of its first step
    run.settings.values.emplace_back("per_beta_env_frames", setting_text(config, "per_beta_env_frames"));
  if (config.run.algo->learns_q_values() && config.replay.replay_gb == 0)
    run.settings.values.emplace_back("replay_gb", real_text(file.resources.memory_gb / 2));
  run.goal_env_frames = config.run.train_for_env_frames;
  return run;
}

/// The trials or members of a search with the settings of `base`.
std::vector<SweepRun> runs_of_search(const SweepFile& file, const SweepRun& base, int64_t seed) {
  const SweepSearch& search = file.search;
  std::vector<SweepRun> runs;
  for (int64_t number = 1; number <= search.runs; ++number) {
    SweepRun& run = runs.emplace_back(base);
    run.study = base.name.empty() ? file.name : base.name;
    run.number = number;
    char word[32];
    std::snprintf(word, sizeof word, search.has_trials() ? "trial_%03lld" : "member_%lld",
                  static_cast<long long>(number));
    run.name += (base.name.empty() ? "" : "_") + std::string(word);
    if (!search.has_trials())  // members begin with different weights
      run.settings.values = with_settings(run.settings.values, {{"seed", std::to_string(seed + number - 1)}});
  }
  return runs;
}

/// Adds to `extremes` the runs that have one searched setting at an end. Errors: those of make_run; kBadInput for a setting
/// that has no effect in any of them.
Status add_extremes(const SweepFile& file, const std::vector<std::string>& values, const Describe& describe,
                    int64_t cores, std::vector<SweepRun>& extremes) {
  std::vector<RunConfig> configs;
  for (const SearchedSetting& searched : file.search.space)
    for (const std::string& value : searched.extremes()) {
      Expected<SweepRun> run =
          make_run(file, values, describe, cores, configs.emplace_back(), {{searched.setting, value}});
      const std::string words = searched.setting + "=" + value;
      if (!run) return Error{run.error().code, "with " + words + ": " + run.error().message};
      run->name += (run->name.empty() ? "" : " ") + ("with " + words);
      if (file.search.is_stepwise())
        run->settings.values = with_settings(
            run->settings.values,
            {{"train_for_env_frames", real_text(file.search.end_of_step(0, run->goal_env_frames))}});
      extremes.push_back(*std::move(run));
    }
  for (const SearchedSetting& searched : file.search.space)
    if (const SettingRow* row = find_setting(searched.setting);
        std::ranges::none_of(configs, [&](const RunConfig& config) { return row->applies(config); }))
      return Error{ErrorCode::kBadInput,
                   searched.setting + " has no effect with these settings; take it out of the search"};
  return {};
}

/// What tensors depend on, as text: equal for networks of one size.
std::string network_key(const RunConfig& config, const EnvShape& env) {
  std::string key = config.run.algo.name();
  for (const SettingRow& row : setting_rows())
    if (row.traits.fixed_in_a_run && row.name != "scenario") key += "\n" + row.text(config);
  for (const std::string& word : shape_flags(env)) key += " " + word;
  return key;
}

}  // namespace

Status check_starts(const SweepPlan& plan, const Describe& describe,
                    const DescribeNetwork& describe_network) {
  DescribeOnce once(describe);
  std::map<std::string, Expected<NetworkSize>> sizes;
  const auto size_once = [&](const RunConfig& config, const EnvShape& env) {
    const std::string key = network_key(config, env);
    auto known = sizes.find(key);
    if (known == sizes.end()) known = sizes.emplace(key, describe_network(config, env)).first;
    return known->second;
  };
  std::vector<SweepRun> runs = plan.runs;
  runs.insert(runs.end(), plan.extremes.begin(), plan.extremes.end());
  for (const SweepRun& run : runs) {
    const std::string run_dir = plan.folder + "/" + run.name;
    const bool is_begun = find_checkpoint(run_dir, CheckpointKind::kLatest).has_value();
    COMRAD_TRY_ASSIGN(const MergedSettings merged,
                      merge_new({"", run.settings}, std::ref(once), static_cast<int>(plan.cores)));
    const auto start = check_start(merged.config, merged.scenario.env, run_dir, size_once);
    // A cluster's hosts have their own memory and disks.
    const bool is_elsewhere =
        plan.file.backend == SweepBackend::kSlurm && !start && start.error().code == ErrorCode::kNoSpace;
    if (is_elsewhere) continue;
    Status can_start = start ? Status() : Status(start.error());
    if (can_start && !is_begun) can_start = check_learning_begins(merged.config, start->replay);
    if (!can_start)
      return Error{can_start.error().code, plan.file.at(line_of(plan.file, can_start.error().message)) +
                                               run.name + " cannot run: " + can_start.error().message};
  }
  return {};
}

Status check_existing_runs(const SweepPlan& plan, const Describe& describe) {
  DescribeOnce once(describe);
  for (const SweepRun& run : plan.runs) {
    const std::string run_dir = plan.folder + "/" + run.name;
    if (!find_checkpoint(run_dir, CheckpointKind::kLatest)) continue;
    COMRAD_TRY_ASSIGN(const RunConfig config, load_run_config(run_dir + "/config.toml"));
    const auto merged =
        merge_onto_run(config, {"", run.settings}, std::ref(once), static_cast<int>(plan.cores));
    if (!merged)
      return Error{merged.error().code, plan.file.at(line_of(plan.file, merged.error().message)) + run.name +
                                            " is there already: " + merged.error().message +
                                            "; put the setting back, or give the sweep another name"};
  }
  return {};
}

std::vector<std::string> SweepRun::command(const std::string& comrad, const std::string& folder,
                                           const SettingValues& over) const {
  std::vector<std::string> words = {comrad, "train", "--train_dir", folder, "--experiment", name};
  for (const auto& [setting, value] : with_settings(settings.values, over))
    words.push_back("--" + setting + "=" + value);
  return words;
}

std::string sweep_run_name(const std::vector<SweepAxis>& axes, const std::vector<std::string>& values) {
  std::string name;
  for (std::size_t i = 0; i < axes.size(); ++i) {
    const std::string& setting = axes[i].setting;
    std::string value = values[i];
    const bool speaks_for_itself = setting == "scenario" || setting == "algo" || setting == "preset";
    if (setting == "scenario") value = fs::path(value).filename().string();
    if (value.ends_with(".0")) value.resize(value.size() - 2);  // a whole number that is real
    name += (i == 0 ? "" : "_") + (speaks_for_itself ? "" : setting) + value;
  }
  for (char& c : name)
    if (!is_word(c) && c != '.' && c != '-' && !(c >= '0' && c <= '9')) c = '-';
  return name;
}

Expected<SweepPlan> plan_sweep(const SweepFile& file, const Describe& describe, int host_cores) {
  SweepPlan plan;
  plan.file = file;
  std::error_code failed;
  plan.folder = (fs::absolute(file.train_dir, failed) / file.name).lexically_normal().string();
  if (!file.results.folder.empty())
    plan.file.results.folder = fs::absolute(file.results.folder, failed).lexically_normal().string();
  plan.cores = file.resources.cores;
  if (plan.cores == 0 && file.backend == SweepBackend::kSlurm)
    return Error{ErrorCode::kBadInput,
                 file.path + ": add [resources] cores: Slurm needs the number of cores of a run"};
  if (plan.cores == 0) plan.cores = std::max<int64_t>(1, host_cores / file.local_at_once);

  std::size_t count = 1;
  const std::size_t each = file.search.is_on() ? static_cast<std::size_t>(file.search.runs) : 1;
  for (const SweepAxis& axis : file.axes)
    if ((count *= axis.values.size()) * each > kRunsMax)
      return Error{ErrorCode::kBadInput,
                   fmt::format("{}the axes make more than {} runs; write several sweeps", file.at(axis.line),
                               kRunsMax)};
  DescribeOnce once(describe);
  COMRAD_TRY(check_scenarios(file, once));

  std::optional<Error> refused;
  std::size_t refused_count = 0;
  std::set<std::string> names;
  for (std::size_t number = 0; number < count; ++number) {
    // The last axis varies fastest, as nested loops in the order of the file would.
    std::vector<std::string> values(file.axes.size());
    std::size_t rest = number;
    for (std::size_t i = file.axes.size(); i-- > 0; rest /= file.axes[i].values.size())
      values[i] = file.axes[i].values[rest % file.axes[i].values.size()];
    if (is_excluded(file, values)) continue;
    RunConfig config;
    Expected<SweepRun> run = make_run(file, values, std::ref(once), plan.cores, config);
    Status can_run =
        run ? add_extremes(file, values, std::ref(once), plan.cores, plan.extremes) : Status(run.error());
    if (!can_run) {
      const std::string& why = can_run.error().message;
      const std::string name = run ? run->name : sweep_run_name(file.axes, values);
      if (++refused_count == 1)
        refused = Error{can_run.error().code, file.at(line_of(file, why)) +
                                                  (name.empty() ? std::string("a run") : name) +
                                                  " cannot run: " + why};
      continue;
    }
    std::vector<SweepRun> runs = {*std::move(run)};
    if (file.search.is_on()) runs = runs_of_search(file, runs.front(), config.run.seed);
    const std::string& name = runs.front().name;
    if (!names.insert(name).second)
      return Error{ErrorCode::kBadInput, file.at(first_line(file)) + "two runs would be called " + name +
                                             "; their values differ only in signs or folders"};
    if (name.size() > 200 || name[0] == '.')
      return Error{ErrorCode::kBadInput, file.at(first_line(file)) + "a run would be called " + name +
                                             ": at most 200 letters, not first '.'"};
    plan.runs.insert(plan.runs.end(), runs.begin(), runs.end());
  }
  if (refused) {
    if (refused_count > 1)
      refused->message += fmt::format(" (and {} more runs; [[exclude]] leaves some out)", refused_count - 1);
    return *refused;
  }
  if (plan.runs.empty())
    return Error{ErrorCode::kBadInput,
                 file.at(file.exclusions.front().line) + "[[exclude]] leaves no run at all"};
  return plan;
}

}  // namespace comrad::deploy
