// `comrad train`: merges the settings, makes or resumes the run directory, makes the map once, and hands the
// plan to the supervisor. Everything that can be refused is refused before the run directory is touched.

#include <spdlog/fmt/fmt.h>

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <map>
#include <utility>
#include <vector>

#include "deploy/hosts/host_calls.h"
#include "deploy/hosts/serving.h"
#include "deploy/launch/evaluator.h"
#include "deploy/launch/metrics_page.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/supervisor.h"
#include "deploy/process/child_program.h"
#include "deploy/run/command.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/existing_run.h"
#include "deploy/settings/game_files.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/start_check.h"
#include "deploy/settings/start_notes.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/link/join/link_address.h"
#include "rollout_buffer/settings/layers.h"
#include "rollout_buffer/settings/setting.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

/// <scenario>_<ALGO>_s<seed>_<YYYYMMDD_HHMMSS>[_j<Slurm job>]. RunDirectory::open_new() adds a number where it is taken.
std::string automatic_name(const RunConfig& config) {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char date[32];
  std::strftime(date, sizeof(date), "%Y%m%d_%H%M%S", &local);
  const char* job = std::getenv("SLURM_JOB_ID");
  return fmt::format("{}_{}_s{}_{}{}", scenario_file_name(config), upper_case(config.run.algo->name),
                     config.run.seed, date, (job != nullptr ? std::string("_j") + job : ""));
}

using ExplicitValues = std::vector<std::pair<std::string, std::string>>;

/// A start of which everything that can be refused was checked, and nothing is written yet.
struct StartPlan {
  UserSettings user;
  SettingsLayer file;  ///< of the user
  RunPlace place;
  MergedSettings merged;
  bool exists = false;   ///< an earlier run's config.toml lies in the directory, to continue from
  bool resumes = false;  ///< and a checkpoint
  SettingsLayer before;  ///< that config.toml; empty unless the run resumes
  std::string iwad;
  std::string keys;         ///< folder of the keys of a run that serves or publishes
  std::string layout_list;  ///< of the run's pool, once it is there
  StartCheck start;

  std::string run_dir() const { return (fs::path(place.train_dir) / merged.config.run.experiment).string(); }
};

/// What [explicit] in a run's config.toml holds from now on: of an earlier start what was not changed since, and what this
/// one worked out.
ExplicitValues explicit_values(const StartPlan& plan) {
  const MergedSettings& merged = plan.merged;
  std::map<std::string, std::string> all(plan.before.explicit_values.begin(),
                                         plan.before.explicit_values.end());
  for (const auto& [name, from] : merged.from)
    if (from == "command line" || from == "file") all.erase(name);
  for (const auto& [name, text] : merged.explicit_values) all[name] = text;
  const RunConfig built_in;
  for (const char* name : {"experiment", "restart_behavior"}) all[name] = setting_text(built_in, name);
  if (plan.place.is_default_train_dir) all["train_dir"] = built_in.run.train_dir;
  if (is_generated_layout(merged.config)) all["wad"] = "";
  ExplicitValues in_order;
  for (const SettingRow& row : setting_rows())
    if (const auto found = all.find(std::string(row.name)); found != all.end()) in_order.push_back(*found);
  return in_order;
}

/// The settings of a run that continues in `run_dir`.
Expected<MergedSettings> settings_of_resumed(const std::string& run_dir, const UserSettings& user) {
  COMRAD_TRY_ASSIGN(const RunConfig run, load_run_config(run_dir + "/config.toml"));
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_onto_run(run, user, describe_scenario, usable_cores()));
  if (run.environment.layout_pool.empty() != merged.config.environment.layout_pool.empty())
    return Error{
        ErrorCode::kBadInput,
        "--layout_pool=" + merged.config.environment.layout_pool + ": the run was made " +
            (run.environment.layout_pool.empty() ? "without a pool" : "with " + run.environment.layout_pool) +
            "; leave it out, or start anew with another --experiment or --restart_behavior=restart"};
  forget_stale_layout(run, merged.config);
  return merged;
}

std::string absolute(const std::string& path) {
  std::error_code ignored;
  return fs::absolute(path, ignored).lexically_normal().string();
}

/// Whole paths for the files of maps, which are checked as far as they are there.
Status check_maps(StartPlan& plan) {
  RunConfig& config = plan.merged.config;
  if (std::string& graph = config.curriculum.interestingness_graph_path; !graph.empty())
    graph = absolute(graph);
  if (std::string& pool = config.environment.layout_pool; !pool.empty() && !is_pool_to_draw(pool)) {
    pool = absolute(pool);
    if (!is_pool_to_make(pool)) {
      COMRAD_TRY_ASSIGN(plan.layout_list, ensure_layout_pool(config, "", /*for_training=*/true));
    } else if (!plan.resumes) {
      COMRAD_TRY(check_wad(pool));
    }
  }
  return check_layout(config);
}

Expected<StartPlan> plan_start(const UserSettings& user, bool allow_no_update,
                               const std::string& key_folder) {
  StartPlan plan;
  plan.user = user;
  COMRAD_TRY_ASSIGN(plan.file, file_layer(user));
  COMRAD_TRY_ASSIGN(plan.place, place_of_run(plan.file, user.typed));
  const std::string& name = plan.place.experiment;
  const std::string named_dir = (fs::path(plan.place.train_dir) / name).string();
  std::error_code error;
  plan.exists = !name.empty() && plan.place.restart_behavior == RestartBehavior::kResume &&
                fs::exists(named_dir + "/config.toml", error);
  // A run that never saved has nothing to continue from; it may have been refused for the settings in its config.toml.
  plan.resumes = plan.exists && find_checkpoint(named_dir, CheckpointKind::kLatest).has_value();
  if (plan.resumes) {
    COMRAD_TRY_ASSIGN(plan.merged, settings_of_resumed(named_dir, user));
    COMRAD_TRY_ASSIGN(plan.before, read_settings_toml(named_dir + "/config.toml"));
  } else {
    COMRAD_TRY_ASSIGN(plan.merged, merge_new(user, describe_scenario, usable_cores()));
  }
  print_warnings(plan.merged.scenario);
  RunConfig& config = plan.merged.config;
  config.run.train_dir = plan.place.train_dir;
  config.run.experiment = name.empty() ? automatic_name(config) : name;
  config.run.restart_behavior = plan.place.restart_behavior;
  COMRAD_TRY(check_metrics_port(config.run.metrics_port));
  COMRAD_TRY_ASSIGN(plan.iwad, find_iwad());
  plan.keys = key_folder.empty() ? link::kept_keys(plan.run_dir()) : absolute(key_folder);
  COMRAD_TRY(prepare_serving(config, plan.keys));
  COMRAD_TRY_ASSIGN(plan.start, check_start(config, plan.merged.scenario.env, plan.run_dir()));
  if (!plan.resumes && !allow_no_update) COMRAD_TRY(check_learning_begins(config, plan.start.replay));
  COMRAD_TRY(check_maps(plan));
  return plan;
}

/// The run's directory, which then names the run.
Expected<RunDirectory> claim_directory(StartPlan& plan) {
  RunConfig& config = plan.merged.config;
  const std::string run_dir = plan.run_dir();
  COMRAD_TRY_ASSIGN(
      RunDirectory directory,
      plan.place.experiment.empty()
          ? RunDirectory::open_new(plan.place.train_dir, config.run.experiment)
          : RunDirectory::open(plan.place.train_dir, config.run.experiment, config.run.restart_behavior));
  config.run.experiment = fs::path(directory.path()).filename().string();
  if (directory.is_resumed() != plan.exists)
    return Error{ErrorCode::kBadInput, run_dir + ": another run was made here just now; start again"};
  std::fprintf(stderr, "%s %s\n",
               plan.resumes ? "Resuming the run in" : "Run directory:", directory.path().c_str());
  return directory;
}

/// The run's map or pool, and the pool that it is evaluated on.
Status make_maps(StartPlan& plan, const std::string& run_dir) {
  RunConfig& config = plan.merged.config;
  const std::string folder = run_dir + "/layouts";
  if (config.environment.layout_pool.empty()) {
    COMRAD_TRY_ASSIGN(config.environment.wad, ensure_layout(config, folder));
  } else {
    if (plan.layout_list.empty()) {
      COMRAD_TRY_ASSIGN(plan.layout_list, ensure_layout_pool(config, folder, /*for_training=*/true));
    }
    COMRAD_TRY(write_layout_list(run_dir, plan.layout_list));
  }
  if (!is_played_beside(config.run) || config.run.eval_maps != EvalMaps::kHeldOut) return {};
  // Once, and before the run needs all cores.
  RunConfig evaluated = config;
  evaluated.environment.layout_pool = kHeldOutPool;
  COMRAD_TRY_ASSIGN(const std::string list, ensure_layout_pool(evaluated, folder, /*for_training=*/false));
  return write_layout_list(run_dir, list, kHeldOutListFile);
}

/// What the user hears of the settings.
Expected<std::vector<std::string>> notes_of(const StartPlan& plan) {
  const RunConfig& config = plan.merged.config;
  std::vector<std::string> notes = flags_without_effect(config, plan.user.typed);
  if (plan.resumes) {
    RunConfig last;
    COMRAD_TRY(apply_layer(last, plan.before));
    if (std::string changes = changes_text(last, config); !changes.empty())
      notes.push_back(std::move(changes));
  }
  if (std::string left_out = left_out_text(plan.file); !left_out.empty())
    notes.push_back(std::move(left_out));
  return notes;
}

/// Runs until the run is over. Gives the exit code.
Expected<int> launch(const StartPlan& start, const RunDirectory& directory) {
  const RunConfig& config = start.merged.config;
  const std::string run_dir = directory.path();
  LaunchPlan plan;
  if (config.hosts.serve || config.hosts.publish) {
    COMRAD_TRY(link::keep_keys(run_dir, start.keys));
    COMRAD_TRY_ASSIGN(plan.join_address, open_join_endpoint(run_dir, config, start.iwad));
    std::fprintf(stderr, "%s\n", join_note(plan.join_address, config).c_str());
  }
  COMRAD_TRY_ASSIGN(plan.notes, notes_of(start));
  plan.hosts = host_calls(config, environment_variable, sibling_program("comrad"));
  plan.simulators_join = config.hosts.link == LinkKind::kDds;
  if (plan.simulators_join) plan.hosts.push_back(own_simulators(config, run_dir, sibling_program("comrad")));
  plan.config = config;
  plan.env = start.merged.scenario.env;
  plan.network = start.start.network;
  plan.decision_limit = start.merged.scenario.decision_limit;
  plan.run_dir = run_dir;
  plan.lock_descriptor = directory.lock_descriptor();
  COMRAD_TRY_ASSIGN(const RunOutcome outcome, deploy::run(plan));
  // Like all run output: a blocked terminal must not block the run.
  std::string last = outcome.message;
  if (outcome.exit_code == kExitDone && find_checkpoint(run_dir, CheckpointKind::kLatest))
    last += "\n" + next_commands(run_dir);
  if (!last.empty()) ProgressPrinter(STDERR_FILENO, /*show=*/true).note(last);
  return outcome.exit_code;
}

Expected<int> train(const UserSettings& user, bool allow_no_update, const std::string& key_folder) {
  COMRAD_TRY_ASSIGN(StartPlan plan, plan_start(user, allow_no_update, key_folder));
  COMRAD_TRY_ASSIGN(const RunDirectory directory, claim_directory(plan));
  COMRAD_TRY(make_maps(plan, directory.path()));
  COMRAD_TRY(directory.write_config(plan.merged.config, explicit_values(plan)));
  return launch(plan, directory);
}

}  // namespace

int train_command(Arguments arguments) {
  CommandLine line(
      "train --scenario NAME [--algo NAME] [--seed N] [settings]",
      "Trains agents: simulators, policy workers and the learner run as their own processes until\n"
      "--train_for_env_frames env frames are learned from. Ctrl-C saves a checkpoint and stops. The run "
      "lies\n"
      "in <train_dir>/<experiment>; the same command with the same --experiment continues where it stopped.");
  bool allow_no_update = false;
  line.add_switch("allow_no_update", allow_no_update,
                  "start even where the run would end before the replay is filled and learning begins");
  std::string key_folder;
  line.add_option("keys", key_folder, "FOLDER",
                  "with --serve or --publish: the run's keys, which `comrad keys` made, for a network");
  line.add_settings();
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("train", parsed.error());
  if (line.help_requested()) return print_settings_help("train", line);
  const Expected<int> done = train({line.config_file(), line.typed()}, allow_no_update, key_folder);
  return done ? *done : report_error("train", done.error());
}

}  // namespace comrad::deploy
