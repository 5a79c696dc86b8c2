#include "policy_workers/device/queue.h"

#include <utility>

#include "policy_workers/policy/torch_ops.h"
#include "rollout_buffer/core/log.h"

#ifdef COMRAD_HAS_CUDA
#include <ATen/cuda/CUDAGraph.h>
#include <c10/cuda/CUDAException.h>
#include <c10/cuda/CUDAFunctions.h>
#include <c10/cuda/CUDAGuard.h>
#include <c10/cuda/CUDAStream.h>
#include <cuda_runtime_api.h>
#endif

namespace comrad::device {

#ifdef COMRAD_HAS_CUDA

struct Stream::Queue {
  c10::cuda::CUDAStream stream;
};
struct StreamScope::Guard {
  c10::cuda::CUDAStreamGuard guard;
};
struct Event::Place {
  explicit Place(c10::DeviceIndex device) {
    const c10::cuda::CUDAGuard guard(device);
    C10_CUDA_CHECK(cudaEventCreateWithFlags(&event, cudaEventDisableTiming));
  }
  ~Place() { cudaEventDestroy(event); }
  Place(const Place&) = delete;
  Place& operator=(const Place&) = delete;
  cudaEvent_t event = nullptr;
};
struct Graph::Recording {
  at::cuda::CUDAGraph graph;
};

Stream Stream::current(torch::Device device) {
  Stream stream;
  if (device.is_cuda())
    stream.queue_ = std::make_shared<Queue>(Queue{c10::cuda::getCurrentCUDAStream(device.index())});
  return stream;
}

Stream Stream::beside(torch::Device device) {
  Stream stream;
  if (device.is_cuda())
    stream.queue_ = std::make_shared<Queue>(Queue{c10::cuda::getStreamFromPool(false, device.index())});
  return stream;
}

void Stream::wait_for(const Event& event) const {
  if (queue_ && event.place_)
    C10_CUDA_CHECK(cudaStreamWaitEvent(queue_->stream.stream(), event.place_->event, 0));
}

StreamScope::StreamScope(const Stream& stream) {
  if (stream.queue_) guard_.reset(new Guard{c10::cuda::CUDAStreamGuard(stream.queue_->stream.unwrap())});
}

void Event::record(const Stream& stream) {
  if (!stream.queue_) return;
  if (!place_) place_ = std::make_shared<Place>(stream.queue_->stream.device_index());
  C10_CUDA_CHECK(cudaEventRecord(place_->event, stream.queue_->stream.stream()));
}

bool Event::is_done() const {
  if (!place_) return true;
  const cudaError_t result = cudaEventQuery(place_->event);
  if (result == cudaErrorNotReady) {
    (void)cudaGetLastError();
    return false;
  }
  C10_CUDA_CHECK(result);
  return true;
}

void Event::wait() const {
  if (place_) C10_CUDA_CHECK(cudaEventSynchronize(place_->event));
}

bool Graph::record(torch::Device device, std::function<void()> work) {
  work_ = std::move(work);
  if (!device.is_cuda()) return true;
  const Stream before = Stream::current(device), stream = Stream::beside(device);
  Event reached;
  reached.record(before);
  stream.wait_for(reached);
  try {
    const StreamScope scope(stream);
    work_();  // allocators and libraries set themselves up outside of the recording
    reached.record(stream);
    reached.wait();
    auto recording = std::make_unique<Recording>();
    recording->graph.capture_begin();
    work_();
    recording->graph.capture_end();
    recording_ = std::move(recording);
  } catch (const std::exception& error) {
    spdlog::warn("device: work is given piece by piece, it could not be recorded: {}", error.what());
    recording_.reset();
    return false;
  }
  return true;
}

void Graph::replay() {
  if (recording_)
    recording_->graph.replay();
  else
    work_();
}

Memory memory_of(torch::Device device) {
  if (!device.is_cuda()) return {};
  const c10::cuda::CUDAGuard guard(device);
  std::size_t free_bytes = 0, total_bytes = 0;
  C10_CUDA_CHECK(cudaMemGetInfo(&free_bytes, &total_bytes));
  return {.total_bytes = static_cast<int64_t>(total_bytes), .free_bytes = static_cast<int64_t>(free_bytes)};
}

int gpu_count() { return c10::cuda::device_count(); }

#else

struct Stream::Queue {};
struct StreamScope::Guard {};
struct Event::Place {};
struct Graph::Recording {};

Stream Stream::current(torch::Device) { return {}; }
Stream Stream::beside(torch::Device) { return {}; }
void Stream::wait_for(const Event&) const {}
StreamScope::StreamScope(const Stream&) {}
void Event::record(const Stream&) {}
bool Event::is_done() const { return true; }
void Event::wait() const {}
bool Graph::record(torch::Device, std::function<void()> work) {
  work_ = std::move(work);
  return true;
}
void Graph::replay() { work_(); }
Memory memory_of(torch::Device) { return {}; }
int gpu_count() { return 0; }

#endif

StreamScope::~StreamScope() = default;
Graph::Graph() = default;
Graph::~Graph() = default;
Graph::Graph(Graph&&) noexcept = default;
Graph& Graph::operator=(Graph&&) noexcept = default;

Tensor host_memory(at::IntArrayRef sizes, torch::ScalarType type, torch::Device device) {
  return torch::empty(sizes, torch::TensorOptions(type).pinned_memory(!device.is_cpu()));
}

}  // namespace comrad::device
