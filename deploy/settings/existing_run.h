// Finds a run that users name by its folder or by its experiment name, and the checkpoint in it that counts.
#pragma once

#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/words.h"

namespace comrad::deploy {

/// The run directory called `name`: a path that holds config.toml, or an experiment below `train_dir`.
/// Errors: kNotFound naming the nearest experiment.
Expected<std::string> find_run(const std::string& name, const std::string& train_dir);

/// The latest checkpoint (highest version) or the best (highest score) in a run directory.
/// Errors: kNotFound saying what there is.
Expected<std::string> find_checkpoint(const std::string& run_dir, CheckpointKind kind);

}  // namespace comrad::deploy
