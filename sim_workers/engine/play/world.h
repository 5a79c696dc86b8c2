// One Doom world in play: N players, the things around them, one tic at a time. No globals: many worlds live
// in one process, sharing the immutable Level and ActorCatalog. Stage: tic.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/acs/machine_state.h"
#include "sim_workers/engine/actors/actor_catalog.h"
#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/map/level.h"
#include "sim_workers/engine/play/actor.h"
#include "sim_workers/engine/play/player.h"
#include "sim_workers/engine/play/stable_list.h"
#include "sim_workers/engine/specials/mover_state.h"

namespace comrad::doom {

/// Actors of one world at a time; scripts and states that make more make none.
constexpr std::size_t kActorsMax = 1 << 14;

class World;
struct LevelIndex;
namespace acs {
class Behavior;
}

/// A scenario's rules in C++: called at the places where the engine runs scripts. Maps with a BEHAVIOR lump
/// need none.
class ScriptHost {
 public:
  virtual ~ScriptHost() = default;
  virtual void on_open(World& world) = 0;               ///< map start, after things spawned
  virtual void on_enter(World& world, int player) = 0;  ///< a player entered
  virtual void on_tic(World& world) = 0;                ///< delayed scripts that are due
  virtual void on_death(World& world, int player) { (void)world, (void)player; }
  virtual void on_pickup(World& world, int player, const Actor& item) {
    (void)world, (void)player, (void)item;
  }
};

/// A square of a HUD drawn by native rules (tether bar and the like), in the frame of one player.
struct HudBox {
  int player = -1;                    ///< -1: everyone
  float x = 0.5f, y = 0.5f;           ///< centre as a fraction of the screen
  float width = 0.0f, height = 0.0f;  ///< fractions of the screen
  std::array<uint8_t, 3> color{};
};

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
  bool deathmatch = false;
  bool infinite_ammo = false;
  bool start_at_deathmatch_starts = false;  ///< where a map has no start of a player's own
};

/// A linedef as play changes it.
struct LineState {
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  uint32_t flags = 0;
  int32_t id = 0;
  float alpha = -1.0f;  ///< of its middle textures; below 0 as the level says
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
/// render/ read it through World.
struct WorldState {
  uint64_t tic_count = 0;
  bool level_exited = false;
  bool exited_secretly = false;
  uint32_t next_actor_id = 1;
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
  std::vector<HudBox> hud;
  int32_t monster_count = 0, item_total = 0, secret_total = 0;  ///< of the map
  int32_t kill_total = 0, item_taken = 0, secret_found = 0;     ///< by all
  Fixed gravity = kFracUnit;                                    ///< units/tic^2
  Fixed air_control = 256;
  std::vector<uint32_t> corpse_ids;
  struct BrainState {
    uint32_t next_spot = 0;
    bool easy_skip = false;
  } brain;
  Rng rng{uint64_t{0}};
};

/// The world. Copying one is a snapshot.
class World {
 public:
  World(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog,
        std::shared_ptr<const acs::Behavior> behavior = nullptr);

  /// Starts the map anew: sectors and things as loaded, players at their starts (or 0,0 without one), OPEN
  /// and ENTER scripts run, on_open and on_enter called. Things without a picture that touch nothing (map
  /// spots, teleport destinations) become no actors unless they have a thing id. `scripts` must outlive the
  /// world or the next reset; null: no native rules.
  void reset(const WorldOptions& options, ScriptHost* scripts);

  /// One tic, in Doom's order: players think (turn, thrust, jump, eye, weapon, damage of the floor they stand
  /// on), then each actor in order of age moves and thinks, then movers, then scripts. `buttons` has one
  /// entry per player; missing ones press nothing. After the level was exited nothing moves any more.
  void tic(std::span<const Buttons> buttons);

  // Read side.
  uint64_t tic_count() const { return state_.tic_count; }  ///< map clock: tics finished since reset
  bool level_exited() const { return state_.level_exited; }
  int player_count() const { return static_cast<int>(state_.players.size()); }
  const Player& player(int index) const { return state_.players[static_cast<std::size_t>(index)]; }
  const Actor& body(int index) const;  ///< the player's actor
  /// Live actors by rising id. Those with `removed` set leave at the end of the tic.
  const StableList<Actor>& actors() const { return state_.actors; }
  const Actor* find_actor(uint32_t id) const;
  const Level& level() const { return *level_; }
  const std::shared_ptr<const Level>& shared_level() const { return level_; }  ///< for caches keyed by level
  std::span<const Sector> sectors() const { return state_.sectors; }  ///< current heights, lights, damage
  std::span<const SideState> sides() const { return state_.sides; }
  std::span<const LineState> lines() const { return state_.lines; }
  const ActorCatalog& catalog() const { return *catalog_; }
  const std::shared_ptr<const ActorCatalog>& shared_catalog() const { return catalog_; }
  const std::shared_ptr<const acs::Behavior>& behavior() const { return behavior_; }
  std::span<const HudBox> hud() const { return state_.hud; }
  uint32_t sector_at(Fixed x, Fixed y) const;
  uint64_t hash() const;  ///< hash_of(state())
  const WorldOptions& options() const { return options_; }
  int32_t exported(int index) const;  ///< USER1..USER60: index 1..60
  const WorldState& state() const { return state_; }

  // Write side, for play/, specials/, acs/ and native rules.
  WorldState& state() { return state_; }
  const LevelIndex& index() const { return *index_; }
  ScriptHost* script_host() const { return scripts_; }
  Rng& rng() { return state_.rng; }
  int random_byte() { return static_cast<int>(state_.rng.below(256)); }  ///< 0..255
  int random_triangle() {
    const int first = random_byte();
    return first - random_byte();
  }                           ///< -255..255
  Actor* actor(uint32_t id);  ///< null: nobody, or gone
  Actor* body_of(int player) { return actor(state_.players[static_cast<std::size_t>(player)].actor_id); }
  Player* player_of(const Actor& actor) {
    return actor.player_index >= 0 ? &state_.players[static_cast<std::size_t>(actor.player_index)] : nullptr;
  }
  const ActorType& type_of(const Actor& actor) const { return (*catalog_)[actor.type]; }
  std::size_t slot_of(const Actor& actor) const;

  /// Makes an actor whether it fits or not (Doom's P_SpawnMobj); z may be kOnFloor or kOnCeiling.
  Actor& spawn_unchecked(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle = 0);
  std::optional<uint32_t> spawn(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle, int32_t thing_id = 0,
                                bool force = false);       ///< actor id; nothing where it does not fit
  void remove(uint32_t actor_id);                          ///< at the end of the tic; never a player's body
  bool try_teleport(uint32_t actor_id, Fixed x, Fixed y);  ///< moves where the body fits; z follows the floor
  void set_position(uint32_t actor_id, Fixed x, Fixed y, Fixed z);  ///< unchecked
  void set_angle(uint32_t actor_id, Angle angle);
  /// Enters a state and runs its action, then those of states of no tics. False when the actor was removed by
  /// it.
  bool set_state(Actor& actor, uint32_t state);
  bool set_label(Actor& actor,
                 StateLabel label);  ///< false where the type has no such label, or the actor is gone
  void set_thing_id(Actor& actor, int32_t thing_id);
  /// The next actor with that id, in order of age, after `after` (an actor id, 0 from the start); null at the
  /// end.
  Actor* find_thing(int32_t thing_id, uint32_t after = 0);
  void link(Actor& actor);  ///< into the lists of things, after its place or its flags changed
  void unlink(Actor& actor);
  void set_sector_damage(int32_t tag, int32_t amount, int32_t interval);
  void damage_player(int player, int32_t amount);
  void set_export(int index, int32_t value);
  void exit_level();
  void set_hud(std::vector<HudBox> boxes) { state_.hud = std::move(boxes); }
  int count_actors(uint32_t type) const;
  bool respawn_player(int player);  ///< at its start; false while something solid stands there

 private:
  std::size_t append_actor(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle, int32_t thing_id);
  std::optional<std::size_t> find_slot(uint32_t id) const;
  void remove_slot(std::size_t slot);
  void link_slot(std::size_t slot);
  void unlink_slot(std::size_t slot);
  void compact();
  void spawn_players();
  void spawn_player(int index, Fixed x, Fixed y, Angle angle);
  void spawn_map_things();
  void tic_actor(std::size_t slot);

  std::shared_ptr<const Level> level_;
  std::shared_ptr<const LevelIndex> index_;
  std::shared_ptr<const ActorCatalog> catalog_;
  std::shared_ptr<const acs::Behavior> behavior_;
  WorldOptions options_;
  ScriptHost* scripts_ = nullptr;
  WorldState state_;
};

constexpr Fixed kOnFloor = INT32_MIN, kOnCeiling = INT32_MAX;  ///< for z of spawn_unchecked

/// Distance of two points as Doom estimates it: the longer axis plus half of the shorter one.
Fixed approximate_distance(Fixed dx, Fixed dy);
/// The angle from one point to another, from an arctangent table: the same on every machine.
Angle angle_to(Fixed from_x, Fixed from_y, Fixed to_x, Fixed to_y);

}  // namespace comrad::doom
