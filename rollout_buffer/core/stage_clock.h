// Processor and wall time of the pipeline's stages, and bytes that one stage copies for another. A bench requests it by a folder
// `stages` in its run's folder: every worker then counts in a file there, which the bench reads while they work. Elsewhere
// nothing is counted, and a border costs one load.
#pragma once

#include <array>
#include <atomic>
#include <cstdint>
#include <ctime>
#include <initializer_list>
#include <string>
#include <vector>

#include "rollout_buffer/core/clock.h"
#include "rollout_buffer/core/expected.h"

namespace comrad {

enum class Stage {
  kTic,              ///< worlds, rewards, resets, rows of slabs
  kRender,           ///< views, final ones included
  kHandOver,         ///< the simulator's commits, doorbells and waits
  kGather,           ///< the policy worker's waits and inputs
  kWeights,          ///< new ones taken in
  kPack,             ///< inputs into memory that a GPU copies
  kForward,          ///< its network; on a GPU from the copy up to the answers on the host
  kScatter,          ///< actions drawn and answers written
  kCollate,          ///< slabs into batches or the replay, draws from it
  kForwardBackward,  ///< the rest of an update: normaliser, targets, losses, both passes
  kOptimizer,        ///< clipping and the step
  kPublish,          ///< weights for the policy workers
};
constexpr std::size_t kStageCount = 12;

/// Of a run's folder; a bench makes it.
constexpr const char* kStagesFolder = "stages";

/// "forward_backward": as reports call it.
const char* name_of(Stage stage);

/// One process's counters since it began.
struct StageCounters {
  std::atomic<uint64_t> pid;
  std::array<std::atomic<uint64_t>, kStageCount> cpu_ns;
  std::array<std::atomic<uint64_t>, kStageCount> wall_ns;  ///< of StageClock's
  std::atomic<uint64_t> copied_bytes;
};
static_assert(std::atomic<uint64_t>::is_always_lock_free);

/// This process's counters; null where they are off.
StageCounters* stage_counters();

/// Counts in the file `<folder>/<name>` from now on; nothing happens where there is no such folder. Call once, before the
/// threads that count. Errors: kSystem.
Status share_stages(const std::string& folder, const std::string& name);

/// What share_stages() made in `folder`, as it is now. A file that is still too short is left out.
struct StageTotals {
  uint64_t pid = 0;
  std::string name;
  std::array<uint64_t, kStageCount> cpu_ns{}, wall_ns{};
  uint64_t copied_bytes = 0;
};
std::vector<StageTotals> read_stages(const std::string& folder);

inline void count_copied(uint64_t bytes) {
  if (StageCounters* counters = stage_counters())
    counters->copied_bytes.fetch_add(bytes, std::memory_order_relaxed);
}

/// Borders between the stages of one thread: end(stage) counts the thread's time since the last border. Threads: one.
class StageClock {
 public:
  void begin() {
    if (stage_counters() == nullptr) return;
    border_s_ = thread_cpu_s();
    border_ns_ = monotonic_ns();
  }
  void end(Stage stage) {
    StageCounters* counters = stage_counters();
    if (counters == nullptr) return;
    const double now_s = thread_cpu_s();
    counters->cpu_ns[static_cast<std::size_t>(stage)].fetch_add(
        static_cast<uint64_t>((now_s - border_s_) * 1e9), std::memory_order_relaxed);
    border_s_ = now_s;
    end_wall(stage);
  }
  /// The same of a stage whose processor time a ProcessStage counts.
  void end_wall(Stage stage) {
    StageCounters* counters = stage_counters();
    if (counters == nullptr) return;
    const int64_t now_ns = monotonic_ns();
    counters->wall_ns[static_cast<std::size_t>(stage)].fetch_add(static_cast<uint64_t>(now_ns - border_ns_),
                                                                 std::memory_order_relaxed);
    border_ns_ = now_ns;
  }

 private:
  double border_s_ = 0;
  int64_t border_ns_ = 0;
};

/// A stage that several threads of the process work on: from its making to its end, the process's time less what `others`
/// counted meanwhile.
class ProcessStage {
 public:
  explicit ProcessStage(Stage stage, std::initializer_list<Stage> others = {});
  ProcessStage(const ProcessStage&) = delete;
  ProcessStage& operator=(const ProcessStage&) = delete;
  ~ProcessStage();

 private:
  double own_s() const;
  const Stage stage_;
  const std::vector<Stage> others_;
  const double began_s_;
};

}  // namespace comrad
