#include "policy_workers/device/mapped_memory.h"

#include <utility>

#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/text.h"

#ifdef COMRAD_HAS_CUDA
#include <c10/cuda/CUDAGuard.h>
#include <cuda_runtime_api.h>
#endif

namespace comrad::device {

Expected<MappedMemory> MappedMemory::create(std::span<std::byte> bytes, torch::Device device) {
  MappedMemory memory;
  void* there = bytes.data();
  if (!device.is_cpu() && !device.has_index()) device.set_index(0);
#ifdef COMRAD_HAS_CUDA
  if (device.is_cuda()) {
    const c10::cuda::CUDAGuard guard(device);
    cudaError_t result =
        cudaHostRegister(bytes.data(), bytes.size(), cudaHostRegisterPortable | cudaHostRegisterMapped);
    if (result == cudaSuccess) {
      memory.registered_ = bytes.data();
      result = cudaHostGetDevicePointer(&there, bytes.data(), 0);
    }
    if (result != cudaSuccess) {
      (void)cudaGetLastError();  // it is reported here, not to the next call
      return Error{ErrorCode::kSystem, "the driver does not map " +
                                           bytes_text(static_cast<int64_t>(bytes.size())) +
                                           " of shared memory: " + cudaGetErrorString(result)};
    }
  }
#endif
  memory.there_ = at::for_blob(there, {static_cast<int64_t>(bytes.size())})
                      .options(torch::TensorOptions(torch::kUInt8).device(device))
                      .target_device(device)
                      .make_tensor();
  return memory;
}

MappedMemory::MappedMemory(MappedMemory&& other) noexcept
    : registered_(std::exchange(other.registered_, nullptr)), there_(std::move(other.there_)) {}

MappedMemory& MappedMemory::operator=(MappedMemory&& other) noexcept {
  std::swap(registered_, other.registered_);
  std::swap(there_, other.there_);
  return *this;
}

MappedMemory::~MappedMemory() {
#ifdef COMRAD_HAS_CUDA
  if (registered_ != nullptr) (void)cudaHostUnregister(registered_);
#endif
}

}  // namespace comrad::device
