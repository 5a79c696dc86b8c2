// The Doom environment: N agents in one world, factorised actions held for frame_skip tics, rewards from the
// scenario's terms, endings by kind. A set of them shares the level, the actor types and one renderer.
// Stage: tic > render > step.
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "doomgen/wad/wad_reader.h"
#include "scenarios/spec/layout_info.h"
#include "scenarios/spec/rewards.h"
#include "scenarios/spec/scenario_spec.h"
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/engine/world/world.h"
#include "sim_workers/env/action_map.h"
#include "sim_workers/env/environment.h"
#include "sim_workers/env/global_state.h"
#include "sim_workers/env/observation.h"

namespace comrad::sim {

/// What all environments of a set share; immutable while they run.
struct DoomGame {
  scenarios::ScenarioSpec spec;
  scenarios::LayoutInfo layout;
  uint64_t layout_id = 0;  ///< hash of the WAD
  std::shared_ptr<const doom::Level> level;
  std::shared_ptr<const doom::ActorCatalog> catalog;
  std::shared_ptr<const doom::acs::Behavior> behavior;  ///< null: no scripts
  int num_agents = 2;
  double ceiling = 0.0;  ///< the best J that this map allows so many agents; 0: not known
  int frame_skip = 4;
  bool use_measurements = false, use_global_state = false;
  bool no_monsters = false;
  std::vector<std::pair<int, int32_t>> globals;  ///< [USER number, value] when an episode begins
  ActionMap actions;
};

/// The layouts of a pool as games, loaded on first use; of more than kGamesKept the one that
/// was unused longest is dropped. Environments of a set share it. Threads: one.
class LayoutLibrary {
 public:
  static constexpr std::size_t kGamesKept = 64;

  /// Loads the first layout. Errors: as load_doom_game().
  static Expected<std::shared_ptr<LayoutLibrary>> create(const EnvironmentOptions& options);

  int size() const { return static_cast<int>(options_.layouts.size()); }
  /// Errors: kBadInput for an index outside the pool; those of load_doom_game() and Renderer::prepare().
  Expected<std::shared_ptr<const DoomGame>> game(int layout_index);
  /// Whose art is loaded with a level from now on; null: none.
  void draw_with(doom::Renderer* renderer) { renderer_ = renderer; }

 private:
  struct Kept {
    std::shared_ptr<const DoomGame> game;
    uint64_t asked = 0;  ///< when it was last used
  };
  explicit LayoutLibrary(const EnvironmentOptions& options) : options_(options) {}
  EnvironmentOptions options_;
  doom::Renderer* renderer_ = nullptr;
  std::map<int, Kept> games_;
  uint64_t clock_ = 0;
};

class DoomEnvironment;

/// Is shown an environment at every tic that there is something to see; for videos.
class TicWatcher {
 public:
  virtual ~TicWatcher() = default;
  /// An episode begins.
  virtual void began(const DoomEnvironment& environment) = 0;
  /// A tic is over. After the last one of a decision rewards and endings are those of the decision.
  virtual void ticked(const DoomEnvironment& environment) = 0;
};

/// One environment. Time limits are tics: decision_limit counts decisions of 4 tics whatever frame_skip is,
/// and the engine's own clock of 10 minutes ends everything; both truncate. A .cfg's timeout is in place of both.
class DoomEnvironment final : public Environment {
 public:
  explicit DoomEnvironment(std::shared_ptr<const DoomGame> game);

  const EnvShape& shape() const override { return shape_; }
  uint64_t layout_id() const override { return game_->layout_id; }
  Status choose_layout(int layout_index) override;
  /// What choose_layout() chooses from; null: the game it was made with.
  void choose_from(std::shared_ptr<LayoutLibrary> library) { library_ = std::move(library); }
  void set_env_frames(uint64_t env_frames) override {
    rewards_.set_env_frames(static_cast<double>(env_frames));
  }
  void reset(uint64_t episode_seed) override;
  void step(std::span<const int32_t> action) override;
  /// The same with what each agent presses [N], for frame_skip tics.
  void press(std::span<const doom::Buttons> buttons);
  const Step& last_step() const override { return step_; }
  const EpisodeRecord& summary() const override { return summary_; }
  /// The last step's rewards [N] before they are rounded to float.
  std::span<const double> exact_reward() const { return exact_reward_; }
  uint64_t state_hash() const override;

  /// What each reward term added to the last step's exact rewards [term, N].
  std::span<const double> reward_parts() const { return rewards_.parts(); }

  /// Adds a watcher, which sees each tic after those that were added before. Not owned.
  void show_to(TicWatcher* watcher) { watchers_.push_back(watcher); }
  /// What each agent [N] holds down since the last step began.
  std::span<const doom::Buttons> pressed() const { return buttons_; }
  /// The summary as if the episode ended now.
  EpisodeRecord summary_so_far() const;

  const DoomGame& game() const { return *game_; }
  const doom::World& world() const { return world_; }
  doom::World& world() { return world_; }  ///< for tools that put things elsewhere
  /// A variable that terms may read; `agent_stride` as in RewardTerm.
  double read(int agent, scenarios::GameVariable variable, int agent_stride = 0) const;
  /// Writes everything but the pictures. The global state is of the world as it is now, whether or not the shape has one.
  void observe_numbers(const ObservationTarget& target) const;

 private:
  /// A reward or measurement variable, resolved.
  struct Reading {
    scenarios::GameVariable variable;
    int agent_stride = 0;      ///< of a USER variable: agent i reads number index + i * stride
    bool is_team_sum = false;  ///< an agent's variable in a team term: summed over agents
    std::optional<scenarios::GameVariable> when = {}, unless = {};  ///< the term pays only if these allow it
  };
  void make_action_mask();
  void read_reward_variables();
  void fill(EpisodeRecord& summary) const;

  std::shared_ptr<const DoomGame> game_;
  std::shared_ptr<LayoutLibrary> library_;
  EnvShape shape_;
  doom::World world_;
  std::vector<Reading> reward_readings_;
  std::vector<scenarios::GameVariable> measurement_variables_;
  GlobalState global_state_;
  scenarios::RewardTracker rewards_;
  std::vector<double> reward_value_;  // [term, N]
  std::vector<uint8_t> reward_pays_;  // [term, N]; empty where no term has a gate
  std::vector<double> exact_reward_;  // [N]
  bool has_gates_ = false;
  std::vector<uint8_t> action_mask_;    // [N, logits]
  std::vector<doom::Buttons> buttons_;  // [N]
  uint64_t limit_tics_;
  uint32_t step_count_ = 0;
  Step step_;
  EpisodeRecord summary_;
  std::vector<TicWatcher*> watchers_;
};

/// A worker's environments and their one renderer.
class DoomEnvironmentSet final : public EnvironmentSet {
 public:
  /// `library`: where the environments' layouts come from, `game` being its first; null: `game` alone.
  DoomEnvironmentSet(std::shared_ptr<const DoomGame> game, std::unique_ptr<doom::Renderer> renderer,
                     int count, ViewSize render_size, Resize filter,
                     std::shared_ptr<LayoutLibrary> library = nullptr);
  ~DoomEnvironmentSet() override;

  int size() const override { return static_cast<int>(environments_.size()); }
  DoomEnvironment& at(int index) override { return *environments_[index]; }
  void observe(std::span<const int> indices, std::span<const ObservationTarget> targets) override;

 private:
  std::unique_ptr<doom::Renderer> renderer_;
  std::shared_ptr<LayoutLibrary> library_;
  std::vector<std::unique_ptr<DoomEnvironment>> environments_;
  ViewSize render_size_;
  Resize filter_;
  std::vector<doom::ViewRequest> views_;
  std::vector<uint8_t> drawn_;  // [count * N, 3, height, width] where a filter brings them to size
};

/// make_doom_environments() by its own type.
Expected<std::unique_ptr<DoomEnvironmentSet>> make_doom_environment_set(const EnvironmentOptions& options);

/// What draws the views of a game as its scenario defines, at a size, with the art of its IWAD and of `wads`; the game's level
/// is prepared. Errors: those of ArtArchive::open(), Renderer::create() and Renderer::prepare().
Expected<std::unique_ptr<doom::Renderer>> make_renderer(const DoomGame& game,
                                                        const std::vector<std::string>& wads, ViewSize size,
                                                        RendererKind kind = RendererKind::kPainter);

/// Reads the scenario and its WAD: everything of a set but its renderer.
/// Errors: kNotFound, kBadFormat, kBadInput as make_doom_environments().
Expected<std::shared_ptr<const DoomGame>> load_doom_game(const EnvironmentOptions& options);
/// The same with a WAD that is open already; options.wad_path is not read.
Expected<std::shared_ptr<const DoomGame>> load_doom_game(const EnvironmentOptions& options,
                                                         const wad::WadFile& wad);
/// The same of a scenario that is read already; options.scenario names it in messages.
Expected<std::shared_ptr<const DoomGame>> load_doom_game(const EnvironmentOptions& options,
                                                         scenarios::ScenarioSpec spec,
                                                         const wad::WadFile& wad);

}  // namespace comrad::sim
