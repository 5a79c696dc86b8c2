// What a run on this host is to do: the merged settings, what chooses the actions, when it ends.
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "deploy/launch/restart_policy.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/process.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/network_size.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/run_config.h"
#include "rollout_buffer/settings/seat_plan.h"
#include "rollout_buffer/shm/arena.h"

namespace comrad::deploy {

/// What chooses the actions.
enum class PolicySource {
  kTraining,    ///< a learner trains and publishes
  kCheckpoint,  ///< a learner in serve mode publishes one checkpoint's weights
  kRandom,      ///< uniform over each head; no learner
  kOracle,      ///< the scenario's scripted team, inside the simulators; no learner
  kSeats,       ///< each agent its own player: LaunchPlan::seats
  kFeeding,     ///< a learner on another host, which is fed with what is played here
};

/// What is recorded of an evaluation: all its episodes, one after the other, played by one environment.
struct VideoPlan {
  std::string video;           ///< file; empty: none
  std::string finished_video;  ///< what the simulator renames it to once it is whole
  std::string frames;          ///< folder of single pictures; empty: none
  std::string size;            ///< of one agent's view, "640x360"
  double seconds = 0;  ///< of video, a decision's 4 tics are 4/35 s; the episodes are played on; 0: no limit
  bool is_wanted() const { return !video.empty() || !frames.empty(); }
};

/// Where what an evaluation plays is shown live, played by one environment (comrad watch, comrad play).
struct PagePlan {
  std::string socket;  ///< the abstract socket that the simulator connects to; empty: nowhere
  std::string size;    ///< of one agent's view, "640x360"
  double pictures_per_s = 17.5;
  std::vector<int> people = {};  ///< agents that people play there, and no policy
  bool is_wanted() const { return !socket.empty(); }
};

/// A program that makes another host join this run. It reads the run's address from its standard input, and leaves when
/// that ends.
struct HostStart {
  std::string name;                  ///< for people: "host a", "srun"
  std::vector<std::string> command;  ///< first a path, or a name on PATH
  bool is_needed = false;            ///< without it the run fails
};

/// What to run. `config` is merged and resolved; `run_dir` exists and holds config.toml.
struct LaunchPlan {
  RunConfig config;
  EnvShape env;                ///< from `comrad-scenarios describe`
  NetworkSize network;         ///< from `comrad-policy-worker --describe`; nothing without a learner
  int64_t decision_limit = 0;  ///< of the scenario, in decisions of 4 tics whatever env_frameskip is; 0: none
  std::string run_dir;
  PolicySource policy = PolicySource::kTraining;
  std::string checkpoint;               ///< kCheckpoint: the file to serve
  SeatPlan seats = {};                  ///< kSeats: as seats.toml in run_dir has it
  bool greedy = false;                  ///< argmax actions
  uint64_t episodes = 0;                ///< > 0: evaluation; stop after so many (fixed quota per environment)
  double seconds = 0;                   ///< > 0: stop after so long (bench); measured after the first update
  double warmup_seconds = 0;            ///< not counted in `seconds`
  bool show_progress = true;            ///< one line on a terminal, plain lines when piped; to stderr
  std::vector<std::string> notes = {};  ///< printed at the start, in the terminal and the log
  int lock_descriptor = -1;  ///< RunDirectory::lock_descriptor(); the learner holds it too until it has left
  std::string bin_dir;       ///< where the worker programs lie; empty: beside this program
  RestartLimits restarts;
  double join_timeout_s = 120 * patience();  ///< a worker that has not joined by then is stuck
  std::vector<HostStart> hosts = {};         ///< are made to join once the run is at work
  std::string join_address = {};             ///< the address they join
  bool leaves_with_input = false;            ///< the end of the standard input ends the run, as SIGTERM does
  double patience_s = 300;                   ///< kFeeding: how long the learner's host may be silent
  bool simulators_join =
      false;  ///< this run's simulators play in one that joins it, from this host (--link dds)
  bool sends_frames = false;  ///< kFeeding: its policy workers play with this host's simulators
  VideoPlan recording;
  PagePlan page = {};
  std::function<void(const EpisodeRecord&)> on_episode = nullptr;  ///< evaluation: called as each one ends
  bool keeps_positions = false;  ///< each simulator writes where agents were to positions_path()
  bool keeps_episodes = false;   ///< simulators write each episode into episodes_folder(), which is there

  /// What simulator `index` writes, in the run's folder: JSON lines as sim_workers/worker/position_log.h describes.
  std::string positions_path(int index) const {
    return run_dir + "/positions_" + std::to_string(index) + ".jsonl";
  }
  /// Files as sim_workers/worker/episode_recorder.h describes.
  std::string episodes_folder() const { return run_dir + "/episodes"; }
  /// The most decisions that an episode of this run takes; 0: no limit. Sizes journals in deterministic mode.
  int64_t longest_episode() const;
  /// The path of a program of this name.
  std::string program(const std::string& name) const;
  bool trains() const { return policy == PolicySource::kTraining; }
  /// This host plays for the learner of another one.
  bool feeds() const { return policy == PolicySource::kFeeding; }
  /// A learner takes what is played, here or elsewhere.
  bool drains() const { return trains() || feeds(); }
  /// Other hosts may join.
  bool serves() const { return trains() && config.hosts.serve; }
  /// Monitors on other hosts may look.
  bool publishes() const { return trains() && config.hosts.publish; }
  /// Simulators that this run starts itself.
  int64_t own_workers() const { return simulators_join ? 0 : config.collection.num_workers; }
  /// Places for simulators of hosts without a policy; this host counts as one where its simulators join.
  int64_t remote_frame_workers() const {
    return serves() ? config.hosts.serve_frame_workers + config.collection.num_workers - own_workers() : 0;
  }
  /// Processes: none where the learner has policy workers as threads, or another host's play and the one that sends frames is in
  /// their place.
  int64_t own_policy_workers() const {
    return sends_frames || (trains() && !config.collection.policy_processes)
               ? 0
               : config.collection.policy_workers;
  }
  /// There is a learner among the workers.
  bool has_learner() const {
    if (policy == PolicySource::kSeats) return !seats.networks.empty();
    return policy != PolicySource::kRandom && policy != PolicySource::kOracle && !feeds();
  }
  /// Simulators play on in one slab each: no learner drains sealed ones.
  bool evaluates() const { return episodes > 0 || !drains(); }
  /// Rollout by rollout, all workers in lock step.
  bool is_lock_step() const {
    return trains() && (config.collection.deterministic || !config.collection.async_rl);
  }
};

/// The shared memory that the plan needs. Errors: kBadInput when a deterministic run's journals cannot be sized.
Expected<shm::ArenaShape> arena_shape(const LaunchPlan& plan);

}  // namespace comrad::deploy
