// What `comrad doctor` makes of the libtorch that networks run with, the NVIDIA driver and the GPUs: which they are, whether they
// fit each other, and what to do where they do not. The facts come from `comrad-policy-worker --describe --libtorch`.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "deploy/tools/machine_check.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::deploy {

struct LibtorchSeen {
  struct Device {
    std::string name, capability;
    int64_t memory_bytes = 0;
  };
  std::string version;  ///< "2.14.1"
  std::string library;  ///< the file that was loaded
  std::string cuda;     ///< "13.0"; empty without
  int64_t cudnn = 0;    ///< 92400; 0 without
  bool has_nccl = false;
  std::vector<Device> devices;
  std::string error;  ///< CUDA's own words where it sees no GPU
};

/// Errors: kBadFormat.
Expected<LibtorchSeen> parse_libtorch(std::string_view described);

/// "580.65.06" of the text of /proc/driver/nvidia/version; empty where there is none.
std::string driver_version_in(std::string_view text);

/// The first driver that runs programs of a CUDA, by its major version: 13 -> 580. 0: not known.
/// Source: NVIDIA, CUDA Toolkit Release Notes, table "CUDA Toolkit and Minimum Required Driver Version for CUDA Minor Version
/// Compatibility".
int oldest_driver_for(std::string_view cuda);

CheckResult judge_libtorch(const LibtorchSeen& seen);

/// `driver`: as driver_version_in() gives it. `visible_devices`: CUDA_VISIBLE_DEVICES, nullptr where it is not set.
CheckResult judge_cuda(const LibtorchSeen& seen, const std::string& driver, const char* visible_devices);

}  // namespace comrad::deploy
