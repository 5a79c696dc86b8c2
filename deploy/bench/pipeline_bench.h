// The whole pipeline for some seconds, in a temporary run: what `comrad bench train` and `comrad tune` measure with.
#pragma once

#include <string>
#include <vector>

#include "deploy/launch/supervisor.h"
#include "deploy/settings/merged_settings.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad::deploy {

struct PipelineBench {
  double seconds = 20, warmup_seconds = 5;  ///< both after the first update
  std::vector<std::string> notes = {};      ///< printed at the start
  bool shows_progress = true;
};

/// Settings under which a run neither ends nor saves by itself, above the built-in ones.
SettingsLayer endless_settings();

/// Trains in a temporary folder and measures. RunOutcome::measured.seconds is above 0.
/// Errors: those of TemporaryRun::create() and run(); kSystem where it was interrupted; kPeerLost where nothing was measured.
Expected<RunOutcome> bench_pipeline(MergedSettings merged, const PipelineBench& bench);

}  // namespace comrad::deploy
