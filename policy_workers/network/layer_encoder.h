// An encoder of layers (rollout_buffer/settings/encoder_layers.h), with the measurement branch beside it (training spec 1.1). Frames are
// normalised by their running statistics first.
#pragma once

#include "policy_workers/network/encoder.h"

namespace comrad::policy {

/// Parameters: conv1, conv2, ... (a residual layer has two), norm1, ... and image, image2, ... of linear layers, in the order of
/// the layers; then measurement1 and measurement2, two layers of 128 features with ELU, where M > 0, and with `layer_norm`
/// measurement1_norm and measurement2_norm. Features: those of the last
/// layer, then the measurement branch's.
std::shared_ptr<const Encoder> make_layer_encoder(const EncoderInput& input, const LayerMaker& make);

}  // namespace comrad::policy
