// An encoder written in Python: a TorchScript module of frames u8 [B, C, H, W] and measurements f32 [B, M] (M may be 0) that returns
// features f32 [B, F], as comrad.export_encoder writes it. Its parameters are trained like all others; its buffers stay as they are.
#pragma once

#include "policy_workers/network/encoder.h"

namespace comrad::policy {

/// Weights begin as the file has them, whatever `make` draws. Aborts for a file that check_script_encoder() refuses.
std::shared_ptr<const Encoder> make_script_encoder(const EncoderInput& input, const LayerMaker& make);

/// Loads the module and tries it on random rows: shape, dtype, finite numbers, the same answer twice, rows that do not depend on each
/// other, a gradient for every parameter. Errors: kNotFound; kBadFormat naming the file, what it did and what is expected.
Status check_script_encoder(const std::string& path, const EnvShape& env);

}  // namespace comrad::policy
