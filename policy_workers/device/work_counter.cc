#include "policy_workers/device/work_counter.h"

#include <ATen/core/ivalue.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <string_view>

#include "policy_workers/policy/torch_ops.h"

namespace comrad::device {
namespace {

struct Place {
  std::atomic<int64_t> flop, bytes, launches;
};
std::array<Place, kPhaseCount> places;
thread_local int optimizers_open = 0;

/// One operator at work, or a node of the backward pass.
struct Running : at::ObserverContext {
  Running* caller = nullptr;
  bool is_operator = false;  ///< else a node
  bool is_backward = false;
  bool is_whole = false;  ///< what it calls is its own work
  bool has_called = false;
  int64_t flop = 0, of_each_result = 0,
          bytes_in = 0;  ///< arguments live as long as the call begins, no longer
};
thread_local Running* innermost = nullptr;

bool is_allocation(std::string_view name) {
  return name.starts_with("aten::empty") || name.starts_with("aten::new_empty") ||
         name.starts_with("aten::resize") || name == "aten::set_" || name == "aten::lift_fresh";
}

/// What is one on a GPU, whatever a CPU makes of it: the products, and the lists of optimizers.
bool is_one_kernel(std::string_view name) {
  constexpr std::array<std::string_view, 8> kProducts = {
      "aten::mm",      "aten::bmm",   "aten::mv",          "aten::addmm",
      "aten::baddbmm", "aten::addmv", "aten::convolution", "aten::convolution_backward"};
  return std::ranges::find(kProducts, name) != kProducts.end() || name.starts_with("aten::_foreach_");
}

/// A result that shares an argument's memory without writing it.
bool is_view(const at::RecordFunction& function) {
  const auto schema = function.operator_schema();
  if (!schema || schema->returns().empty()) return false;
  const auto* alias = schema->returns()[0].alias_info();
  return alias != nullptr && !alias->isWrite();
}

int64_t bytes_of(const c10::IValue& value) {
  if (value.isTensor()) {
    const torch::Tensor& tensor = value.toTensor();
    return tensor.defined() ? static_cast<int64_t>(tensor.nbytes()) : 0;
  }
  int64_t bytes = 0;
  if (value.isTensorList())
    for (const torch::Tensor& tensor : value.toTensorVector()) bytes += static_cast<int64_t>(tensor.nbytes());
  return bytes;
}

/// FLOP that follow from the arguments; `of_each_result` are those of a convolution, for each value that it makes.
int64_t flop_of(std::string_view name, c10::ArrayRef<const c10::IValue> inputs, int64_t& of_each_result) {
  const auto tensor = [&](std::size_t index) {
    return index < inputs.size() && inputs[index].isTensor() ? inputs[index].toTensor() : torch::Tensor();
  };
  const auto product = [&](std::size_t left) -> int64_t {
    const torch::Tensor a = tensor(left), b = tensor(left + 1);
    return a.defined() && b.defined() ? 2 * a.numel() * (b.dim() < 2 ? 1 : b.size(-1)) : 0;
  };
  const auto of_a_value = [](const torch::Tensor& weight) {
    return weight.defined() && weight.size(0) > 0 ? 2 * (weight.numel() / weight.size(0)) : 0;
  };
  if (name == "aten::mm" || name == "aten::bmm" || name == "aten::mv") return product(0);
  if (name == "aten::addmm" || name == "aten::baddbmm" || name == "aten::addmv") return product(1);
  if (name == "aten::convolution") of_each_result = of_a_value(tensor(1));
  if (name == "aten::convolution_backward" && !inputs.empty() && inputs.back().isList()) {
    const auto wanted = inputs.back().toListRef();  // the gradients of input, weight and bias
    const torch::Tensor gradient = tensor(0);
    if (!gradient.defined() || wanted.size() != 3) return 0;
    return gradient.numel() * of_a_value(tensor(2)) *
           (int64_t{wanted[0].toBool()} + int64_t{wanted[1].toBool()});
  }
  return 0;
}

}  // namespace

WorkCounter::WorkCounter()
    : handle_(at::addGlobalCallback(
          at::RecordFunctionCallback(&WorkCounter::begin, &WorkCounter::end)
              .needsInputs(true)
              .needsOutputs(true)
              .scopes({at::RecordScope::FUNCTION, at::RecordScope::BACKWARD_FUNCTION}))) {
  for (Place& place : places) place.flop = place.bytes = place.launches = 0;
}

WorkCounter::~WorkCounter() { at::removeCallback(handle_); }

Work WorkCounter::of(Phase phase) const {
  const Place& place = places[static_cast<std::size_t>(phase)];
  return {.flop = place.flop, .bytes = place.bytes, .launches = place.launches};
}

std::unique_ptr<at::ObserverContext> WorkCounter::begin(const at::RecordFunction& function) {
  auto running = std::make_unique<Running>();
  running->caller = innermost;
  running->is_operator = function.scope() == at::RecordScope::FUNCTION;
  running->is_backward = !running->is_operator || (innermost != nullptr && innermost->is_backward);
  const std::string_view name = function.name();
  running->is_whole = (innermost != nullptr && innermost->is_whole) || is_one_kernel(name);
  if (running->is_operator && innermost != nullptr) innermost->has_called = true;
  if (running->is_operator && name.starts_with("aten::")) {
    const auto inputs = function.inputs();
    running->flop = flop_of(name, inputs, running->of_each_result);
    for (const c10::IValue& value : inputs) running->bytes_in += bytes_of(value);
  }
  innermost = running.get();
  return running;
}

void WorkCounter::end(const at::RecordFunction& function, at::ObserverContext* context) {
  const auto* running = static_cast<const Running*>(context);
  if (running == nullptr) return;
  innermost = running->caller;
  const std::string_view name = function.name();
  if (!running->is_operator || !name.starts_with("aten::")) return;
  const Phase phase = optimizers_open > 0    ? Phase::kOptimizer
                      : running->is_backward ? Phase::kBackward
                                             : Phase::kForward;
  Place& place = places[static_cast<std::size_t>(phase)];
  const std::vector<c10::IValue>& outputs = function.outputs();
  place.flop += running->flop;
  if (running->of_each_result > 0 && !outputs.empty() && outputs[0].isTensor())
    place.flop += running->of_each_result * outputs[0].toTensor().numel();
  const bool is_part_of_a_whole = running->caller != nullptr && running->caller->is_whole;
  const bool is_last = running->is_whole ? !is_part_of_a_whole : !running->has_called;
  if (!is_last || is_allocation(name) || is_view(function)) return;
  place.bytes += running->bytes_in;
  for (const c10::IValue& value : outputs) place.bytes += bytes_of(value);
  ++place.launches;
}

OptimizerScope::OptimizerScope() { ++optimizers_open; }
OptimizerScope::~OptimizerScope() { --optimizers_open; }

}  // namespace comrad::device
