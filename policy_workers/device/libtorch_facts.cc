#include "policy_workers/device/libtorch_facts.h"

#include <spdlog/fmt/fmt.h>

#include <dlfcn.h>
#include <torch/version.h>

#include "policy_workers/device/torch_ops.h"
#ifdef COMRAD_HAS_CUDA
#include <cuda_runtime_api.h>
#endif

namespace comrad::device {

LibtorchFacts libtorch_facts() {
  LibtorchFacts facts;
  facts.version = TORCH_VERSION;
  Dl_info info{};
  if (dladdr(reinterpret_cast<const void*>(&at::get_num_threads), &info) != 0 && info.dli_fname != nullptr)
    facts.library = info.dli_fname;
#ifdef USE_C10D_NCCL
  facts.has_nccl = true;
#endif
#ifdef COMRAD_HAS_CUDA
  facts.cuda = fmt::format("{}.{}", CUDART_VERSION / 1000, CUDART_VERSION % 1000 / 10);
  facts.cudnn = at::globalContext().versionCuDNN();
  int count = 0;
  if (const cudaError_t result = cudaGetDeviceCount(&count); result != cudaSuccess) {
    facts.error = cudaGetErrorString(result);
    cudaGetLastError();  // reported already; libtorch must not find it
    return facts;
  }
  for (int index = 0; index < count; ++index) {
    cudaDeviceProp device{};
    if (cudaGetDeviceProperties(&device, index) != cudaSuccess) continue;
    facts.devices.push_back({.name = device.name,
                             .memory_bytes = static_cast<int64_t>(device.totalGlobalMem),
                             .capability = fmt::format("{}.{}", device.major, device.minor)});
  }
#endif
  return facts;
}

}  // namespace comrad::device
