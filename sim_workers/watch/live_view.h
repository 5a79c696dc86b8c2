// Shows one environment live: every tic takes its time, is drawn and goes to the page; people press buttons there. Stage: beside
// step, for eyes.
#pragma once

#include <chrono>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>
#include <span>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/shm/arena.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/env/observation.h"
#include "sim_workers/watch/page_link.h"

namespace comrad::sim {

struct LiveViewOptions {
  ViewSize size{640, 360};       ///< of one agent's view
  double pictures_per_s = 17.5;  ///< at most
  std::vector<int> people = {};  ///< agents that people play
};

/// The page's commands:
///
///   {"do": "shown", "pages": 2}              how many pages look; without one nothing is played
///   {"do": "pause"} {"do": "run"}            a decision that is under way is played to its end first; then "pace" is "paused"
///   {"do": "step"}                           one decision, then pause
///   {"do": "begin"}                          the next episode, which people begin themselves
///   {"do": "speed", "times": 2}              of 35 tics a second; 0: as fast as it goes
///   {"do": "size", "width": 640, "height": 360}
///   {"do": "renderer", "name": "osmesa"}     one that cannot be had is named in "refused", and the last one stays
///   {"do": "press", "agent": 0, "choice": [1, 0]}   what a person holds down, by head; a tap counts once
///
/// What it sends: {"type": "began", ...} as an episode begins, {"type": "now", ...} with every picture. Threads: the
/// environment's.
class LiveView final : public TicWatcher {
 public:
  /// `is_stopping`: the worker is to end; nothing waits then. Errors: those of make_renderer().
  static Expected<std::unique_ptr<LiveView>> create(const LiveViewOptions& options,
                                                    const EnvironmentOptions& environments,
                                                    const DoomGame& first, PageLink link,
                                                    std::function<bool()> is_stopping);

  void began(const DoomEnvironment& environment) override;
  void ticked(const DoomEnvironment& environment) override;

  /// The page is closed, or the worker is to end.
  bool is_left() const { return link_.is_closed() || is_stopping_(); }
  /// Of a run whose page is closed: plays nothing more until the worker is to end.
  void rest_if_closed() const;
  /// Before a decision: puts what people press into `action` [N, heads].
  void press(std::span<int32_t> action);
  /// What the policies thought of the decision that follows: `value` [N], `logits` [N, A]; empty: nothing.
  void thought(std::vector<float> value, std::vector<float> logits);

 private:
  using Clock = std::chrono::steady_clock;
  enum class Pace { kRun, kPause, kStep };
  struct Person {
    std::vector<int32_t> held, tapped;
  };

  /// How views are drawn.
  struct Look {
    ViewSize size;
    RendererKind renderer = RendererKind::kPainter;
  };

  LiveView(const LiveViewOptions& options, const EnvironmentOptions& environments, const DoomGame& first,
           PageLink link, std::function<bool()> is_stopping);
  void obey(const nlohmann::json& command);
  void read_commands(int wait_ms);
  void wait_while(const DoomEnvironment& environment, const std::function<bool()>& waits);
  void pass_time(const DoomEnvironment& environment, double tics);
  void show(const DoomEnvironment& environment);
  nlohmann::json began_words(const DoomEnvironment& environment);
  nlohmann::json now_words(const DoomEnvironment& environment) const;
  Status make_renderer_of(const DoomGame& game, const Look& look);

  LiveViewOptions options_;
  const EnvironmentOptions environments_;
  PageLink link_;
  const std::function<bool()> is_stopping_;
  std::unique_ptr<doom::Renderer> renderer_;
  std::vector<std::vector<uint8_t>> views_;  ///< [N][3, height, width]
  std::map<int, Person> people_;
  int pages_ = 0;
  Pace pace_ = Pace::kRun;
  Look look_, wanted_look_;
  std::string refused_;  ///< why a look could not be had
  bool may_begin_ = false, is_look_new_ = false, is_waiting_ = false;
  double speed_ = 1;
  Clock::time_point due_{}, drawn_{};
  int tics_ = 0;  ///< of the decision under way
  uint64_t episodes_ = 0;
  std::vector<double> term_sums_;  ///< [term, N] since the episode began
  std::vector<float> value_, logits_;
};

/// The environments (one) with people and thoughts in between. `view` outlives them.
std::unique_ptr<EnvironmentSet> shown_environments(std::unique_ptr<EnvironmentSet> inner,
                                                   const shm::Arena& arena, LiveView& view);

}  // namespace comrad::sim
