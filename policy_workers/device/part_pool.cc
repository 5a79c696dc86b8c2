#include "policy_workers/device/part_pool.h"

#include <optional>

#include "policy_workers/device/cpu_tuning.h"

namespace comrad::device {

PartPool::PartPool(int threads) {
  for (int i = 1; i < threads; ++i) helpers_.emplace_back([this] { help(); });
}

PartPool::~PartPool() {
  {
    const std::lock_guard lock(mutex_);
    closing_ = true;
  }
  job_begins_.notify_all();
  for (std::thread& helper : helpers_) helper.join();
}

bool PartPool::run(int64_t parts, const std::function<void(int64_t)>& work,
                   const std::function<bool()>& keep_going) {
  const bool alone = helpers_.empty() || parts <= 1;
  // Before any helper may begin. This thread's share is computed like the helpers': the result must not
  // depend on which thread took a part.
  std::optional<OneMathThread> one_thread;
  if (!alone) one_thread.emplace();
  {
    const std::lock_guard lock(mutex_);
    work_ = &work, parts_ = parts, next_ = 0;
    stopped_ = false, failure_ = nullptr;
    if (!alone) ++job_;
  }
  if (!alone) job_begins_.notify_all();
  take_parts(keep_going);
  std::unique_lock lock(mutex_);
  job_ends_.wait(lock, [this] { return busy_ == 0; });
  work_ = nullptr;
  if (failure_) std::rethrow_exception(failure_);
  return !stopped_;
}

void PartPool::help() {
  set_operator_threads(1);
  int64_t seen = 0;
  std::unique_lock lock(mutex_);
  while (true) {
    job_begins_.wait(lock, [&] { return closing_ || job_ != seen; });
    if (closing_) return;
    seen = job_;
    if (work_ == nullptr) continue;  // it was over before this thread woke
    ++busy_;
    lock.unlock();
    take_parts(nullptr);
    lock.lock();
    if (--busy_ == 0) job_ends_.notify_all();
  }
}

void PartPool::take_parts(const std::function<bool()>& keep_going) {
  while (true) {
    const bool goes_on = !keep_going || keep_going();
    int64_t part = 0;
    {
      const std::lock_guard lock(mutex_);
      if (next_ >= parts_ || stopped_) return;
      if (!goes_on) {
        stopped_ = true;
        return;
      }
      part = next_++;
    }
    try {
      (*work_)(part);
    } catch (...) {
      const std::lock_guard lock(mutex_);
      if (!failure_) failure_ = std::current_exception();
      next_ = parts_;
      return;
    }
  }
}

}  // namespace comrad::device
