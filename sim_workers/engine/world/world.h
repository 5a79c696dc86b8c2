// One Doom world: N players and the things around them, on a map that other worlds share. No globals: many worlds
// live in one process. Here is what needs nothing but the state: finding, linking, making and removing actors.
// How they move and act is in play/, specials/ and acs/; tic/tic.h makes it go. Stage: tic.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <utility>
#include <vector>

#include "sim_workers/engine/actors/actor_catalog.h"
#include "sim_workers/engine/world/world_events.h"
#include "sim_workers/engine/world/world_state.h"

namespace comrad::doom {

/// Actors of one world at a time; scripts and states that make more make none.
constexpr std::size_t kActorsMax = 1 << 14;

struct LevelIndex;
namespace acs {
class Behavior;
}

/// The world. Copying one is a snapshot.
class World {
 public:
  World(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog,
        std::shared_ptr<const acs::Behavior> behavior = nullptr);

  // Read side.
  uint64_t tic_count() const { return state_.tic_count; }  ///< map clock: tics finished since reset
  bool level_exited() const { return state_.level_exited; }
  int player_count() const { return static_cast<int>(state_.players.size()); }
  bool is_multiplayer() const { return player_count() > 1 || options().network_game; }
  bool has(wad::GameFlag flag) const { return options_.flags.has(flag); }
  bool is_fast() const { return options_.skill >= 5 || has(wad::GameFlag::kFastMonsters); }
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
  uint32_t sector_at(Fixed x, Fixed y) const;
  uint64_t hash() const;  ///< hash_of(state())
  const WorldOptions& options() const { return options_; }
  int32_t exported(int index) const;  ///< USER1..USER60: index 1..60
  const WorldState& state() const { return state_; }

  // Write side, for play/, specials/ and acs/.
  /// The map as loaded, without actors: reset_world()'s first step. `events` must outlive the world or the
  /// next start.
  void start(const WorldOptions& options, const WorldEvents* events);
  const WorldEvents& events() const { return *events_; }
  WorldState& state() { return state_; }
  const LevelIndex& index() const { return *index_; }
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
  /// The same without a limit of their number. Its slot.
  std::size_t append_actor(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle, int32_t thing_id);
  void drop_last_actor();          ///< takes the one that append_actor() made back, as if it had never been
  void remove(uint32_t actor_id);  ///< at the end of the tic; never a player's body
  void remove_slot(std::size_t slot);
  void compact();  ///< takes the removed out of the lists; the end of a tic
  void set_angle(uint32_t actor_id, Angle angle);
  void set_thing_id(Actor& actor, int32_t thing_id) {
    actor.thing_id = thing_id;
    if (thing_id != 0) actor.thing_order = state_.next_thing_order++;
  }
  /// Of the actors with that id the one that got it last, of those with a thing_order below `before`; null: none.
  Actor* find_thing(int32_t thing_id, uint32_t before = UINT32_MAX);
  /// Calls visit(actor) for every thing with that id, the latest first, those that it makes left out; id 0 is the activator, if
  /// there is one. How many there were.
  template <typename Visit>
  int32_t each_thing(int32_t thing_id, Actor* activator, Visit visit) {
    if (thing_id == 0) {
      if (activator == nullptr || activator->removed) return 0;
      visit(*activator);
      return 1;
    }
    int32_t count = 0;
    for (Actor* actor = find_thing(thing_id); actor != nullptr;) {
      const uint32_t order = actor->thing_order;
      visit(*actor);
      ++count;
      actor = find_thing(thing_id, order);
    }
    return count;
  }
  void link(Actor& actor);  ///< into the lists of things, after its place or its flags changed
  void unlink(Actor& actor);
  void set_sector_damage(int32_t tag, int32_t amount, int32_t interval);
  void set_export(int index, int32_t value);
  /// Gives a bridge the size that its arguments say.
  void size_bridge(Actor& actor) const;
  void exit_level() { (options_.exit_takes_a_tic ? state_.leaves_level : state_.level_exited) = true; }
  int count_actors(uint32_t type) const;
  std::optional<std::size_t> find_slot(uint32_t id) const;

 private:
  void link_slot(std::size_t slot);
  void unlink_slot(std::size_t slot);

  std::shared_ptr<const Level> level_;
  std::shared_ptr<const LevelIndex> index_;
  std::shared_ptr<const ActorCatalog> catalog_;
  std::shared_ptr<const acs::Behavior> behavior_;
  WorldOptions options_;
  const WorldEvents* events_ = nullptr;
  WorldState state_;
};

constexpr Fixed kOnFloor = INT32_MIN, kOnCeiling = INT32_MAX;  ///< for z of spawn_unchecked

}  // namespace comrad::doom
