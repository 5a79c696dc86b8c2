// One player's game to trace: a ViZDoom .cfg or a scenario of COMRAD's. Stage: tic > step.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/game_names.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/env/doom_env.h"
#include "sim_workers/trace/trace_actions.h"

namespace comrad::trace {

struct GameOptions {
  std::string target;    ///< FILE.cfg, or the name of a scenario
  std::string wad_path;  ///< instead of the cfg's; of a scenario: its layout. Empty: drawn from `layout_seed`
  uint64_t layout_seed = 42;
  bool no_monsters = false;
  bool no_timeout = false;  ///< of a cfg: its episode_timeout does not count
};

/// The first agent's buttons; the others stand still.
class TraceGame {
 public:
  /// `game` has a frame_skip of 1.
  explicit TraceGame(std::shared_ptr<const sim::DoomGame> game);

  /// Starts an episode; the world is then as row t = 0 shows it.
  void reset(uint64_t seed) { environment_.reset(seed); }
  /// One tic. Returns its reward.
  double step(const doom::Buttons& buttons);
  bool finished() const { return environment_.last_step().episode_over(); }
  doom::World& world() { return environment_.world(); }
  /// As read_variable(), but a cfg's HEALTH is the body's, which is below 0 after a death, as in ViZDoom.
  double variable(const scenarios::GameVariable& variable) const;

  std::string title;                       ///< of the first line of a trace
  std::vector<scenarios::Button> buttons;  ///< what random actions choose from
  std::vector<std::string> button_names;   ///< parallel
  uint64_t default_seed = 42;              ///< where none is given
  std::string iwad_path;                   ///< of the art; empty: found
  std::vector<std::string> art_paths;      ///< PWADs with art
  doom::RenderOptions render;              ///< what the game shows; the size is the caller's
  std::vector<std::string> warnings;

 private:
  sim::DoomEnvironment environment_;
  std::vector<doom::Buttons> pressed_;
};

/// Errors: kNotFound, kBadFormat, kBadInput, kUnsupported; the message names file and place.
Expected<std::unique_ptr<TraceGame>> open_trace_game(const GameOptions& options);

/// Puts player 0 into a pose.
void set_pose(doom::World& world, const Pose& pose);

}  // namespace comrad::trace
