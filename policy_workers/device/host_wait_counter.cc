#include "policy_workers/device/host_wait_counter.h"

#include <ATen/core/ivalue.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <string_view>

#include "policy_workers/device/torch_ops.h"

namespace comrad::device {
namespace {

enum Kind { kNumberRead, kNonzero, kDeviceCopy, kReadback, kKinds };
using Places = std::array<std::atomic<int64_t>, kKinds>;

std::atomic<int> steps_open = 0;
std::atomic<bool> is_counting = false;
Places in_step, between;

void count(Kind kind) {
  if (!is_counting) return;
  ++(steps_open > 0 ? in_step : between)[kind];
}

HostWaitCounter::Counts counts_of(const Places& places) {
  return {.numbers_read = places[kNumberRead],
          .nonzero = places[kNonzero],
          .device_copies = places[kDeviceCopy],
          .readbacks = places[kReadback]};
}

/// Autograd names the device, too, where it gives the gradient of a rounding its old type.
bool is_rounding(const at::Tensor& tensor, const at::RecordFunction& function) {
  const auto inputs = function.inputs();
  const bool is_asked_for = std::ranges::any_of(inputs, [](const c10::IValue& input) {
    return input.isInt() && input.toInt() == static_cast<int64_t>(at::kBFloat16);
  });
  return tensor.is_cpu() && (is_asked_for || tensor.scalar_type() == at::kBFloat16);
}

bool is_copy_to_host(const at::RecordFunction& function) {
  at::Tensor moved;
  for (const c10::IValue& input : function.inputs()) {
    if (input.isTensor() && input.toTensor().defined()) moved = input.toTensor();
    if (input.isDevice())
      return moved.defined() && input.toDevice().is_cpu() && !input.toDevice().has_index() &&
             !is_rounding(moved, function);
  }
  return false;
}

}  // namespace

StepScope::StepScope() { ++steps_open; }
StepScope::~StepScope() { --steps_open; }

HostWaitCounter::HostWaitCounter()
    : handle_(at::addGlobalCallback(at::RecordFunctionCallback(&HostWaitCounter::begin)
                                        .needsInputs(true)
                                        .scopes({at::RecordScope::FUNCTION}))) {
  for (Places* places : {&in_step, &between})
    for (std::atomic<int64_t>& place : *places) place = 0;
  is_counting = true;
}

HostWaitCounter::~HostWaitCounter() {
  is_counting = false;
  at::removeCallback(handle_);
}

HostWaitCounter::Counts HostWaitCounter::in_steps() const { return counts_of(in_step); }
HostWaitCounter::Counts HostWaitCounter::between_steps() const { return counts_of(between); }

std::unique_ptr<at::ObserverContext> HostWaitCounter::begin(const at::RecordFunction& function) {
  const std::string_view name = function.name();
  if (name == "aten::_local_scalar_dense" || name == "aten::equal") count(kNumberRead);
  if (name == "aten::nonzero" || name == "aten::masked_select" || name == "aten::_unique2") count(kNonzero);
  if (name == "aten::to" && is_copy_to_host(function)) count(kDeviceCopy);
  if (name == "aten::copy_") {
    const auto inputs = function.inputs();
    if (inputs.size() > 1 && inputs[0].isTensor() && inputs[1].isTensor() && inputs[0].toTensor().is_cpu() &&
        !inputs[1].toTensor().is_cpu())
      count(kDeviceCopy);
  }
  return nullptr;
}

void count_readback() { count(kReadback); }

}  // namespace comrad::device
