// What changes while a map is played, as plain data; a copy is a snapshot. Actors, players, movers and scripts
// have their own headers. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "doomgen/wad/game_flags.h"
#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/map/level.h"
#include "sim_workers/engine/world/actor.h"
#include "sim_workers/engine/world/machine_state.h"
#include "sim_workers/engine/world/mover_state.h"
#include "sim_workers/engine/world/player.h"
#include "sim_workers/engine/world/stable_list.h"

namespace comrad::doom {

struct WorldOptions {
  int player_count = 1;
  uint64_t seed = 0;
  int skill = 3;
  bool crosshair = true;
  bool no_monsters = false;
  bool autoaim =
      false;  ///< sv_noautoaim 0: full auto-aim; false: only the slope that free look's absence gives
  bool free_look = false;
  bool allow_crouch = false, allow_jump = true;
  bool forced_respawn = false;  ///< dead players come back by themselves
  int respawn_delay_tics = 0;
  bool network_game = false;  ///< also with one player: things of cooperative games; USE brings the dead back
  bool always_run = false;    ///< players run, and walk while they hold SPEED
  bool deathmatch = false;
  bool infinite_ammo = false;
  bool start_at_deathmatch_starts = false;  ///< where a map has no start of a player's own
  wad::GameFlags flags = {};                ///< those without a field here; a deathmatch sets what it implies
  bool exit_takes_a_tic = false;            ///< in which nothing moves, as in ViZDoom
  int frag_limit = 0;                       ///< of a deathmatch; 0: none
  Fixed gravity = kFracUnit;                ///< times the level's
  std::optional<Fixed> air_control = {};    ///< else the level's
};

/// A linedef as play changes it.
struct LineState {
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  uint32_t flags = 0;
  int32_t id = 0;
  float alpha = -1.0f;  ///< of its middle textures; below 0: as in the level
};

/// A sidedef as play changes it.
struct SideState {
  std::string top, bottom, middle;
  Fixed scroll_x = 0, scroll_y = 0;  ///< added to its offsets
  bool retextured = false;           ///< differs from the level: the renderer looks the names up anew
};

/// Place of an actor in the lists of solid and touchable things, by slots of `actors`.
struct ThingLink {
  int32_t next = -1, previous = -1;
  int32_t cell = -1;  ///< -1: in no list
};

/// Everything that changes while a world runs; a plain value. Play, specials and scripts write it; env/ and
/// render/ read it.
struct WorldState {
  uint64_t tic_count = 0;
  bool level_exited = false;
  bool leaves_level = false;  ///< the next tic is the last
  bool exited_secretly = false;
  uint32_t next_actor_id = 1;
  uint32_t next_thing_order = 1;
  StableList<Actor> actors;
  StableList<ThingLink> links;                ///< parallel to actors
  std::vector<int32_t> cell_heads;            ///< [cell of the blockmap] slot of the first thing, -1: none
  std::vector<int32_t> type_counts;           ///< [type] live actors
  std::vector<uint32_t> sector_sound_target;  ///< [sector] id of who made the last noise heard there
  std::vector<uint64_t> sector_sound_tic;
  std::vector<uint8_t> sound_blocks;  ///< scratch of alert_monsters(), as the next two; not part of the hash
  std::vector<uint32_t> sound_queue, sound_queue_later;
  Fixed radius_max = 0;  ///< of the things in the lists; never shrinks within an episode
  bool has_removed = false;
  std::vector<Player> players;
  std::vector<Sector> sectors;
  std::vector<LineState> lines;
  std::vector<SideState> sides;
  MoverState movers;                  ///< doors, lifts, lights, scrollers, polyobjects (specials/)
  acs::MachineState scripts;          ///< running scripts, map variables, HUD messages (acs/)
  std::array<int32_t, 64> globals{};  ///< ACS global variables; 1..60 are USER1..USER60, 0 ViZDoom's reward
  int32_t monster_count = 0, item_total = 0, secret_total = 0;  ///< of the map
  int32_t kill_total = 0, item_taken = 0, secret_found = 0;     ///< by all
  bool has_special_friction = false;                            ///< some sector is ice or mud
  Fixed gravity = kFracUnit;                                    ///< units/tic^2
  Fixed air_control = kAirControl;
  std::vector<uint32_t> corpse_ids;
  struct BrainState {
    uint32_t next_spot = 0;
    bool easy_skip = false;
  } brain;
  Rng rng{uint64_t{0}};
};

}  // namespace comrad::doom
