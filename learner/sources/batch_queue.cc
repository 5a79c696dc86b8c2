#include "learner/sources/batch_queue.h"

#include <pthread.h>

#include <algorithm>
#include <chrono>
#include <exception>

#include "learner/sources/collate_slabs.h"
#include "learner/sources/stop_signal.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/futex.h"
#include "rollout_buffer/shm/slab_pool.h"

namespace comrad::learn {

BatchQueue::BatchQueue(const shm::Arena& arena, int64_t slabs_per_batch, int64_t capacity,
                       torch::Device device, const policy::SlabFrames* frames)
    : arena_(arena),
      slabs_per_batch_(slabs_per_batch),
      capacity_(std::max<int64_t>(1, capacity)),
      device_(device),
      frames_(frames),
      thread_([this] { run(); }) {}

BatchQueue::~BatchQueue() {
  stop_ = true;
  changed_.notify_all();
  thread_.join();
}

std::unique_ptr<RolloutBatch> BatchQueue::pop(int timeout_ms) {
  std::unique_lock lock(mutex_);
  changed_.wait_for(lock, std::chrono::milliseconds(timeout_ms),
                    [this] { return !full_.empty() || !failure_.empty(); });
  if (full_.empty()) return nullptr;
  std::unique_ptr<RolloutBatch> batch = std::move(full_.front());
  full_.pop_front();
  lock.unlock();
  changed_.notify_all();
  return batch;
}

void BatchQueue::recycle(std::unique_ptr<RolloutBatch> batch) {
  {
    const std::lock_guard lock(mutex_);
    free_.push_back(std::move(batch));
  }
  changed_.notify_all();
}

int BatchQueue::waiting() const {
  const std::lock_guard lock(mutex_);
  return static_cast<int>(full_.size());
}

std::string BatchQueue::failure() const {
  const std::lock_guard lock(mutex_);
  return failure_;
}

void BatchQueue::run() {
  pthread_setname_np(pthread_self(), "batcher");
  try {
    fill();
  } catch (const std::exception& error) {
    {
      const std::lock_guard lock(mutex_);
      failure_ = error.what();
    }
    changed_.notify_all();
  }
}

void BatchQueue::fill() {
  while (!stop_) {
    std::unique_ptr<RolloutBatch> batch;
    {
      std::unique_lock lock(mutex_);
      // One batch beyond the waiting ones is in training; this one is the next to wait.
      changed_.wait_for(lock, std::chrono::microseconds(kPollUs),
                        [this] { return stop_ || static_cast<int64_t>(full_.size()) < capacity_; });
      if (static_cast<int64_t>(full_.size()) >= capacity_) continue;
      if (!free_.empty()) {
        batch = std::move(free_.back());
        free_.pop_back();
      }
    }
    if (batch == nullptr)
      batch = std::make_unique<RolloutBatch>(
          make_rollout_batch(arena_.shape().trajectory, slabs_per_batch_, device_, frames_ != nullptr));
    if (!collect(*batch)) return;
    send_ahead(*batch, device_);
    {
      const std::lock_guard lock(mutex_);
      full_.push_back(std::move(batch));
    }
    changed_.notify_all();
  }
}

bool BatchQueue::collect(RolloutBatch& batch) {
  StageClock stage;
  stage.begin();
  clear(batch);
  int64_t position = 0;
  while (!stop_) {
    shm::Doorbell& sealed = arena_.control().slab_sealed;
    const uint32_t heard = shm::listen(sealed);
    std::vector<PlacedSlab> slabs;
    for (const uint32_t index : arena_.slabs().drain(static_cast<int>(slabs_per_batch_ - position)))
      slabs.push_back({.slab_index = index, .position = position++});
    broken_ += static_cast<uint64_t>(collate_slabs(batch, slabs, arena_, frames_, device_));
    for (const PlacedSlab& slab : slabs) arena_.slabs().release(slab.slab_index);
    stage.end(Stage::kCollate);
    if (position == slabs_per_batch_) return true;
    if (slabs.empty()) shm::wait(sealed, heard, kPollUs);
  }
  return false;
}

}  // namespace comrad::learn
