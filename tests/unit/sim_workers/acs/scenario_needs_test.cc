// What the scenarios ask of actors and scripts together: their own monsters, weapons and items, and the calls
// that their scripts make. Each test is a small piece of a scenario.
#include <gtest/gtest.h>

#include <set>

#include "sim_workers/engine/actors/decorate.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/unit/sim_workers/acs/script_world.h"

namespace comrad::doom::acs::test {
namespace scenario_needs_test {

std::shared_ptr<const ActorCatalog> catalog_with(std::string_view lump) {
  auto catalog = std::make_shared<ActorCatalog>();
  std::vector<std::string> warnings;
  const Status status = parse_decorate(lump, "test", catalog.get(), &warnings);
  EXPECT_TRUE(status.has_value()) << (status ? "" : status.error().message);
  EXPECT_TRUE(warnings.empty()) << warnings[0];
  return catalog;
}

/// A long hall from west to east; player 1 in its west looks east.
std::shared_ptr<const Level> hall() {
  doom::test::LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256, 900);
  builder.room(room, -512, -256, 1536, 256).thing(1, 0, 0).thing(2, 0, 128);
  return builder.build();
}

struct Scene {
  explicit Scene(std::string_view lump, const BehaviorBuilder& code = BehaviorBuilder(), int players = 1)
      : catalog(catalog_with(lump)),
        world(hall(), catalog, load(code)),
        buttons(static_cast<std::size_t>(players)) {
    WorldOptions options;
    options.player_count = players;
    options.free_look = true;
    reset_world(world, options);
  }
  Actor& spawn(std::string_view type, int x, int y, int degrees = 0) {
    return world.spawn_unchecked(*catalog->find(type), to_fixed(x), to_fixed(y), kOnFloor,
                                 degrees_to_angle(degrees));
  }
  void tics(int count) {
    for (int i = 0; i < count; ++i) run_tic(world, buttons);
  }
  Actor& body(int player = 0) { return *world.body_of(player); }
  int32_t user(int index) const { return world.exported(index); }
  const std::string& error() const { return world.state().scripts.last_error; }

  std::shared_ptr<const ActorCatalog> catalog;
  World world;
  std::vector<Buttons> buttons;
};

TEST(ScenarioNeeds, AStagIsShieldedHealsAndItsDeathPays) {
  BehaviorBuilder code(Container::kHiddenCompact);
  code.script(1, kOpen).push_text("Stag").push({400 * 65536, 0, 0, 7, 128}).op(PCode::kSpawn).store_global(1);
  code.push({7, 11, 1}).op(PCode::kSetActorProperty).op(PCode::kDelayDirect, {4});
  code.push({7, 0, 450})
      .op(PCode::kSetActorProperty)
      .push({7, 0})
      .op(PCode::kGetActorProperty)
      .store_global(2);
  code.push({7, 11, 0}).op(PCode::kSetActorProperty).end();
  code.script(12).op(PCode::kIncGlobalVar, {3}).op(PCode::kActivatorTid).store_global(4).end();
  Scene scene(R"(actor Stag : BaronOfHell 15030 { Health 500 +BOSS DropItem None
    States { Death: BOSS I 8; BOSS J 8 A_Scream BOSS K 8 ACS_ExecuteAlways(12, 0) BOSS O -1 stop } })",
              code);
  scene.tics(2);
  EXPECT_EQ(scene.user(1), 1);
  Actor& stag = *scene.world.find_thing(7);
  EXPECT_EQ(damage_actor(scene.world, stag, nullptr, nullptr, 100), 0) << "invulnerable";
  scene.tics(6);
  EXPECT_EQ(scene.user(2), 450);
  EXPECT_EQ(damage_actor(scene.world, stag, nullptr, nullptr, 449), 449);
  EXPECT_EQ(scene.user(3), 0);
  damage_actor(scene.world, stag, nullptr, nullptr, 10);
  scene.tics(40);
  EXPECT_EQ(scene.user(3), 1) << "its death script ran once";
  EXPECT_EQ(scene.user(4), 7) << "as the stag";
  EXPECT_EQ(scene.error(), "");
}

TEST(ScenarioNeeds, ARabbitWandersWithoutAttacking) {
  Scene scene(R"(actor Rabbit : ZombieMan 15031 { Health 1 Speed 24 +FRIGHTENED +LOOKALLAROUND DropItem None
    States { Spawn: POSS A 4 A_Look loop See: POSS A 2 A_Wander loop Melee: stop Missile: stop } })");
  const uint32_t id = scene.spawn("Rabbit", 300, 0).id;
  const Fixed x = scene.world.actor(id)->x, y = scene.world.actor(id)->y;
  Fixed moved = 0;
  for (int tic = 0; tic < 200; ++tic) {
    scene.tics(1);
    const Actor& rabbit = *scene.world.actor(id);
    moved = std::max(moved, approximate_distance(rabbit.x - x, rabbit.y - y));
  }
  EXPECT_GT(moved, to_fixed(48));
  EXPECT_EQ(scene.world.player(0).health, 100);
}

const char* const kShortShotgun = R"(actor ShortShotgun : Shotgun 15003 { Weapon.SlotNumber 3
    States { Fire: SHTG A 3; SHTG A 7 A_FireBullets(5.6, 0, 7, 5, "BulletPuff", 1, 500) SHTG B 10; SHTG C 4; SHTG B 10;
      SHTG A 3; SHTG A 7 A_ReFire goto Ready } }
  actor Board { Health 100000 Radius 64 Height 64 Mass 100000 +SOLID +SHOOTABLE +NOBLOOD States { Spawn: TLMP A -1 stop } })";

TEST(ScenarioNeeds, AShortShotgunHasItsOwnSpreadRangeAndCycle) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter)
      .op(PCode::kClearInventory)
      .push_text("ShortShotgun")
      .push(1)
      .op(PCode::kGiveInventory);
  code.push_text("Shell")
      .push(20)
      .op(PCode::kGiveInventory)
      .push_text("ShortShotgun")
      .op(PCode::kSetWeapon)
      .store_global(1);
  code.end();
  for (const int distance : {300, 700}) {
    Scene scene(kShortShotgun, code);
    scene.tics(1);
    EXPECT_EQ(scene.user(1), 1);
    const uint32_t board = scene.spawn("Board", distance, 0).id;
    scene.tics(40);
    const uint32_t shells = *scene.catalog->find("Shell");
    const int32_t before = count_item(scene.world, 0, shells);
    scene.buttons[0].attack = true;
    std::vector<int> shots;
    int32_t left = before;
    for (int tic = 0; tic < 100; ++tic) {
      scene.tics(1);
      const int32_t now = count_item(scene.world, 0, shells);
      if (now != left) shots.push_back(tic);
      left = now;
    }
    ASSERT_GE(shots.size(), 2u);
    EXPECT_EQ(shots[1] - shots[0], 37) << "held: the last seven tics are ReFire's";
    EXPECT_EQ(before - left, static_cast<int32_t>(shots.size())) << "one shell each";
    const int32_t harm = 100000 - scene.world.actor(board)->health;
    if (distance == 300) {
      EXPECT_GE(harm, 5 * 7) << "some of the pellets of the first two shots";
      EXPECT_LE(harm, static_cast<int32_t>(shots.size()) * 7 * 15);
      EXPECT_EQ(harm % 5, 0);
    } else {
      EXPECT_EQ(harm, 0) << "beyond its reach";
    }
  }
}

TEST(ScenarioNeeds, AMeleeZombieHitsForExactlyTen) {
  Scene scene(R"(actor MeleeZombie : ZombieMan 15003 { States { Missile: stop
    Melee: POSS E 10 A_FaceTarget POSS F 8 A_CustomMeleeAttack(10) POSS E 8 goto See } })");
  Actor& zombie = scene.spawn("MeleeZombie", 50, 0, 180);
  zombie.target_id = scene.body().id;
  zombie.move_direction = kWest;  // not from the walk east that it is born with
  set_label(scene.world, zombie, StateLabel::kSee);
  std::vector<int32_t> losses;
  int32_t health = 100;
  for (int tic = 0; tic < 400 && scene.world.player(0).alive; ++tic) {
    scene.tics(1);
    if (scene.world.player(0).health != health) losses.push_back(health - scene.world.player(0).health);
    health = scene.world.player(0).health;
  }
  ASSERT_GE(losses.size(), 2u);
  for (const int32_t loss : losses) EXPECT_EQ(loss, 10);
}

TEST(ScenarioNeeds, ATurretFiresSeparateBolts) {
  Scene scene(
      R"(actor Turret : DoomImp 16000 { Health 140 Speed 0 Radius 24 PainChance 0 Mass 0x7fffffff +LOOKALLAROUND
      +MISSILEEVENMORE DropItem None
    States { Missile: TROO E 4 A_FaceTarget TROO G 2 A_CustomMissile("TurretBolt", 32) TROO G 2 A_CustomMissile("TurretBolt", 32)
      TROO E 14; TROO E 2 A_Chase goto See Melee: stop } }
    actor TurretBolt : DoomImpBall 16001 { Radius 6 Height 8 Speed 14 Damage 2 RenderStyle Add })");
  const uint32_t bolt = *scene.catalog->find("TurretBolt");
  Actor& turret = scene.spawn("Turret", 400, 0, 0);
  const uint32_t id = turret.id;
  std::set<uint32_t> bolts;
  int32_t health = 100;
  std::vector<int32_t> losses;
  for (int tic = 0; tic < 300; ++tic) {
    scene.tics(1);
    for (const Actor& actor : scene.world.actors())
      if (actor.type == bolt) bolts.insert(actor.id);
    if (scene.world.player(0).health < health) losses.push_back(health - scene.world.player(0).health);
    health = scene.world.player(0).health;
  }
  EXPECT_GE(bolts.size(), 4u);
  ASSERT_FALSE(losses.empty());
  for (const int32_t loss : losses) EXPECT_LE(loss, 32) << "2 x 1..8, at most two bolts in a tic";
  EXPECT_EQ(scene.world.actor(id)->x, to_fixed(400)) << "it does not move";
}

TEST(ScenarioNeeds, ACustomBonusIsTakenAtFullHealthAndRunsItsScript) {
  BehaviorBuilder code(Container::kCompact);
  code.script(40).op(PCode::kIncGlobalVar, {1}).op(PCode::kPlayerNumber).store_global(2).end();
  Scene scene(R"(actor ForageBonus : CustomInventory 15040 { +INVENTORY.ALWAYSPICKUP
    States { Spawn: BON1 ABCDCB 6 loop Pickup: TNT1 A 0 ACS_ExecuteAlways(40, 0) stop } })",
              code);
  scene.spawn("ForageBonus", 60, 0), scene.spawn("ForageBonus", 60, 0);
  scene.buttons[0].forward = true;
  scene.tics(30);
  EXPECT_EQ(scene.user(1), 2) << "two may lie on one spot";
  EXPECT_EQ(scene.user(2), 0) << "the taker's number";
  EXPECT_EQ(scene.world.count_actors(*scene.catalog->find("ForageBonus")), 0);
}

TEST(ScenarioNeeds, SignalWeaponsComeUpAtOnceAndCallAScript) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter).op(PCode::kClearInventory);
  for (const char* weapon : {"GreenSignal", "RedSignal"})
    code.push_text(weapon).push(1).op(PCode::kGiveInventory);
  code.push_text("Clip")
      .push(200)
      .op(PCode::kGiveInventory)
      .push_text("GreenSignal")
      .op(PCode::kSetWeapon)
      .op(PCode::kDrop)
      .end();
  code.script(30, 0, 1).op(PCode::kPushScriptVar, {0}).store_global(1).op(PCode::kIncGlobalVar, {2}).end();
  Scene scene(R"(actor GreenSignal : Pistol { Weapon.SlotNumber 1 +WEAPON.NOALERT
      States { Select: PISG A 0 A_Raise loop Deselect: PISG A 0 A_Lower loop
        Fire: PISG A 4; PISG B 0 ACS_ExecuteAlways(30, 0, 1) PISG B 36 goto Ready } }
    actor RedSignal : GreenSignal { Weapon.SlotNumber 2
      States { Fire: SHTG A 3; SHTG B 0 ACS_ExecuteAlways(30, 0, 2) SHTG B 55 goto Ready } })",
              code);
  scene.tics(3);
  EXPECT_TRUE(scene.world.player(0).weapon_ready) << "raised in no time";
  scene.buttons[0].attack = true;
  scene.tics(7);
  EXPECT_EQ(scene.user(1), 1);
  scene.tics(40 * 3);
  EXPECT_NEAR(scene.user(2), 4, 1) << "a signal every 40 tics";
  scene.buttons[0].attack = false;
  scene.tics(45);
  scene.buttons[0].select_weapon = 2;
  scene.tics(4);
  scene.buttons[0].select_weapon = -1;
  EXPECT_EQ(scene.world.player(0).ready_weapon, scene.catalog->find("RedSignal"));
  scene.buttons[0].attack = true;
  scene.tics(8);
  EXPECT_EQ(scene.user(1), 2);
}

TEST(ScenarioNeeds, ScriptsSetAPlayersSpeedEyeJumpScaleAndMass) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter).push({0, 1, 65536 * 3 / 2}).op(PCode::kSetActorProperty);
  code.push({0, 39, 110 * 65536})
      .op(PCode::kSetActorProperty)
      .push({0, 12, 12 * 65536})
      .op(PCode::kSetActorProperty);
  code.push({0, 29, 65536 * 11 / 2})
      .op(PCode::kSetActorProperty)
      .push({0, 32, INT32_MAX})
      .op(PCode::kSetActorProperty);
  code.push({0, 21, 0}).op(PCode::kSetActorProperty);
  code.push({0, 39})
      .op(PCode::kGetActorProperty)
      .store_global(1)
      .push({0, 12})
      .op(PCode::kGetActorProperty)
      .store_global(2);
  code.end();
  Scene scene("", code);
  scene.tics(2);
  EXPECT_EQ(scene.user(1), 110 * 65536);
  EXPECT_EQ(scene.user(2), 12 * 65536);
  EXPECT_EQ(scene.world.player(0).view_z, to_fixed(110));
  EXPECT_EQ(scene.body().scale_x, 5.5f);
  EXPECT_EQ(scene.body().mass, INT32_MAX);
  scene.buttons[0].forward = true;
  scene.tics(90);
  // 8.333 units a tic at factor 1.
  EXPECT_NEAR(to_float(scene.body().velocity_x) / 0.90625f, 12.5f, 0.05f);
  EXPECT_EQ(scene.world.player(0).eye_height, to_fixed(110));
}

TEST(ScenarioNeeds, ADefenderStandsStillAndARunnerIsFrozenByAProperty) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter).push({0, 1, 0}).op(PCode::kSetActorProperty);
  const auto again = code.label();
  code.bind(again).push({0, 0, 0, 0, 0, 0}).call(BuiltIn::kSetActorVelocity, 6).op(PCode::kDrop);
  code.op(PCode::kDelayDirect, {1}).go(PCode::kGoto, again);
  Scene scene("", code);
  scene.tics(2);
  const Fixed x = scene.body().x;
  scene.buttons[0].forward = scene.buttons[0].left = true;
  scene.tics(40);
  EXPECT_EQ(scene.body().x, x);

  BehaviorBuilder freeze(Container::kCompact);
  freeze.script(1, kEnter)
      .push({0, 1, 4})
      .op(PCode::kLspec3, {191})
      .end();  // SetPlayerProperty: totally frozen
  Scene frozen("", freeze);
  frozen.tics(2);
  const Angle angle = frozen.body().angle;
  frozen.buttons[0].forward = frozen.buttons[0].turn_left = true;
  frozen.tics(40);
  EXPECT_EQ(frozen.body().x, to_fixed(0));
  EXPECT_EQ(frozen.body().angle, angle);
}

TEST(ScenarioNeeds, AmmunitionLimitsAreAPlayersOwn) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter).op(PCode::kClearInventory).push_text("Shell").push(9999).op(PCode::kSetAmmoCapacity);
  code.push_text("Shell")
      .push(9999)
      .op(PCode::kGiveInventory)
      .push_text("Shell")
      .op(PCode::kCheckInventory)
      .store_global(1);
  code.push_text("Shell").op(PCode::kGetAmmoCapacity).store_global(2);
  code.push_text("Clip")
      .push(5000)
      .op(PCode::kGiveInventory)
      .push_text("Clip")
      .op(PCode::kCheckInventory)
      .store_global(3);
  code.push_text("GreenArmor")
      .push(1)
      .op(PCode::kGiveInventory)
      .op(PCode::kPlayerArmorPoints)
      .store_global(4)
      .end();
  Scene scene("", code);
  scene.tics(2);
  EXPECT_EQ(scene.user(1), 9999);
  EXPECT_EQ(scene.user(2), 9999);
  EXPECT_EQ(scene.user(3), 200);
  EXPECT_EQ(scene.user(4), 100);
}

TEST(ScenarioNeeds, TetherNodesAreMadeAndTakenAwayForEver) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kOpen);
  const auto again = code.label(), node = code.label();
  code.bind(again).push(900).op(PCode::kLspec1, {132});  // Thing_Remove
  code.push(0).op(PCode::kAssignScriptVar, {0}).bind(node);
  code.push_text("TetherNode").op(PCode::kPushScriptVar, {0}).push(10 * 65536).op(PCode::kMultiply);
  code.push({0, 20 * 65536, 900, 0}).call(BuiltIn::kSpawnForced, 6).op(PCode::kDrop);
  code.op(PCode::kIncScriptVar, {0})
      .op(PCode::kPushScriptVar, {0})
      .push(30)
      .op(PCode::kLess)
      .go(PCode::kIfGoto, node);
  code.op(PCode::kDelayDirect, {5}).go(PCode::kGoto, again);
  Scene scene(
      R"(actor TetherNode { +NOINTERACTION +NOGRAVITY +NOBLOCKMAP Scale 0.13 RenderStyle Add Alpha 0.55
    States { Spawn: APLS A -1 bright stop } })",
      code);
  const uint32_t node_type = *scene.catalog->find("TetherNode");
  scene.tics(1);
  std::size_t actors = 0;
  for (int round = 0; round < 50; ++round) {
    scene.tics(5);
    EXPECT_EQ(scene.world.count_actors(node_type), 30);
    if (round == 10) actors = scene.world.actors().size();
  }
  EXPECT_EQ(scene.world.actors().size(), actors) << "nothing piles up";
  EXPECT_EQ(scene.error(), "");
}

TEST(ScenarioNeeds, MonstersHateWhomAScriptNames) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kOpen).push_text("Core").push({600 * 65536, 0, 0, 50, 0}).op(PCode::kSpawn).op(PCode::kDrop);
  code.push_text("DoomImp").push({900 * 65536, 0, 0, 51, 128}).op(PCode::kSpawn).op(PCode::kDrop);
  code.push({51, 50, 4}).op(PCode::kLspec3, {177}).end();  // Thing_Hate
  Scene scene(R"(actor Core { Health 1000 Radius 16 Height 50 Monster -COUNTKILL +FRIENDLY +NOBLOOD Speed 0
      DamageFactor "Taunt", 0.0 States { Spawn: TLMP A -1 stop Death: TLMP A 1 stop } })",
              code);
  scene.tics(900);
  const Actor* core = scene.world.find_thing(50);
  ASSERT_NE(core, nullptr);
  EXPECT_LT(core->health, 1000) << "the imp attacks the core";
  EXPECT_EQ(scene.world.player(0).health, 100);
}

TEST(ScenarioNeeds, DamageTypesOfALumpsOwnHaveFactorsDeathsAndPains) {
  Scene scene(
      R"(actor Target : DoomImp { Health 100 PainChance 0 PainChance "Taunt", 256 DamageFactor "Holy", 0.5
      DamageFactor "Fire", 0
    States { Pain.Taunt: TROO H 50 goto See Death.Holy: TROO I 77 stop } })");
  Actor& target = scene.spawn("Target", 300, 0);
  const DamageType taunt = *scene.catalog->find_damage_type("taunt"),
                   holy = *scene.catalog->find_damage_type("Holy");
  EXPECT_EQ(damage_actor(scene.world, target, nullptr, nullptr, 50, DamageType::kFire), 0);
  EXPECT_EQ(damage_actor(scene.world, target, nullptr, nullptr, 20, holy), 10);
  damage_actor(scene.world, target, nullptr, nullptr, 1, taunt);
  EXPECT_EQ(target.state, scene.world.type_of(target).find_label("pain.taunt"));
  damage_actor(scene.world, target, nullptr, nullptr, 1000, holy);
  EXPECT_EQ(target.state, scene.world.type_of(target).find_label("death.holy"));
}

TEST(ScenarioNeeds, SectorsHurtAsScriptsSay) {
  struct Case {
    std::vector<int32_t> args;
    int hits;  // in 96 tics
  };
  // Measured in ViZDoom: without an interval every 32 tics; an interval of 0 is every tic.
  for (const Case& hurt : {Case{{900, 5, 0}, 3}, Case{{900, 5, 0, 10}, 9}, Case{{900, 2, 0, 0}, 95}}) {
    BehaviorBuilder code(Container::kCompact);
    code.script(1, kOpen);
    for (const int32_t arg : hurt.args) code.push(arg);
    code.call(BuiltIn::kSetSectorDamage, static_cast<int>(hurt.args.size())).op(PCode::kDrop).end();
    Scene scene("", code);
    scene.body().health = 1000;
    scene.world.state().players[0].health = 1000;
    scene.tics(97);
    EXPECT_NEAR(1000 - scene.world.player(0).health, hurt.args[1] * hurt.hits, hurt.args[1])
        << testing::PrintToString(hurt.args);
  }
}

TEST(ScenarioNeeds, HudMessagesReplaceEachOtherById) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter);
  const auto again = code.label();
  code.bind(again).push({320, 240, 0}).op(PCode::kSetHudSize).push_text("SMALLFONT").op(PCode::kSetFont);
  code.op(PCode::kBeginPrint).push_text("\034DVULNERABLE").op(PCode::kPrintString).op(PCode::kMoreHudMessage);
  code.push({0, 77, 3, 160 * 65536, 220 * 65536, 0}).op(PCode::kEndHudMessage);
  code.push_text("BARPIC").op(PCode::kSetFont).op(PCode::kBeginPrint).push_text("A").op(PCode::kPrintString);
  code.op(PCode::kMoreHudMessage).push({0, 78, 0, 160 * 65536, 100 * 65536, 65536}).op(PCode::kEndHudMessage);
  code.op(PCode::kDelayDirect, {5}).go(PCode::kGoto, again);
  Scene scene("", code, 2);
  scene.tics(60);
  const auto& messages = scene.world.state().scripts.hud_messages;
  ASSERT_EQ(messages.size(), 4u) << "two for each player, however often they were written";
  for (const HudMessage& message : messages) {
    EXPECT_EQ(message.hud_width, 320);
    EXPECT_EQ(message.x, 160 * 65536);
    EXPECT_TRUE(message.id == 77 ? message.text == "\034DVULNERABLE" : message.font == "BARPIC")
        << message.text;
  }
}

TEST(ScenarioNeeds, TheFallenFadeAwayAndTheirScriptsSeeThemGo) {
  Scene scene(
      R"(actor Fader : ZombieMan { DropItem None States { Death: POSS H 5; POSS I 5 A_NoBlocking POSS L 35
    Fade: POSS L 2 A_FadeOut(0.1) loop } })");
  Actor& fader = scene.spawn("Fader", 200, 0);
  fader.target_id = scene.body().id;
  damage_actor(scene.world, fader, nullptr, nullptr, 25);
  scene.tics(30);
  EXPECT_EQ(scene.world.count_actors(*scene.catalog->find("Fader")), 1);
  scene.tics(100);
  EXPECT_EQ(scene.world.count_actors(*scene.catalog->find("Fader")), 0);
  EXPECT_EQ(scene.world.count_actors(*scene.catalog->find("Clip")), 0) << "drops nothing";
}

TEST(ScenarioNeeds, PlayersComeBackWithTheirRespawnScript) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, 2).op(PCode::kIncGlobalVar, {1}).op(PCode::kPlayerNumber).store_global(2).end();  // RESPAWN
  code.script(2, 3).op(PCode::kIncGlobalVar, {3}).end();                                           // DEATH
  auto catalog = catalog_with("");
  World world(hall(), catalog, load(code));
  WorldOptions options;
  options.player_count = 2, options.forced_respawn = true, options.respawn_delay_tics = 10;
  reset_world(world, options);
  run_tic(world, {});
  damage_actor(world, *world.body_of(1), nullptr, nullptr, 500);
  for (int tic = 0; tic < 60; ++tic) run_tic(world, {});
  EXPECT_EQ(world.exported(3), 1);
  EXPECT_EQ(world.exported(1), 1);
  EXPECT_EQ(world.exported(2), 1);
  EXPECT_EQ(world.player(1).health, 100);
}

TEST(ScenarioNeeds, AUseKeyIsSeenByItsEdge) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter);
  const auto again = code.label(), no = code.label();
  // BT_USE (2) among the buttons of this tic (1) and not among the last one's (0).
  code.bind(again).push({0, 1}).op(PCode::kGetPlayerInput).push(2).op(PCode::kAndBitwise);
  code.push({0, 0}).op(PCode::kGetPlayerInput).push(2).op(PCode::kAndBitwise).op(PCode::kNegateLogical);
  code.op(PCode::kAndLogical).go(PCode::kIfNotGoto, no).op(PCode::kIncGlobalVar, {1}).bind(no);
  code.op(PCode::kDelayDirect, {1}).go(PCode::kGoto, again);
  Scene scene("", code);
  scene.tics(3);
  scene.buttons[0].use = true;
  scene.tics(10);
  EXPECT_EQ(scene.user(1), 1) << "once, however long it is held";
  scene.buttons[0].use = false;
  scene.tics(3);
  scene.buttons[0].use = true;
  scene.tics(3);
  EXPECT_EQ(scene.user(1), 2);
}

// The numbers are ViZDoom 1.3.2's.
TEST(ScenarioNeeds, PlayerInputHasTurnsLooksAndButtons) {
  constexpr int kOldButtons = 0, kButtons = 1, kPitch = 2, kYaw = 3, kUpMove = 7, kModOldButtons = 8,
                kModButtons = 9;
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kEnter);
  const auto again = code.label();
  code.bind(again);
  for (int input = 0; input < 10; ++input)
    code.push({0, input}).op(PCode::kGetPlayerInput).store_global(input + 1);
  code.op(PCode::kDelayDirect, {1}).go(PCode::kGoto, again);
  Scene scene("", code);
  scene.tics(3);
  const auto shown = [&](int input) { return scene.user(input + 1); };
  Buttons& buttons = scene.buttons[0];

  buttons.turn_left = true;
  for (int tic = 1; tic <= 8; ++tic) {
    scene.tics(1);
    EXPECT_EQ(shown(kYaw), tic <= 5 ? 320 : 640) << "a turn starts slowly, tic " << tic;
  }
  buttons = {};
  buttons.turn_right = buttons.speed = true;
  scene.tics(1);
  EXPECT_EQ(shown(kYaw), -1280) << "turning continues";

  buttons = {};
  buttons.look_up = buttons.move_up = true;
  scene.tics(1);
  EXPECT_EQ(shown(kPitch), 450);
  EXPECT_EQ(shown(kUpMove), 256);
  buttons.speed = true;
  scene.tics(1);
  EXPECT_EQ(shown(kPitch), 512);
  EXPECT_EQ(shown(kUpMove), 768);
  buttons = {};
  buttons.look_down = buttons.move_down = true;
  buttons.up_delta = 7;
  scene.tics(1);
  EXPECT_EQ(shown(kPitch), -450);
  EXPECT_EQ(shown(kUpMove), -249);

  buttons = {};
  scene.tics(1);
  buttons.turn_180 = true;
  for (int tic = 1; tic <= 4; ++tic) {
    scene.tics(1);
    EXPECT_EQ(shown(kButtons), tic == 1 ? 16 : 0) << "only the press counts, tic " << tic;
    EXPECT_EQ(shown(kOldButtons), tic == 2 ? 16 : 0);
  }

  buttons = {};
  buttons.jump = buttons.crouch = true;
  scene.tics(2);
  EXPECT_EQ(shown(kButtons), 12);
  EXPECT_EQ(shown(kOldButtons), 12);
  EXPECT_EQ(shown(kModButtons), 4) << "the jump wins over the crouch";
  EXPECT_EQ(shown(kModOldButtons), 4);
}

TEST(ScenarioNeeds, ActorsThatMakeActorsComeToAnEnd) {
  Scene scene(R"(actor Weed { +NOINTERACTION +NOBLOCKMAP States { Spawn: TNT1 A 1
      TNT1 A 0 A_SpawnItemEx("Weed", 0, 0, 0, 0, 0, 0, 0, SXF_NOCHECKPOSITION)
      TNT1 A 1 A_SpawnItemEx("Weed", 0, 0, 0, 0, 0, 0, 0, SXF_NOCHECKPOSITION) loop } })");
  scene.spawn("Weed", 300, 0);
  for (int tic = 0; tic < 40; ++tic) {
    scene.tics(1);
    ASSERT_LE(scene.world.actors().size(), kActorsMax + 128);
  }
  EXPECT_GE(scene.world.actors().size(), kActorsMax - 2) << "as many as there may be";
  EXPECT_EQ(scene.world.player(0).health, 100);
}

TEST(ScenarioNeeds, AScriptEndsTheEpisode) {
  BehaviorBuilder code(Container::kCompact);
  code.script(1, kOpen).op(PCode::kDelayDirect, {5}).push(0).op(PCode::kLspec1, {243}).end();  // Exit_Normal
  Scene scene("", code);
  scene.tics(4);
  EXPECT_FALSE(scene.world.level_exited());
  scene.tics(4);
  EXPECT_TRUE(scene.world.level_exited());
}

}  // namespace scenario_needs_test
}  // namespace comrad::doom::acs::test
