// The section "architecture" of a checkpoint: what Python needs beside tensors and settings to build the network.
#pragma once

#include "learner/checkpoint/checkpoint.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/settings/run_config.h"

namespace comrad::learn {

/// "architecture/encoder": the encoder's layers as text, with those of q_layer_norm, "module" for a TorchScript file, whose bytes are "architecture/encoder_module"
/// u8 [n], or the name of an encoder written in C++. Errors: those of reading the file.
Expected<StateDict> architecture_of(const RunConfig& config);

}  // namespace comrad::learn
