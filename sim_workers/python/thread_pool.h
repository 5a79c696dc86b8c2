// A thread pool that runs one task at a time: each thread does its share, and the task ends when all have ended.
// Stage: beside step, for Python.
#pragma once

#include <condition_variable>
#include <cstdint>
#include <functional>
#include <mutex>
#include <thread>
#include <vector>

namespace comrad::python {

/// Threads: all calls from one thread at a time.
class ThreadPool {
 public:
  explicit ThreadPool(int size);
  ~ThreadPool();
  ThreadPool(const ThreadPool&) = delete;
  ThreadPool& operator=(const ThreadPool&) = delete;

  int size() const { return static_cast<int>(threads_.size()); }
  /// Every thread runs `task(its index)`; returns at once. The last task must have ended.
  void start(std::function<void(int)> task);
  /// Waits until the task has ended in every thread.
  void wait();

 private:
  void work(int index);

  std::mutex mutex_;
  std::condition_variable begins_, ends_;
  std::function<void(int)> task_;
  uint64_t round_ = 0;
  int busy_ = 0;
  bool leaves_ = false;
  std::vector<std::thread> threads_;
};

}  // namespace comrad::python
