#include "deploy/sweep/sweep_plan.h"

#include <algorithm>
#include <filesystem>
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

/// Asks once about every scenario, team size, input and heads: hundreds of runs share a few.
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

/// The line of the setting that `message` speaks of first; that of the first axis where it names none.
int line_of(const SweepFile& file, const std::string& message) {
  int line = file.axes.front().line;
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

bool is_excluded(const SweepFile& file, const std::vector<std::string>& values) {
  return std::ranges::any_of(file.exclusions, [&](const SweepExclusion& exclusion) {
    return std::ranges::all_of(exclusion.settings, [&](const SweepAxis& excluded) {
      const auto axis = std::ranges::find(file.axes, excluded.setting, &SweepAxis::setting);
      const std::string& value = values[static_cast<std::size_t>(axis - file.axes.begin())];
      return std::ranges::find(excluded.values, value) != excluded.values.end();
    });
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

/// The settings of one run, complete. Errors: those of merging, and of the files that the settings name.
Expected<SweepRun> make_run(const SweepFile& file, const std::vector<std::string>& values,
                            const Describe& describe, int64_t cores) {
  SweepRun run;
  run.name = sweep_run_name(file.axes, values);
  run.settings = file.settings;
  for (std::size_t i = 0; i < file.axes.size(); ++i)
    run.settings.values.emplace_back(file.axes[i].setting, values[i]);
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_new({"", run.settings}, describe, static_cast<int>(cores)));
  const RunConfig& config = merged.config;
  // What follows from the cores and the memory of one run, not from the host that happens to make it.
  for (const char* size : {"num_workers", "learner_threads"})
    if (merged.from.at(size) == "automatic")
      run.settings.values.emplace_back(size, setting_text(config, size));
  if (config.run.algo->learns_q_values() && config.replay.replay_gb == 0)
    run.settings.values.emplace_back("replay_gb", real_text(file.resources.memory_gb / 2));
  run.goal_env_frames = config.run.train_for_env_frames;
  return run;
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
  for (const SweepRun& run : plan.runs) {
    const std::string run_dir = plan.folder + "/" + run.name;
    const bool is_begun = find_checkpoint(run_dir, CheckpointKind::kLatest).has_value();
    COMRAD_TRY_ASSIGN(const MergedSettings merged,
                      merge_new({"", run.settings}, std::ref(once), static_cast<int>(plan.cores)));
    const auto start = check_start(merged.config, merged.scenario.env, run_dir, size_once);
    // A cluster's hosts have memory and disks of their own.
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

std::vector<std::string> SweepRun::command(const std::string& comrad, const std::string& folder) const {
  std::vector<std::string> words = {comrad, "train", "--train_dir", folder, "--experiment", name};
  for (const auto& [setting, value] : settings.values) words.push_back("--" + setting + "=" + value);
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
                 file.path + ": add [resources] cores, for Slurm must be told how many a run gets"};
  if (plan.cores == 0) plan.cores = std::max<int64_t>(1, host_cores / file.local_at_once);

  std::size_t count = 1;
  for (const SweepAxis& axis : file.axes)
    if ((count *= axis.values.size()) > kRunsMax)
      return Error{ErrorCode::kBadInput, file.at(axis.line) + "the axes make more than " +
                                             std::to_string(kRunsMax) + " runs; write several sweeps"};
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
    Expected<SweepRun> run = make_run(file, values, std::ref(once), plan.cores);
    if (!run) {
      const std::string& why = run.error().message;
      if (++refused_count == 1)
        refused = Error{run.error().code, file.at(line_of(file, why)) + sweep_run_name(file.axes, values) +
                                              " cannot run: " + why};
      continue;
    }
    if (!names.insert(run->name).second)
      return Error{ErrorCode::kBadInput, file.at(file.axes.front().line) + "two runs would be called " +
                                             run->name + "; their values differ only in signs or folders"};
    if (run->name.size() > 200 || run->name[0] == '.')
      return Error{ErrorCode::kBadInput, file.at(file.axes.front().line) + "a run would be called " +
                                             run->name + ": at most 200 letters, not first '.'"};
    plan.runs.push_back(*std::move(run));
  }
  if (refused) {
    if (refused_count > 1)
      refused->message +=
          " (and " + std::to_string(refused_count - 1) + " more runs; [[exclude]] leaves some out)";
    return *refused;
  }
  if (plan.runs.empty())
    return Error{ErrorCode::kBadInput,
                 file.at(file.exclusions.front().line) + "[[exclude]] leaves no run at all"};
  return plan;
}

}  // namespace comrad::deploy
