// How busy the GPUs of this machine are while a bench measures, by the driver's own nvidia-smi.
#pragma once

#include <optional>
#include <string>

#include "deploy/process/child_process.h"

namespace comrad::deploy {

/// Watches from its making on. Threads: the one that made it.
class GpuLoad {
 public:
  /// `program` is asked twice a second. What it reports is the share of the time since the report before in which the GPU had work.
  explicit GpuLoad(const std::string& program = "nvidia-smi");
  /// Mean share of the time, 0 to 1, of the busiest GPU; none where the program is not there or has not reported.
  std::optional<double> busy();

 private:
  std::optional<ChildProcess> watcher_;
};

}  // namespace comrad::deploy
