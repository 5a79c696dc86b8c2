// Which libtorch this program runs with, and what it sees of GPUs: for `comrad doctor` and beside measurements.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

namespace comrad::device {

/// One GPU as libtorch sees it.
struct CudaDevice {
  std::string name;          ///< "NVIDIA H100 80GB HBM3"
  int64_t memory_bytes = 0;  ///< in all
  std::string capability;    ///< "9.0"
};

struct LibtorchFacts {
  std::string version;    ///< of the headers, "2.14.1"
  std::string library;    ///< the file of libtorch_cpu.so that was loaded
  std::string cuda;       ///< "13.0": the CUDA it was built with; empty without
  int64_t cudnn = 0;      ///< 92400: version of cuDNN; 0 without
  bool has_nccl = false;  ///< whether c10d can use NCCL
  std::vector<CudaDevice> devices;
  std::string error;  ///< why it sees no GPU, in CUDA's words; empty where it does, or has no CUDA
};

/// Queries libtorch and, in a build with CUDA, its runtime. Starts CUDA where there is a GPU. Threads: any.
LibtorchFacts libtorch_facts();

}  // namespace comrad::device
