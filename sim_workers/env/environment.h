// The environment that a simulator worker steps: N agents, factorised discrete actions, frame skip, rewards,
// true final observations. A Doom scenario is one (doom_env.h); tests bring toys. Stage: tic > render > step.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/schema/episode_record.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/words.h"

namespace comrad::sim {

/// Where one observation of all agents goes; spans into a slab.
struct ObservationTarget {
  uint8_t* frame = nullptr;         ///< [N, C, H, W]
  float* measurement = nullptr;     ///< [N, M]; may be null when M = 0
  uint8_t* action_mask = nullptr;   ///< [N, A]
  uint8_t* agent_active = nullptr;  ///< [N]
  float* global_state = nullptr;    ///< [S]; may be null where it is unused
};

/// What one decision brought.
struct Step {
  std::vector<float> reward;  ///< [N], raw: before scale, clip and sharing
  bool terminated = false;    ///< the game ended by its rules
  bool truncated = false;     ///< a time limit ended it; exclusive with terminated
  bool episode_over() const { return terminated || truncated; }
};

class Environment {
 public:
  virtual ~Environment() = default;
  virtual const EnvShape& shape() const = 0;
  virtual uint64_t layout_id() const = 0;
  /// The next reset plays this layout of the set's pool, which is loaded if need be; a set without a pool has
  /// layout 0 alone. What was played before is over. Errors: kNotFound and kBadFormat where the layout's file
  /// went bad, kBadInput for an index outside the pool.
  virtual Status choose_layout(int layout_index) {
    if (layout_index == 0) return {};
    return Error{ErrorCode::kBadInput,
                 "layout " + std::to_string(layout_index) + " of a set that plays one map was requested"};
  }
  /// Where the run that plays here stands, for weights of rewards that change with it. Never called in evaluations.
  virtual void set_env_frames(uint64_t /*env_frames*/) {}
  /// Starts an episode that is a pure function of `episode_seed` and the actions that follow.
  virtual void reset(uint64_t episode_seed) = 0;
  /// Advances frame_skip tics (fewer when the episode ends inside). `action` is [N, heads]; out-of-range
  /// choices are treated as 0. Does not render.
  virtual void step(std::span<const int32_t> action) = 0;
  virtual const Step& last_step() const = 0;
  /// The episode's lengths, scores and returns; the worker adds its identity. Valid once last_step().episode_over().
  virtual const EpisodeRecord& summary() const = 0;
  /// Hash of the whole state, for determinism tests.
  virtual uint64_t state_hash() const = 0;
};

/// Environments that share one renderer and level: a worker's whole set, observed together because drawing
/// many views at once is cheaper than one by one.
class EnvironmentSet {
 public:
  virtual ~EnvironmentSet() = default;
  virtual int size() const = 0;
  virtual Environment& at(int index) = 0;
  /// Writes the present observation of `at(indices[i])` to targets[i].
  virtual void observe(std::span<const int> indices, std::span<const ObservationTarget> targets) = 0;
};

/// What a set of Doom environments is made from.
struct EnvironmentOptions {
  std::string scenario;
  std::string wad_path = {};              ///< the layout to play
  std::vector<std::string> layouts = {};  ///< instead of wad_path: the pool to choose_layout() from
  int num_agents = 2;
  int count = 16;
  int frame_skip = 4;
  bool use_measurements = false;
  bool use_global_state = false;  ///< the shape has one (global_state.h)
  std::string render_size = "128x72";
  RendererKind renderer = RendererKind::kPainter;
  Resize resize = Resize::kNone;
  std::string reward = {};  ///< weights in place of the scenario's (the setting of that name)
  std::string heads = {};   ///< in place of the scenario's, likewise
  int64_t decision_limit =
      0;  ///< in place of the scenario's, decisions of frame_skip tics; 0: the scenario's

  /// All files to play from.
  std::vector<std::string> wads() const {
    return layouts.empty() ? std::vector<std::string>{wad_path} : layouts;
  }
};

/// Makes `count` environments of a scenario (env/doom_env.cc). Errors: kNotFound (scenario, WAD,
/// IWAD), kBadFormat.
Expected<std::unique_ptr<EnvironmentSet>> make_doom_environments(const EnvironmentOptions& options);

}  // namespace comrad::sim
