// A value in the arena behind a sequence number, odd while it is written: one writer, readers that never make it wait. Only rooms
// of the arena include this header.
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

namespace comrad::shm {

/// Writes `value` under the even number `sequence`; a writer killed half way leaves the odd one before it.
template <typename T>
void write_locked(std::atomic<uint64_t>& lock, uint64_t sequence, const T& value, T& target) {
  lock.store(sequence - 1, std::memory_order_relaxed);
  std::atomic_thread_fence(std::memory_order_seq_cst);
  target = value;
  std::atomic_thread_fence(std::memory_order_release);
  lock.store(sequence, std::memory_order_release);
}

/// The value that was written under the even number `sequence`; nothing where another one is there, or is being written.
template <typename T>
std::optional<T> read_locked(const std::atomic<uint64_t>& lock, uint64_t sequence, const T& source) {
  if (lock.load(std::memory_order_acquire) != sequence) return std::nullopt;
  const T value = source;
  std::atomic_thread_fence(std::memory_order_acquire);
  if (lock.load(std::memory_order_relaxed) != sequence) return std::nullopt;
  return value;
}

}  // namespace comrad::shm
