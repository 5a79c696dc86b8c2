// One player's game to trace: a ViZDoom .cfg or a scenario of COMRAD's. Stage: tic > step.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/game_names.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/engine/world/world.h"
#include "sim_workers/trace/trace_actions.h"

namespace comrad::trace {

struct GameOptions {
  std::string target;    ///< FILE.cfg, or the name of a scenario
  std::string wad_path;  ///< instead of the cfg's; of a scenario: its layout. Empty: drawn from `layout_seed`
  uint64_t layout_seed = 42;
  bool no_monsters = false;
  bool no_timeout = false;  ///< of a cfg: its episode_timeout does not count
};

class TraceGame {
 public:
  virtual ~TraceGame() = default;
  /// Starts an episode; the world is then as row t = 0 shows it.
  virtual void reset(uint64_t seed) = 0;
  /// One tic. Returns its reward.
  virtual double step(const doom::Buttons& buttons) = 0;
  virtual bool finished() const = 0;
  virtual doom::World& world() = 0;
  virtual double variable(const scenarios::GameVariable& variable) const = 0;

  std::string title;                       ///< of the first line of a trace
  std::vector<scenarios::Button> buttons;  ///< what random actions choose from
  std::vector<std::string> button_names;   ///< parallel
  uint64_t default_seed = 42;              ///< where none is given
  std::string iwad_path;                   ///< of the art; empty: found
  std::vector<std::string> art_paths;      ///< PWADs with art
  doom::RenderOptions render;              ///< what the game shows; the size is the caller's
  std::vector<std::string> warnings;
};

/// Errors: kNotFound, kBadFormat, kBadInput, kUnsupported; the message names file and place.
Expected<std::unique_ptr<TraceGame>> open_trace_game(const GameOptions& options);

/// Puts player 0 into a pose.
void set_pose(doom::World& world, const Pose& pose);

}  // namespace comrad::trace
