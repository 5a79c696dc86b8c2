#include "learner/algorithms/step_guard.h"

#include <cmath>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/stage_clock.h"

namespace comrad::learn {
namespace {

constexpr int64_t kSkippedInARowMax = 20;

}  // namespace

bool StepGuard::step(AdamOptimizer& optimizer, double loss, double learning_rate, PolicyVersion& version,
                     UpdateStats& stats) {
  const ProcessStage stage(Stage::kOptimizer, {Stage::kCollate});
  grad_norm_ = optimizer.clip_gradients();
  if (!std::isfinite(loss) || !std::isfinite(grad_norm_)) {
    ++skipped_in_a_row_;
    ++stats.skipped_steps;
    spdlog::error("update: loss {} with gradient norm {} at version {}; optimizer step skipped ({} in a row)",
                  loss, grad_norm_, version, skipped_in_a_row_);
    return false;
  }
  skipped_in_a_row_ = invalid_in_a_row_ = 0;
  learning_rate_ = learning_rate;
  optimizer.step(learning_rate);
  ++version;
  ++stats.optimizer_steps;
  return true;
}

Status StepGuard::skip_invalid_batch(int64_t dropped, UpdateStats& stats) {
  ++invalid_in_a_row_;
  ++stats.skipped_steps;
  spdlog::warn("update: no valid sample in the batch ({} too old); skipped ({} in a row)", dropped,
               invalid_in_a_row_);
  return status();
}

Status StepGuard::status() const {
  if (invalid_in_a_row_ >= kSkippedInARowMax)
    return Error{
        ErrorCode::kBadInput,
        "no sample was valid in " + std::to_string(invalid_in_a_row_) +
            " batches in a row, so nothing is learned: either the policy gives numbers that are not finite "
            "(resume from an earlier checkpoint) or all data is older than --max_policy_lag"};
  if (skipped_in_a_row_ < kSkippedInARowMax) return {};
  return Error{ErrorCode::kBadInput,
               "loss or gradient was not finite in " + std::to_string(skipped_in_a_row_) +
                   " optimizer steps in a row; lower --learning_rate or --max_grad_norm and resume from the "
                   "last checkpoint"};
}

}  // namespace comrad::learn
