// Rules of the world: items, floors that hurt, death, scripts' calls, snapshots and determinism.
#include "sim_workers/engine/tic/tic.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <set>

#include "sim_workers/engine/actors/actor_catalog.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/arena.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace tic_test {

const std::shared_ptr<const ActorCatalog>& catalog() {
  static const auto kCatalog = std::make_shared<const ActorCatalog>();
  return kCatalog;
}
uint32_t type_of(const char* name) { return catalog()->find(name).value(); }

Buttons forward() {
  Buttons buttons;
  buttons.forward = true;
  return buttons;
}

/// `at_open` lets a test set the stage.
struct Game {
  explicit Game(std::shared_ptr<const Level> level = test::one_room(), int players = 1, uint64_t seed = 1,
                void (*at_open)(World&) = nullptr)
      : world(std::move(level), catalog()) {
    reset_world(world, {.player_count = players, .seed = seed});
    if (at_open != nullptr) at_open(world);
    buttons.resize(static_cast<std::size_t>(players));
    for (int player = 0; player < players; ++player)
      world.body_of(player)->reaction_tics = 0;  // no birth pause
  }
  void tics(int count) {
    for (int i = 0; i < count; ++i) run_tic(world, buttons);
  }
  World world;
  std::vector<Buttons> buttons;
};

// ---------------------------------------------------------------- start

// As on the maps of ViZDoom's multi_deathmatch, multi_duel and cig, which have no starts 1 to 8.
TEST(World, PlayersWithoutAStartTakeADeathmatchStartEach) {
  constexpr int kDeathmatchStartNumber = 11;
  test::LevelBuilder builder;
  builder.room(builder.sector(0, 128), -512, -512, 512, 512).thing(1, -400, -400);
  for (const int x : {-200, 0, 200}) builder.thing(kDeathmatchStartNumber, x, 100);
  const auto level = builder.build();
  World world(level, catalog());
  std::set<Fixed> second_player;
  for (uint64_t seed = 0; seed < 20; ++seed) {
    reset_world(world, {.player_count = 4, .seed = seed, .start_at_deathmatch_starts = true});
    EXPECT_EQ(world.body(0).x, to_fixed(-400)) << "its own start";
    std::set<Fixed> taken;
    for (int player = 1; player < 4; ++player) {
      EXPECT_EQ(world.body(player).y, to_fixed(100));
      taken.insert(world.body(player).x);
    }
    EXPECT_EQ(taken.size(), 3u) << "nobody is in another";
    second_player.insert(world.body(1).x);
  }
  EXPECT_EQ(second_player.size(), 3u) << "which one is drawn";
}

TEST(World, StartsWithPlayersAtTheirStarts) {
  Game game(test::one_room(), 2);
  EXPECT_EQ(game.world.body(0).x, to_fixed(-128));
  EXPECT_EQ(game.world.body(1).angle, kAngle180);
  EXPECT_EQ(game.world.player(0).health, 100);
  EXPECT_EQ(game.world.player(0).view_z, to_fixed(41));
  game.tics(3);
  EXPECT_EQ(game.world.tic_count(), 3u);
}

TEST(World, SpawnsTheMapsThingsOfTheSkillAndLeavesMarkersAndUnknownKindsOut) {
  test::LevelBuilder builder;
  const uint32_t room = builder.sector(16, 128);
  builder.room(room, -512, -512, 512, 512).thing(1, 0, 0).thing(2011, 64, 64).thing(48, -64, 64);
  builder.thing(9001, 100, 100).thing(14, 120, 120).thing(31337, 140, 140);
  Game game(builder.build());
  ASSERT_EQ(game.world.actors().size(), 3u);
  EXPECT_EQ(game.world.count_actors(type_of("Stimpack")), 1);
  EXPECT_EQ(game.world.actors()[1].z, to_fixed(16));
}

TEST(World, AMarkerWithAThingIdIsAnActorThatScriptsFind) {
  test::LevelBuilder builder;
  const uint32_t room = builder.sector(16, 128);
  builder.room(room, -512, -512, 512, 512).thing(1, 0, 0);
  builder.thing(9001, 100, 100, 90, 7).thing(14, 120, 120, 0, 8).thing(9001, 140, 140);
  Game game(builder.build());
  EXPECT_EQ(game.world.actors().size(), 3u);
  const Actor* spot = game.world.find_thing(7);
  ASSERT_NE(spot, nullptr);
  EXPECT_EQ(spot->type, type_of("MapSpot"));
  EXPECT_EQ(spot->x, to_fixed(100));
  EXPECT_EQ(spot->angle, kAngle90);
  ASSERT_NE(game.world.find_thing(8), nullptr);
  EXPECT_EQ(game.world.find_thing(8)->type, type_of("TeleportDest"));
  EXPECT_EQ(game.world.find_thing(9), nullptr);
}

TEST(World, AThingWithoutTheSkillFlagDoesNotAppear) {
  test::LevelBuilder builder;
  builder.room(builder.sector(0, 128), -512, -512, 512, 512).thing(1, 0, 0).thing(2011, 64, 64);
  Level level = *builder.build();
  level.things[1].flags &= ~(kThingSkill1 << 2);
  Game game(std::make_shared<const Level>(level));
  EXPECT_EQ(game.world.actors().size(), 1u);
}

TEST(World, ResetBringsBackTheVeryStart) {
  Game game(test::one_room(), 2);
  reset_world(game.world, game.world.options());
  const uint64_t start = game.world.hash();
  game.buttons[0] = forward();
  game.world.set_sector_damage(900, 50, 0);
  game.tics(20);
  EXPECT_NE(game.world.hash(), start);
  reset_world(game.world, game.world.options());
  EXPECT_EQ(game.world.hash(), start);
}

// ---------------------------------------------------------------- items

/// A player at `health` walks over an item of that name; true where it is taken.
bool takes(const char* item, int health, int* health_after = nullptr) {
  Game game;
  damage_player(game.world, 0, 100 - health);
  spawn_actor(game.world, type_of(item), game.world.body(0).x + to_fixed(80), 0, 0, 0);
  game.buttons[0] = forward();
  game.tics(20);
  if (health_after != nullptr) *health_after = game.world.player(0).health;
  return game.world.count_actors(type_of(item)) == 0;
}

TEST(Pickups, HealUpToTheirLimit) {
  int health = 0;
  EXPECT_TRUE(takes("Stimpack", 50, &health));
  EXPECT_EQ(health, 60);
  EXPECT_TRUE(takes("Medikit", 50, &health));
  EXPECT_EQ(health, 75);
  EXPECT_TRUE(takes("Medikit", 99, &health));
  EXPECT_EQ(health, 100);
  EXPECT_TRUE(takes("HealthBonus", 100, &health));
  EXPECT_EQ(health, 101);
}

TEST(Pickups, StayWhereTheyAreAtFullHealth) {
  EXPECT_FALSE(takes("Stimpack", 100));
  EXPECT_FALSE(takes("Medikit", 100));
}

TEST(Pickups, FlashAndCount) {
  Game game;
  damage_player(game.world, 0, 50);
  spawn_actor(game.world, type_of("Stimpack"), game.world.body(0).x + to_fixed(37), 0, 0, 0);
  game.buttons[0] = forward();
  game.tics(2);
  EXPECT_EQ(game.world.player(0).bonus_flash, 6);
  EXPECT_EQ(game.world.player(0).pickup_count, 1);
  EXPECT_EQ(game.world.actors().size(), 1u) << "gone at the end of the tic";
  game.tics(6);
  EXPECT_EQ(game.world.player(0).bonus_flash, 0);
}

TEST(Pickups, AreTakenByMovingOnly) {
  Game game;
  damage_player(game.world, 0, 50);
  spawn_actor(game.world, type_of("Stimpack"), game.world.body(0).x, game.world.body(0).y, 0, 0);
  game.tics(10);
  EXPECT_EQ(game.world.player(0).pickup_count, 0);
  game.buttons[0] = forward();
  game.tics(1);
  EXPECT_EQ(game.world.player(0).pickup_count, 1);
}

TEST(Pickups, AreReachedFrom32BelowTheFeetToTheHead) {
  for (const auto& [z, reached] : {std::pair{56, true}, std::pair{57, false}, std::pair{0, true}}) {
    ActorCatalog hovering;
    const uint32_t type = hovering.find("Medikit").value();
    hovering.edit(type).flags.set(ActorFlag::kNoGravity);
    World world(test::one_room(), std::make_shared<const ActorCatalog>(hovering));
    reset_world(world, {});
    damage_player(world, 0, 50);  // which wakes it as well
    spawn_actor(world, type, world.body(0).x, world.body(0).y, to_fixed(z), 0);
    const Buttons buttons = forward();
    run_tic(world, {&buttons, 1});
    EXPECT_EQ(world.player(0).pickup_count, reached ? 1 : 0) << z;
  }
}

TEST(Pickups, TouchSquaresNotCircles) {
  for (const auto& [offset, taken] : {std::pair{35, true}, std::pair{36, false}}) {
    Game game;
    damage_player(game.world, 0, 50);
    // Far enough ahead in y only; moving along x keeps |dy|.
    spawn_actor(game.world, type_of("Stimpack"), game.world.body(0).x + to_fixed(30), to_fixed(offset), 0, 0);
    game.buttons[0] = forward();
    game.tics(10);
    EXPECT_EQ(game.world.player(0).pickup_count, taken ? 1 : 0) << offset;
  }
}

// ---------------------------------------------------------------- floors, death

void hurt_arena(World& world) { world.set_sector_damage(900, 5, 32); }

TEST(SectorDamage, TwentyHitsOfFiveKillWhenTheMapClockReads640) {
  Game game(test::one_room(), 1, 1, hurt_arena);
  game.tics(32);
  EXPECT_EQ(game.world.player(0).health, 100) << "clock 0 came before the script";
  game.tics(1);
  EXPECT_EQ(game.world.player(0).health, 95);
  game.tics(640 - 33);
  EXPECT_EQ(game.world.tic_count(), 640u);
  EXPECT_TRUE(game.world.player(0).alive);
  EXPECT_EQ(game.world.player(0).health, 5);
  game.tics(1);
  EXPECT_FALSE(game.world.player(0).alive);
  EXPECT_EQ(game.world.player(0).death_tic, 640u);
  EXPECT_EQ(game.world.player(0).damage_taken, 100);
}

TEST(SectorDamage, FiftyAndMoreHurtEveryTic) {
  Game game(test::one_room(), 1, 1, [](World& world) { world.set_sector_damage(900, 50, 0); });
  game.tics(2);
  EXPECT_EQ(game.world.player(0).health, 50);
  game.tics(1);
  EXPECT_FALSE(game.world.player(0).alive);
}

TEST(SectorDamage, NeedsFeetOnTheFloorAndTheRightTag) {
  Game game(test::one_room(), 1, 1, [](World& world) { world.set_sector_damage(900, 50, 0); });
  game.buttons[0].jump = true;
  game.tics(1);  // clock 0 does not hurt and the jump lifts off
  game.tics(15);
  EXPECT_EQ(game.world.player(0).health, 100);
  Game other(test::one_room(), 1, 1, [](World& world) { world.set_sector_damage(901, 50, 0); });
  other.tics(10);
  EXPECT_EQ(other.world.player(0).health, 100);
}

TEST(SectorDamage, FlashesRedAndFades) {
  Game game(test::one_room(), 1, 1, hurt_arena);
  game.tics(33);
  EXPECT_EQ(game.world.player(0).damage_flash, 5);
  game.tics(5);
  EXPECT_EQ(game.world.player(0).damage_flash, 0);
}

TEST(Death, LeavesACorpseThatIsNotSolidAndDoesNotObey) {
  Game game(test::one_room(), 2);
  damage_player(game.world, 1, 1000);
  EXPECT_EQ(game.world.player(1).health, 0);
  EXPECT_TRUE(game.world.body(1).is_corpse());
  const ActorType& type = (*catalog())[game.world.body(1).type];
  EXPECT_EQ(game.world.body(1).state, type.state(StateLabel::kXDeath)) << "far below zero: torn apart";
  const Fixed x = game.world.body(1).x;
  game.buttons[0] = game.buttons[1] = forward();
  game.buttons[0].speed = true;
  game.tics(60);
  EXPECT_EQ(game.world.body(1).x, x);
  EXPECT_GT(game.world.body(0).x, x + to_fixed(40)) << "walked through";
  EXPECT_EQ(game.world.player(1).view_height, to_fixed(6));
  damage_player(game.world, 1, 10);
  EXPECT_EQ(game.world.player(1).death_count, 1);
  EXPECT_EQ(game.world.player(1).death_tic, 0u);
}

TEST(Death, ACorpseSlidesOnWithFriction) {
  Game game;
  game.buttons[0] = forward();
  game.tics(15);
  damage_player(game.world, 0, 100);
  const Fixed x = game.world.body(0).x;
  game.tics(60);
  EXPECT_GT(game.world.body(0).x, x + to_fixed(20));
  EXPECT_EQ(game.world.body(0).velocity_x, 0);
}

// ---------------------------------------------------------------- frames, exports, exit

TEST(Frames, ThePlayerWalksWhileItMovesAndStandsStillAfter) {
  Game game;
  const ActorType& type = (*catalog())[game.world.body(0).type];
  const uint32_t walk = type.state(StateLabel::kSee);
  game.buttons[0] = forward();
  std::vector<uint32_t> seen;
  for (int tic = 0; tic < 20; ++tic) {
    game.tics(1);
    const uint32_t state = game.world.body(0).state - walk;
    if (seen.empty() || seen.back() != state) seen.push_back(state);
  }
  EXPECT_THAT(seen, testing::ElementsAre(0, 1, 2, 3, 0, 1));
  game.buttons[0] = Buttons{};
  game.tics(80);
  EXPECT_EQ(game.world.body(0).state, type.state(StateLabel::kSpawn));
}

TEST(Frames, AHealthBonusGoesThroughItsLetters) {
  Game game;
  const uint32_t bonus = spawn_actor(game.world, type_of("HealthBonus"), 0, to_fixed(200), 0, 0).value();
  std::string letters;
  for (int tic = 0; tic < 36; tic += 6) {
    letters += static_cast<char>('A' + game.world.find_actor(bonus)->frame);
    game.tics(6);
  }
  EXPECT_EQ(letters, "ABCDCB");
  EXPECT_EQ(game.world.find_actor(bonus)->frame, 0);
}

TEST(World, NothingMovesAfterTheLevelWasExited) {
  Game game;
  game.buttons[0] = forward();
  game.tics(3);
  game.world.exit_level();
  const uint64_t hash = game.world.hash();
  game.tics(5);
  EXPECT_EQ(game.world.hash(), hash);
  EXPECT_TRUE(game.world.level_exited());
}

TEST(World, ExportsStayInsideTheirRange) {
  Game game;
  game.world.set_export(60, 7);
  game.world.set_export(64, 9);
  game.world.set_export(-1, 9);
  EXPECT_EQ(game.world.exported(60), 7);
  EXPECT_EQ(game.world.exported(64), 0);
  EXPECT_EQ(game.world.exported(-1), 0);
}

// ---------------------------------------------------------------- many actors

TEST(Actors, StaySortedCompactAndFindableWhileTheyComeAndGo) {
  Game game(test::star_arena());
  Rng rng(3);
  std::vector<uint32_t> alive;
  for (int tic = 0; tic < 500; ++tic) {
    for (int i = 0; i < 5; ++i) {
      const auto id = spawn_actor(game.world, type_of("Medikit"), to_fixed(rng.between(-900, 900)),
                                  to_fixed(rng.between(-900, 900)), 0, 0);
      if (id) alive.push_back(*id);
    }
    while (alive.size() > 60) {
      const std::size_t index = rng.below(static_cast<uint32_t>(alive.size()));
      game.world.remove(alive[index]);
      EXPECT_EQ(game.world.find_actor(alive[index]), nullptr);
      alive.erase(alive.begin() + static_cast<std::ptrdiff_t>(index));
    }
    game.tics(1);
    ASSERT_EQ(game.world.actors().size(), alive.size() + 1);
    ASSERT_EQ(game.world.count_actors(type_of("Medikit")), static_cast<int>(alive.size()));
    uint32_t last = 0;
    for (const Actor& actor : game.world.actors()) {
      ASSERT_GT(actor.id, last);
      last = actor.id;
    }
    for (uint32_t id : alive) ASSERT_EQ(game.world.find_actor(id)->id, id);
  }
}

TEST(Actors, ItemsFoundThroughTheGridAreThoseThatOverlap) {
  // Every item lies where a slow player will pass; after the walk exactly those within reach are gone.
  Game game;
  damage_player(game.world, 0, 99);
  Rng rng(5);
  std::vector<std::pair<uint32_t, bool>> items;
  for (int i = 0; i < 200; ++i) {
    const int x = rng.between(-60, 300), y = rng.between(-200, 200);
    const auto id = spawn_actor(game.world, type_of("HealthBonus"), to_fixed(x), to_fixed(y), 0, 0);
    items.emplace_back(id.value(), std::abs(y) < 36);
  }
  game.buttons[0] = forward();
  while (game.world.body(0).x < to_fixed(320)) game.tics(1);
  for (const auto& [id, gone] : items) EXPECT_EQ(game.world.find_actor(id) == nullptr, gone);
}

TEST(Actors, APlayersBodyCannotBeRemoved) {
  Game game;
  game.world.remove(game.world.player(0).actor_id);
  game.tics(1);
  EXPECT_EQ(game.world.body(0).player_index, 0);
}

// ---------------------------------------------------------------- determinism

/// A map whose floor hurts.
void start(World& world, const WorldOptions& options) {
  reset_world(world, options);
  hurt_arena(world);
}

/// A tic, and kits now and then from the world's own dice, as a scenario's scripts spawn them.
void tic_with_kits(World& world, std::span<const Buttons> buttons) {
  run_tic(world, buttons);
  if (world.tic_count() % 35 != 1) return;
  const Fixed x = to_fixed(world.rng().between(-900, 900)), y = to_fixed(world.rng().between(-900, 900));
  spawn_actor(world, type_of(world.rng().below(4) == 0 ? "Medikit" : "Stimpack"), x, y, 0, 0);
}

std::vector<Buttons> random_buttons(Rng& rng, int players) {
  std::vector<Buttons> buttons(static_cast<std::size_t>(players));
  for (Buttons& player : buttons) {
    player.forward = rng.below(3) != 0, player.backward = rng.below(5) == 0;
    player.left = rng.below(4) == 0, player.right = rng.below(4) == 0;
    player.turn_left = rng.below(3) == 0, player.turn_right = rng.below(3) == 0;
  }
  return buttons;
}

TEST(Determinism, SameSeedAndActionsGiveTheSameHashAtEveryTicEvenInterleaved) {
  const std::shared_ptr<const Level> level = test::star_arena();
  std::vector<uint64_t> alone;
  {
    World world(level, catalog());
    start(world, {.player_count = 2, .seed = 7});
    Rng rng(11);
    for (int tic = 0; tic < 600; ++tic) {
      tic_with_kits(world, random_buttons(rng, 2));
      alone.push_back(world.hash());
    }
  }
  World first(level, catalog()), second(level, catalog());
  start(first, {.player_count = 2, .seed = 7});
  start(second, {.player_count = 3, .seed = 8});
  Rng first_rng(11), second_rng(12);
  for (int tic = 0; tic < 600; ++tic) {
    tic_with_kits(second, random_buttons(second_rng, 3));
    tic_with_kits(first, random_buttons(first_rng, 2));
    ASSERT_EQ(first.hash(), alone[static_cast<std::size_t>(tic)]) << "tic " << tic;
  }
  EXPECT_NE(first.hash(), second.hash());
}

TEST(Determinism, ACopyIsASnapshotThatContinuesAsTheOriginal) {
  World world(test::star_arena(), catalog());
  start(world, {.player_count = 2, .seed = 7});
  Rng rng(11);
  for (int tic = 0; tic < 300; ++tic) tic_with_kits(world, random_buttons(rng, 2));
  World snapshot = world;
  EXPECT_EQ(snapshot.hash(), world.hash());
  const uint64_t state = rng.state();
  for (int tic = 0; tic < 300; ++tic) tic_with_kits(world, random_buttons(rng, 2));
  EXPECT_NE(snapshot.hash(), world.hash());
  rng = Rng::restore(state);
  for (int tic = 0; tic < 300; ++tic) tic_with_kits(snapshot, random_buttons(rng, 2));
  EXPECT_EQ(snapshot.hash(), world.hash());
}

TEST(Determinism, TheSeedMattersAndSoDoesEveryButton) {
  World world(test::star_arena(), catalog());
  const auto hash_of = [&](uint64_t seed, auto&& press) {
    start(world, {.player_count = 1, .seed = seed});
    world.body_of(0)->reaction_tics = 0;
    Buttons buttons;
    press(buttons);
    tic_with_kits(world, {&buttons, 1});
    return world.hash();
  };
  const uint64_t idle = hash_of(1, [](Buttons&) {});
  EXPECT_EQ(idle, hash_of(1, [](Buttons&) {}));
  EXPECT_NE(idle, hash_of(2, [](Buttons&) {}));
  EXPECT_NE(idle, hash_of(1, [](Buttons& b) { b.forward = true; }));
  EXPECT_NE(idle, hash_of(1, [](Buttons& b) { b.left = true; }));
  EXPECT_NE(idle, hash_of(1, [](Buttons& b) { b.turn_left = true; }));
  EXPECT_NE(idle, hash_of(1, [](Buttons& b) { b.jump = true; }));
}

}  // namespace tic_test
}  // namespace comrad::doom
