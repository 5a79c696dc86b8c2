#include "policy_workers/device/queue.h"

#include <array>
#include <atomic>
#include <utility>
#include <vector>

#include "policy_workers/device/operator_path.h"
#include "policy_workers/device/tensor_layout.h"
#include "policy_workers/device/torch_ops.h"
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
namespace {

std::atomic<int> recordings_open = 0;

struct RecordingScope {
  RecordingScope() { ++recordings_open; }
  ~RecordingScope() { --recordings_open; }
  RecordingScope(const RecordingScope&) = delete;
  RecordingScope& operator=(const RecordingScope&) = delete;
};

}  // namespace

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

Stream Stream::beside(torch::Device device, Priority priority) {
  Stream stream;
  if (device.is_cuda())
    stream.queue_ = std::make_shared<Queue>(
        Queue{c10::cuda::getStreamFromPool(priority == Priority::kHigh, device.index())});
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

bool Graph::launch(bool records) {
  const Stream before = Stream::current(device_);
  const bool is_first = before.queue_->stream.priority() < 0;  // CUDA's priorities: the lower, the sooner
  const Stream stream = Stream::beside(device_, is_first ? Priority::kHigh : Priority::kUsual);
  Event reached;
  reached.record(before);
  stream.wait_for(reached);
  if (!records) {
    {
      const StreamScope scope(stream);
      work_();
    }
    reached.record(stream);
    before.wait_for(reached);
    return true;
  }
  const StreamScope scope(stream);
  const RecordingScope recording_now;
  auto recording = std::make_unique<Recording>();
  std::string refusal;
  try {
    // Other threads continue copying and allocating: what is not this thread's does not end the recording.
    recording->graph.capture_begin({0, 0}, cudaStreamCaptureModeThreadLocal);
    work_();
  } catch (const std::exception& error) {
    refusal = error.what();
  }
  try {
    recording->graph.capture_end();
  } catch (const std::exception& error) {
    if (refusal.empty()) refusal = error.what();
  }
  if (!refusal.empty()) {
    spdlog::warn("device: CUDA graph capture failed; operators are launched one by one: {}", refusal);
    return false;
  }
  recording_ = std::move(recording);
  return true;
}

bool Graph::record(torch::Device device, std::function<void()> work) {
  work_ = std::move(work);
  device_ = device;
  if (!device.is_cuda()) return true;
  (void)launch(/*records=*/false);  // allocators and libraries set themselves up outside of the recording
  return launch(/*records=*/true);
}

void Graph::replay() {
  if (replays_before_recording_ >= 0 && device_.is_cuda()) {
    if (replays_before_recording_-- > 0) {
      (void)launch(/*records=*/false);
      return;
    }
    (void)launch(/*records=*/true);
  }
  if (recording_) {
    recording_->graph.replay();
    return;
  }
  const RecordingScope as_if;
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
Stream Stream::beside(torch::Device, Priority) { return {}; }
void Stream::wait_for(const Event&) const {}
StreamScope::StreamScope(const Stream&) {}
void Event::record(const Stream&) {}
bool Event::is_done() const { return true; }
void Event::wait() const {}
bool Graph::launch(bool) { return false; }
bool Graph::record(torch::Device, std::function<void()> work) {
  work_ = std::move(work);
  return true;
}
void Graph::replay() {
  const RecordingScope as_if;
  work_();
}
Memory memory_of(torch::Device) { return {}; }
int gpu_count() { return 0; }

#endif

void Graph::record_at_second_replay(torch::Device device, std::function<void()> work) {
  work_ = std::move(work);
  device_ = device;
  replays_before_recording_ = 1;
}

bool is_recording() { return recordings_open > 0; }

StreamScope::~StreamScope() = default;
Graph::Graph() = default;
Graph::~Graph() = default;
Graph::Graph(Graph&&) noexcept = default;
Graph& Graph::operator=(Graph&&) noexcept = default;

Tensor host_memory(at::IntArrayRef sizes, torch::ScalarType type, torch::Device device) {
  return torch::empty(sizes, torch::TensorOptions(type).pinned_memory(!device.is_cpu()));
}

void move_together(std::span<Tensor* const> tensors, torch::Device device) {
  if (has_own_kernels(device)) return;
  const torch::NoGradGuard no_grad;
  std::vector<Tensor*> moving;
  TensorLayout layout;
  for (Tensor* tensor : tensors) {
    if (!tensor->defined() || (!device.is_cpu() && !tensor->is_cpu())) continue;
    if (!device.is_cpu() && tensor->is_pinned()) {
      *tensor = tensor->to(device, /*non_blocking=*/true);
      continue;
    }
    moving.push_back(tensor);
    layout.add(tensor->sizes(), tensor->scalar_type());
  }
  if (moving.empty()) return;
  const Tensor here = host_memory({layout.bytes()}, torch::kUInt8, device);
  for (std::size_t i = 0; i < moving.size(); ++i) layout.view(here, i).copy_(*moving[i]);
  const Tensor there = here.to(device, /*non_blocking=*/true);
  for (std::size_t i = 0; i < moving.size(); ++i) *moving[i] = layout.view(there, i);
}

Tensor moved(Tensor tensor, torch::Device device) {
  move_together(std::array{&tensor}, device);
  return tensor;
}

}  // namespace comrad::device
