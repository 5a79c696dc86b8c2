// How much work torch's operators do, counted from the shapes of their tensors on whatever device they run: what a model of
// another device is made from (`comrad bench model --gpus`). Serves benches and tests.
#pragma once

#include <ATen/record_function.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>

namespace comrad::device {

/// Where an operator runs: in autograd's backward pass, in an optimizer's step, or elsewhere.
enum class Phase : std::size_t { kForward, kBackward, kOptimizer };
constexpr std::size_t kPhaseCount = 3;

struct Work {
  int64_t flop = 0;      ///< of convolutions and matrix products; a multiplication and an addition are two
  int64_t bytes = 0;     ///< read and written by operators, each tensor once an operator
  int64_t launches = 0;  ///< operators that do something: on a GPU about so many kernels
};

/// Counts what all threads do while it lives. Composite operators count as the operators that they call; convolutions,
/// products and lists for optimizers (`_foreach_*`) as one, as on a GPU; views and allocations as none. One lives at a time;
/// an operator costs some microseconds more meanwhile.
class WorkCounter {
 public:
  WorkCounter();
  ~WorkCounter();
  WorkCounter(const WorkCounter&) = delete;
  WorkCounter& operator=(const WorkCounter&) = delete;

  Work of(Phase phase) const;

 private:
  static std::unique_ptr<at::ObserverContext> begin(const at::RecordFunction& function);
  static void end(const at::RecordFunction& function, at::ObserverContext* context);
  const at::CallbackHandle handle_;
};

/// Marks an optimizer's step. Threads: any.
class OptimizerScope {
 public:
  OptimizerScope();
  ~OptimizerScope();
  OptimizerScope(const OptimizerScope&) = delete;
  OptimizerScope& operator=(const OptimizerScope&) = delete;
};

}  // namespace comrad::device
