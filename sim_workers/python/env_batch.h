// Many environments behind one call, for Python: a thread pool steps and draws them, results lie in arrays that
// Python sees without a copy. Stage: tic > render > step, in place of a simulator worker.
#pragma once

#include <unistd.h>

#include <atomic>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/game_names.h"
#include "sim_workers/engine/render/automap.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/python/thread_pool.h"

namespace comrad::python {

/// What a batch is made from.
struct BatchOptions {
  std::string scenario;  ///< a name, the path of a folder with a scenario.toml, or of a ViZDoom .cfg
  std::vector<std::string>
      maps;            ///< WADs; environment e of E plays maps[(e + k E) mod count] in its k-th episode
  int num_agents = 0;  ///< N; 0: what the scenario is made for
  int frame_skip = 4;
  int num_envs = 1;  ///< E
  int num_threads = 1;
  int width = 128, height = 72;  ///< of one agent's view
  bool has_pictures = true, has_depth = false, has_labels = false, has_automap = false;
  std::string automap_mode;  ///< ViZDoom's name of one; empty: as the .cfg sets, NORMAL for a scenario
  bool channels_first = false;
  bool autoreset =
      false;  ///< the step after an episode's end begins the next one; else stepping it is an error
  bool by_buttons = false;    ///< actions are numbers for a .cfg's buttons, not choices of heads
  std::string reward, heads;  ///< the settings of these names
};

/// What the arrays hold; they keep their place as long as the batch lives. E environments, N agents, view h x w.
struct BatchArrays {
  std::vector<uint8_t> picture;  ///< [E, N, h, w, 3], or [E, N, 3, h, w] where channels come first
  std::vector<float> depth;      ///< [E, N, h, w]  map units ahead of the eye, 0 for sky and below the view
  std::vector<uint8_t> labels;  ///< [E, N, h, w]  as doom::Renderer::draw_labels() has them, 0 below the view
  std::vector<uint8_t> automap;                ///< as `picture`
  std::vector<float> measurement;              ///< [E, N, M]  scaled as networks get them
  std::vector<float> variable;                 ///< [E, N, M]  the same game variables as they are
  std::vector<uint8_t> action_mask;            ///< [E, N, A]
  std::vector<uint8_t> active;                 ///< [E, N]  0: dead and not coming back
  std::vector<float> state;                    ///< [E, S]  as state_names() describes (env/global_state.h)
  std::vector<float> reward;                   ///< [E, N]
  std::vector<uint8_t> terminated, truncated;  ///< [E]
  // Of the episode that continues, or that just ended.
  std::vector<float> score, ceiling;                ///< [E]
  std::vector<float> agent_return;                  ///< [E, N]
  std::vector<uint32_t> length_tics, length_steps;  ///< [E]
  std::vector<uint64_t> episode_seed;               ///< [E]
  // The EpisodeKey that it was begun with, for the one that follows it.
  std::vector<uint64_t> stream_seed, episode_number;  ///< [E]
};

/// A thing that an agent sees.
struct SeenThing {
  doom::ThingLabel label;
  std::string name;  ///< of its class
  double x = 0, y = 0, z = 0, angle_degrees = 0, velocity_x = 0, velocity_y = 0, velocity_z = 0;
};

/// Lines that each agent of an environment has seen: [agent][linedef].
using SeenLines = std::vector<std::vector<uint8_t>>;

/// Which episode: the `number`-th of those that follow from a seed, or the one whose own seed it is (BatchArrays::episode_seed).
struct EpisodeKey {
  uint64_t seed = 0;
  std::optional<uint64_t> number;
};

/// One environment as it stands: a copy to go back to. Of one scenario and process.
class SavedState {
 public:
  uint64_t hash() const { return environment_.state_hash(); }

 private:
  friend class EnvBatch;
  SavedState(const sim::DoomEnvironment& environment, const EpisodeKey& episode, bool is_over, SeenLines seen)
      : environment_(environment), episode_(episode), is_over_(is_over), seen_lines_(std::move(seen)) {}
  sim::DoomEnvironment environment_;
  EpisodeKey episode_;
  bool is_over_;
  SeenLines seen_lines_;
};

/// Threads: any, but one at a time; a second one is refused, and so is a child process that inherited it.
class EnvBatch {
 public:
  /// Errors: those of load_doom_game() and make_renderer(); kBadInput for sizes and for buttons without a .cfg.
  static Expected<std::unique_ptr<EnvBatch>> create(const BatchOptions& options);
  ~EnvBatch();

  const BatchOptions& options() const { return options_; }
  const EnvShape& shape() const { return shape_; }
  const scenarios::ScenarioSpec& spec() const { return spec_; }
  const BatchArrays& arrays() const { return arrays_; }
  const std::vector<std::string>& state_names() const { return state_names_; }
  const std::vector<std::string>& button_names() const { return button_names_; }
  /// What an agent's action consists of: heads, or buttons.
  int action_count() const {
    return options_.by_buttons ? static_cast<int>(buttons_.size()) : static_cast<int>(shape_.head_count);
  }

  /// Begins an episode in each environment that has a key; its next ones have the numbers that follow. `keys` [E].
  /// Errors: of the map; kBadInput for another count; misuse as below.
  Status reset(std::span<const std::optional<EpisodeKey>> keys);
  /// One decision in every environment, in the background. `action` [E, N, action_count()]: choices of heads, or what
  /// buttons get. Errors: kBadInput naming the place of a choice out of range or of a number that is none, of an episode
  /// that is over and of environments that were never reset; misuse as below.
  Status send(std::span<const int32_t> choices);
  Status send_buttons(std::span<const float> values);
  /// Until the decision is over and the arrays hold what it brought. Errors: without a send(); of the next map.
  Status receive();
  /// send() for the environments `indices` alone, `choices` [indices.size(), N, heads]. More may be sent before others are
  /// received; until all are, every other call is refused. Errors: of send(); an index outside or whose step is on its way.
  Status send_some(std::span<const int> indices, std::span<const int32_t> choices);
  /// Until `least` environments (or all that were sent, where these are fewer) are done: the indices of all that are, rising.
  /// Their rows of the arrays stay as they are until they are sent again. Errors: without a send_some(); of the next map.
  Expected<std::vector<int>> receive_some(int least);

  /// Errors: an index outside; misuse as below.
  Expected<std::shared_ptr<const SavedState>> state_of(int index);
  /// Continues from there, and draws it. Errors: kBadInput for a state of another scenario, team or frame skip.
  Status restore(int index, const SavedState& state);
  Expected<uint64_t> hash_of(int index);
  /// What the labels of an agent's picture are of, by rising value. Errors: of the indices; of environments without
  /// labels.
  Expected<std::vector<SeenThing>> things_seen(int index, int agent);
  /// The views of one environment at another size, planar RGB [N, 3, height, width]. Errors: of the size.
  Expected<std::vector<uint8_t>> draw(int index, int width, int height);
  /// Ends the threads, after a step that was sent. Everything but close() and the arrays is refused from then on.
  /// Errors: while another thread is in a call.
  Status close();
  bool is_closed() const { return works_ == nullptr; }

 private:
  struct Slot;
  struct Works;
  explicit EnvBatch(const BatchOptions& options);
  Status open();
  void size_arrays();
  /// Refuses a second thread, a child process, a closed batch, and a call between send() and receive().
  class Entry;
  /// In every thread; wait for it with finish(), or with Works::wait() where it `serves` jobs.
  void run(std::function<Status(int)> task, bool serves = false);
  Status finish();
  Status begin_episode(Slot& slot);
  Status check_can_step(const Slot& slot) const;
  /// `choices` [indices.size(), N, heads] against the heads, the environments' episodes and their steps on the way.
  Status check_step(std::span<const int> indices, std::span<const int32_t> choices) const;
  std::vector<int> all_indices() const;
  /// One decision of an environment, or its next episode's begin; its row of the arrays except for what is drawn.
  Status step_one(int index, const std::function<void(sim::DoomEnvironment&)>& act);
  /// A thread's work between send_some() and the call that ends it: its jobs in their order.
  Status serve(int thread);
  /// One decision in every thread: `act(environment, its index)` where an episode continues.
  void run_step(std::function<void(sim::DoomEnvironment&, std::size_t)> act);
  void write_numbers(int index);
  void draw_views(int thread, std::span<const int> indices);
  void draw_pictures(int thread, std::span<const int> indices);
  /// What is seen beside the picture.
  void draw_buffers(doom::Renderer& renderer, int index);

  BatchOptions options_;
  scenarios::ScenarioSpec spec_;
  EnvShape shape_;
  std::vector<std::string> state_names_, button_names_;
  std::vector<scenarios::Button> buttons_;
  std::vector<scenarios::GameVariable> variables_;  // of the measurements
  doom::AutomapOptions automap_;
  BatchArrays arrays_;
  std::unique_ptr<Works> works_;
  std::atomic<bool> is_entered_ = false;
  bool is_sent_ = false;
  int some_sent_ = 0;  // by send_some(), and not received
  const pid_t process_ = getpid();
};

}  // namespace comrad::python
