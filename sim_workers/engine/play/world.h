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
#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/map/level.h"

namespace comrad::doom {

/// What one player presses during one tic. Binary buttons as ViZDoom names them.
struct Buttons {
  bool forward = false, backward = false, left = false, right = false;  ///< move; left and right strafe
  bool turn_left = false, turn_right = false;
  bool attack = false, use = false, jump = false, speed = false;
  int8_t select_weapon = -1;  ///< slot, or -1
};

/// The kinds of things this engine knows; grows with the DECORATE and monster work.
struct ActorType {
  std::string name;            ///< class name, e.g. "Stimpack"
  int32_t editor_number = -1;  ///< -1: none
  Fixed radius = to_fixed(20), height = to_fixed(16);
  int32_t health = 1000, mass = 100;
  bool solid = false, shootable = false, pickup = false, is_player = false, no_gravity = false;
  bool no_blockmap = false;  ///< pure decoration: never blocks, never collides
  bool bright = false;       ///< drawn full-bright
  int32_t heal_amount = 0, heal_limit = 100;
  bool always_taken = false;  ///< a pickup that vanishes even where it has nothing to give
  std::string sprite;         ///< four letters
  float scale = 1.0f;         ///< size the sprite is drawn at, of its own
  /// Animation frames: letter index and tics (-1: forever). After a frame comes `next`, or, where that is -1,
  /// the one below it; the last one goes back to the first.
  struct Frame {
    uint8_t frame = 0;
    int16_t tics = -1;
    bool bright = false;
    int16_t next = -1;
  };
  std::vector<Frame> frames;
};

/// All actor types by name and editor number. Built-in ones are there from the start; scenarios add their
/// own.
class ActorCatalog {
 public:
  ActorCatalog();  ///< Player, player starts, Stimpack, Medikit, HealthBonus, ... of Doom
  /// Adds a type, which may replace one of the same name. Returns its index.
  uint32_t add(ActorType type);
  std::optional<uint32_t> find(std::string_view name) const;
  std::optional<uint32_t> find_editor_number(int32_t number) const;
  const ActorType& operator[](uint32_t index) const { return types_[index]; }
  std::size_t size() const { return types_.size(); }

 private:
  std::vector<ActorType> types_;
};

/// A live object of the world (Doom's mobj).
struct Actor {
  uint32_t id = 0;    ///< never reused inside a world
  uint32_t type = 0;  ///< index into the catalog
  Fixed x = 0, y = 0, z = 0;
  Fixed velocity_x = 0, velocity_y = 0, velocity_z = 0;
  Angle angle = 0;
  Fixed radius = 0, height = 0;
  Fixed floor_z = 0, ceiling_z = 0;  ///< of the opening it stands in
  uint32_t sector_index = 0;
  int32_t health = 0;
  int32_t thing_id = 0;      ///< TID of scripts; 0 none
  uint16_t frame_index = 0;  ///< into ActorType::frames
  int16_t frame_tics = -1;
  int32_t player_index = -1;  ///< -1: no player
  bool removed = false;       ///< taken out at the end of the tic
  bool is_corpse = false;
};

/// A player's own state, apart from its body.
struct Player {
  uint32_t actor_id = 0;
  int32_t health = 100;
  int32_t armor = 0;
  bool alive = true;
  int32_t turn_held_tics = 0;
  int32_t jump_tics = 0;     ///< until the next jump; -1 while in the air from one
  int32_t damage_flash = 0;  ///< red, counts down a tic at a time
  int32_t bonus_flash = 0;   ///< gold
  Fixed view_height = to_fixed(41);
  Fixed view_z = 0;             ///< eye height above zero, bob included
  Fixed view_height_delta = 0;  ///< how fast view_height returns after a step or a landing
  int32_t damage_taken = 0;     ///< total
  int32_t pickup_count = 0;     ///< items taken, total
  uint64_t death_tic = 0;
};

class World;
struct LevelIndex;

/// A scenario's rules: what its ACS scripts do, called at the places where the engine runs scripts. Native
/// rules use the same World calls that the script machine will use, and are replaced by scripts one by one.
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

/// A square of a HUD drawn by a script (tether bar and the like), in the frame of one player.
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
};

/// The world. Copying one is a snapshot.
class World {
 public:
  World(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog);

  /// Starts the map anew: sectors and things as loaded, players at their starts (or 0,0 without one), on_open
  /// and on_enter called. Things without a picture that touch nothing (map spots, teleport destinations)
  /// become no actors: scripts find them in level().things. `scripts` must outlive the world or the next
  /// reset; null: no rules.
  void reset(const WorldOptions& options, ScriptHost* scripts);

  /// One tic, in Doom's order: players think (turn, thrust, jump, eye, damage of the floor they stand on),
  /// then each actor in order of age moves and thinks, then scripts. `buttons` has one entry per player;
  /// missing ones press nothing. After the level was exited nothing moves any more.
  void tic(std::span<const Buttons> buttons);

  // Read side.
  uint64_t tic_count() const { return tic_count_; }  ///< map clock: tics finished since reset
  bool level_exited() const { return level_exited_; }
  int player_count() const { return static_cast<int>(players_.size()); }
  const Player& player(int index) const { return players_[index]; }
  const Actor& body(int index) const;  ///< the player's actor
  /// Live actors by rising id. Those with `removed` set leave at the end of the tic.
  std::span<const Actor> actors() const { return actors_; }
  const Actor* find_actor(uint32_t id) const;
  const Level& level() const { return *level_; }
  const std::shared_ptr<const Level>& shared_level() const { return level_; }  ///< for caches keyed by level
  std::span<const Sector> sectors() const { return sectors_; }  ///< current heights, lights, damage
  const ActorCatalog& catalog() const { return *catalog_; }
  const std::shared_ptr<const ActorCatalog>& shared_catalog() const { return catalog_; }
  std::span<const HudBox> hud() const { return hud_; }
  uint32_t sector_at(Fixed x, Fixed y) const;
  uint64_t hash() const;  ///< 64-bit hash of the whole world
  const WorldOptions& options() const { return options_; }
  int32_t exported(int index) const;  ///< USER1..USER60: index 1..60

  // What scripts do.
  Rng& rng() { return rng_; }
  std::optional<uint32_t> spawn(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle, int32_t thing_id = 0,
                                bool force = false);       ///< actor id; nothing where it does not fit
  void remove(uint32_t actor_id);                          ///< at the end of the tic; never a player's body
  bool try_teleport(uint32_t actor_id, Fixed x, Fixed y);  ///< moves where the body fits; z follows the floor
  void set_position(uint32_t actor_id, Fixed x, Fixed y, Fixed z);  ///< unchecked (decoration)
  void set_angle(uint32_t actor_id, Angle angle);
  void set_sector_damage(int32_t tag, int32_t amount, int32_t interval);
  void damage_player(int player, int32_t amount);
  void set_export(int index, int32_t value);
  void exit_level();
  void set_hud(std::vector<HudBox> boxes) { hud_ = std::move(boxes); }
  int count_actors(uint32_t type) const;

 private:
  friend class Movement;
  friend class PlayerThinker;

  /// Place of an actor in the lists of solid and touchable things, by slots of actors_.
  struct ThingLink {
    int32_t next = -1, previous = -1;
    int32_t cell = -1;  ///< -1: in no list
  };

  std::size_t append_actor(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle, int32_t thing_id);
  std::optional<std::size_t> slot_of(uint32_t id) const;
  Actor* find_live(uint32_t id);
  void link(std::size_t slot);
  void unlink(std::size_t slot);
  void remove_slot(std::size_t slot);
  void compact();
  void set_frame(Actor& actor, uint16_t frame_index);
  void advance_frames(Actor& actor);
  void spawn_players();
  void spawn_map_things();

  std::shared_ptr<const Level> level_;
  std::shared_ptr<const LevelIndex> index_;
  std::shared_ptr<const ActorCatalog> catalog_;
  std::vector<Sector> sectors_;
  std::vector<Actor> actors_;
  std::vector<ThingLink> links_;      // parallel to actors_
  std::vector<int32_t> cell_heads_;   // [cell of the blockmap] slot of the first thing, -1: none
  std::vector<int32_t> type_counts_;  // [type] live actors
  Fixed radius_max_ = 0;              // of the things in the lists; never shrinks within an episode
  bool has_removed_ = false;
  std::vector<Player> players_;
  std::vector<HudBox> hud_;
  std::array<int32_t, 64> exported_{};
  WorldOptions options_;
  ScriptHost* scripts_ = nullptr;
  Rng rng_{uint64_t{0}};
  uint64_t tic_count_ = 0;
  uint32_t next_actor_id_ = 1;
  bool level_exited_ = false;
};

}  // namespace comrad::doom
