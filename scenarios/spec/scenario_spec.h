// A scenario as data: everything in scenario.toml. One loader reads it; nothing about a scenario stands
// elsewhere than in its folder. Stage: what a frame, an action and a reward mean.
#pragma once

#include <algorithm>
#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "doomgen/wad/game_flags.h"
#include "rollout_buffer/core/expected.h"
#include "rollout_buffer/core/files.h"
#include "rollout_buffer/schema/spec.h"
#include "rollout_buffer/settings/schedule.h"
#include "rollout_buffer/settings/settings_layer.h"

namespace comrad::scenarios {

/// One factorised action head: index 0 is "none", index k the k-th button.
struct ActionHead {
  std::vector<std::string>
      buttons;  ///< as parse_press() reads them: MOVE_FORWARD, TURN_LEFT_RIGHT_DELTA=-10, ...
};

/// How the engine plays the map. The defaults are those of the folders with a scenario.toml; a ViZDoom .cfg has its own.
struct GameRules {
  int skill = 3;
  bool no_monsters = false, deathmatch = false, infinite_ammo = false;
  bool autoaim = false, free_look = false, allow_crouch = false, allow_jump = true;
  int start_tics = 0;    ///< pass before the first decision
  int timeout_tics = 0;  ///< of an episode, from there on; 0: decision_limit alone counts
  /// The death of an only player ends the episode, except in a network game; several come back.
  bool lone_death_ends = false;
  bool network_game = false;  ///< -host: of one player, too, whose death then does not end the episode
  bool always_run = false;    ///< cl_run: players run, and walk while they hold SPEED
  wad::GameFlags flags = {};  ///< those that have no field here are the engine's to read
  int frag_limit = 0;         ///< of a deathmatch: with so many the map ends; 0: none
  double gravity = 1.0;       ///< times the map's
  std::optional<double> air_control = {};  ///< part of a push that counts in the air; else the map's
};

/// One component of the measurement vector: clip(variable * scale + offset).
struct MeasurementTerm {
  std::string variable;
  int agent_stride = 0;  ///< agent i reads USER(k + i * stride)
  double scale = 1.0, offset = 0.0;
  double clip = 0.0;                ///< 0: none, else +- clip
  std::optional<double> low, high;  ///< further bounds
};

/// One reward term over a game variable (HEALTH, DEAD, USER4, ...).
struct RewardTerm {
  std::string name;
  std::string variable;
  int agent_stride = 0;       ///< agent i reads USER(k + i * stride): one global for each player
  std::string kind;           ///< delta, rise, fall, new_max, value, event
  Schedule weight = 0.0;      ///< a scenario sets a number; --reward may say one over env frames
  std::string scope = "own";  ///< own | team (a team variable; weight is divided by N when per_agent)
  double cap = 0.0;           ///< 0: none
  bool per_agent = false;     ///< divide the weight by N
  /// Variables, or empty: the term pays only in decisions after which `when` is not 0 and `unless` is 0.
  std::string when = {}, unless = {};
  std::string meaning = {};  ///< the comment behind its name, or empty
};

/// What one agent may not choose: of one head only `allowed` ("none" and buttons).
struct MaskTerm {
  int agent = 0, head = 0;
  std::vector<std::string> allowed;
};

/// One global variable of the script that others read by name: a row of [exports].
struct ScenarioExport {
  std::string name;
  int user = 0;         ///< 1..60: the number of the script's global variable, ViZDoom's USER<number>
  std::string meaning;  ///< the comment behind the row, or empty
  int line = 0;         ///< of scenario.toml
};

constexpr int kTicsPerDecision = 4;       ///< what decision limits are counted in
constexpr int kEngineLimitTics = 21'000;  ///< ten minutes, after which no episode continues

/// A whole number that scenario.toml gives something of another file, by name.
struct NamedNumber {
  std::string name;
  int64_t value = 0;
  std::string where;  ///< "path:line:column"
};

struct ScenarioSpec {
  std::string name, title, summary;  ///< the name of a variant is "stag_hunt_arena@reference"
  int version =
      1;  ///< goes up where maps, rules or rewards change, so that results of different versions are distinguished
  int difficulty = 0;
  int default_agents = 2;
  std::vector<int> supported_agents;
  std::vector<ActionHead> heads;
  int decision_limit = 0;
  bool respawn = false;
  int respawn_delay_tics = 0;
  double shared_reward_alpha = 0.0;
  std::string score;               ///< what J is: survival_tics, return, or a game variable at the end
  std::string score_meaning = {};  ///< the comment behind it, or empty
  int score_agent_stride = 0;
  double score_scale = 1.0;          ///< J = variable * scale
  std::string score_divisor;         ///< a game variable that J is divided by (1 where it is 0); empty: none
  std::string score_unit = "count";  ///< of J: tics, decisions, kills, share, reward or count
  double ceiling = 0.0;              ///< the best J on the default map of the default team; 0: not known
  bool maps_say_ceiling = true;  ///< false: `ceiling` holds for every map and team, whatever the map contains
  std::string wad;               ///< a scenario without recipe: its map, in `folder`
  std::vector<ScenarioExport>
      exports;  ///< in the order of the file; all variables below are by ViZDoom's names
  std::vector<MeasurementTerm> measurements;
  std::vector<RewardTerm> rewards;
  std::vector<MaskTerm> masks;
  bool hud = true, crosshair = false, screen_flashes = true, weapon = true;
  GameRules rules = {};
  std::string map = {};                    ///< of the WAD; empty: its first
  std::string iwad = {};                   ///< textures and sprites; empty: where COMRAD looks for them
  bool is_vizdoom = false;                 ///< from a .cfg (vizdoom_scenario.h), not from a folder
  std::vector<std::string> warnings = {};  ///< "path:line: ..." of what is not understood or not served
  std::vector<NamedNumber> globals;        ///< exports or USER<number> that the script finds set
  std::vector<NamedNumber> layout;         ///< layout parameters in place of the recipe's defaults
  SettingsLayer training;                  ///< its rows of the recipes; keys "<preset>.<algorithm>.<setting>"
  /// The scenario whose maps, scripts and actors it plays, and their folder: its own, or those of its base.
  std::string maps_of, folder;
  int maps_version = 1;  ///< of that scenario

  /// Of its observations and actions; without a global state, see global_state.h.
  EnvShape shape(int num_agents, bool use_measurements) const;
  /// The number of the USER variable that [exports] calls `wanted`. Errors: kBadFormat with the nearest name.
  Expected<int> user_number(std::string_view wanted) const;
  /// The same, or that of "USER<number>".
  Expected<int> global_number(const std::string& wanted) const;
  /// Those of several. Errors: as user_number().
  Expected<std::vector<int>> user_numbers(const std::vector<std::string_view>& wanted) const;
  /// When episodes are cut off, tics.
  int limit_tics() const {
    return rules.timeout_tics > 0 ? rules.start_tics + rules.timeout_tics
                                  : std::min(kTicsPerDecision * decision_limit, kEngineLimitTics);
  }
};

/// Reads the scenario.toml of a scenario, by its name or by the path of its folder (scenario_files.h), and the file of the
/// variant that "@variant" behind it names; a path that ends in .cfg is a ViZDoom configuration (vizdoom_scenario.h).
/// Errors: kNotFound listing the known names; kBadFormat with line, column and the offending key.
Expected<ScenarioSpec> load_scenario(const std::string& name);

/// Names of all scenarios below data_dir() and in COMRAD_SCENARIO_PATH, sorted.
std::vector<std::string> list_scenarios();

}  // namespace comrad::scenarios
