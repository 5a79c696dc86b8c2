// `comrad train`: merges the settings, makes or resumes the run directory, makes the map once, and hands the
// plan to the supervisor. Everything that can be refused is refused before the run directory is touched.

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
#include "rollout_buffer/link/link_address.h"
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
  return scenario_file_name(config) + "_" + upper_case(config.run.algo->name) + "_s" +
         std::to_string(config.run.seed) + "_" + date + (job != nullptr ? std::string("_j") + job : "");
}

using AskedFor = std::vector<std::pair<std::string, std::string>>;

/// What [asked_for] in a run's config.toml holds from now on: of an earlier start (`before`) what nobody changed since, and
/// what this one worked out.
AskedFor asked_for(const AskedFor& before, const MergedSettings& merged, const RunConfig& asked) {
  std::map<std::string, std::string> all(before.begin(), before.end());
  for (const auto& [name, from] : merged.from)
    if (from == "command line" || from == "file") all.erase(name);
  for (const auto& [name, text] : merged.asked_for) all[name] = text;
  const RunConfig built_in;
  for (const char* name : {"experiment", "restart_behavior"}) all[name] = setting_text(built_in, name);
  if (asked.run.train_dir == built_in.run.train_dir) all["train_dir"] = built_in.run.train_dir;
  if (is_generated_layout(merged.config)) all["wad"] = "";
  AskedFor in_order;
  for (const SettingRow& row : setting_rows())
    if (const auto found = all.find(std::string(row.name)); found != all.end()) in_order.push_back(*found);
  return in_order;
}

/// The settings of a run that will live in `run_dir`, where an earlier one may lie.
Expected<MergedSettings> settings_for(const std::string& run_dir, bool resumes, const UserSettings& user) {
  const int core_count = usable_cores();
  if (!resumes) return merge_new(user, describe_scenario, core_count);
  COMRAD_TRY_ASSIGN(const RunConfig run, load_run_config(run_dir + "/config.toml"));
  COMRAD_TRY_ASSIGN(MergedSettings merged, merge_onto_run(run, user, describe_scenario, core_count));
  if (run.environment.layout_pool.empty() != merged.config.environment.layout_pool.empty())
    return Error{
        ErrorCode::kBadInput,
        "--layout_pool=" + merged.config.environment.layout_pool + ": the run was made " +
            (run.environment.layout_pool.empty() ? "without a pool" : "with " + run.environment.layout_pool) +
            "; leave it out, or start anew with another --experiment or --restart_behavior=restart"};
  forget_stale_layout(run, merged.config);
  return merged;
}

Expected<int> train(const CommandLine& line, bool allow_no_update, const std::string& key_folder) {
  const UserSettings user{line.config_file(), line.typed()};
  RunConfig asked;  // only what says where the run lies is read from here
  COMRAD_TRY_ASSIGN(const SettingsLayer file, file_layer(user));
  COMRAD_TRY(apply_layer(asked, file));
  COMRAD_TRY(apply_layer(asked, user.typed));
  std::error_code error;
  const std::string train_dir = fs::absolute(asked.run.train_dir, error).lexically_normal().string();
  const bool is_named = !asked.run.experiment.empty();
  const std::string experiment = is_named ? asked.run.experiment : automatic_name(asked);
  const std::string run_dir = (fs::path(train_dir) / experiment).string();

  const bool exists = is_named && asked.run.restart_behavior == RestartBehavior::kResume &&
                      fs::exists(run_dir + "/config.toml", error);
  // A run that never saved has nothing to go on from; it may have been refused for the settings in
  // its config.toml.
  const bool resumes = exists && find_checkpoint(run_dir, CheckpointKind::kLatest).has_value();
  COMRAD_TRY_ASSIGN(MergedSettings merged, settings_for(run_dir, resumes, user));
  print_warnings(merged.scenario);
  RunConfig& config = merged.config;
  config.run.train_dir = train_dir;
  config.run.experiment = experiment;
  config.run.restart_behavior = asked.run.restart_behavior;
  COMRAD_TRY(check_metrics_port(config.run.metrics_port));
  COMRAD_TRY_ASSIGN(const std::string iwad, find_iwad());
  std::string keys =
      key_folder.empty() ? link::kept_keys(run_dir) : fs::absolute(key_folder).lexically_normal().string();
  COMRAD_TRY(prepare_serving(config, keys));
  COMRAD_TRY_ASSIGN(const StartCheck start, check_start(config, merged.scenario.env, run_dir));
  if (!resumes && !allow_no_update) COMRAD_TRY(check_learning_begins(config, start.replay));
  if (!config.curriculum.interestingness_graph_path.empty())
    config.curriculum.interestingness_graph_path =
        fs::absolute(config.curriculum.interestingness_graph_path, error).lexically_normal().string();
  std::string layout_list;
  if (!config.environment.layout_pool.empty() && !is_pool_to_draw(config.environment.layout_pool)) {
    config.environment.layout_pool =
        fs::absolute(config.environment.layout_pool, error).lexically_normal().string();
    if (!is_pool_to_make(config.environment.layout_pool)) {
      COMRAD_TRY_ASSIGN(layout_list, ensure_layout_pool(config, "", /*for_training=*/true));
    } else if (!resumes) {
      COMRAD_TRY(check_wad(config.environment.layout_pool));
    }
  }
  COMRAD_TRY(check_layout(config));

  SettingsLayer before;  // the run's config.toml as it was
  if (resumes) {
    COMRAD_TRY_ASSIGN(before, read_settings_toml(run_dir + "/config.toml"));
  }
  COMRAD_TRY_ASSIGN(const RunDirectory directory,
                    is_named ? RunDirectory::open(train_dir, experiment, config.run.restart_behavior)
                             : RunDirectory::open_new(train_dir, experiment));
  config.run.experiment = fs::path(directory.path()).filename().string();
  if (directory.is_resumed() != exists)
    return Error{ErrorCode::kBadInput, run_dir + ": another run was made here just now; start again"};
  std::fprintf(stderr, "%s %s\n",
               resumes ? "Resuming the run in" : "Run directory:", directory.path().c_str());
  if (config.environment.layout_pool.empty()) {
    COMRAD_TRY_ASSIGN(config.environment.wad, ensure_layout(config, directory.path() + "/layouts"));
  } else {
    if (layout_list.empty()) {
      COMRAD_TRY_ASSIGN(layout_list,
                        ensure_layout_pool(config, directory.path() + "/layouts", /*for_training=*/true));
    }
    COMRAD_TRY(write_layout_list(directory.path(), layout_list));
  }
  if (config.run.eval_every_env_frames > 0 && config.run.eval_maps == EvalMaps::kHeldOut) {
    // Once, and before the run needs all cores.
    RunConfig evaluated = config;
    evaluated.environment.layout_pool = kHeldOutPool;
    COMRAD_TRY_ASSIGN(const std::string list, ensure_layout_pool(evaluated, directory.path() + "/layouts",
                                                                 /*for_training=*/false));
    COMRAD_TRY(write_layout_list(directory.path(), list, kHeldOutListFile));
  }
  COMRAD_TRY(directory.write_config(config, asked_for(before.asked_for, merged, asked)));

  std::string address;
  if (config.hosts.serve) {
    COMRAD_TRY(link::keep_keys(directory.path(), keys));
    COMRAD_TRY_ASSIGN(address, open_door(directory.path(), config, iwad));
  }

  LaunchPlan plan;
  if (!address.empty()) std::fprintf(stderr, "%s\n", door_note(address, config).c_str());
  plan.notes = flags_without_effect(config, user.typed);
  if (resumes) {
    RunConfig last;
    COMRAD_TRY(apply_layer(last, before));
    if (std::string changes = changes_text(last, config); !changes.empty())
      plan.notes.push_back(std::move(changes));
  }
  if (std::string left_out = left_out_text(file); !left_out.empty())
    plan.notes.push_back(std::move(left_out));
  plan.hosts = host_calls(config, environment_variable, sibling_program("comrad"));
  plan.simulators_join = config.hosts.link == LinkKind::kDds;
  if (plan.simulators_join)
    plan.hosts.push_back(own_simulators(config, directory.path(), sibling_program("comrad")));
  plan.door_address = address;
  plan.config = config;
  plan.env = merged.scenario.env;
  plan.network = start.network;
  plan.decision_limit = merged.scenario.decision_limit;
  plan.run_dir = directory.path();
  plan.lock_descriptor = directory.lock_descriptor();
  COMRAD_TRY_ASSIGN(const RunOutcome outcome, deploy::run(plan));
  // As all that a run says: a terminal that stands still must not keep it.
  std::string last = outcome.message;
  if (outcome.exit_code == kExitDone && find_checkpoint(plan.run_dir, CheckpointKind::kLatest))
    last += "\n" + next_commands(plan.run_dir);
  if (!last.empty()) ProgressPrinter(STDERR_FILENO, /*show=*/true).note(last);
  return outcome.exit_code;
}

}  // namespace

int train_command(Arguments arguments) {
  CommandLine line(
      "train --scenario NAME [--algo NAME] [--seed N] [settings]",
      "Trains agents: simulators, policy workers and the learner run as processes of their own until\n"
      "--train_for_env_frames env frames are learned from. Ctrl-C saves a checkpoint and stops. The run "
      "lies\n"
      "in <train_dir>/<experiment>; the same command with the same --experiment goes on where it stopped.");
  bool allow_no_update = false;
  line.add_switch("allow_no_update", allow_no_update,
                  "start even where the run would end before the replay is filled and learning begins");
  std::string key_folder;
  line.add_option("keys", key_folder, "FOLDER",
                  "with --serve: the run's keys, which `comrad keys` made, for a network");
  line.add_settings();
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("train", parsed.error());
  if (line.help_requested()) return print_settings_help("train", line);
  const Expected<int> done = train(line, allow_no_update, key_folder);
  return done ? *done : report_error("train", done.error());
}

}  // namespace comrad::deploy
