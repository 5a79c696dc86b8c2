#include "rollout_buffer/shm/learner_report.h"

#include "rollout_buffer/shm/region.h"

namespace comrad::shm {

LearnerReports::LearnerReports(Region& region) : block_(region.take<ReportBlock>(1)) {}

void LearnerReports::publish(const LearnerReport& report) const {
  const uint64_t writing = (block_->sequence.load(std::memory_order_relaxed) + 1) | 1;
  block_->sequence.store(writing, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  block_->report = report;
  std::atomic_thread_fence(std::memory_order_release);
  block_->sequence.store(writing + 1, std::memory_order_release);
}

std::optional<LearnerReport> LearnerReports::read(uint64_t& sequence) const {
  const uint64_t before = block_->sequence.load(std::memory_order_acquire);
  if (before == sequence || before % 2 != 0) return std::nullopt;
  LearnerReport report = block_->report;
  std::atomic_thread_fence(std::memory_order_acquire);
  if (block_->sequence.load(std::memory_order_relaxed) != before) return std::nullopt;
  report.last_checkpoint[kCheckpointPathBytes - 1] = 0;
  sequence = before;
  return report;
}

}  // namespace comrad::shm
