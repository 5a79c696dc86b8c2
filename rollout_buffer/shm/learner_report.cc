#include "rollout_buffer/shm/learner_report.h"

#include "rollout_buffer/shm/region.h"
#include "rollout_buffer/shm/sequence_lock.h"

namespace comrad::shm {

LearnerReports::LearnerReports(Region& region) : block_(region.take<ReportBlock>(1)) {}

void LearnerReports::publish(const TrainStats& report) const {
  const uint64_t writing = (block_->sequence.load(std::memory_order_relaxed) + 1) | 1;
  write_locked(block_->sequence, writing + 1, report, block_->report);
}

std::optional<TrainStats> LearnerReports::read(uint64_t& sequence) const {
  const uint64_t before = block_->sequence.load(std::memory_order_acquire);
  if (before == sequence || before % 2 != 0) return std::nullopt;
  std::optional<TrainStats> report = read_locked(block_->sequence, before, block_->report);
  if (!report) return std::nullopt;
  report->last_checkpoint[kCheckpointPathBytes - 1] = 0;
  sequence = before;
  return report;
}

}  // namespace comrad::shm
