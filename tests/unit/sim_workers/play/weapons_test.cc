// Weapons: their pace, what they use up, how hands change them, what they do.
#include "sim_workers/engine/play/weapons.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <map>
#include <string>
#include <vector>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/placement.h"
#include "tests/unit/sim_workers/play/monster_stage.h"

namespace comrad::doom {
namespace weapons_test {

using test::Stage;
using ::testing::Each;

uint32_t type_of(std::string_view name) { return test::game_catalog()->find(name).value(); }

/// A player with a weapon in the hand, ready, and plenty for it.
struct Shooter : Stage {
  explicit Shooter(std::string_view weapon, WorldOptions options = {})
      : Stage(test::big_room().build(), options) {
    for (const char* ammo : {"Clip", "Shell", "RocketAmmo", "Cell"}) give_item(world, 0, type_of(ammo), 300);
    give_item(world, 0, type_of(weapon), 1);
    select_weapon(world, 0, type_of(weapon));
    EXPECT_TRUE(
        tics_until(80, [&] { return player().ready_weapon == type_of(weapon) && player().weapon_ready; }));
  }
  int ammo() const { return selected_ammo(world, 0); }
  /// A body that takes everything and does nothing, ahead of the player.
  Actor& dummy(int distance) {
    Actor& body = spawn("Demon", distance, 0, 180);
    body.health = 10'000'000;
    body.tics = -1;
    body.mass = INT32_MAX;
    body.set(ActorFlag::kNoPain);
    body.threshold = 1'000'000;  // and turns on nobody
    return body;
  }
  /// Tics from the press of the trigger to each of the shots of a burst.
  std::vector<int> shot_tics(int count) {
    std::vector<int> shots;
    buttons[0].attack = true;
    const bool blade = ammo() == 0;
    int32_t before = blade ? player().damage_dealt : ammo();
    for (int tic = 0; tic < 400 && static_cast<int>(shots.size()) < count; ++tic) {
      tics(1);
      const int32_t now = blade ? player().damage_dealt : ammo();
      if (now != before) shots.push_back(tic);
      before = now;
    }
    return shots;
  }
};

std::vector<int> gaps(const std::vector<int>& tics) {
  std::vector<int> result;
  for (std::size_t i = 1; i < tics.size(); ++i) result.push_back(tics[i] - tics[i - 1]);
  return result;
}

// ---------------------------------------------------------------- pace

struct Pace {
  const char* weapon;
  int first, gap, ammo_use;
};

class WeaponPace : public ::testing::TestWithParam<Pace> {};

TEST_P(WeaponPace, ABurstKeepsDoomsTime) {
  const Pace pace = GetParam();
  Shooter stage(pace.weapon);
  stage.dummy(pace.ammo_use == 0 ? 60 : 900);  // within a fist's reach, or out of a blast's
  const int before = stage.ammo();
  const std::vector<int> shots = stage.shot_tics(6);
  ASSERT_EQ(shots.size(), 6u);
  EXPECT_EQ(shots[0], pace.first) << "tics from the press to the first shot";
  EXPECT_THAT(gaps(shots), Each(pace.gap));
  EXPECT_EQ(before - stage.ammo(), 6 * pace.ammo_use);
}

// The gaps are the sums of the states' tics from one shot to the next while the trigger is held; the last
// state fires again the moment it begins.
INSTANTIATE_TEST_SUITE_P(All, WeaponPace,
                         ::testing::Values(Pace{"Fist", 4, 17, 0}, Pace{"Chainsaw", 0, 4, 0},
                                           Pace{"Pistol", 4, 14, 1}, Pace{"Shotgun", 3, 37, 1},
                                           Pace{"SuperShotgun", 3, 51, 2}, Pace{"Chaingun", 0, 4, 1},
                                           Pace{"RocketLauncher", 8, 20, 1}, Pace{"PlasmaRifle", 0, 3, 1},
                                           Pace{"BFG9000", 30, 40, 40}),
                         [](const auto& pace) { return std::string(pace.param.weapon); });

TEST(Weapons, ATapOfTheChaingunFiresTwiceAndOfThePistolOnce) {
  for (const auto& [weapon, shots] :
       {std::pair{"Chaingun", 2}, std::pair{"Pistol", 1}, std::pair{"PlasmaRifle", 1}}) {
    Shooter stage(weapon);
    const int before = stage.ammo();
    stage.buttons[0].attack = true;
    stage.tics(1);
    stage.buttons[0].attack = false;
    stage.tics(40);
    EXPECT_EQ(before - stage.ammo(), shots) << weapon;
    EXPECT_TRUE(stage.player().weapon_ready) << weapon;
  }
}

TEST(Weapons, ComeUpInSixteenTicsAndGoDownAsFast) {
  Stage stage;
  int up = 0;
  while (!stage.player().weapon_ready && up < 100) stage.tics(1), ++up;
  EXPECT_EQ(up, 15) << "the first step up is made at birth";
  stage.buttons[0].select_weapon = 1;
  int change = 0;
  do stage.tics(1), ++change;
  while (change < 100 && !(stage.player().weapon_ready && stage.player().ready_weapon == type_of("Fist")));
  EXPECT_EQ(change, 31);
}

TEST(Weapons, ATriggerHeldSinceBirthDoesNotFireALauncher) {
  Stage stage;
  give_item(stage.world, 0, type_of("RocketLauncher"), 1);
  give_item(stage.world, 0, type_of("RocketAmmo"), 10);
  const auto rockets = [&] { return count_item(stage.world, 0, type_of("RocketAmmo")); };
  const int before = rockets();
  stage.buttons[0].attack = true;
  stage.tics(1);
  select_weapon(stage.world, 0, type_of("RocketLauncher"));
  stage.tics(150);
  EXPECT_EQ(stage.player().ready_weapon, type_of("RocketLauncher"));
  EXPECT_EQ(rockets(), before) << "ViZDoom 1.3.2 fires none in 150 tics";
  stage.buttons[0].attack = false;
  stage.tics(2);
  stage.buttons[0].attack = true;
  stage.tics(20);
  EXPECT_LT(rockets(), before);
}

// ---------------------------------------------------------------- slots

TEST(WeaponSlots, AKeyActsWhenItGoesDownAndNotWhileItIsHeld) {
  Shooter stage("Shotgun");
  stage.buttons[0].select_weapon = 2;
  stage.tics(40);
  EXPECT_EQ(stage.player().ready_weapon, type_of("Pistol"));
  // Still held: something else brings the shotgun back, and it stays.
  select_weapon(stage.world, 0, type_of("Shotgun"));
  stage.tics(40);
  EXPECT_EQ(stage.player().ready_weapon, type_of("Shotgun"));
  stage.buttons[0].select_weapon = -1;
  stage.tics(1);
  stage.buttons[0].select_weapon = 2;
  stage.tics(40);
  EXPECT_EQ(stage.player().ready_weapon, type_of("Pistol"));
}

TEST(WeaponSlots, GoRoundTheWeaponsOfASlotThatAreOwnedAndLoaded) {
  Shooter stage("Pistol");
  const auto press = [&](int slot) {
    stage.buttons[0].select_weapon = -1;
    stage.tics(1);
    stage.buttons[0].select_weapon = static_cast<int8_t>(slot);
    stage.tics(45);
    stage.buttons[0].select_weapon = -1;
    return stage.world.catalog()[stage.player().ready_weapon].name;
  };
  EXPECT_EQ(press(3), "Pistol") << "no shotgun yet";
  give_item(stage.world, 0, type_of("Shotgun"), 1);
  EXPECT_EQ(press(3), "Shotgun");
  give_item(stage.world, 0, type_of("SuperShotgun"), 1);
  EXPECT_EQ(press(3), "SuperShotgun");
  EXPECT_EQ(press(3), "Shotgun");
  EXPECT_EQ(press(2), "Pistol");
  take_item(stage.world, 0, type_of("Shell"), 0);
  EXPECT_EQ(press(3), "Pistol") << "nothing to load them with";
  EXPECT_EQ(press(1), "Fist");
  give_item(stage.world, 0, type_of("Chainsaw"), 1);
  EXPECT_EQ(press(1), "Chainsaw");
  EXPECT_EQ(weapons_of_slot(stage.world, 0, 1), 2);
}

TEST(WeaponSlots, AnEmptyWeaponGivesWayToTheBestLoadedOne) {
  Shooter stage("Shotgun");
  stage.world.state().players[0].inventory.reserve(64);
  take_item(stage.world, 0, type_of("Shell"), 99 + 100);
  give_item(stage.world, 0, type_of("Shell"), 2);
  take_item(stage.world, 0, type_of("Shell"), selected_ammo(stage.world, 0) - 1);
  ASSERT_EQ(stage.ammo(), 1);
  stage.buttons[0].attack = true;
  stage.tics(100);
  EXPECT_EQ(stage.player().ready_weapon, type_of("Pistol"));
}

TEST(WeaponSlots, ADeadPlayersWeaponGoesDownAndStaysThere) {
  Shooter stage("Pistol");
  damage_actor(stage.world, stage.body(), nullptr, nullptr, 120);
  stage.buttons[0].attack = true;
  const int ammo = count_item(stage.world, 0, type_of("Clip"));
  stage.tics(60);
  EXPECT_GE(stage.player().weapon_sprites[0].own_y, kWeaponBottom);
  EXPECT_EQ(count_item(stage.world, 0, type_of("Clip")), ammo);
}

// ---------------------------------------------------------------- what they do

/// Damage of many shots, one by one.
std::map<int, int> damage_counts(std::string_view weapon, int distance, int shots) {
  Shooter stage(weapon);
  const uint32_t dummy = stage.dummy(distance).id;
  std::map<int, int> counts;
  for (int i = 0; i < shots; ++i) {
    for (InventoryItem& item : stage.world.state().players[0].inventory)
      if (stage.world.catalog()[item.type].item_class == ItemClass::kAmmo) item.amount = 50;
    const int32_t before = stage.at(dummy).health;
    stage.buttons[0].attack = true;
    stage.tics(1);
    stage.buttons[0].attack = false;
    stage.tics_until(200, [&] { return stage.player().weapon_ready; });
    stage.tics(3);
    ++counts[before - stage.at(dummy).health];
    stage.body().angle = 0;  // a fist turns its player
  }
  return counts;
}

TEST(WeaponDamage, APistolsFirstShotIsExactAndDoesFiveTenOrFifteen) {
  const std::map<int, int> counts = damage_counts("Pistol", 700, 300);
  int total = 0;
  for (const auto& [damage, count] : counts) {
    EXPECT_TRUE(damage == 5 || damage == 10 || damage == 15) << damage;
    EXPECT_NEAR(count, 100, 35) << damage;
    total += count;
  }
  EXPECT_EQ(total, 300);
}

TEST(WeaponDamage, AKillCountsItsWholeDamage) {
  Shooter stage("Pistol");
  Actor& body = stage.dummy(300);
  body.health = 1;
  stage.shot_tics(1);
  EXPECT_EQ(stage.world.state().kill_total, 1);
  EXPECT_GE(stage.player().damage_dealt, 5);
  EXPECT_EQ(stage.player().damage_dealt % 5, 0);
}

TEST(WeaponDamage, AFistDoesTwoToTwentyAndTenfoldWithStrength) {
  for (const auto& [damage, count] : damage_counts("Fist", 60, 200)) {
    EXPECT_GE(damage, 2);
    EXPECT_LE(damage, 20);
    EXPECT_EQ(damage % 2, 0);
  }
  Shooter stage("Fist");
  const uint32_t dummy = stage.dummy(60).id;
  give_item(stage.world, 0, type_of("PowerStrength"), 1);
  stage.shot_tics(1);
  EXPECT_GE(10'000'000 - stage.at(dummy).health, 20);
  EXPECT_EQ((10'000'000 - stage.at(dummy).health) % 20, 0);
}

TEST(WeaponDamage, ShotgunsThrowSevenAndTwentyPellets) {
  int shotgun_max = 0, double_max = 0;
  for (const auto& [damage, count] : damage_counts("Shotgun", 60, 100)) {
    EXPECT_GE(damage, 35);
    EXPECT_LE(damage, 105);
    EXPECT_EQ(damage % 5, 0);
    shotgun_max = std::max(shotgun_max, damage);
  }
  for (const auto& [damage, count] : damage_counts("SuperShotgun", 60, 60)) {
    EXPECT_GE(damage, 100);
    EXPECT_LE(damage, 300);
    EXPECT_EQ(damage % 5, 0);
    double_max = std::max(double_max, damage);
  }
  EXPECT_GT(shotgun_max, 75);
  EXPECT_GT(double_max, 205);
}

TEST(WeaponDamage, ARocketHurtsByItsBlowAndItsBlast) {
  for (const auto& [damage, count] : damage_counts("RocketLauncher", 300, 20)) {
    // 20 to 160 of the blow and up to 128 of the blast, which starts at the target's skin.
    EXPECT_GE(damage, 20 + 100);
    EXPECT_LE(damage, 160 + 128);
  }
}

TEST(WeaponDamage, PlasmaDoesFiveToForty) {
  for (const auto& [damage, count] : damage_counts("PlasmaRifle", 100, 60)) {
    EXPECT_GE(damage, 5);
    EXPECT_LE(damage, 40);
    EXPECT_EQ(damage % 5, 0);
  }
}

TEST(WeaponDamage, ARocketsBlastThrowsItsOwnerBackAndHurtsHim) {
  Shooter stage("RocketLauncher");
  set_position(stage.world, stage.body().id, to_fixed(1024 - 60), 0, 0);
  stage.make_player_tough(1000);
  stage.buttons[0].attack = true;
  stage.tics(1);
  stage.buttons[0].attack = false;
  stage.tics(25);
  EXPECT_LT(stage.player().health, 1000 - 40);
  EXPECT_LT(stage.body().x, to_fixed(1024 - 60 - 20));
}

// A rocket fired at a wall 60 units ahead, standing and crouched, level and down: ViZDoom 1.3.2's velocities in the tic of the
// blast, on two sides of rounding. The vertical part is the body's middle above the rocket.
TEST(WeaponDamage, ABlastLiftsWhatItPushes) {
  struct Shot {
    int wall, pitch_degrees;
    bool crouch;
    double across, up;
  };
  for (const Shot& shot : {Shot{60, 0, false, -13.0033, -1.6107}, Shot{40, 0, false, -15.6033, -1.9307},
                           Shot{90, 0, false, -8.7117, -1.0773}, Shot{60, 20, false, -12.6101, 5.084},
                           Shot{60, 0, true, -13.0033, -0.8053}}) {
    SCOPED_TRACE(shot.wall);
    test::LevelBuilder room;
    room.room(room.sector(0, 512), -512, -512, 512, 512).thing(1, 512 - shot.wall, 0);
    Stage stage(room.build(), {.free_look = true, .allow_crouch = true});
    stage.make_player_tough();
    give_item(stage.world, 0, type_of("RocketAmmo"), 10);
    give_item(stage.world, 0, type_of("RocketLauncher"), 1);
    select_weapon(stage.world, 0, type_of("RocketLauncher"));
    stage.buttons[0].crouch = shot.crouch;
    ASSERT_TRUE(stage.tics_until(80, [&] {
      return stage.player().ready_weapon == type_of("RocketLauncher") && stage.player().weapon_ready;
    }));
    stage.tics(20);
    stage.body().pitch = degrees_to_angle(shot.pitch_degrees);
    stage.buttons[0].attack = true;
    ASSERT_TRUE(stage.tics_until(60, [&] { return stage.body().velocity_x != 0; }));
    EXPECT_NEAR(to_double(stage.body().velocity_x), shot.across, 0.001);
    EXPECT_NEAR(to_double(stage.body().velocity_z), shot.up, 0.001);
  }
}

TEST(WeaponDamage, PlayersDoNotHurtEachOtherButAreInTheWay) {
  for (const char* weapon : {"Pistol", "Shotgun", "RocketLauncher", "PlasmaRifle", "Fist"}) {
    test::LevelBuilder builder = test::big_room();
    builder.thing(2, 50, 0, 180);
    Stage stage(builder.build(), {.player_count = 2});
    for (const char* ammo : {"Clip", "Shell", "RocketAmmo", "Cell"})
      give_item(stage.world, 0, type_of(ammo), 50);
    give_item(stage.world, 0, type_of(weapon), 1);
    select_weapon(stage.world, 0, type_of(weapon));
    Actor& behind = stage.spawn("Demon", 110, 0, 180);
    const uint32_t id = behind.id;
    behind.tics = -1;
    stage.tics(60);
    stage.buttons[0].attack = true;
    stage.tics(60);
    EXPECT_EQ(stage.player(1).health, 100) << weapon;
    EXPECT_EQ(stage.player(1).damage_taken, 0) << weapon;
    if (std::string_view(weapon) != "RocketLauncher") {  // whose blast reaches round a body
      EXPECT_EQ(stage.at(id).health, 150) << weapon << " went through the partner";
    }
  }
}

TEST(Weapons, InfiniteAmmunitionIsNotUsedUp) {
  Shooter stage("Chaingun", {.infinite_ammo = true});
  const int before = stage.ammo();
  stage.buttons[0].attack = true;
  stage.tics(100);
  EXPECT_EQ(stage.ammo(), before);
}

TEST(Weapons, AimUpAtWhatStandsHighAlthoughTheLookIsLevel) {
  test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 512), ledge = builder.sector(200, 512);
  builder.room(room, -1024, -1024, 1024, 1024).island(ledge, room, 400, -200, 800, 200).thing(1, 0, 0);
  Stage stage(builder.build());
  Actor& high = stage.spawn("Demon", 440, 0, 180, 200);
  high.tics = -1;
  const uint32_t id = high.id;
  stage.tics(20);
  stage.buttons[0].attack = true;
  stage.tics(6);
  EXPECT_LT(stage.at(id).health, 150);
}

}  // namespace weapons_test
}  // namespace comrad::doom
