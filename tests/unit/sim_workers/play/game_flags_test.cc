// ZDoom's flags of a game (dmflags, sv_...) and network games, as ViZDoom 1.3.2 was measured to play them: the same small maps, tic
// by tic, with `game_args` of one flag each.
#include <gtest/gtest.h>

#include <algorithm>
#include <string>
#include <vector>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace game_flags_test {

using wad::GameFlag;

constexpr int kStimpack = 2011, kGreenArmor = 2018, kBlurSphere = 2024, kShotgun = 2001, kShells = 2008,
              kRedCard = 13, kImp = 3001, kBarrel = 2035, kDeathmatchStart = 11;

struct Game {
  Game(test::LevelBuilder& room, std::vector<GameFlag> flags, WorldOptions options = {})
      : world(room.build(), catalog()) {
    for (const GameFlag flag : flags) options.flags.set(flag);
    reset_world(world, options);
    for (int player = 0; player < options.player_count; ++player) body(player).reaction_tics = 0;
  }
  static const std::shared_ptr<const ActorCatalog>& catalog() {
    static const auto kCatalog = std::make_shared<const ActorCatalog>();
    return kCatalog;
  }
  Actor& body(int player = 0) { return *world.body_of(player); }
  const Player& player() const { return world.player(0); }
  uint32_t type(const std::string& name) const { return world.catalog().find(name).value(); }
  int count(const std::string& name) const { return world.count_actors(type(name)); }
  int has(const std::string& name) const { return count_item(world, 0, type(name)); }
  void give(const std::string& name, int amount = 1) { give_item(world, 0, type(name), amount); }
  void tics(int count, const Buttons& buttons = {}) {
    for (int tic = 0; tic < count; ++tic) run_tic(world, {&buttons, 1});
  }
  int32_t special(int32_t number) {
    return world.events().run_special(world, {.number = number, .activator = &body()});
  }
  World world;
};

test::LevelBuilder room(int ceiling = 256) {
  test::LevelBuilder builder;
  builder.room(builder.sector(0, ceiling), 0, -512, 1024, 512).thing(1, 128, 0);
  return builder;
}

const WorldOptions kCooperative = {.forced_respawn = true, .respawn_delay_tics = 35, .network_game = true};
const WorldOptions kDeathmatch = {
    .forced_respawn = true, .respawn_delay_tics = 35, .network_game = true, .deathmatch = true};

TEST(GameFlags, ADeathmatchLeavesOutWhatItsFlagsSay) {
  test::LevelBuilder map = room();
  map.thing(kStimpack, 300, 0).thing(kGreenArmor, 400, 0);
  for (const bool deathmatch : {false, true}) {
    Game game(map, {GameFlag::kNoHealth, GameFlag::kNoArmor}, {.deathmatch = deathmatch});
    EXPECT_EQ(game.count("Stimpack"), deathmatch ? 0 : 1);
    EXPECT_EQ(game.count("GreenArmor"), deathmatch ? 0 : 1);
  }
}

TEST(GameFlags, WeaponsForSeveralPlayersMayBeLeftOut) {
  test::LevelBuilder map = room();
  map.thing(kShotgun, 300, 0);
  auto level = std::make_shared<Level>(*map.build());
  level->things.back().flags &= ~uint32_t{kThingSingle};
  for (const bool leaves_out : {false, true}) {
    World world(level, Game::catalog());
    WorldOptions options = kCooperative;
    options.flags.set(GameFlag::kNoCooperativeWeapons, leaves_out);
    reset_world(world, options);
    EXPECT_EQ(world.count_actors(world.catalog().find("Shotgun").value()), leaves_out ? 0 : 1);
  }
}

// 1 050 tics after it was taken an item is back; powers of the great kind only with their own flag.
TEST(GameFlags, ItemsComeBackAlsoWithoutADeathmatch) {
  for (const bool powers_too : {false, true}) {
    test::LevelBuilder map = room();
    map.thing(kShells, 128, 0).thing(kBlurSphere, 128, 0);
    std::vector<GameFlag> flags = {GameFlag::kItemsReturn};
    if (powers_too) flags.push_back(GameFlag::kPowersReturn);
    Game game(map, flags);
    Buttons walk;
    walk.forward = true;
    game.tics(30, walk);
    EXPECT_EQ(game.has("Shell"), 4);
    EXPECT_EQ(game.count("Shell"), 1) << "it is hidden";
    EXPECT_EQ(game.count("BlurSphere"), powers_too ? 1 : 0);
    const auto lies_there = [&] {
      for (const Actor& actor : game.world.actors())
        if (actor.type == game.type("Shell")) return actor.has(ActorFlag::kSpecial);
      return false;
    };
    EXPECT_FALSE(lies_there());
    game.tics(1060);
    EXPECT_TRUE(lies_there());
  }
}

TEST(GameFlags, WeaponsStayAlsoWithoutADeathmatch) {
  for (const bool stay : {false, true}) {
    test::LevelBuilder map = room();
    map.thing(kShotgun, 128, 0);
    Game game(map, stay ? std::vector{GameFlag::kWeaponsStay} : std::vector<GameFlag>{});
    Buttons walk;
    walk.forward = true;
    game.tics(5, walk);
    EXPECT_EQ(game.has("Shotgun"), 1);
    EXPECT_EQ(game.has("Shell"), 8);
    EXPECT_EQ(game.count("Shotgun"), stay ? 1 : 0);
  }
}

TEST(GameFlags, AmmunitionIsDoubled) {
  test::LevelBuilder map = room();
  Game game(map, {GameFlag::kDoubleAmmo});
  game.give("Shotgun");
  EXPECT_EQ(game.has("Shell"), 16);
  EXPECT_EQ(game.has("Clip"), 50) << "what players begin with is as it was";
}

// From 107: 106 after 35 tics, then 105, 104 and, as less than five are left, 100.
TEST(GameFlags, DegenerationTakesAPointASecondAndTheLastFourAtOnce) {
  test::LevelBuilder map = room();
  Game game(map, {GameFlag::kDegeneration});
  game.tics(1);
  game.body().health = game.world.state().players[0].health = 107;
  std::vector<int> seen;
  for (int second = 0; second < 5; ++second) {
    game.tics(35);
    seen.push_back(game.body().health);
  }
  EXPECT_EQ(seen, (std::vector<int>{106, 105, 104, 100, 100}));
}

// Falls from the height, with the speed of the landing, and what each kind of damage leaves of 100 points of health.
TEST(GameFlags, FallsHurtAsInZDoomHexenAndStrife) {
  struct Case {
    int height, hexen, old, strife;
  };
  for (const auto& [height, hexen, old, strife] :
       {Case{190, 100, 100, 100}, Case{200, 100, 98, 100}, Case{220, 100, 97, 45}, Case{260, 100, 93, 40},
        Case{280, 97, 91, 38}, Case{500, 75, 71, 17}, Case{700, 58, 57, 4}, Case{1500, -22, -14, -44},
        Case{3000, 100 - kTelefragDamage, -139, -101}}) {
    const auto left = [height = height](std::vector<GameFlag> flags) {
      test::LevelBuilder map = room(4096);
      Game game(map, flags);
      game.body().z = to_fixed(height);
      game.tics(90);
      return game.body().health;
    };
    SCOPED_TRACE(height);
    EXPECT_EQ(left({}), 100);
    EXPECT_EQ(left({GameFlag::kFallDamage}), hexen);
    EXPECT_EQ(left({GameFlag::kOldFallDamage}), old);
    EXPECT_EQ(left({GameFlag::kFallDamage, GameFlag::kOldFallDamage}), strife);
  }
}

TEST(GameFlags, AHexenFallBelow39LeavesAPointOfHealth) {
  test::LevelBuilder map = room(4096);
  Game game(map, {GameFlag::kFallDamage});
  game.body().health = game.world.state().players[0].health = 10;
  game.body().z = to_fixed(500);
  game.tics(60);
  EXPECT_EQ(game.body().health, 1);
}

TEST(GameFlags, ExitsWaitForTheMonsters) {
  test::LevelBuilder map = room();
  map.thing(kImp, 900, 400, 0, 5);
  Game game(map, {GameFlag::kExitAfterMonsters});
  EXPECT_EQ(game.special(243), 0);
  EXPECT_FALSE(game.world.level_exited());
  Actor& imp = *game.world.find_thing(5);
  damage_actor(game.world, imp, nullptr, nullptr, 1000);
  EXPECT_EQ(game.special(243), 1);
  EXPECT_TRUE(game.world.level_exited());
}

TEST(GameFlags, AnExitKillsInADeathmatchWithoutOne) {
  for (const bool deathmatch : {false, true}) {
    test::LevelBuilder map = room();
    Game game(map, {GameFlag::kNoExit}, {.deathmatch = deathmatch});
    game.special(244);
    EXPECT_EQ(game.world.level_exited(), !deathmatch);
    EXPECT_EQ(game.world.state().exited_secretly, !deathmatch);
    EXPECT_EQ(game.body().health, deathmatch ? 100 - kTelefragDamage : 100);
  }
}

// Probe: Exit_Normal by script and by line: another tic, in which nothing moves; its reward is the map's end.
TEST(GameFlags, AnExitTakesATicInViZDoomsGames) {
  for (const bool takes : {false, true}) {
    test::LevelBuilder map = room();
    Game game(map, {}, {.exit_takes_a_tic = takes});
    game.tics(3);
    game.special(243);
    EXPECT_EQ(game.world.level_exited(), !takes);
    const uint64_t before = game.world.tic_count();
    Buttons walk;
    walk.forward = true;
    game.tics(1, walk);
    EXPECT_TRUE(game.world.level_exited());
    EXPECT_EQ(game.world.tic_count(), before + (takes ? 1 : 0));
    EXPECT_EQ(game.body().velocity_x, 0);
  }
}

TEST(GameFlags, FragsEndALevel) {
  test::LevelBuilder map = room();
  Game counted(map, {}, {.deathmatch = true, .frag_limit = 3});
  counted.world.state().players[0].frag_count = 2;
  counted.tics(1);
  EXPECT_FALSE(counted.world.level_exited());
  counted.world.state().players[0].frag_count = 3;
  counted.tics(1);
  EXPECT_TRUE(counted.world.level_exited());
}

TEST(GameFlags, GravityAndAirControlAreTheGames) {
  test::LevelBuilder map = room(4096);
  const auto fallen = [&](WorldOptions options) {
    Game game(map, {}, options);
    game.body().z = to_fixed(500);
    Buttons walk;
    walk.forward = true;
    game.tics(12, walk);
    return std::pair(game.body().velocity_z, game.body().x);
  };
  const auto [plain_speed, plain_x] = fallen({});
  const auto [half_speed, half_x] = fallen({.gravity = kFracUnit / 2});
  EXPECT_EQ(half_speed * 2, plain_speed);
  EXPECT_EQ(half_x, plain_x);
  EXPECT_GT(fallen({.air_control = kFracUnit}).second, plain_x + to_fixed(10));
}

TEST(GameFlags, JumpsAreForbiddenAllowedOrTheMapsToSay) {
  test::LevelBuilder map = room();
  for (const bool map_forbids : {false, true})
    for (const bool allowed : {false, true}) {
      auto level = std::make_shared<Level>(*map.build());
      level->rules.no_jump = map_forbids;
      World world(level, Game::catalog());
      WorldOptions options;
      options.flags.set(GameFlag::kAllowJump, allowed);
      reset_world(world, options);
      EXPECT_EQ(world.options().allow_jump, !map_forbids || allowed);
    }
}

TEST(GameFlags, FastMonstersAndTheirReturnNeedNoNightmare) {
  test::LevelBuilder map = room();
  map.thing(kImp, 900, 400, 0, 5);
  Game game(map, {GameFlag::kFastMonsters, GameFlag::kMonstersReturn});
  EXPECT_TRUE(game.world.is_fast());
  damage_actor(game.world, *game.world.find_thing(5), nullptr, nullptr, 1000);
  int tics = 0;
  for (; tics < 30'000 && game.world.state().monster_count == 1; ++tics) game.tics(1);
  EXPECT_EQ(game.world.state().monster_count, 2) << "another imp, where it was";
  EXPECT_GT(tics, 420);
}

TEST(GameFlags, BarrelsComeBack) {
  for (const bool back : {false, true}) {
    test::LevelBuilder map = room();
    map.thing(kBarrel, 900, 400, 0, 5);
    Game game(map, back ? std::vector{GameFlag::kBarrelsReturn} : std::vector<GameFlag>{});
    damage_actor(game.world, *game.world.find_thing(5), nullptr, nullptr, 1000);
    game.tics(1000);
    EXPECT_EQ(game.count("ExplosiveBarrel"), back ? 1 : 0) << "out of sight";
    if (!back) continue;
    EXPECT_LE(game.world.find_thing(5)->health, 0);
    game.tics(100);
    EXPECT_EQ(game.world.find_thing(5)->health, 20);
  }
}

TEST(GameFlags, UsedItemsAreKept) {
  for (const bool kept : {false, true}) {
    test::LevelBuilder map = room();
    Game game(map, kept ? std::vector{GameFlag::kInfiniteInventory} : std::vector<GameFlag>{});
    Player& player = game.world.state().players[0];
    player.inventory.push_back({.type = game.type("Medikit"), .amount = 2, .max_amount = 5});
    game.body().health = player.health = 10;
    EXPECT_TRUE(use_item(game.world, 0, game.type("Medikit")));
    EXPECT_EQ(game.has("Medikit"), kept ? 2 : 1);
  }
}

TEST(GameFlags, TheDeadDropWhatTheyHeld) {
  for (const bool drop : {false, true}) {
    test::LevelBuilder map = room();
    Game game(map, drop ? std::vector{GameFlag::kDropWeapons} : std::vector<GameFlag>{}, kCooperative);
    damage_actor(game.world, game.body(), nullptr, nullptr, 1000);
    EXPECT_EQ(game.count("Pistol"), drop ? 1 : 0);
  }
}

// ---------------------------------------------------------------- coming back

struct Lost {
  std::vector<GameFlag> flags;
  int clips, shells, shotguns, keys, armor;
};

// A cooperative player of a network keeps all but powers; one of a deathmatch begins anew.
TEST(Respawn, ACooperativePlayerKeepsWhatItHadButWhatFlagsTake) {
  using enum GameFlag;
  for (const auto& [flags, clips, shells, shotguns, keys, armor] :
       {Lost{{}, 141, 49, 1, 1, 199}, Lost{{kLoseInventory}, 50, 0, 0, 0, 0},
        Lost{{kLoseKeys}, 141, 49, 1, 0, 199}, Lost{{kLoseWeapons}, 141, 49, 0, 1, 199},
        Lost{{kLoseArmor}, 141, 49, 1, 1, 0}, Lost{{kLoseAmmo}, 50, 0, 1, 1, 199},
        Lost{{kHalveAmmo}, 70, 24, 1, 1, 199}}) {
    test::LevelBuilder map = room();
    Game game(map, flags, kCooperative);
    game.give("Shotgun"), game.give("Shell", 41), game.give("Clip", 91), game.give("RedCard");
    game.give("BlueArmor"), game.give("Berserk");
    Player& player = game.world.state().players[0];
    player.armor = 199;
    player.alive = true;
    game.body().health = player.health = 1;
    damage_actor(game.world, game.body(), nullptr, nullptr, 5, DamageType::kDrowning);
    ASSERT_FALSE(player.alive);
    game.tics(40);
    ASSERT_TRUE(player.alive);
    EXPECT_EQ(game.has("Clip"), clips);
    EXPECT_EQ(game.has("Shell"), shells);
    EXPECT_EQ(game.has("Shotgun"), shotguns);
    EXPECT_EQ(game.has("RedCard"), keys);
    EXPECT_EQ(player.armor, armor);
    EXPECT_FALSE(player.has_power(PowerKind::kStrength));
  }
}

TEST(Respawn, ADeathmatchBeginsAnewAtAnyOfItsStarts) {
  test::LevelBuilder map = room();
  for (int i = 0; i < 4; ++i) map.thing(kDeathmatchStart, 200 + 200 * i, 100);
  Game game(map, {}, kDeathmatch);
  game.give("Shotgun");
  std::vector<Fixed> places;
  for (int death = 0; death < 12; ++death) {
    damage_actor(game.world, game.body(), nullptr, nullptr, 1000);
    game.tics(40);
    ASSERT_TRUE(game.player().alive);
    EXPECT_EQ(game.has("Shotgun"), 0);
    if (std::find(places.begin(), places.end(), game.body().spawn_x) == places.end())
      places.push_back(game.body().spawn_x);
  }
  EXPECT_GE(places.size(), 3u);
}

TEST(Respawn, TheFarthestStartIsThatWithMostRoomRoundIt) {
  test::LevelBuilder map = room();
  map.thing(2, 128, 64)
      .thing(kDeathmatchStart, 200, 0)
      .thing(kDeathmatchStart, 900, 0)
      .thing(kDeathmatchStart, 500, 0);
  WorldOptions options = kDeathmatch;
  options.player_count = 2;
  Game game(map, {GameFlag::kSpawnFarthest}, options);
  EXPECT_EQ(game.body(0).x, to_fixed(200)) << "the first comes to an empty map";
  EXPECT_EQ(game.body(1).x, to_fixed(900));
}

TEST(Respawn, ProtectionLasts105TicsAndOneLessAfterADeath) {
  test::LevelBuilder map = room();
  Game game(map, {GameFlag::kRespawnProtection}, kCooperative);
  const auto protected_tics = [&] {
    int tics = 0;
    for (; damage_actor(game.world, game.body(), nullptr, nullptr, 7) == 0; ++tics) game.tics(1);
    return tics;
  };
  EXPECT_EQ(protected_tics(), 105);
  damage_actor(game.world, game.body(), nullptr, nullptr, kTelefragDamage);
  while (!game.player().alive) game.tics(1);
  EXPECT_EQ(protected_tics(), 104);
  Game alone(map, {GameFlag::kRespawnProtection});
  EXPECT_EQ(damage_actor(alone.world, alone.body(), nullptr, nullptr, 7), 7) << "of networks alone";
}

TEST(Respawn, WhereItDied) {
  test::LevelBuilder map = room();
  Game game(map, {GameFlag::kRespawnWhereDied}, kCooperative);
  Buttons walk;
  walk.forward = true;
  game.tics(20, walk);
  damage_actor(game.world, game.body(), nullptr, nullptr, 1000);
  game.tics(40);
  EXPECT_TRUE(game.player().alive);
  EXPECT_GT(game.body().x, to_fixed(140));
}

}  // namespace game_flags_test
}  // namespace comrad::doom
