// The device that a setting names.
#pragma once

#include <torch/types.h>

#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::policy {

/// The device a setting names: "auto" takes the first CUDA device where there is one, else the CPU.
/// Errors: kBadInput for another word; kUnsupported for a CUDA device that this build or machine lacks.
Expected<torch::Device> choose_device(const std::string& setting);

}  // namespace comrad::policy
