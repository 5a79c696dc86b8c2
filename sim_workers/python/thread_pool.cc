#include "sim_workers/python/thread_pool.h"

#include <utility>

namespace comrad::python {

ThreadPool::ThreadPool(int size) {
  for (int index = 0; index < size; ++index) threads_.emplace_back([this, index] { work(index); });
}

ThreadPool::~ThreadPool() {
  wait();
  {
    const std::lock_guard lock(mutex_);
    leaves_ = true;
  }
  begins_.notify_all();
  for (std::thread& thread : threads_) thread.join();
}

void ThreadPool::start(std::function<void(int)> task) {
  {
    const std::lock_guard lock(mutex_);
    task_ = std::move(task);
    busy_ = size();
    ++round_;
  }
  begins_.notify_all();
}

void ThreadPool::wait() {
  std::unique_lock lock(mutex_);
  ends_.wait(lock, [this] { return busy_ == 0; });
}

void ThreadPool::work(int index) {
  uint64_t seen = 0;
  std::unique_lock lock(mutex_);
  while (true) {
    begins_.wait(lock, [&] { return leaves_ || round_ != seen; });
    if (leaves_) return;
    seen = round_;
    lock.unlock();
    task_(index);  // unchanged until all threads have ended
    lock.lock();
    if (--busy_ == 0) ends_.notify_all();
  }
}

}  // namespace comrad::python
