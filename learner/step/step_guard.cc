#include "learner/step/step_guard.h"

#include <spdlog/fmt/fmt.h>

#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/stage_clock.h"

namespace comrad::learn {
namespace {

constexpr int64_t kSkippedInARowMax = 20;

}  // namespace

torch::Tensor StepGuard::step(AdamOptimizer& optimizer, const torch::Tensor& loss, double learning_rate,
                              PolicyVersion& version, UpdateStats& stats) {
  const ProcessStage stage(Stage::kOptimizer, {Stage::kCollate});
  count_step(version, stats);
  return optimizer.step(learning_rate, loss);
}

void StepGuard::count_step(PolicyVersion& version, UpdateStats& stats) {
  ++version;
  ++stats.optimizer_steps;
}

void StepGuard::complete(const Outcome& outcome, PolicyVersion& version, UpdateStats& stats) {
  grad_norm_ = outcome.grad_norm;
  if (outcome.was_taken) {
    skipped_in_a_row_ = invalid_in_a_row_ = 0;
    learning_rate_ = outcome.learning_rate;
    return;
  }
  --version;
  --stats.optimizer_steps;
  ++skipped_in_a_row_;
  ++stats.skipped_steps;
  spdlog::error("update: loss {} with gradient norm {} at version {}; optimizer step skipped ({} in a row)",
                outcome.loss, grad_norm_, version, skipped_in_a_row_);
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
    return Error{ErrorCode::kBadInput,
                 fmt::format("no sample was valid in {} batches in a row, so nothing is learned: either the "
                             "policy gives numbers that are not finite (resume from an earlier checkpoint) "
                             "or all data is older than --max_policy_lag",
                             invalid_in_a_row_)};
  if (skipped_in_a_row_ < kSkippedInARowMax) return {};
  return Error{ErrorCode::kBadInput,
               fmt::format("loss or gradient was not finite in {} optimizer steps in a row; lower "
                           "--learning_rate or --max_grad_norm and resume from the last checkpoint",
                           skipped_in_a_row_)};
}

}  // namespace comrad::learn
