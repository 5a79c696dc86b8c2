// How a minibatch is cut into micro-batches, and how many of them are computed at a time. Stage: update.
#pragma once

#include <torch/types.h>

#include <cstdint>

#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// Samples of one micro-batch, as `micro_batch_size` describes; 0 stands for what suits the device: a CPU's caches, or a GPU, which is
/// started as often for few samples as for many.
int64_t samples_of_part(const RunConfig& config, torch::Device device);

/// How many micro-batches of a run's learner are computed at a time: learner_threads of them, fewer where
/// their activations would take too much memory. One on a GPU, which is busy with one micro-batch.
int threads_for_parts(const RunConfig& config, torch::Device device);

}  // namespace comrad::learn
