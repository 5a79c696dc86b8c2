#include "deploy/bench/pipeline_bench.h"

#include <filesystem>

#include "deploy/settings/network_description.h"
#include "deploy/settings/temporary_run.h"
#include "rollout_buffer/core/stage_clock.h"

namespace comrad::deploy {

SettingsLayer endless_settings() {
  return {"bench",
          {{"train_for_env_frames", "1e15"},
           {"save_every_sec", "1e9"},
           {"save_best_after_env_frames", "1e15"},
           {"learning_starts_decisions", "4096"}}};
}

Expected<RunOutcome> bench_pipeline(MergedSettings merged, const PipelineBench& bench) {
  COMRAD_TRY_ASSIGN(const TemporaryRun folder, TemporaryRun::create(merged.config));
  // Its workers count what their stages cost there (core/stage_clock.h).
  std::error_code failure;
  if (!std::filesystem::create_directory(folder.path() + "/" + kStagesFolder, failure))
    return Error{ErrorCode::kSystem, "cannot make a folder in " + folder.path() + ": " + failure.message()};
  LaunchPlan plan;
  plan.config = merged.config;
  plan.env = merged.scenario.env;
  COMRAD_TRY_ASSIGN(plan.network, describe_network(merged.config, plan.env));
  plan.decision_limit = merged.scenario.decision_limit;
  plan.run_dir = folder.path();
  plan.seconds = bench.seconds;
  plan.warmup_seconds = bench.warmup_seconds;
  plan.notes = bench.notes;
  plan.show_progress = bench.shows_progress;
  COMRAD_TRY_ASSIGN(RunOutcome outcome, deploy::run(plan));
  // A learner that was in a long update when the window ended may leave without a checkpoint, which a bench needs not.
  if (outcome.measured.seconds <= 0 && outcome.reason != StopReason::kFinished)
    return Error{ErrorCode::kSystem, "interrupted"};
  if (outcome.measured.seconds <= 0)
    return Error{ErrorCode::kPeerLost, outcome.message.empty() ? "nothing was measured" : outcome.message};
  return outcome;
}

}  // namespace comrad::deploy
