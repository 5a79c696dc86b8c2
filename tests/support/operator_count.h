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
        "aten::_log_softmax", "aten::_log_softmax_backward_data",
        "aten::abs",          "aten::add",
        "aten::add_",         "aten::addcmul",
        "aten::addcmul_",     "aten::addmm",
        "aten::bitwise_or",   "aten::cat",
        "aten::clamp",        "aten::clamp_",
        "aten::clamp_max",    "aten::clamp_min",
        "aten::convolution",  "aten::convolution_backward",
        "aten::copy_",        "aten::div",
        "aten::div_",         "aten::elu",
        "aten::elu_",         "aten::elu_backward",
        "aten::eq",           "aten::exp",
        "aten::fill_",        "aten::gather",
        "aten::ge",           "aten::gt",
        "aten::index_copy_",  "aten::index_select",
        "aten::le",           "aten::lerp_",
        "aten::logical_and",  "aten::logical_and_",
        "aten::lt",           "aten::masked_fill_",
        "aten::max",          "aten::maximum",
        "aten::min",          "aten::minimum",
        "aten::mm",           "aten::mul",
        "aten::mul_",         "aten::ne",
        "aten::neg",          "aten::norm",
        "aten::pow",          "aten::reciprocal",
        "aten::rsqrt",        "aten::scatter_add_",
        "aten::sigmoid_",     "aten::sqrt",
        "aten::sub",          "aten::sub_",
        "aten::sum",          "aten::tanh_",
        "aten::where",        "aten::zero_"};
    return kNames.contains(function.name());
  }
  /// What it reads: results that are given to it, and what it overwrites without a look, are left out.
  static c10::ArrayRef<const c10::IValue> read_by(const at::RecordFunction& function) {
    const c10::ArrayRef<const c10::IValue> inputs = function.inputs();
    const auto name = function.operator_name();
    if (name && name->overload_name.ends_with("out")) return inputs.slice(0, inputs.size() - 1);
    static const std::set<std::string_view> kOverwrite = {"aten::copy_", "aten::fill_", "aten::zero_"};
    return kOverwrite.contains(function.name()) ? inputs.slice(1) : inputs;
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
    add_bytes(read_by(function));
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
