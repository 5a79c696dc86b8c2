// ViZDoom's .cfg files: what to play, what may be pressed, what is shown, what pays. Keys compare without
// case and underscores; what is unknown is one warning, what cannot be meant is an error. Stage: loading.
#pragma once

#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "scenarios/spec/game_names.h"
#include "scenarios/spec/scenario_spec.h"

namespace comrad::scenarios {

/// What a step pays besides the map's own reward. "per" is times the change of the variable in the step.
struct VizdoomRewards {
  double living = 0;         ///< per tic
  double death_penalty = 0;  ///< taken off when the player dies
  double death = 0;          ///< paid when the player dies
  double map_exit = 0;
  double kill = 0, secret = 0, item = 0, frag = 0;  ///< per KILLCOUNT, SECRETCOUNT, ITEMCOUNT, FRAGCOUNT
  double hit = 0, damage_made = 0;                  ///< per HITCOUNT, DAMAGECOUNT
  double hit_taken = 0, damage_taken = 0;           ///< per HITS_TAKEN, DAMAGE_TAKEN; penalties are taken off
  double health = 0, armor = 0;                     ///< per point gained; losses pay nothing
};

/// What the game shows beside the picture. Python serves these (comrad.gym_env); training sees the picture alone.
struct VizdoomBuffers {
  bool depth = false, labels = false, automap = false;
  std::string automap_mode = "NORMAL";  ///< NORMAL, WHOLE, OBJECTS or OBJECTS_WITH_SIZE
  bool automap_rotates = false;
  bool gray = false;  ///< screen_format = GRAY8: pictures of one channel
};

struct VizdoomConfig {
  std::string path;           ///< of the file; begins every message
  std::string scenario_path;  ///< WAD; relative to the cfg where it was not absolute; empty: the IWAD's maps
  std::string game_path;      ///< IWAD; empty: where COMRAD looks for one
  std::string map = "MAP01";
  int scenario_line = 0, game_line = 0, map_line = 0;  ///< where the three stand; 0: nowhere
  int skill = 3;
  std::optional<uint64_t> seed;
  std::vector<Button> buttons;
  std::vector<std::string> button_names;  ///< parallel to buttons
  std::vector<GameVariable> variables;
  std::vector<std::string> variable_names;
  int timeout_tics = 0;  ///< episode_timeout, counted from the first step; 0: none
  VizdoomRewards rewards;
  int width = 320, height = 240;  ///< screen_resolution
  bool hud = false, minimal_hud = false, weapon = true, crosshair = false, screen_flashes = true,
       corpses = true, decals = true, particles = true, effects_sprites = true, messages = false;
  GameRules rules;  ///< from doom_skill, episode_start_time (at least 1 tic) and game_args
  bool forced_respawn = false;
  int respawn_delay_tics = 0;
  int host_count = 0;  ///< players that -host waits for; 0: not said, no network game
  VizdoomBuffers buffers;
  std::vector<std::string> warnings;         ///< "path:line: ..." of what is not understood or not served
  std::vector<std::string> buffer_warnings;  ///< the same of `buffers`, where they are not served
};

/// Reads a cfg file. Errors: kNotFound; kBadFormat as "path:line: what"; kBadInput for a value out of range.
Expected<VizdoomConfig> load_vizdoom_config(const std::string& path);

/// The same from text. `path` names it in messages, and relative paths start from its folder.
Expected<VizdoomConfig> parse_vizdoom_config(std::string_view text, const std::string& path);

/// The file as named, or in another case of its last part: a cfg comes from file systems that do not mind. `path`
/// itself where there is neither.
std::string existing_file(const std::string& path);

}  // namespace comrad::scenarios
