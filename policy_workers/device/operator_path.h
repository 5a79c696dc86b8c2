// Which path a network takes: on a CPU kernels of our own where these are faster, on every other device torch's operators
// alone. Tests take the second one on a CPU, too, so that all but the driver is tried everywhere.
#pragma once

#include <torch/types.h>

namespace comrad::device {

/// While one lives, everything on a CPU runs as on a GPU. Threads: any; make it before the work begins.
class OperatorPath {
 public:
  OperatorPath();
  ~OperatorPath();
  OperatorPath(const OperatorPath&) = delete;
  OperatorPath& operator=(const OperatorPath&) = delete;
};

/// Whether work on `device` takes our own kernels.
bool has_own_kernels(torch::Device device);

}  // namespace comrad::device
