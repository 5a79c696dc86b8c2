// `comrad train`: merges the settings, makes or resumes the run directory, makes the map once, and hands the
// plan to the supervisor. Everything that can be refused is refused before the run directory is touched.

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <filesystem>

#include "deploy/commands/command.h"
#include "deploy/launch/progress.h"
#include "deploy/launch/run_directory.h"
#include "deploy/launch/supervisor.h"
#include "deploy/settings/command_line.h"
#include "deploy/settings/existing_run.h"
#include "deploy/settings/game_files.h"
#include "deploy/settings/merged_settings.h"
#include "deploy/settings/network_description.h"
#include "rollout_buffer/core/cores.h"
#include "rollout_buffer/core/text.h"
#include "rollout_buffer/settings/layers.h"

namespace comrad::deploy {
namespace {

namespace fs = std::filesystem;

/// <scenario>_<ALGO>_<YYYYMMDD_HHMMSS>[_j<Slurm job>], as Sample Factory users know it.
std::string automatic_name(const RunConfig& config) {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  localtime_r(&now, &local);
  char date[32];
  std::strftime(date, sizeof(date), "%Y%m%d_%H%M%S", &local);
  const char* job = std::getenv("SLURM_JOB_ID");
  return scenario_file_name(config) + "_" + upper_case(config.run.algo->name) + "_" + date +
         (job != nullptr ? std::string("_j") + job : "");
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

Expected<int> train(const CommandLine& line) {
  const UserSettings user{line.config_file(), line.typed()};
  RunConfig asked;  // only what says where the run lies is read from here
  if (!user.config_file.empty()) {
    COMRAD_TRY_ASSIGN(const SettingsLayer file, read_settings_toml(user.config_file));
    COMRAD_TRY(apply_layer(asked, file));
  }
  COMRAD_TRY(apply_layer(asked, user.typed));
  std::error_code error;
  const std::string train_dir = fs::absolute(asked.run.train_dir, error).lexically_normal().string();
  const std::string experiment = asked.run.experiment.empty() ? automatic_name(asked) : asked.run.experiment;
  const std::string run_dir = (fs::path(train_dir) / experiment).string();

  const bool exists =
      asked.run.restart_behavior == RestartBehavior::kResume && fs::exists(run_dir + "/config.toml", error);
  // A run that never saved has nothing to go on from; it may have been refused for the settings in
  // its config.toml.
  const bool resumes = exists && find_checkpoint(run_dir, CheckpointKind::kLatest).has_value();
  COMRAD_TRY_ASSIGN(MergedSettings merged, settings_for(run_dir, resumes, user));
  print_warnings(merged.scenario);
  RunConfig& config = merged.config;
  config.run.train_dir = train_dir;
  config.run.experiment = experiment;
  config.run.restart_behavior = asked.run.restart_behavior;
  COMRAD_TRY(find_iwad());
  if (!config.environment.wad.empty()) COMRAD_TRY(check_wad(config.environment.wad));
  if (!config.curriculum.interestingness_graph_path.empty()) {
    if (!fs::is_regular_file(config.curriculum.interestingness_graph_path, error))
      return Error{ErrorCode::kNotFound, "interestingness_graph_path is " +
                                             config.curriculum.interestingness_graph_path +
                                             ", which is no file"};
    config.curriculum.interestingness_graph_path =
        fs::absolute(config.curriculum.interestingness_graph_path, error).lexically_normal().string();
  }
  COMRAD_TRY(check_pool_to_draw(config.environment.layout_pool, /*for_training=*/true));
  std::string layout_list;
  if (!config.environment.layout_pool.empty() && !is_pool_to_draw(config.environment.layout_pool)) {
    config.environment.layout_pool =
        fs::absolute(config.environment.layout_pool, error).lexically_normal().string();
    COMRAD_TRY_ASSIGN(layout_list, ensure_layout_pool(config, "", /*for_training=*/true));
  }

  // Before anything is written: an encoder that is not known is refused here.
  COMRAD_TRY_ASSIGN(const NetworkSize network, describe_network(config, merged.scenario.env));
  COMRAD_TRY_ASSIGN(const RunDirectory directory,
                    RunDirectory::open(train_dir, experiment, config.run.restart_behavior));
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
  COMRAD_TRY(directory.write_config(config));

  LaunchPlan plan;
  plan.config = config;
  plan.env = merged.scenario.env;
  plan.network = network;
  plan.decision_limit = merged.scenario.decision_limit;
  plan.run_dir = directory.path();
  plan.lock_descriptor = directory.lock_descriptor();
  COMRAD_TRY_ASSIGN(const RunOutcome outcome, deploy::run(plan));
  // As all that a run says: a terminal that stands still must not keep it.
  if (!outcome.message.empty()) ProgressPrinter(STDERR_FILENO, /*show=*/true).note(outcome.message);
  return outcome.exit_code;
}

}  // namespace

int train_command(Arguments arguments) {
  CommandLine line(
      "train --scenario NAME [--algo NAME] [--seed N] [settings]",
      "Trains agents: simulators, policy workers and the learner run as processes of their own until\n"
      "--train_for_env_steps env frames are learned from. Ctrl-C saves a checkpoint and stops. The run lies\n"
      "in <train_dir>/<experiment>; the same command with the same --experiment goes on where it stopped.");
  line.add_settings();
  if (const Status parsed = line.parse(arguments); !parsed) return report_error("train", parsed.error());
  if (line.help_requested()) {
    std::fputs(line.help().c_str(), stdout);
    return kExitDone;
  }
  const Expected<int> done = train(line);
  return done ? *done : report_error("train", done.error());
}

}  // namespace comrad::deploy
