#include "policy_workers/device/readback.h"

#include <atomic>

#include "policy_workers/device/host_wait_counter.h"
#include "policy_workers/device/torch_ops.h"
#include "rollout_buffer/core/check.h"

namespace comrad::device {
namespace {

std::atomic<int64_t> waits = 0;
std::atomic<int> slow_readbacks = 0;

}  // namespace

Readback::Readback(const Tensor& numbers) : is_slow_(readbacks_are_slow()) {
  COMRAD_CHECK(numbers.scalar_type() == torch::kFloat64 && numbers.dim() == 1, "numbers are f64 [K]");
  if (numbers.is_cpu()) {
    host_ = numbers.contiguous();
    return;
  }
  host_ = host_memory(numbers.sizes(), torch::kFloat64, numbers.device());
  host_.copy_(numbers, /*non_blocking=*/true);
  copied_.record(Stream::current(numbers.device()));
}

bool Readback::is_ready() const { return !is_slow_ && copied_.is_done(); }

void Readback::wait() {
  ++waits;
  count_readback();
  copied_.wait();
  is_slow_ = false;
}

const double* Readback::values() const {
  COMRAD_CHECK(is_ready(), "numbers are used once they are there");
  return host_.data_ptr<double>();
}

int64_t host_waits() { return waits; }

SlowReadbacks::SlowReadbacks() { ++slow_readbacks; }
SlowReadbacks::~SlowReadbacks() { --slow_readbacks; }
bool readbacks_are_slow() { return slow_readbacks > 0; }

}  // namespace comrad::device
