// A device's queues of work: streams, events, memory of the host that a device can copy while the host continues, and
// recorded work (graphs). Only this folder uses CUDA; on a CPU the same calls do the work at once, so that everything
// but the driver is tested everywhere. Serves forward, and update of a learner on a GPU.
#pragma once

#include <torch/types.h>

#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "rollout_buffer/core/expected.h"

namespace comrad::device {

using torch::Tensor;

class Event;

/// Of a queue: what is in one of high priority goes first wherever the device has room.
enum class Priority { kUsual, kHigh };

/// One queue of a device, which runs its work in launch order. Threads: one launches work at a time.
class Stream {
 public:
  /// The queue that operators of the calling thread go to.
  static Stream current(torch::Device device);
  /// Another one, for work and copies beside it.
  static Stream beside(torch::Device device, Priority priority = Priority::kUsual);

  /// What comes after waits, on the device, for the event. Does not wait here.
  void wait_for(const Event& event) const;

 private:
  friend class Event;
  friend class Graph;
  friend class StreamScope;
  struct Queue;
  std::shared_ptr<Queue> queue_;  ///< null on a CPU
};

/// While one lives, operators of the calling thread go to `stream`.
class StreamScope {
 public:
  explicit StreamScope(const Stream& stream);
  ~StreamScope();
  StreamScope(const StreamScope&) = delete;
  StreamScope& operator=(const StreamScope&) = delete;

 private:
  struct Guard;
  std::unique_ptr<Guard> guard_;
};

/// A place in a queue. Done from the start, and on a CPU always.
class Event {
 public:
  void record(const Stream& stream);
  bool is_done() const;
  /// Waits here until it is reached.
  void wait() const;

 private:
  friend class Stream;
  struct Place;
  std::shared_ptr<Place> place_;
};

/// Memory of the host. For a GPU it is pinned: copies from and to it continue beside the host's work.
Tensor host_memory(at::IntArrayRef sizes, torch::ScalarType type, torch::Device device);

/// Moves tensors of the host to `device`, all in one copy out of pinned memory: a copy out of other memory waits until the device has
/// done what is in its queue. What is undefined, or lies there already, stays as it is, as does everything on a CPU.
void move_together(std::span<Tensor* const> tensors, torch::Device device);
/// One alone.
Tensor moved(Tensor tensor, torch::Device device);

/// Work of fixed shapes and addresses that is recorded once, with the priority of the calling thread's queue, and then launched
/// as one piece. What it reads and writes must be the same tensors each time; on a CPU, and on a GPU that refused to record, it
/// is launched again each time.
class Graph {
 public:
  Graph();
  ~Graph();
  Graph(Graph&&) noexcept;
  Graph& operator=(Graph&&) noexcept;

  /// Records `work`, which is done once before: it must not matter. False, with a warning in the log, where the device refused.
  bool record(torch::Device device, std::function<void()> work);
  /// For work that matters each time: the first replay() launches it piece by piece, the second one records it.
  void record_at_second_replay(torch::Device device, std::function<void()> work);
  void replay();
  bool is_recorded() const { return recording_ != nullptr; }

 private:
  struct Recording;
  /// The work on its own queue, done (`records` false) or recorded.
  bool launch(bool records);
  std::unique_ptr<Recording> recording_;
  std::function<void()> work_;
  torch::Device device_ = torch::kCPU;
  int replays_before_recording_ = -1;  ///< negative: it is recorded, or will never be
};

/// Whether work is being recorded, in any thread; on a CPU, where nothing is recorded, while a Graph replays. What is kept from one
/// pass to the next must be rebuilt then: a replay would not see that it is outdated.
bool is_recording();

/// What a device's memory looks like; 0 where it is the host's.
struct Memory {
  int64_t total_bytes = 0, free_bytes = 0;
};
Memory memory_of(torch::Device device);

/// How many GPUs this process can use: 0 without a driver, or in a build without CUDA.
int gpu_count();

}  // namespace comrad::device
