// Starts, watches and stops the processes of one run on this host: simulators, policy workers, learner. Owns
// the arena's memfd, its socket and the host's DDS participant, bridges simulators to DDS, restarts what
// dies.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "deploy/launch/restart_policy.h"
#include "rollout_buffer/core/config.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/dds/bus.h"
#include "rollout_buffer/schema/spec.h"

namespace comrad::deploy {

/// Who chooses the actions.
enum class PolicySource {
  kTraining,    ///< a learner trains and publishes
  kCheckpoint,  ///< a learner in serve mode publishes one checkpoint's weights
  kRandom,      ///< uniform over each head; no learner
  kOracle,      ///< the scenario's scripted team, inside the simulators; no learner
};

/// What to run. `config` is merged and resolved; `run_dir` exists and holds config.toml.
struct LaunchPlan {
  RunConfig config;
  EnvShape env;                ///< from `comrad-scenarios describe`
  int64_t decision_limit = 0;  ///< of the scenario; sizes journals in deterministic mode
  std::string run_dir;
  PolicySource policy = PolicySource::kTraining;
  std::string checkpoint;     ///< kCheckpoint: the file to serve
  bool greedy = false;        ///< argmax actions
  uint64_t episodes = 0;      ///< > 0: evaluation; stop after so many (fixed quota per environment)
  double seconds = 0;         ///< > 0: stop after so long (bench); measured after the first update
  double warmup_seconds = 0;  ///< not counted in `seconds`
  bool show_progress = true;  ///< one line on a terminal, plain lines when piped; to stderr
  int lock_descriptor = -1;   ///< RunDirectory::lock_descriptor(); the learner holds it too until it has left
  std::string bin_dir;        ///< where the worker programs lie; empty: beside this program
  RestartLimits restarts;
};

/// How it ended.
struct RunOutcome {
  int exit_code = 0;
  bool interrupted = false;
  std::string
      message;  ///< how it ended, env frames, time, both rates over the run, J, checkpoint; one line to show
  dds::TrainStats last_stats;
  std::vector<dds::EpisodeResult> episodes;  ///< evaluation: all of them, ordered by episode_id
  double measured_seconds = 0;               ///< bench: the counted window
  uint64_t measured_decisions = 0;  ///< agent decisions the learner trained on (or simulators took) in it
  uint64_t measured_updates = 0;    ///< optimizer steps in it
  double lag_mean = 0;
  uint64_t steps_lost = 0;       ///< agent decisions lost to restarts
  uint64_t env_frames_lost = 0;  ///< trained on, then forgotten by a learner that went back to its checkpoint
  uint32_t restarts = 0;
};

/// Runs the plan to its end. SIGINT and SIGTERM: finish the optimizer step, checkpoint, flush, stop within 10
/// s; a second SIGINT stops at once. A dead simulator or policy worker is restarted with back-off; a dead
/// learner is restarted from the last checkpoint. Children die with this process. Errors: kNoSpace (arena),
/// kSystem (sockets, DDS), kPeerLost (a worker that keeps dying; its last log line).
Expected<RunOutcome> run(const LaunchPlan& plan);

}  // namespace comrad::deploy
