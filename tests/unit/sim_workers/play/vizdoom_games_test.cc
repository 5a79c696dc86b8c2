// Rules that random games beside ViZDoom 1.3.2 showed (tests/parity/random_games.py): missiles and blasts, the inventory bar,
// powers, teleports, bodies that overlap. Each value was measured in a separate small map.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "sim_workers/engine/actors/decorate.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/weapons.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace vizdoom_games_test {

std::shared_ptr<const ActorCatalog> catalog_with(const std::string& decorate) {
  auto own = std::make_shared<ActorCatalog>();
  std::vector<std::string> warnings;
  EXPECT_TRUE(parse_decorate(decorate, "test", own.get(), &warnings));
  EXPECT_TRUE(warnings.empty()) << warnings.front();
  return own;
}

const std::shared_ptr<const ActorCatalog>& builtin() {
  static const auto kCatalog = std::make_shared<const ActorCatalog>();
  return kCatalog;
}

/// A player at (0, 0) in a room of `half` to each side, facing east.
test::LevelBuilder room(int half = 512, int floor = 0, int ceiling = 256) {
  test::LevelBuilder builder;
  builder.room(builder.sector(floor, ceiling, 1), -half, -half, half, half).thing(1, 0, 0);
  return builder;
}

struct Game {
  explicit Game(std::shared_ptr<const Level> level, WorldOptions options = {},
                std::shared_ptr<const ActorCatalog> catalog = builtin())
      : world(std::move(level), std::move(catalog)) {
    reset_world(world, options);
    body().reaction_tics = 0;
  }
  Actor& body() { return *world.body_of(0); }
  Player& player() { return world.state().players[0]; }
  uint32_t type(std::string_view name) { return world.catalog().find(name).value(); }
  void tic(const Buttons& keys = {}, int count = 1) {
    for (int i = 0; i < count; ++i) run_tic(world, {&keys, 1});
  }
  World world;
};

// ---------------------------------------------------------------- missiles and blasts

// Probe: A_FireCustomMissile of speed 200 with SetActorPitch (65536 to a turn, down) at 0 degrees; two units of the last bit, because
// ViZDoom's own depend on the processor.
TEST(VizdoomGames, AMissileKeepsItsSpeedAtEveryPitch) {
  const auto own = catalog_with("actor M 20100 { Projectile Speed 200 States { Spawn: TNT1 A 1 loop } }");
  for (const auto& [pitch, across, up] :
       {std::tuple{-532, 13'090'409, 663'230}, std::tuple{-464, 13'094'677, 572'820},
        std::tuple{12, 13'107'196, -10'000}, std::tuple{80, 13'106'816, -100'401},
        std::tuple{-5, 13'107'200, 0}}) {
    Game game(room(8000, -8000, 8000).build(), {.free_look = true}, own);
    game.body().pitch = static_cast<Angle>(pitch) << 16;
    const Actor* missile = spawn_player_missile(game.world, game.body(), game.type("M"), 0, 0, 0, 0);
    ASSERT_NE(missile, nullptr);
    EXPECT_NEAR(missile->velocity_x, across, 2) << pitch;
    EXPECT_NEAR(missile->velocity_z, up, 2) << pitch;
  }
}

// Probe: a body of 40 at 400 east whose feet are at z, auto-aim: halfway between the pitches to its top and its bottom, seen from
// its near side.
TEST(VizdoomGames, AutoAimMeasuresToTheNearSide) {
  const auto own = catalog_with(
      "actor M 20100 { Projectile Speed 50 States { Spawn: TNT1 A 1 loop } }\n"
      "actor T 20300 { Radius 20 Height 40 +SHOOTABLE +NOGRAVITY Health 1000 States { Spawn: TNT1 A -1 stop "
      "} }");
  for (const auto& [z, across, up] :
       {std::tuple{44, 3'268'107, 238'515}, std::tuple{176, 3'021'429, 1'268'219},
        std::tuple{297, 2'692'984, 1'866'882}, std::tuple{308, 3'276'800, 0}}) {
    Game game(room(4000, 0, 4000).thing(20300, 400, 0, 0, 7).build(), {.autoaim = true}, own);
    set_position(game.world, game.world.find_thing(7)->id, to_fixed(400), 0, to_fixed(z));
    const Actor* missile = spawn_player_missile(game.world, game.body(), game.type("M"), 0, 0, 0, 0);
    ASSERT_NE(missile, nullptr);
    EXPECT_NEAR(missile->velocity_x, across, 2) << z;
    EXPECT_NEAR(missile->velocity_z, up, 2) << z;
  }
}

// Probe: A_FireCustomMissile("M", 0, 0, 8) at 0, 45 and 200 degrees: the missile starts 8 units to the right.
TEST(VizdoomGames, AMissilesOffsetIsToTheRight) {
  const auto own = catalog_with(
      "actor M 20100 { Projectile Speed 1 Radius 6 Height 16 States { Spawn: TNT1 A 1 loop } }\n"
      "actor W : Weapon 20400 { States { Ready: TNT1 A 1 A_WeaponReady loop Select: TNT1 A 1 A_Raise loop "
      "Deselect: TNT1 A 1 A_Lower loop Fire: TNT1 A 60 A_FireCustomMissile(\"M\", 0, 0, 8) goto Ready } }");
  struct Case {
    int degrees;
    double x, y;
  };
  // The first half step and two whole ones included.
  for (const auto& [degrees, x, y] : {Case{0, 2.5, -8}, Case{45, 7.42, -3.88}, Case{200, -5.08, 6.66}}) {
    Game game(room().build(), {}, own);
    game.body().angle = degrees_to_angle(degrees);
    give_item(game.world, 0, game.type("W"), 1);
    select_weapon(game.world, 0, game.type("W"));
    Buttons fire;
    fire.attack = true;
    const Actor* missile = nullptr;
    for (int tic = 0; tic < 80 && missile == nullptr; ++tic) {
      game.tic(fire);
      for (const Actor& actor : game.world.actors())
        if (actor.type == game.type("M")) missile = &actor;
    }
    ASSERT_NE(missile, nullptr);
    const double flown = to_double(missile->x) * std::cos(degrees * M_PI / 180) +
                         to_double(missile->y) * std::sin(degrees * M_PI / 180);
    const double left = 2.5 - flown;
    EXPECT_NEAR(to_double(missile->x) + left * std::cos(degrees * M_PI / 180), x, 0.03);
    EXPECT_NEAR(to_double(missile->y) + left * std::sin(degrees * M_PI / 180), y, 0.03);
  }
}

// Probe: A_Explode(128, 128) of a body 122 east and 25 north without a target: 22 points, -2.8016 across and 1.54 up; with
// OLDRADIUSDMG on either, as barrels have it, the damage's push alone, -2.6938.
TEST(VizdoomGames, ABlastWithoutASourceLiftsToo) {
  for (const bool old : {false, true}) {
    Game game(room().thing(30, 122, 25, 0, 5).build());
    Actor& spot = *game.world.find_thing(5);
    spot.set(ActorFlag::kOldRadiusDamage, old);
    radius_attack(game.world, spot, nullptr, 128, to_fixed(128), DamageType::kNormal);
    EXPECT_NEAR(to_double(game.body().velocity_x), old ? -2.6938 : -2.8016, 0.001);
    EXPECT_NEAR(to_double(game.body().velocity_z), old ? 0 : 1.54, 0.001);
  }
}

// Probe: two bodies side by side, the first explodes and dies of it: the player beside it is hurt all the same.
TEST(VizdoomGames, ABlastThatKillsItsSpotHurtsTheOthersToo) {
  const auto own = catalog_with(
      "actor B 20300 { Radius 20 Height 56 Health 1 +SHOOTABLE States { Spawn: TNT1 A -1 stop } }");
  Game game(room().thing(20300, 122, 0, 0, 5).build(), {}, own);
  radius_attack(game.world, *game.world.find_thing(5), nullptr, 128, to_fixed(128), DamageType::kNormal);
  EXPECT_EQ(game.body().health, 78);
}

// Probe: a rocket fired 17 units before a wall ends half a step ahead, behind the player's middle, and pushes it away from the wall.
TEST(VizdoomGames, AMissileThatCannotSpawnEndsHalfAStepAhead) {
  Game game(room().build());
  set_position(game.world, game.body().id, to_fixed(495), 0, 0);
  const uint32_t before = game.world.state().next_actor_id;
  EXPECT_EQ(spawn_player_missile(game.world, game.body(), game.type("Rocket"), 0, 0, 0, 0), nullptr);
  const Actor* rocket = game.world.find_actor(before);
  ASSERT_NE(rocket, nullptr);
  EXPECT_EQ(rocket->x, to_fixed(495 + 10));
  EXPECT_FALSE(rocket->has(ActorFlag::kMissile));
}

/// ThrustThingZ(0, 20) for what hits the line.
void make_impact_line(test::LevelBuilder& builder, std::size_t line) {
  builder.line(line).special = 128, builder.line(line).args = {0, 20, 0, 0, 0},
  builder.line(line).flags |= kLineImpact;
}

/// How high a player rises in 40 tics after it fired a rocket.
Fixed rise_after_a_rocket(Game& game) {
  EXPECT_NE(spawn_player_missile(game.world, game.body(), game.type("Rocket"), 0, 0, 0, 0), nullptr);
  Fixed highest = 0;
  for (int tic = 0; tic < 40; ++tic) game.tic(), highest = std::max(highest, game.body().z);
  return highest;
}

// Probe: a missile against a line with ThrustThingZ(0, 20) and impact: its shooter rises by 5.
TEST(VizdoomGames, ALineThatAMissileHitsActsForItsShooter) {
  test::LevelBuilder builder = room();
  make_impact_line(builder, 2);
  Game game(builder.build());
  EXPECT_GE(rise_after_a_rocket(game), to_fixed(5));
}

// Probe: a ripper of damage 0 through a barrel: HITCOUNT goes up, DAMAGECOUNT does not.
TEST(VizdoomGames, ARipperThatHurtsNobodyCountsAsAHit) {
  const auto own = catalog_with(
      "actor M 20100 { Projectile Speed 10 Damage (0) +RIPPER States { Spawn: TNT1 A 1 loop } }");
  Game game(room().thing(2035, 200, 0).build(), {}, own);
  ASSERT_NE(spawn_player_missile(game.world, game.body(), game.type("M"), 0, 0, 0, 0), nullptr);
  game.tic({}, 30);
  EXPECT_EQ(game.player().hits_dealt, 6) << "one a tic over 52 units";
  EXPECT_EQ(game.player().damage_dealt, 0);
}

// Probe: Thing_Damage, Thing_Destroy and A_DamageSelf of a body with NODAMAGE: it keeps its health.
TEST(VizdoomGames, WhatTakesNoDamageKeepsItsHealth) {
  const auto own = catalog_with(
      "actor B 20300 { Radius 20 Height 56 Health 1 +SHOOTABLE +NODAMAGE States { Spawn: TNT1 A -1 stop } }");
  Game game(room().thing(20300, 122, 0, 0, 5).build(), {}, own);
  Actor& target = *game.world.find_thing(5);
  damage_actor(game.world, target, nullptr, nullptr, 20, DamageType::kNormal);
  damage_actor(game.world, target, nullptr, nullptr, kTelefragDamage, DamageType::kNormal);
  EXPECT_EQ(target.health, 1);
}

// Probe: Thing_Damage of a barrel, the blast and the end of its states: 15 tics from one to the other.
TEST(VizdoomGames, ABarrelIsGoneFifteenTicsAfterItsBlast) {
  Game game(room().thing(2035, 60, 25, 0, 5).build());
  const uint32_t id = game.world.find_thing(5)->id;
  damage_actor(game.world, *game.world.find_thing(5), nullptr, nullptr, 50, DamageType::kNormal);
  int blast = 0, gone = 0;
  for (int tic = 1; tic < 60; ++tic) {
    game.tic();
    if (blast == 0 && game.body().health < 100) blast = tic;
    if (gone == 0 && game.world.find_actor(id) == nullptr) gone = tic;
  }
  EXPECT_EQ(gone - blast, 15);
}

// ---------------------------------------------------------------- what players carry

constexpr char kThreeItems[] =
    "actor A : CustomInventory { +INVENTORY.INVBAR Inventory.MaxAmount 20\n"
    " States { Use: TNT1 A 0 A_GiveInventory(\"Clip\", 1) stop } }\n"
    "actor B : A { }\nactor C : A { }\n";

struct Bar : Game {
  Bar() : Game(room().build(), {}, catalog_with(kThreeItems)) {
    for (const char* name : {"A", "B", "C"}) give_item(world, 0, type(name), 5);
  }
  /// What a press of the use key in the second tic from now uses; empty: nothing.
  std::string used() {
    for (int i = 0; i < 2; ++i) {
      std::vector<int32_t> before;
      for (const char* name : {"A", "B", "C"}) before.push_back(count_item(world, 0, type(name)));
      Buttons keys;
      keys.use_item = i == 1;
      tic(keys);
      for (std::size_t k = 0; k < before.size(); ++k)
        if (count_item(world, 0, type(std::string(1, static_cast<char>('A' + k)))) < before[k])
          return std::string(1, static_cast<char>('A' + k));
    }
    return "";
  }
  void press(bool Buttons::*key, int times) {
    Buttons keys;
    keys.*key = true;
    for (int i = 0; i < times; ++i) tic(keys), tic();
  }
};

// Probe: GiveInventory of A, B, C, then SELECT_NEXT_ITEM, SELECT_PREV_ITEM and ACTIVATE_SELECTED_ITEM. The first press after a move
// closes the bar, for 175 tics after it.
TEST(VizdoomGames, TheInventoryBarGoesFromTheFirstTakenToTheLast) {
  struct Case {
    int next, previous;
    const char* expected;
  };
  for (const auto& [next, previous, expected] :
       {Case{1, 0, "C"}, Case{2, 0, "B"}, Case{3, 0, "A"}, Case{0, 1, "B"}, Case{0, 2, "C"}}) {
    Bar bar;
    bar.press(&Buttons::select_next_item, next);
    bar.press(&Buttons::select_previous_item, previous);
    EXPECT_EQ(bar.used(), "") << "the bar is open";
    EXPECT_EQ(bar.used(), expected) << next << " " << previous;
  }
  Bar bar;
  EXPECT_EQ(bar.used(), "A");
  bar.press(&Buttons::select_next_item, 1);
  bar.tic({}, 172);
  EXPECT_EQ(bar.used(), "C") << "175 tics later";
}

// Probe: one of each, four presses: A, B, C; after SELECT_NEXT_ITEM C, B, A.
TEST(VizdoomGames, AUsedUpItemLeavesTheSelectionToItsNeighbour) {
  for (const bool moves : {false, true}) {
    Bar bar;
    for (const char* name : {"A", "B", "C"}) take_item(bar.world, 0, bar.type(name), 4);
    if (moves) bar.press(&Buttons::select_next_item, 1), bar.used();
    std::string order;
    for (int i = 0; i < 4; ++i) order += bar.used();
    EXPECT_EQ(order, moves ? "CBA" : "ABC");
  }
}

// Probe: the item of 20 tics of speed, used by its key: 20 pushes of 1.5; picked up, which is after that tic's push: 19.
TEST(VizdoomGames, APowersFirstTicCounts) {
  const auto own = catalog_with(
      "actor P : PowerupGiver 20200 { Powerup.Type Speed Powerup.Duration 20 States { Spawn: TNT1 A -1 stop "
      "} }\n"
      "actor Q : P 20201 { +INVENTORY.AUTOACTIVATE }");
  for (const bool by_key : {true, false}) {
    test::LevelBuilder builder = room(2000);
    if (!by_key) builder.thing(20201, 150, 0);
    Game game(builder.build(), {}, own);
    if (by_key) give_item(game.world, 0, game.type("P"), 1);
    int fast = 0;
    for (int tic = 0; tic < 110; ++tic) {
      Buttons keys;
      keys.forward = true, keys.use_item = tic == 20;
      const Fixed x = game.body().x, speed = game.body().velocity_x;
      game.tic(keys);
      const Fixed push = game.body().x - x - speed;
      fast += push > to_fixed(1) ? 1 : 0;  // 0.78 without, 1.17 with it
    }
    EXPECT_EQ(fast, by_key ? 20 : 19);
  }
}

// Probe: two weapons of DECORATE beside fist and chainsaw, SELECT_NEXT_WEAPON: the order of definition, whatever SelectionOrder.
TEST(VizdoomGames, ASlotHoldsItsWeaponsInTheOrderOfDefinition) {
  constexpr char kStates[] =
      " Weapon.SlotNumber 1 States { Ready: TNT1 A 1 A_WeaponReady loop Select: TNT1 A 1 A_Raise loop "
      "Deselect: TNT1 A 1 A_Lower "
      "loop Fire: TNT1 A 8 goto Ready } }\n";
  const auto own = catalog_with(std::string("actor W1 : Weapon 20400 { Weapon.SelectionOrder 1000") +
                                kStates + "actor W2 : Weapon 20401 { Weapon.SelectionOrder 9000" + kStates);
  Game game(room().build(), {}, own);
  take_item(game.world, 0, game.type("Pistol"), 0);
  for (const char* name : {"Chainsaw", "W1", "W2"}) give_item(game.world, 0, game.type(name), 1);
  select_weapon(game.world, 0, game.type("Fist"));
  game.tic({}, 60);
  std::string order;
  for (int i = 0; i < 4; ++i) {
    order += game.world.catalog()[game.player().ready_weapon].name + " ";
    Buttons keys;
    keys.select_next_weapon = true;
    game.tic(keys);
    game.tic({}, 60);
  }
  EXPECT_EQ(order, "Fist Chainsaw W1 W2 ");
}

// Probe: four items of radius 8 round the corner of blockmap cells: those of the south-western cell first, row by row.
TEST(VizdoomGames, ItemsAreTakenCellByCell) {
  for (const bool reversed : {false, true}) {
    const auto own = catalog_with(
        "actor I : CustomInventory 20200 { Radius 8 Inventory.MaxAmount 1 +COUNTITEM States { Spawn: TNT1 A "
        "-1 stop "
        "Pickup: TNT1 A 0 A_GiveInventory(\"Clip\", 1) stop Use: TNT1 A 0 stop } }");
    test::LevelBuilder builder = room();
    // The cells begin at the map's corner: their edges are multiples of 128.
    std::vector<std::pair<int, int>> places = {{116, 116}, {140, 116}, {116, 140}, {140, 140}};
    if (reversed) std::reverse(places.begin(), places.end());
    for (std::size_t i = 0; i < places.size(); ++i)
      builder.thing(20200, places[i].first, places[i].second, 0, static_cast<int>(i) + 1);
    Game game(builder.build(), {}, own);
    set_position(game.world, game.body().id, to_fixed(128), to_fixed(128), 0);
    game.body().velocity_x = kFracUnit / 8;
    game.tic();
    // One is taken, because the player holds one at most.
    EXPECT_EQ(game.world.find_thing(reversed ? 4 : 1), nullptr);
    EXPECT_NE(game.world.find_thing(reversed ? 1 : 4), nullptr);
  }
}

// ---------------------------------------------------------------- players

// Probe: TURN180 pressed again three tics after the first press: 12 tics of 20 degrees.
TEST(VizdoomGames, TurningRoundBeginsAnewWithEachPress) {
  Game game(room().build());
  for (int tic = 0; tic < 30; ++tic) {
    Buttons keys;
    keys.turn_180 = tic == 5 || tic == 8;
    game.tic(keys);
  }
  EXPECT_NEAR(angle_to_radians(game.body().angle) * 57.29578, 240, 0.001);
}

// Probe: DamageThing(200) of a player that runs, its pitch 10.8 down: 7.8, 4.8 and 0 in the next tics, and its eye continues to bob.
TEST(VizdoomGames, TheDeadLookAheadAndBob) {
  Game game(room(2000).build(), {.network_game = true});
  Buttons run;
  run.forward = run.speed = true;
  game.tic({}, 8);
  game.tic(run, 33);
  game.body().pitch = degrees_to_angle(1) / 10 * 108;
  damage_actor(game.world, game.body(), nullptr, nullptr, 200, DamageType::kNormal);
  ASSERT_FALSE(game.player().alive);
  for (const auto& [pitch, view] :
       {std::pair{7.8, 42.4686}, std::pair{4.8, 43.7012}, std::pair{0.0, 44.4692}, std::pair{0.0, 44.6077}}) {
    game.tic(run);
    EXPECT_NEAR(static_cast<int32_t>(game.body().pitch) / 4294967296.0 * 360, pitch, 0.001);
    EXPECT_NEAR(to_double(game.player().view_z - game.body().z), view, 0.01);
  }
}

// Probe: Teleport_NoFog(90, 0, 0, 1) onto a floor of -24 whose ledge of 0 the box reaches: z is -24, and 0 a tic later.
TEST(VizdoomGames, ATeleportThatKeepsTheHeightCountsFromTheFloorOfItsCentre) {
  test::LevelBuilder builder;
  const uint32_t hall = builder.sector(0, 256), low = builder.sector(-24, 256);
  builder.room(hall, -512, -512, 512, 512).island(low, hall, -64, -64, 64, 64).thing(1, -300, 0);
  builder.thing(14, 0, 60, 0, 90);
  Game game(builder.build());
  game.world.events().run_special(game.world,
                                  {.number = 71, .args = {90, 0, 0, 1, 0}, .activator = &game.body()});
  EXPECT_EQ(game.body().z, to_fixed(-24));
  game.tic();
  EXPECT_EQ(game.body().z, 0);
}

// Probe: Thing_Move and SetActorPosition of the player onto a barrel, a pillar and a monster: it goes there; a barrel does not.
TEST(VizdoomGames, ScriptsMovePlayersOntoBodies) {
  for (const int kind : {2035, 30, 3001}) {
    Game game(room().thing(kind, 203, 125, 0, 6).thing(2035, -196, 125, 0, 7).build());
    EXPECT_TRUE(put_where_it_fits(game.world, game.body(), to_fixed(196), to_fixed(125), 0)) << kind;
    EXPECT_FALSE(put_where_it_fits(game.world, *game.world.find_thing(7), to_fixed(196), to_fixed(125), 0))
        << kind;
  }
}

// Probe: GetActorFloorZ of a player on a barrel is the floor's height.
TEST(VizdoomGames, TheGroundOfWhoStandsOnABodyIsTheFloor) {
  Game game(room().thing(2035, 100, 0).build());
  set_position(game.world, game.body().id, to_fixed(100), 0, to_fixed(42));
  game.tic();
  EXPECT_EQ(game.body().z, to_fixed(42));
  EXPECT_EQ(game.body().ground_z, 0);
}

// Probe: a player inside a stalagmite, pushed in sixteen directions: free is what takes it away by Doom's estimate of distances.
TEST(VizdoomGames, OverlappingBodiesMoveApartByTheEstimatedDistance) {
  struct Case {
    int x, y;
    double dx, dy;
    bool goes_x, goes_y;
  };
  for (const auto& [x, y, dx, dy, goes_x, goes_y] :
       {Case{20, -10, 2, 0, false, false}, Case{20, -10, .77, 1.85, true, true},
        Case{20, -27, 1.41, 1.41, true, true}, Case{27, -10, -.5, -1.2, true, false},
        Case{27, -10, .5, 1.2, true, true}, Case{27, -15, .45, .85, false, true}}) {
    Game game(room().thing(47, x, y).build());
    game.body().velocity_x = static_cast<Fixed>(dx * kFracUnit);
    game.body().velocity_y = static_cast<Fixed>(dy * kFracUnit);
    game.tic();
    EXPECT_EQ(game.body().x != 0, goes_x) << x << " " << y << " by " << dx << " " << dy;
    EXPECT_EQ(game.body().y != 0, goes_y) << x << " " << y << " by " << dx << " " << dy;
  }
}

// Probe: lines with playerpush and Teleport, which stops, and Teleport_NoStop: after the first nothing of the move is left.
TEST(VizdoomGames, ALineThatChangesTheSpeedOfWhoRunsIntoItEndsTheMove) {
  constexpr int kTeleport = 70, kTeleportNoStop = 154;
  for (const int special : {kTeleport, kTeleportNoStop}) {
    test::LevelBuilder builder = room();
    for (uint32_t line = 0; line < 4; ++line)
      builder.line(line).special = special, builder.line(line).args = {90, 0, 0, 0, 0},
      builder.line(line).flags |= kLinePlayerPush | kLineRepeatable;
    builder.thing(14, 0, 300, 0, 90);
    Game game(builder.build());
    set_position(game.world, game.body().id, to_fixed(490), 0, 0);
    game.body().velocity_x = to_fixed(10), game.body().velocity_y = to_fixed(4);
    game.tic();
    EXPECT_EQ(game.body().x, 0);
    EXPECT_EQ(game.body().y, to_fixed(special == kTeleport ? 300 : 304));
  }
}

// Probe: a player that dies half over a step while it slides: no friction in that tic. On flat ground there is.
TEST(VizdoomGames, TheDeadSlideOffSteps) {
  for (const int x : {0, 70}) {
    test::LevelBuilder builder;
    const uint32_t hall = builder.sector(0, 256), high = builder.sector(24, 256);
    builder.room(hall, -512, -512, 512, 512).island(high, hall, -64, -64, 64, 64).thing(1, x, 0);
    Game game(builder.build(), {.network_game = true});
    game.tic();
    damage_actor(game.world, game.body(), nullptr, nullptr, 200, DamageType::kNormal);
    game.body().velocity_y = to_fixed(4);
    game.tic();
    EXPECT_EQ(game.body().velocity_y == to_fixed(4), x == 70) << x;
  }
}

// Probe: a thing of health 0.5 (dead) and dormant: its corpse is in nobody's way.
TEST(VizdoomGames, TheDeadAreNotDormant) {
  test::LevelBuilder builder = room();
  Game game(builder.thing(3005, 100, 0, 0, 5).build());
  damage_actor(game.world, *game.world.find_thing(5), nullptr, nullptr, 400, DamageType::kNormal);
  game.world.find_thing(5)->set(ActorFlag::kDormant);
  game.tic({}, 60);
  EXPECT_FALSE(game.world.find_thing(5)->has(ActorFlag::kSolid));
}

// Probe: a shot at a line that teleports its shooter out of a secret sector: the secret counts from the place where the tic began.
TEST(VizdoomGames, TheFloorActsBeforeTheWeapon) {
  test::LevelBuilder builder;
  const uint32_t hall = builder.sector(0, 256), secret = builder.sector(0, 256);
  builder.sector_at(secret).secret = true;
  builder.room(hall, -512, -512, 512, 512).island(secret, hall, -500, -100, -300, 100).thing(1, 0, 0);
  builder.line(2).special = 70, builder.line(2).args = {90, 0, 0, 0, 0};
  builder.line(2).flags |= kLineImpact | kLineRepeatable;
  builder.thing(14, -400, 0, 0, 90);
  Game game(builder.build());
  Buttons fire;
  fire.attack = true;
  for (int tic = 0; tic < 80 && game.body().x == 0; ++tic) game.tic(fire);
  ASSERT_EQ(game.body().x, to_fixed(-400));
  EXPECT_EQ(game.player().secret_count, 0);
  game.tic();
  EXPECT_EQ(game.player().secret_count, 1);
}

// ---------------------------------------------------------------- planes

// Probe: Scroll_Floor(99, 21, 22, 1) under a player that stands: what would push by less than it takes to keep moving carries by
// its whole length instead, along each axis by itself.
TEST(VizdoomGames, ASlowBeltCarriesWithoutSpeed) {
  Game game(room().build());
  const SpecialCall call{.number = Special::kScroll_Floor, .args = {1, 21, 22, 1, 0}, .activator = nullptr};
  game.world.events().run_special(game.world, call);
  game.tic({}, 2);
  EXPECT_NEAR(to_double(game.body().x), 2 * 0.65625, 0.001);
  EXPECT_EQ(game.body().velocity_x, 0);
  EXPECT_NEAR(to_double(game.body().velocity_y), 0.1113, 0.001);
}

// Probe: Floor_Waggle and Ceiling_Waggle of a shut sector: the floor goes above the ceiling, the ceiling below the floor.
TEST(VizdoomGames, AShutSectorWagglesPastItsOtherPlane) {
  constexpr int kFloorWaggle = 138, kCeilingWaggle = 38;
  for (const int special : {kFloorWaggle, kCeilingWaggle}) {
    test::LevelBuilder builder = room();
    const uint32_t shut = builder.sector(32, 32, 2);
    builder.island(shut, 0, 100, -64, 228, 64);
    Game game(builder.build());
    game.world.events().run_special(game.world, {.number = special, .args = {2, 32, 16, 0, 0}});
    bool passes = false;
    for (int tic = 0; tic < 256; ++tic) {
      game.tic();
      const Sector& sector = game.world.sectors()[shut];
      passes |= sector.floor_height > sector.ceiling_height;
    }
    EXPECT_TRUE(passes) << special;
  }
}

// Probe: a sector from 56 to 240, beside 0 and 256. A door closes onto the floor where it is now, unless a lift has moved that; one
// that starts on the lift closes onto its own ceiling.
TEST(VizdoomGames, ADoorClosesOntoTheFloorAsItIs) {
  const SpecialCall door{.number = Special::kDoor_Raise, .args = {2, 32, 60}};
  const SpecialCall lift{.number = Special::kPlat_DownWaitUpStay, .args = {2, 32, 1500}};
  const SpecialCall sinks{.number = Special::kPlat_DownByValue, .args = {2, 64, 1500, 3}};
  for (const auto& [first, second, closed] : {std::tuple{lift, door, 240}, std::tuple{door, lift, 56},
                                              std::tuple{sinks, door, 32}, std::tuple{door, sinks, 32}}) {
    test::LevelBuilder builder = room();
    const uint32_t inner = builder.sector(56, 240, 2);
    builder.island(inner, 0, 100, -64, 228, 64);
    Game game(builder.build());
    game.world.events().run_special(game.world, first);
    game.world.events().run_special(game.world, second);
    game.tic({}, 250);
    EXPECT_EQ(game.world.sectors()[inner].ceiling_height, to_fixed(closed)) << closed;
  }
}

// ---------------------------------------------------------------- the last ten of 500 games

// Probe: a pistol requested while the fist strikes, then A_SelectWeapon("Fist") of an item: the pistol comes up; after
// SetWeapon("Fist") the fist stays.
TEST(VizdoomGames, AnItemThatSelectsTheWeaponInTheHandLeavesTheRequest) {
  for (const bool by_script : {false, true}) {
    Game game(room().build());
    select_weapon(game.world, 0, game.type("Fist"));
    game.tic({}, 60);
    ASSERT_TRUE(select_weapon(game.world, 0, game.type("Pistol")));
    EXPECT_TRUE(select_weapon(game.world, 0, game.type("Fist"), by_script));
    game.tic({}, 60);
    EXPECT_EQ(game.player().ready_weapon, game.type(by_script ? "Fist" : "Pistol"));
  }
}

// Probe: a bob of the player in the air after it stood up from crouching, which leaves it a hair lower than before.
TEST(VizdoomGames, TheBobInTheAirLosesAnEighthToTheLeastCrouch) {
  for (const bool lower : {false, true}) {
    Game game(room().build());
    if (lower) game.player().crouch_factor = kFracUnit - 1;
    set_position(game.world, game.body().id, 0, 0, to_fixed(200));  // no room to stand up
    Buttons keys;
    keys.forward = keys.speed = true;
    game.tic(keys);
    EXPECT_NEAR(game.player().walk_x, lower ? 350 : 400, 1);
  }
}

// Probe: a solid monster that is dead: a player that can step onto it walks through it, and one above falls through.
TEST(VizdoomGames, DeadMonstersHoldNobody) {
  const auto own = catalog_with(
      "actor A 20300 { Radius 40 Height 32 Health 1 +SOLID +SHOOTABLE States { Spawn: TNT1 A -1 stop "
      "Death: TNT1 A -1 stop } }\nactor B : A 20301 { +ISMONSTER }");
  for (const int number : {20300, 20301})
    for (const bool falls : {false, true}) {
      Game game(room().thing(number, 132, 0, 0, 5).build(), {}, own);
      damage_actor(game.world, *game.world.find_thing(5), nullptr, nullptr, 11, DamageType::kNormal);
      if (falls) set_position(game.world, game.body().id, to_fixed(132), 0, to_fixed(60));
      Buttons keys;
      keys.forward = !falls;
      Fixed lowest = INT32_MAX;
      for (int tic = 0; tic < 25; ++tic) {
        game.tic(keys);
        if (std::abs(game.body().x - to_fixed(132)) < to_fixed(50)) lowest = std::min(lowest, game.body().z);
      }
      EXPECT_EQ(lowest, number == 20301 ? 0 : to_fixed(8)) << number << falls;
    }
}

// Probe: A_SpawnItem("It") by a body of radius 16, an item of 20: 36 of 65536 units ahead.
TEST(VizdoomGames, AnItemWithoutADistanceIsSpawnedAllButThere) {
  const auto own = catalog_with(
      "actor It 20300 { Radius 20 States { Spawn: TNT1 A -1 stop } }\n"
      "actor A 20301 { Radius 16 States { Spawn: TNT1 A 1\nTNT1 A 5 A_SpawnItem(\"It\")\nTNT1 A -1 stop } }");
  Game game(room().thing(20301, 100, 0, 180, 5).build(), {}, own);
  game.tic({}, 10);
  int found = 0;
  for (const Actor& actor : game.world.actors()) {
    if (actor.type != game.type("It")) continue;
    ++found;
    EXPECT_EQ(actor.x, to_fixed(100) - 36);
  }
  EXPECT_EQ(found, 1);
}

// Probe: SpawnProjectile and A_FireCustomMissile: half a step ahead, or half of that, until it is less than the radius of the one
// that launches.
TEST(VizdoomGames, AMissileStartsWithinItsShooter) {
  for (const auto& [speed, ahead] : {std::tuple{20, 10.0}, std::tuple{31, 15.5}, std::tuple{32, 8.0},
                                     std::tuple{40, 10.0}, std::tuple{100, 12.5}}) {
    const auto own = catalog_with("actor M 20100 { Projectile Speed " + std::to_string(speed) +
                                  " States { Spawn: TNT1 A 1 loop } }");
    Game game(room().build(), {}, own);
    const Actor* missile = spawn_player_missile(game.world, game.body(), game.type("M"), 0, 0, 0, 0);
    ASSERT_NE(missile, nullptr);
    EXPECT_NEAR(to_double(missile->x), ahead, 0.01) << speed;
  }
}

// Probe: a missile of speed 10 that begins inside a body pushes it away from where it began, 5 units ahead.
TEST(VizdoomGames, AMissileStrikesFromWhereItBegins) {
  const auto own = catalog_with(
      "actor M 20100 { Projectile Speed 10 Damage (10) States { Spawn: TNT1 A 1 loop Death: TNT1 A 9 stop } "
      "}\n"
      "actor T 20300 { Radius 20 Height 56 +SHOOTABLE +SOLID +NOBLOOD Health 1000 States { Spawn: TNT1 A -1 "
      "stop } }");
  Game game(room().thing(20300, 30, 15, 0, 5).build(), {}, own);
  spawn_player_missile(game.world, game.body(), game.type("M"), 0, 0, 0, 0);
  const Actor& struck = *game.world.find_thing(5);
  EXPECT_NEAR(std::atan2(struck.velocity_y, struck.velocity_x), std::atan2(15, 30 - 5), 0.01);
}

// Probe: a missile against a sector whose ceiling lies below it: the line acts, also where its floor is no step.
TEST(VizdoomGames, ALoweredCeilingIsHitLikeAWall) {
  test::LevelBuilder builder = room();
  builder.island(builder.sector(-8, -8, 2), 0, 100, -64, 228, 64);
  for (std::size_t line = 4; line < 8; ++line) make_impact_line(builder, line);
  Game game(builder.build());
  EXPECT_GE(rise_after_a_rocket(game), to_fixed(5));
}

// Probe: 30 points of InstantDeath against green armour: 20, and 10 of the armour.
TEST(VizdoomGames, ArmourProtectsFromInstantDeath) {
  Game game(room().build());
  give_item(game.world, 0, game.type("GreenArmor"), 1);
  damage_actor(game.world, game.body(), nullptr, nullptr, 30, DamageType::kInstantDeath);
  EXPECT_EQ(game.player().health, 80);
  EXPECT_EQ(game.player().armor, 90);
}

}  // namespace vizdoom_games_test
}  // namespace comrad::doom
