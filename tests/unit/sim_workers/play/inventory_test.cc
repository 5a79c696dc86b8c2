// What players carry: every kind of item, armour, keys and locks, powers, drops, coming back.
#include "sim_workers/engine/play/inventory.h"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/weapons.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/unit/sim_workers/play/monster_stage.h"

namespace comrad::doom {
namespace inventory_test {

using test::LevelBuilder;
using test::Stage;

uint32_t type_of(std::string_view name) { return test::game_catalog()->find(name).value(); }

/// Puts an item under the player's hands; true where it is taken.
bool touch(Stage& stage, std::string_view name, int player = 0) {
  Actor& body = stage.body(player);
  Actor& item = stage.world.spawn_unchecked(type_of(name), body.x, body.y, body.z);
  return touch_item(stage.world, body, item);
}
int held(const Stage& stage, std::string_view name, int player = 0) {
  return count_item(stage.world, player, type_of(name));
}

// ---------------------------------------------------------------- items of the map

struct Pickup {
  const char* item;
  const char* counted;
  int amount, limit;
};

class AmmoPickup : public ::testing::TestWithParam<Pickup> {};

TEST_P(AmmoPickup, GivesItsAmountUpToTheLimitAndTwiceOnTheEasiestSkill) {
  const Pickup pickup = GetParam();
  for (const int skill : {1, 3, 5}) {
    Stage stage(test::big_room().build(), {.skill = skill});
    take_item(stage.world, 0, type_of(pickup.counted), 0);
    EXPECT_TRUE(touch(stage, pickup.item));
    const int factor = skill == 3 ? 1 : 2;
    EXPECT_EQ(held(stage, pickup.counted), std::min(pickup.amount * factor, pickup.limit));
    for (int i = 0; i < 60; ++i) touch(stage, pickup.item);
    EXPECT_EQ(held(stage, pickup.counted), pickup.limit);
    EXPECT_FALSE(touch(stage, pickup.item)) << "full";
  }
}

INSTANTIATE_TEST_SUITE_P(
    All, AmmoPickup,
    ::testing::Values(Pickup{"Clip", "Clip", 10, 200}, Pickup{"ClipBox", "Clip", 50, 200},
                      Pickup{"Shell", "Shell", 4, 50}, Pickup{"ShellBox", "Shell", 20, 50},
                      Pickup{"RocketAmmo", "RocketAmmo", 1, 50}, Pickup{"RocketBox", "RocketAmmo", 5, 50},
                      Pickup{"Cell", "Cell", 20, 300}, Pickup{"CellPack", "Cell", 100, 300}),
    [](const auto& pickup) { return std::string(pickup.param.item); });

class WeaponPickup : public ::testing::TestWithParam<Pickup> {};

TEST_P(WeaponPickup, BringsItsAmmunitionAndComesUp) {
  const Pickup pickup = GetParam();
  Stage stage;
  take_item(stage.world, 0, type_of(pickup.counted), 0);
  EXPECT_TRUE(touch(stage, pickup.item));
  EXPECT_EQ(held(stage, pickup.item), 1);
  EXPECT_EQ(held(stage, pickup.counted), pickup.amount);
  stage.tics(50);
  EXPECT_EQ(stage.player().ready_weapon, type_of(pickup.item));
  EXPECT_TRUE(touch(stage, pickup.item)) << "its ammunition is welcome";
  EXPECT_EQ(held(stage, pickup.item), 1);
  EXPECT_EQ(held(stage, pickup.counted), std::min(2 * pickup.amount, pickup.limit));
}

INSTANTIATE_TEST_SUITE_P(
    All, WeaponPickup,
    ::testing::Values(Pickup{"Shotgun", "Shell", 8, 50}, Pickup{"SuperShotgun", "Shell", 8, 50},
                      Pickup{"Chaingun", "Clip", 20, 200}, Pickup{"RocketLauncher", "RocketAmmo", 2, 50},
                      Pickup{"PlasmaRifle", "Cell", 40, 300}, Pickup{"BFG9000", "Cell", 40, 300}),
    [](const auto& pickup) { return std::string(pickup.param.item); });

TEST(Items, SpheresHealBeyondAHundred) {
  Stage stage;
  EXPECT_TRUE(touch(stage, "Soulsphere"));
  EXPECT_EQ(stage.player().health, 200);
  damage_actor(stage.world, stage.body(), nullptr, nullptr, 150);
  EXPECT_TRUE(touch(stage, "Megasphere"));
  EXPECT_EQ(stage.player().health, 200);
  EXPECT_EQ(stage.player().armor, 200);
  EXPECT_EQ(stage.body().health, 200);
}

TEST(Items, ABackpackDoublesTheRoomAndBringsALittleOfEach) {
  Stage stage;
  EXPECT_TRUE(touch(stage, "Backpack"));
  EXPECT_EQ(held(stage, "Clip"), 60);
  EXPECT_EQ(held(stage, "Shell"), 4);
  EXPECT_EQ(held(stage, "RocketAmmo"), 1);
  EXPECT_EQ(held(stage, "Cell"), 20);
  for (int i = 0; i < 20; ++i) touch(stage, "ClipBox");
  EXPECT_EQ(held(stage, "Clip"), 400);
  EXPECT_TRUE(touch(stage, "Backpack")) << "always taken";
}

TEST(Items, BerserkHealsAndPutsUpTheFist) {
  Stage stage;
  damage_actor(stage.world, stage.body(), nullptr, nullptr, 60);
  EXPECT_TRUE(touch(stage, "Berserk"));
  EXPECT_EQ(stage.player().health, 100);
  EXPECT_TRUE(stage.player().has_power(PowerKind::kStrength));
  stage.tics(50);
  EXPECT_EQ(stage.player().ready_weapon, type_of("Fist"));
}

TEST(Items, PowersLastTheirTimeAndEnd) {
  for (const auto& [item, power, seconds] :
       {std::tuple{"InvulnerabilitySphere", PowerKind::kInvulnerable, 30},
        std::tuple{"BlurSphere", PowerKind::kInvisibility, 60},
        std::tuple{"RadSuit", PowerKind::kIronFeet, 60}, std::tuple{"Infrared", PowerKind::kLightAmp, 120}}) {
    Stage stage;
    EXPECT_TRUE(touch(stage, item));
    stage.tics(seconds * 35 - 1);
    EXPECT_TRUE(stage.player().has_power(power)) << item;
    stage.tics(2);
    EXPECT_FALSE(stage.player().has_power(power)) << item;
  }
  Stage stage;
  EXPECT_TRUE(touch(stage, "Allmap"));
  EXPECT_TRUE(stage.player().has_power(PowerKind::kAllMap));
}

TEST(Items, InvulnerabilityTakesNoDamageAndASuitNoneFromSlime) {
  Stage stage;
  touch(stage, "InvulnerabilitySphere");
  damage_actor(stage.world, stage.body(), nullptr, nullptr, 50);
  EXPECT_EQ(stage.player().health, 100);

  LevelBuilder builder;
  const uint32_t slime = builder.sector(0, 256);
  builder.sector_at(slime).special = 71;
  builder.room(slime, -512, -512, 512, 512).thing(1, 0, 0);
  Stage bare(builder.build()), suited(builder.build());
  touch(suited, "RadSuit");
  bare.tics(100), suited.tics(100);
  EXPECT_EQ(bare.player().health, 100 - 4 * 5);
  EXPECT_EQ(suited.player().health, 100);
}

TEST(Items, ItemsCountAndFlash) {
  Stage stage;
  touch(stage, "HealthBonus");
  touch(stage, "Clip");
  EXPECT_EQ(stage.player().item_count, 1) << "bonuses count as items, clips do not";
  EXPECT_EQ(stage.player().pickup_count, 2);
  EXPECT_EQ(stage.player().bonus_flash, 12);
}

TEST(Items, AThingsSpecialRunsWhenItIsTaken) {
  LevelBuilder builder = test::big_room();
  Stage stage(builder.build());
  Actor& item = stage.world.spawn_unchecked(type_of("GreenArmor"), stage.body().x, stage.body().y, 0);
  item.special = 243;  // Exit_Normal
  EXPECT_TRUE(touch_item(stage.world, stage.body(), item));
  EXPECT_TRUE(stage.world.level_exited());
}

// ---------------------------------------------------------------- armour

TEST(Armor, TakesAThirdOrHalfOfTheDamage) {
  Stage green, blue;
  touch(green, "GreenArmor"), touch(blue, "BlueArmor");
  damage_actor(green.world, green.body(), nullptr, nullptr, 30);
  damage_actor(blue.world, blue.body(), nullptr, nullptr, 30);
  EXPECT_EQ(green.player().health, 80);
  EXPECT_EQ(green.player().armor, 90);
  EXPECT_EQ(blue.player().health, 85);
  EXPECT_EQ(blue.player().armor, 185);
}

TEST(Armor, GivesOutAndIsReplacedByBetterOnly) {
  Stage stage;
  touch(stage, "ArmorBonus");
  touch(stage, "ArmorBonus");
  EXPECT_EQ(stage.player().armor, 2);
  damage_actor(stage.world, stage.body(), nullptr, nullptr, 30);
  EXPECT_EQ(stage.player().armor, 0);
  EXPECT_EQ(stage.player().health, 72);
  EXPECT_TRUE(touch(stage, "GreenArmor"));
  EXPECT_FALSE(touch(stage, "GreenArmor")) << "as good as what is worn";
  EXPECT_TRUE(touch(stage, "BlueArmor"));
  EXPECT_FALSE(touch(stage, "GreenArmor"));
  for (int i = 0; i < 10; ++i) touch(stage, "ArmorBonus");
  EXPECT_EQ(stage.player().armor, 200);
}

// ---------------------------------------------------------------- keys

TEST(Keys, OpenTheirLocksAndAnyOfAColour) {
  const auto opens = [](const char* key, int lock) {
    Stage stage;
    if (key != nullptr) touch(stage, key);
    return has_key(stage.world, stage.body(), lock);
  };
  const char* const keys[] = {"RedCard", "BlueCard", "YellowCard", "RedSkull", "BlueSkull", "YellowSkull"};
  for (int key = 0; key < 6; ++key)
    for (int lock = 1; lock <= 6; ++lock)
      EXPECT_EQ(opens(keys[key], lock), lock == key + 1) << keys[key] << lock;
  EXPECT_TRUE(opens("RedSkull", 129));
  EXPECT_TRUE(opens("RedCard", 129));
  EXPECT_FALSE(opens("BlueCard", 129));
  EXPECT_TRUE(opens("BlueSkull", 100));
  EXPECT_FALSE(opens(nullptr, 100));
  EXPECT_TRUE(opens(nullptr, 0));
  EXPECT_FALSE(opens("RedCard", 77)) << "no such lock";
}

TEST(Keys, StayForTheOtherPlayers) {
  LevelBuilder builder = test::big_room();
  builder.thing(2, 64, 0).thing(13, 40, 0).thing(2001, 40, 0).thing(2008, 40, 0);
  Stage stage(builder.build(), {.player_count = 2});
  stage.body(0).reaction_tics = stage.body(1).reaction_tics = 0;
  stage.buttons[0].forward = true;
  stage.tics(8);
  EXPECT_EQ(held(stage, "RedCard", 0), 1);
  EXPECT_EQ(held(stage, "Shotgun", 0), 1);
  EXPECT_EQ(stage.count("RedCard"), 1);
  EXPECT_EQ(stage.count("Shotgun"), 1);
  EXPECT_EQ(stage.count("Shell"), 0) << "ammunition goes to the first";
  EXPECT_EQ(held(stage, "Shell", 0), 12);
  stage.tics(1);
  EXPECT_EQ(held(stage, "Shell", 0), 12) << "and a weapon that stays gives only once";
}

// ---------------------------------------------------------------- drops, coming back

TEST(Drops, TheDeadLeaveWhatTheyCarriedAndHalfOfItsAmmunition) {
  for (const auto& [monster, item, counted, amount] :
       {std::tuple{"ZombieMan", "Clip", "Clip", 5}, std::tuple{"ShotgunGuy", "Shotgun", "Shell", 4},
        std::tuple{"ChaingunGuy", "Chaingun", "Clip", 10}}) {
    Stage stage;
    Actor& victim = stage.spawn(monster, 200, 0);
    damage_actor(stage.world, victim, nullptr, nullptr, victim.health);
    stage.tics(60);
    ASSERT_EQ(stage.count(item), 1) << monster;
    const int before = held(stage, counted);
    Actor* dropped = nullptr;
    for (Actor& actor : stage.world.state().actors)
      if (actor.type == type_of(item)) dropped = &actor;
    ASSERT_NE(dropped, nullptr);
    EXPECT_TRUE(dropped->has(ActorFlag::kDropped));
    set_position(stage.world, stage.body().id, dropped->x, dropped->y, 0);
    EXPECT_TRUE(touch_item(stage.world, stage.body(), *dropped));
    EXPECT_EQ(held(stage, counted) - before, amount) << monster;
  }
}

TEST(Respawn, BringsAPlayerBackAtItsStartWithItsFirstThings) {
  LevelBuilder builder = test::big_room();
  builder.thing(2, 300, 0);
  Stage stage(builder.build(), {.player_count = 2, .forced_respawn = true, .respawn_delay_tics = 35});
  touch(stage, "Shotgun");
  touch(stage, "BlueArmor");
  set_position(stage.world, stage.body().id, to_fixed(200), to_fixed(200), 0);
  const uint32_t old_body = stage.body().id;
  damage_actor(stage.world, stage.body(), nullptr, nullptr, 1000);
  EXPECT_EQ(stage.player().death_count, 1);
  stage.tics(35);
  EXPECT_FALSE(stage.player().alive);
  stage.tics(3);
  ASSERT_TRUE(stage.player().alive);
  EXPECT_NE(stage.body().id, old_body);
  EXPECT_EQ(stage.body().x, 0);
  EXPECT_EQ(stage.player().health, 100);
  EXPECT_EQ(stage.player().armor, 0);
  EXPECT_EQ(held(stage, "Shotgun"), 0);
  EXPECT_EQ(held(stage, "Clip"), 50);
  EXPECT_EQ(stage.player().respawn_count, 1);
  EXPECT_NE(stage.world.find_actor(old_body), nullptr) << "the corpse stays";
  EXPECT_EQ(stage.player(1).health, 100);
}

TEST(Respawn, WaitsWhileSomebodyStandsOnTheStart) {
  LevelBuilder builder = test::big_room();
  builder.thing(2, 300, 0);
  Stage stage(builder.build(), {.player_count = 2, .forced_respawn = true});
  set_position(stage.world, stage.body(0).id, to_fixed(-400), 0, 0);
  set_position(stage.world, stage.body(1).id, to_fixed(5), 0, 0);
  damage_actor(stage.world, stage.body(0), nullptr, nullptr, 1000);
  stage.tics(20);
  EXPECT_FALSE(stage.player(0).alive);
  set_position(stage.world, stage.body(1).id, to_fixed(300), 0, 0);
  stage.tics(2);
  EXPECT_TRUE(stage.player(0).alive);
}

TEST(Players, AreSolidToEachOther) {
  LevelBuilder builder = test::big_room();
  builder.thing(2, 100, 0, 180);
  Stage stage(builder.build(), {.player_count = 2});
  stage.buttons[0].forward = stage.buttons[0].speed = true;
  stage.tics(60);
  EXPECT_LE(stage.body(0).x, to_fixed(100 - 32));
  EXPECT_GT(stage.body(0).x, to_fixed(100 - 32 - 17));
  EXPECT_EQ(stage.body(1).x, to_fixed(100));
}

TEST(Items, FeetAboveTheTopLeaveItAndItsSecretCountsOnce) {
  Stage stage;
  Actor& item = stage.spawn("HealthBonus", 0, 0);
  item.set(ActorFlag::kCountSecret);
  const uint32_t id = item.id;
  stage.body().z = item.top();
  EXPECT_FALSE(touch_item(stage.world, stage.body(), stage.at(id))) << "as ViZDoom's players jump over it";
  stage.body().z = stage.at(id).top() - 1;
  EXPECT_TRUE(touch_item(stage.world, stage.body(), stage.at(id)));
  EXPECT_EQ(stage.player().health, 101);
  EXPECT_EQ(stage.player().secret_count, 1);
}

// As ViZDoom 1.3.2 plays "-host 1 -deathmatch": 20 shells, a clip again 1 050 tics later, all keys at the start.
TEST(Deathmatch, ItemsComeBackWeaponsStayAndKeysAreHeld) {
  constexpr int kShotgun = 2001, kClip = 2007, kBlueCard = 5;
  LevelBuilder room = test::big_room();
  room.thing(kShotgun, 200, 0).thing(kClip, 300, 0).thing(kBlueCard, 400, 0);
  Stage stage(room.build(), {.deathmatch = true});
  EXPECT_EQ(stage.count("BlueCard"), 0);
  EXPECT_EQ(held(stage, "BlueCard"), 1);
  const auto item = [&](const char* name) -> Actor& {
    for (Actor& actor : stage.world.state().actors)
      if (stage.world.catalog().is_a(actor.type, name)) return actor;
    ADD_FAILURE() << name;
    return stage.body();
  };
  EXPECT_TRUE(touch_item(stage.world, stage.body(), item("Shotgun")));
  EXPECT_EQ(held(stage, "Shell"), 20);
  EXPECT_FALSE(touch_item(stage.world, stage.body(), item("Shotgun"))) << "it stays, and gives once";
  stage.tics(1);
  EXPECT_EQ(stage.count("Shotgun"), 1);

  ASSERT_TRUE(touch_item(stage.world, stage.body(), item("Clip")));
  EXPECT_FALSE(item("Clip").has(ActorFlag::kSpecial));
  stage.tics(1049);
  EXPECT_FALSE(item("Clip").has(ActorFlag::kSpecial));
  stage.tics(1);
  EXPECT_TRUE(item("Clip").has(ActorFlag::kSpecial));
  EXPECT_TRUE(touch_item(stage.world, stage.body(), item("Clip")));
}

// The values are ViZDoom 1.3.2's, by a map and a script that reads them.
TEST(MapThings, TakeTheFieldsOfUdmf) {
  constexpr int kImp = 3001, kDecoration = 2012;  // a Medikit
  const auto fields = [](auto change) {
    MapThing thing;
    change(thing);
    return thing;
  };
  LevelBuilder room = test::big_room();
  room.thing(kImp, 100, 300, 0, 1, fields([](MapThing& t) { t.flags = kThingFriend | kThingStanding; }))
      .thing(kImp, 200, 300, 0, 2, fields([](MapThing& t) { t.health = 2; }))
      .thing(kImp, 300, 300, 0, 3, fields([](MapThing& t) { t.health = -33, t.gravity = kFracUnit / 2; }))
      .thing(kDecoration, 100, 500, 0, 4,
             fields([](MapThing& t) { t.alpha = 0.25f, t.scale_x = t.scale_y = 2; }))
      .thing(kDecoration, 200, 500, 0, 5, fields([](MapThing& t) { t.flags = kThingInvisible; }))
      .thing(kDecoration, 300, 500, 0, 6,
             fields([](MapThing& t) { t.flags = kThingShadow, t.pitch_degrees = 30; }))
      .thing(kDecoration, 400, 500, 0, 7,
             fields([](MapThing& t) { t.score = 7, t.flags = kThingCountSecret; }))
      .thing(kDecoration, 500, 500, 0, 8, fields([](MapThing& t) { t.class_filter = 0xFFFE; }))
      .thing(kImp, 400, 300, 0, 9, fields([](MapThing& t) { t.health = 0; }));
  Stage stage(room.build());
  const auto made = [&](int id) -> const Actor* {
    for (const Actor& actor : stage.world.actors())
      if (actor.thing_id == id) return &actor;
    return nullptr;
  };
  EXPECT_TRUE(made(1)->has(ActorFlag::kFriendly) && made(1)->has(ActorFlag::kStandStill));
  EXPECT_EQ(stage.world.state().monster_count, 3) << "friends are none";
  EXPECT_EQ(made(2)->health, 120);
  EXPECT_EQ(made(3)->health, 33);
  EXPECT_EQ(made(3)->gravity, kFracUnit / 2);
  EXPECT_EQ(made(4)->alpha, 0.25f);
  EXPECT_EQ(made(4)->scale_x, 2.0f);
  EXPECT_EQ(made(5)->render_style, RenderStyle::kNone);
  EXPECT_EQ(made(6)->render_style, RenderStyle::kTranslucent);
  EXPECT_EQ(made(6)->alpha, 0.25f);
  EXPECT_EQ(made(6)->pitch, degrees_to_angle(30));
  EXPECT_EQ(made(7)->score, 7);
  EXPECT_EQ(stage.world.state().secret_total, 1);
  EXPECT_NE(made(8), nullptr) << "classes do not count: Doom's player has no number";
  EXPECT_EQ(made(2)->start_health, 120);
  EXPECT_LE(made(9)->health, 0) << "half a health is none: it lies dead when the map begins";
  EXPECT_EQ(stage.world.state().kill_total, 1);
}

TEST(Monsters, ComeBackOnTheHighestSkillWhereTheyWereBorn) {
  const auto returns = [](int skill) {
    LevelBuilder room = test::big_room();
    for (int i = 0; i < 8; ++i) room.thing(3004, -400 + 100 * i, 400, 90, 7);
    Stage stage(room.build(), {.skill = skill});
    stage.make_player_tough();
    std::vector<uint32_t> first;
    for (const Actor& actor : stage.world.actors())
      if (actor.thing_id == 7) first.push_back(actor.id);
    for (const uint32_t id : first) damage_actor(stage.world, stage.at(id), nullptr, nullptr, 10'000);
    stage.tics(419);
    int back = stage.count("ZombieMan");
    EXPECT_EQ(back, 8) << "corpses alone, before twelve seconds";
    stage.tics(2600);
    int living = 0;
    for (const Actor& actor : stage.world.actors())
      living += actor.health > 0 && stage.world.catalog().is_a(actor.type, "ZombieMan");
    return living;
  };
  EXPECT_EQ(returns(4), 0);
  EXPECT_GE(returns(5), 4) << "8 in 10 on average, as 7 of 8 in ViZDoom";
}

TEST(Players, OneWhoIsBornCannotMoveForEightTicsUnlessItIsHurt) {
  Stage calm, hurt;
  for (Stage* stage : {&calm, &hurt}) {
    reset_world(stage->world, {});
    stage->buttons[0].forward = true;
  }
  calm.tics(8);
  EXPECT_EQ(calm.body().x, 0);
  calm.tics(1);
  EXPECT_GT(calm.body().x, 0);
  damage_actor(hurt.world, hurt.body(), nullptr, nullptr, 1);
  hurt.tics(1);
  EXPECT_GT(hurt.body().x, 0);
}

}  // namespace inventory_test
}  // namespace comrad::doom
