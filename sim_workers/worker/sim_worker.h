// A simulator process's loop: steps its environments in alternating splits, renders each split's new
// observations at once and hands them over. While the policy worker thinks about one split, the other one is
// simulated. Stage: tic > render > commit, step > append > seal.
#pragma once

#include <atomic>
#include <cstdint>
#include <memory>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/stage_clock.h"
#include "rollout_buffer/shm/arena.h"
#include "sim_workers/env/environment.h"
#include "sim_workers/worker/env_port.h"

namespace comrad::sim {

struct SimWorkerOptions {
  int worker_index = 0;
  PortRules rules;  ///< `episodes` is filled in from the control block when the run starts
};

/// Runs `environments` against `arena`. Neither is owned; both outlive the worker.
class SimWorker {
 public:
  /// Errors: kBadInput when the environments do not have the shape that the arena was made for.
  static Expected<std::unique_ptr<SimWorker>> create(EnvironmentSet& environments, const shm::Arena& arena,
                                                     const SimWorkerOptions& options);

  /// Waits for the run to start and plays until `stop` is set or the run state is kStopping.
  /// Errors: kBadFormat when a journal does not replay; those of choose_layout() when a layout of the pool
  /// cannot be loaded.
  Status run(const std::atomic<bool>& stop);

 private:
  SimWorker(EnvironmentSet& environments, const shm::Arena& arena, const SimWorkerOptions& options);

  bool await_start(const std::atomic<bool>& stop);
  bool await_answers(int split, const std::atomic<bool>& stop);
  int play_round(int split);
  void observe(bool (EnvPort::*wants)() const, ObservationTarget (EnvPort::*target)() const, int split);
  bool wait_counted(shm::Doorbell& doorbell, uint32_t heard);

  EnvironmentSet& environments_;
  const shm::Arena& arena_;
  SimWorkerOptions options_;
  std::vector<EnvPort> ports_;         // by local index; splits are ranges of it
  std::vector<int> observed_indices_;  // scratch of one observe() call
  std::vector<ObservationTarget> observed_targets_;
  int64_t waited_ns_ = 0;
  StageClock stage_;
  Status failure_;  // of an environment, in the round played last
};

}  // namespace comrad::sim
