// How fast one simulator process plays: random actions, everything else as in training (two alternating
// splits, rendering into slabs, rewards, final observations), no peers. Or its engine without pictures, or the drawing of
// the same views alone. Behind `comrad-sim-worker --bench`.
#pragma once

#include <cstdint>
#include <vector>

#include "sim_workers/env/environment.h"
#include "sim_workers/worker/reward_rules.h"

namespace comrad::sim {

enum class BenchPart {
  kAll,     ///< tics and views, as in training
  kEngine,  ///< tics alone: nothing is drawn
  kRender,  ///< tics and views, but only the time of the views counts
};

struct BenchOptions {
  BenchPart part = BenchPart::kAll;
  double seconds = 5.0;  ///< counted time; a warm-up before it is not
  double warmup_seconds = 0.5;
  int splits = 2;
  int rollout_steps = 32;
  uint64_t seed = 42;
  int layout_count = 0;  ///< of a pool: every episode of an environment plays the next one; 0: no pool
  RewardRules rewards{};
};

struct BenchResult {
  uint64_t decisions = 0;       ///< agent decisions in the counted time; kRender: views
  uint64_t episodes = 0;        ///< that ended in it
  double seconds = 0;           ///< counted
  std::vector<double> windows;  ///< decisions a second, by window
  double cpu_seconds = 0;       ///< processor time of the process meanwhile; less than seconds on a busy host
  double tic_cpu_seconds = 0;   ///< of it, in this thread: tics, rewards, resets, final observations
  double render_cpu_seconds = 0;  ///< and views
};

/// Threads: plays in the calling thread.
BenchResult run_bench(EnvironmentSet& environments, const BenchOptions& options);

}  // namespace comrad::sim
