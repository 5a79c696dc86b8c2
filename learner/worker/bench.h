// How fast the learner alone is: synthetic slabs, collated and trained on in this process. Stage: update.
#pragma once

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// Trains for about `seconds` after one update of warm-up and prints one JSON object on stdout.
/// Errors: kBadInput (settings), kUnsupported (device).
Status run_bench(const RunConfig& config, const EnvShape& env, double seconds);

}  // namespace comrad::learn
