// How long a world tic takes: two players in a generated-size arena with 80 items and 60 tether nodes.
#include <benchmark/benchmark.h>

#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/arena.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace {

struct BenchGame {
  BenchGame() {
    ActorCatalog types;
    ActorType node;
    node.name = "TetherNode";
    node.radius = node.height = to_fixed(1);
    node.flags.set(ActorFlag::kNoGravity), node.flags.set(ActorFlag::kNoBlockmap);
    types.add_simple(node, "APLS", "AB", 4);
    catalog = std::make_shared<const ActorCatalog>(types);
    world = std::make_unique<World>(test::star_arena(), catalog);
    reset_world(*world, {.player_count = 2, .seed = 1});
    const uint32_t kit = catalog->find("Stimpack").value(), tether = catalog->find("TetherNode").value();
    while (world->count_actors(kit) < 80)
      spawn_actor(*world, kit, to_fixed(rng.between(-1000, 1000)), to_fixed(rng.between(-1000, 1000)), 0, 0);
    for (int i = 0; i < 60; ++i)
      nodes.push_back(spawn_actor(*world, tether, to_fixed(i), 0, to_fixed(20), 0, 0, true).value());
  }
  void press() {
    for (Buttons& player : buttons) {
      player = Buttons{};
      player.forward = rng.below(3) != 0, player.left = rng.below(3) == 0, player.right = rng.below(3) == 0;
      player.turn_left = rng.below(3) == 0, player.turn_right = rng.below(3) == 0;
    }
  }
  Rng rng{uint64_t{1}};
  std::shared_ptr<const ActorCatalog> catalog;
  std::unique_ptr<World> world;
  std::vector<uint32_t> nodes;
  std::array<Buttons, 2> buttons;
};

void BM_Tic(benchmark::State& state) {
  BenchGame game;
  int tic = 0;
  for (auto _ : state) {
    if (tic++ % 4 == 0) game.press();
    run_tic(*game.world, game.buttons);
  }
}
BENCHMARK(BM_Tic);

/// The tether's nodes follow the players every fifth tic.
void BM_TicWithMovingTether(benchmark::State& state) {
  BenchGame game;
  int tic = 0;
  for (auto _ : state) {
    if (tic % 4 == 0) game.press();
    run_tic(*game.world, game.buttons);
    if (tic++ % 5 != 0) continue;
    const Actor a = game.world->body(0), b = game.world->body(1);
    for (std::size_t i = 0; i < game.nodes.size(); ++i) {
      const auto part = static_cast<int64_t>(i + 1);
      set_position(*game.world, game.nodes[i], static_cast<Fixed>(a.x + (int64_t{b.x} - a.x) * part / 61),
                   static_cast<Fixed>(a.y + (int64_t{b.y} - a.y) * part / 61), a.z + to_fixed(20));
    }
  }
}
BENCHMARK(BM_TicWithMovingTether);

/// One room of 2048 units, 20 monsters on the hunt, two players who walk about and do not die.
void BM_TicWithTwentyMonsters(benchmark::State& state) {
  test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256);
  builder.room(room, -1024, -1024, 1024, 1024).thing(1, -128, 0).thing(2, 128, 0);
  const auto catalog = std::make_shared<const ActorCatalog>();
  World world(builder.build(), catalog);
  reset_world(world, {.player_count = 2, .seed = 1});
  const char* const kinds[] = {"Demon", "DoomImp", "ZombieMan", "Demon"};
  for (int i = 0; i < 20; ++i) {
    Actor& monster = world.spawn_unchecked(catalog->find(kinds[i % 4]).value(), to_fixed(-900 + 90 * i),
                                           to_fixed(i % 2 == 0 ? 700 : -700), kOnFloor);
    monster.target_id = world.body(i % 2).id;
    set_label(world, monster, StateLabel::kSee);
  }
  for (int player = 0; player < 2; ++player)
    world.body_of(player)->health = world.state().players[static_cast<std::size_t>(player)].health =
        1'000'000'000;
  Rng rng{uint64_t{1}};
  std::array<Buttons, 2> buttons{};
  int tic = 0;
  for (auto _ : state) {
    if (tic++ % 4 == 0) {
      for (Buttons& player : buttons) {
        player = Buttons{};
        player.forward = rng.below(3) != 0, player.left = rng.below(3) == 0, player.right = rng.below(3) == 0;
        player.turn_left = rng.below(3) == 0, player.turn_right = rng.below(3) == 0;
      }
    }
    run_tic(world, buttons);
  }
  state.counters["tics/s"] =
      benchmark::Counter(static_cast<double>(state.iterations()), benchmark::Counter::kIsRate);
  state.counters["actors"] = static_cast<double>(world.actors().size());
}
BENCHMARK(BM_TicWithTwentyMonsters);

void BM_Hash(benchmark::State& state) {
  BenchGame game;
  for (auto _ : state) benchmark::DoNotOptimize(game.world->hash());
}
BENCHMARK(BM_Hash);

void BM_Reset(benchmark::State& state) {
  BenchGame game;
  for (auto _ : state) reset_world(*game.world, {.player_count = 2, .seed = 1});
}
BENCHMARK(BM_Reset);

void BM_SectorAt(benchmark::State& state) {
  BenchGame game;
  for (auto _ : state)
    benchmark::DoNotOptimize(game.world->sector_at(to_fixed(game.rng.between(-1000, 1000)),
                                                   to_fixed(game.rng.between(-1000, 1000))));
}
BENCHMARK(BM_SectorAt);

}  // namespace
}  // namespace comrad::doom

BENCHMARK_MAIN();
