// What comrad-sim-worker does, and comrad-sim-video, which does the same and records it.
// Stage: tic > render > commit, step > append > seal.
#pragma once

#include <functional>
#include <memory>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/worker_shell.h"
#include "sim_workers/env/doom_env.h"

namespace comrad::sim {

/// What a program adds to the simulator; all may be empty.
struct SimProgram {
  /// The environments are made, nothing is played yet.
  std::function<Status(const EnvironmentOptions& options, DoomEnvironmentSet& environments)> prepare;
  std::function<Status()> finish = nullptr;  ///< the run is over
  /// Gives the environments, scripted teams included, as the worker is to see them.
  std::function<std::unique_ptr<EnvironmentSet>(std::unique_ptr<EnvironmentSet> environments,
                                                const shm::Arena& arena)>
      wrap = nullptr;
};

/// Runs what the command line selects: a run's simulator, or its benchmark. Gives the exit code.
int run_sim_program(int argc, char** argv, shm::WorkerShell& shell, const SimProgram& program);

}  // namespace comrad::sim
