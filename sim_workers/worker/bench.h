// How fast one simulator process plays: random actions, everything else as in training (two alternating
// splits, rendering into slabs, rewards, final observations), no peers. Behind `comrad-sim-worker --bench`.
#pragma once

#include <cstdint>

#include "sim_workers/env/environment.h"
#include "sim_workers/worker/reward_rules.h"

namespace comrad::sim {

struct BenchOptions {
  double seconds = 5.0;  ///< counted time; a warm-up before it is not
  double warmup_seconds = 0.5;
  int splits = 2;
  int rollout_steps = 32;
  uint64_t seed = 42;
  int layout_count = 0;  ///< of a pool: every episode of an environment plays the next one; 0: no pool
  RewardRules rewards{};
};

struct BenchResult {
  uint64_t decisions = 0;  ///< agent decisions in the counted time
  uint64_t episodes = 0;   ///< that ended in it
  double seconds = 0;
  double cpu_seconds = 0;  ///< processor time of the process in it; less than seconds on a busy host
};

/// Threads: plays in the calling thread.
BenchResult run_bench(EnvironmentSet& environments, const BenchOptions& options);

}  // namespace comrad::sim
