// A world for tests of monsters: one player, actors put where a test requires them.
#pragma once

#include <functional>
#include <memory>
#include <string_view>
#include <vector>

#include "sim_workers/engine/play/monsters.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/level_builder.h"

namespace comrad::doom::test {

inline const std::shared_ptr<const ActorCatalog>& game_catalog() {
  static const auto kCatalog = std::make_shared<const ActorCatalog>();
  return kCatalog;
}

/// A room of 2048 units; the player's start is in its middle and looks east.
inline LevelBuilder big_room() {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256);
  builder.room(room, -1024, -1024, 1024, 1024).thing(1, 0, 0);
  return builder;
}

struct Stage {
  explicit Stage(std::shared_ptr<const Level> level = big_room().build(), WorldOptions options = {},
                 std::shared_ptr<const ActorCatalog> actors = game_catalog())
      : catalog(std::move(actors)), world(std::move(level), catalog) {
    reset_world(world, options);
    for (int player = 0; player < options.player_count; ++player)
      body(player).reaction_tics = 0;  // no birth pause
    buttons.resize(static_cast<std::size_t>(options.player_count));
  }

  Actor& spawn(std::string_view type, int x, int y, int angle_degrees = 0, int z = 0) {
    Actor& actor = world.spawn_unchecked(catalog->find(type).value(), to_fixed(x), to_fixed(y), to_fixed(z),
                                         degrees_to_angle(angle_degrees));
    actor.reaction_tics = 0;
    return actor;
  }
  /// The same actor later; it must not be gone.
  Actor& at(uint32_t id) { return *world.actor(id); }
  Actor& body(int player = 0) { return *world.body_of(player); }
  const Player& player(int index = 0) const { return world.player(index); }
  void make_player_tough(int32_t health = 1'000'000) {
    for (int index = 0; index < world.player_count(); ++index) {
      body(index).health = health;
      world.state().players[static_cast<std::size_t>(index)].health = health;
    }
  }
  void tics(int count) {
    for (int i = 0; i < count; ++i) run_tic(world, buttons);
  }
  /// Until `done`; false when `limit` tics were not enough.
  bool tics_until(int limit, const std::function<bool()>& done) {
    for (int i = 0; i < limit; ++i) {
      if (done()) return true;
      tics(1);
    }
    return done();
  }
  int count(std::string_view type) const { return world.count_actors(catalog->find(type).value()); }
  bool is_in(const Actor& actor, StateLabel label, int states = 8) const {
    const uint32_t first = world.type_of(actor).state(label);
    return actor.state >= first && actor.state < first + static_cast<uint32_t>(states);
  }

  std::shared_ptr<const ActorCatalog> catalog;
  World world;
  std::vector<Buttons> buttons;
};

}  // namespace comrad::doom::test
