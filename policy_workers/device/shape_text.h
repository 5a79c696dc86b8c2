// A tensor's dtype and sizes for messages.
#pragma once

#include <torch/types.h>

#include <string>

#include "rollout_buffer/core/text.h"

namespace comrad::device {

/// "Float [5, 32]".
inline std::string shape_text(const torch::Tensor& tensor) {
  return std::string(c10::toString(tensor.scalar_type())) + " [" + joined(tensor.sizes()) + "]";
}

}  // namespace comrad::device
