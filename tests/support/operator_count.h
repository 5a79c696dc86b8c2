// What a device would be given: operators that start a kernel, and the bytes that they read and write, counted on the CPU.
#pragma once

#include <ATen/record_function.h>

#include <atomic>
#include <memory>
#include <set>
#include <string_view>

namespace comrad::test {

/// Of all threads. One lives at a time. Views, and operators that only call others, start nothing; what a kernel calls on a CPU, such as
/// a copy to another type, is a part of it.
class OperatorCount {
 public:
  OperatorCount()
      : handle_(at::addGlobalCallback(at::RecordFunctionCallback(&OperatorCount::begin, &OperatorCount::end)
                                          .needsInputs(true)
                                          .needsOutputs(true)
                                          .scopes({at::RecordScope::FUNCTION}))) {
    started = moved_bytes = 0;
  }
  ~OperatorCount() { at::removeCallback(handle_); }
  OperatorCount(const OperatorCount&) = delete;
  OperatorCount& operator=(const OperatorCount&) = delete;

  int64_t kernels() const { return started; }
  int64_t bytes() const { return moved_bytes; }

 private:
  struct Kernel : at::ObserverContext {
    Kernel() { ++depth; }
    ~Kernel() override { --depth; }
  };
  static bool starts_a_kernel(const at::RecordFunction& function) {
    static const std::set<std::string_view> kNames = {
        "aten::add",         "aten::add_",     "aten::addcmul",      "aten::addcmul_", "aten::addmm",
        "aten::cat",         "aten::clamp",    "aten::clamp_",       "aten::copy_",    "aten::convolution",
        "aten::div",         "aten::elu",      "aten::elu_",         "aten::fill_",    "aten::mm",
        "aten::index_copy_", "aten::mul",      "aten::index_select", "aten::mul_",     "aten::pow",
        "aten::sub",         "aten::sigmoid_", "aten::sum",          "aten::tanh_",    "aten::zero_"};
    return kNames.contains(function.name());
  }
  template <typename Values>
  static void add_bytes(const Values& values) {
    for (const c10::IValue& value : values)
      if (value.isTensor() && value.toTensor().defined())
        moved_bytes += static_cast<int64_t>(value.toTensor().nbytes());
  }
  static std::unique_ptr<at::ObserverContext> begin(const at::RecordFunction& function) {
    if (depth > 0 || !starts_a_kernel(function)) return nullptr;
    ++started;
    add_bytes(function.inputs());
    return std::make_unique<Kernel>();
  }
  static void end(const at::RecordFunction& function, at::ObserverContext* kernel) {
    if (kernel != nullptr) add_bytes(function.outputs());
  }

  inline static std::atomic<int64_t> started = 0, moved_bytes = 0;
  inline static thread_local int depth = 0;
  const at::CallbackHandle handle_;
};

}  // namespace comrad::test
