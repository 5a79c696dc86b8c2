#include "sim_workers/engine/actors/decorate.h"

#include <gtest/gtest.h>

#include <functional>

#include "sim_workers/engine/actors/decorate_properties.h"
#include "sim_workers/engine/actors/flag_names.h"
#include "tests/unit/sim_workers/actors/lump.h"

namespace comrad::doom::test {
namespace decorate_test {

using testing::Test;

// ---- heads

TEST(Decorate, InheritsReplacesAndNumbers) {
  const Lump lump(R"(
    // the stag of the arena
    ACTOR Stag : BaronOfHell 15030 { Health 500 }
    actor Calf : stag replaces DoomImp { }
    actor "Own Name" : Calf 15031 native { Speed 24 }
    ACTOR Plain { Radius 5 })");
  ASSERT_EQ(lump.error, "");
  EXPECT_TRUE(lump.warnings.empty());
  const ActorType& stag = lump.type("STAG");
  EXPECT_EQ(stag.health, 500);
  EXPECT_EQ(stag.height, to_fixed(64)) << "the parent's";
  EXPECT_EQ(stag.editor_number, 15030);
  EXPECT_EQ(lump.catalog.find_editor_number(15030), lump.catalog.find("Stag"));
  EXPECT_EQ(lump.type("Calf").health, 500);
  EXPECT_EQ(lump.type("Calf").editor_number, -1);
  EXPECT_EQ(lump.catalog.replacement(*lump.catalog.find("DoomImp")), lump.catalog.find("Calf"));
  EXPECT_EQ(lump.type("Own Name").speed, to_fixed(24));
  EXPECT_EQ(lump.catalog[lump.type("Plain").parent].name, "Actor");
}

TEST(Decorate, ActorsMayBeNamedBeforeTheyAreRead) {
  const Lump lump(R"(
    actor Thrower : DoomImp { States { Missile: TROO E 4 A_CustomMissile("Thrown", 32) goto See } DropItem "Gift" }
    actor Thrown : DoomImpBall { Speed 40 }
    actor Gift : CustomInventory { })");
  ASSERT_EQ(lump.error, "");
  EXPECT_TRUE(lump.warnings.empty()) << lump.warnings[0];
  const State& state = lump.state("Thrower", "Missile");
  EXPECT_EQ(static_cast<uint32_t>(lump.catalog.args(state)[0].a), lump.catalog.find("Thrown"));
  EXPECT_EQ(lump.type("Thrower").drop_items.at(0).type, lump.catalog.find("Gift"));
}

TEST(Decorate, ReadsConstantsAndEnums) {
  const Lump lump(R"(
    const int kHealth = 4 * (2 + 3);
    const float kSpeed = 2.5;
    enum { ONE = 1, TWO, TEN = 10, ELEVEN };
    actor A1 { const int own = 7; Health (kHealth + TWO) Speed (kSpeed) Mass (ELEVEN * own) })");
  ASSERT_EQ(lump.error, "");
  EXPECT_EQ(lump.type("A1").health, 22);
  EXPECT_EQ(lump.type("A1").speed, to_fixed(5) / 2);
  EXPECT_EQ(lump.type("A1").mass, 77);
}

TEST(Decorate, ComputesConstantExpressions) {
  const std::pair<const char*, int> cases[] = {
      {"1 + 2 * 3", 7},        {"(1 + 2) * 3", 9},  {"7 / 2", 3},           {"7 % 4", 3},
      {"1 << 4 | 3", 19},      {"0x1F & 0x11", 17}, {"6 ^ 3", 5},           {"-5 + 2", -3},
      {"!3 + !0", 1},          {"~0", -1},          {"3 > 2 && 2 >= 2", 1}, {"1 == 2 || 3 != 4", 1},
      {"2 < 1 ? 10 : 20", 20}, {"abs(-9)", 9},      {"int(3.9)", 3},        {"64 >> 2", 16},
      {"2 <= 1", 0},           {"10 - 4 - 3", 3}};
  for (const auto& [text, value] : cases) {
    const Lump lump("actor A1 { Health (" + std::string(text) + ") }");
    ASSERT_EQ(lump.error, "") << text;
    EXPECT_EQ(lump.type("A1").health, value) << text;
  }
}

TEST(Decorate, ALaterLumpSeesTheActorsOfAnEarlierOne) {
  Lump lump("actor First : Demon { Health 7 }");
  std::vector<std::string> warnings;
  const Status status = parse_decorate("actor Second : First { }", "second", &lump.catalog, &warnings);
  ASSERT_TRUE(status.has_value());
  EXPECT_EQ(lump.type("Second").health, 7);
}

// ---- properties

struct PropertyCase {
  const char* text;
  std::function<bool(const ActorType&, const ActorCatalog&)> holds;
};

TEST(Decorate, PropertiesDoWhatTheySay) {
  using T = const ActorType&;
  using C = const ActorCatalog&;
  const PropertyCase cases[] = {
      {"Health 77", [](T t, C) { return t.health == 77; }},
      {"GibHealth 30", [](T t, C) { return t.gib_health == -30; }},
      {"Radius 12.5", [](T t, C) { return t.radius == to_fixed(25) / 2; }},
      {"Radius 1e9", [](T t, C) { return t.radius == to_fixed(8192); }},
      {"Height 90", [](T t, C) { return t.height == to_fixed(90); }},
      {"DeathHeight 9", [](T t, C) { return t.death_height == to_fixed(9); }},
      {"ProjectilePassHeight 20", [](T t, C) { return t.projectile_pass_height == to_fixed(20); }},
      {"Mass 0x7fffffff", [](T t, C) { return t.mass == INT32_MAX; }},
      {"Speed 21", [](T t, C) { return t.speed == to_fixed(21); }},
      {"FastSpeed 30", [](T t, C) { return t.fast_speed == to_fixed(30); }},
      {"FloatSpeed 5", [](T t, C) { return t.float_speed == to_fixed(5); }},
      {"Gravity 0.125", [](T t, C) { return t.gravity == kFracUnit / 8; }},
      {"MaxStepHeight 48", [](T t, C) { return t.max_step_height == to_fixed(48); }},
      {"MaxDropOffHeight 100", [](T t, C) { return t.max_dropoff_height == to_fixed(100); }},
      {"BounceFactor 0.5", [](T t, C) { return t.bounce_factor == kFracUnit / 2; }},
      {"WallBounceFactor 0.25", [](T t, C) { return t.wall_bounce_factor == kFracUnit / 4; }},
      {"BounceCount 3", [](T t, C) { return t.bounce_count == 3; }},
      {"BounceType Doom",
       [](T t, C) { return t.flags.has(ActorFlag::kBounceOnFloors) && t.flags.has(ActorFlag::kBounceOnWalls); }},
      {"Args 1, 2, 3, 4, 5", [](T t, C) { return t.args == std::array<int32_t, 5>{1, 2, 3, 4, 5}; }},
      {"ConversationID 5", [](T t, C) { return t.conversation_id == 5; }},
      {"SpawnID 222", [](T t, C c) { return t.spawn_id == 222 && c.find_spawn_id(222) == c.find("Mine"); }},
      {"Damage 3", [](T t, C) { return t.damage.factor == 3 && !t.damage.exact; }},
      {"Damage (40)", [](T t, C) { return t.damage.factor == 40 && t.damage.exact; }},
      {"Damage (random(1, 8) * 5)", [](T t, C) { return t.damage.factor == 5 && !t.damage.exact; }},
      {"DamageType Fire", [](T t, C) { return t.damage_type == DamageType::kFire; }},
      {"DamageType \"Taunt\"", [](T t, C c) { return c.damage_type_name(t.damage_type) == "Taunt"; }},
      {"DamageFactor 0.5", [](T t, C) { return t.general_damage_factor == kFracUnit / 2; }},
      {"DamageFactor \"Fire\", 0.25",
       [](T t, C) { return t.damage_factor[static_cast<std::size_t>(DamageType::kFire)] == kFracUnit / 4; }},
      {"DamageFactor \"Taunt\", 0.0",
       [](T t, C c) {
         const auto taunt = c.find_damage_type("taunt");
         return taunt && t.damage_factor[static_cast<std::size_t>(*taunt)] == 0;
       }},
      {"PainChance 99", [](T t, C) { return t.pain_chance == 99; }},
      {"PainChance \"Fire\", 12",
       [](T t, C) { return t.pain_chances.size() == 1 && t.pain_chances[0] == std::pair(DamageType::kFire, 12) &&
                t.pain_chance == 200; }},
      {"PainThreshold 20", [](T t, C) { return t.pain_threshold == 20; }},
      {"BloodType Blood", [](T t, C c) { return t.blood_type == c.find("Blood"); }},
      {"BloodColor \"10 20 ff\"", [](T t, C) { return t.blood_color == std::array<uint8_t, 3>{0x10, 0x20, 0xFF}; }},
      {"BloodColor 1 2 3", [](T t, C) { return t.blood_color == std::array<uint8_t, 3>{1, 2, 3}; }},
      {"DropItem \"Shell\" 128 5",
       [](T t, C c) {
         const DropItem drop = t.drop_items.empty() ? DropItem{} : t.drop_items[0];
         return t.drop_items.size() == 1 && drop.type == c.find("Shell") && drop.chance == 128 && drop.amount == 5;
       }},
      {"DropItem None", [](T t, C) { return t.drop_items.empty(); }},
      {"ReactionTime 3", [](T t, C) { return t.reaction_tics == 3; }},
      {"MeleeRange 80", [](T t, C) { return t.melee_range == to_fixed(80); }},
      {"MaxTargetRange 500", [](T t, C) { return t.max_target_range == to_fixed(500); }},
      {"MeleeThreshold 196", [](T t, C) { return t.melee_threshold == to_fixed(196); }},
      {"MinMissileChance 160", [](T t, C) { return t.min_missile_chance == 160; }},
      {"MeleeDamage 4", [](T t, C) { return t.melee_damage == 4; }},
      {"Species \"Demon\"", [](T t, C c) { return t.species == c.find("Demon"); }},
      {"Scale 0.5", [](T t, C) { return t.scale_x == 0.5f && t.scale_y == 0.5f; }},
      {"XScale 2.0", [](T t, C) { return t.scale_x == 2.0f && t.scale_y == 1.0f; }},
      {"YScale 3.0", [](T t, C) { return t.scale_x == 1.0f && t.scale_y == 3.0f; }},
      {"Alpha 0.55", [](T t, C) { return t.alpha == 0.55f; }},
      {"DefaultAlpha", [](T t, C) { return t.alpha == 0.6f; }},
      {"RenderStyle Add", [](T t, C) { return t.render_style == RenderStyle::kAdd; }},
      {"RenderStyle Translucent", [](T t, C) { return t.render_style == RenderStyle::kTranslucent; }},
      {"RenderStyle None", [](T t, C) { return t.render_style == RenderStyle::kNone; }},
      {"RenderStyle Fuzzy", [](T t, C) { return t.render_style == RenderStyle::kFuzzy; }},
      {"Translation \"112:127=176:191\"",
       [](T t, C c) { return c.translation(t.translation)[112] == 176 && c.translation(t.translation)[127] == 191; }},
      {"Translation \"16:16=4:4\", \"20:22=30:32\"",
       [](T t, C c) { return c.translation(t.translation)[16] == 4 && c.translation(t.translation)[21] == 31; }},
      {"Translation 0", [](T t, C c) { return c.translation(t.translation)[0x70] == 0x60; }},
      {"Inventory.Amount 6", [](T t, C) { return t.amount == 6; }},
      {"Inventory.MaxAmount 9999", [](T t, C) { return t.max_amount == 9999; }},
      {"Inventory.DefMaxAmount", [](T t, C) { return t.max_amount == 25; }},
      {"Inventory.InterHubAmount 0", [](T t, C) { return t.inter_hub_amount == 0; }},
      {"Inventory.RespawnTics 70", [](T t, C) { return t.respawn_tics == 70; }},
      {"Armor.SaveAmount 150", [](T t, C) { return t.save_amount == 150; }},
      {"Armor.MaxSaveAmount 250", [](T t, C) { return t.max_save_amount == 250; }},
      {"Armor.SavePercent 50", [](T t, C) { return t.save_percent == kFracUnit / 2; }},
      {"Ammo.BackpackAmount 4", [](T t, C) { return t.backpack_amount == 4; }},
      {"Ammo.BackpackMaxAmount 300", [](T t, C) { return t.backpack_max_amount == 300; }},
      {"Ammo.DropAmount 2", [](T t, C) { return t.drop_amount == 2; }},
      {"Powerup.Type Invulnerable", [](T t, C) { return t.power == PowerKind::kInvulnerable && t.power_tics == 1050; }},
      {"Powerup.Type \"PowerSpeed\"", [](T t, C) { return t.power == PowerKind::kSpeed; }},
      {"Powerup.Duration 100", [](T t, C) { return t.power_tics == 100; }},
      {"Powerup.Duration -2", [](T t, C) { return t.power_tics == 70; }},
      {"Powerup.Color \"ff 00 00\", 0.5",
       [](T t, C) { return t.power_color == std::array<uint8_t, 4>{255, 0, 0, 127}; }},
      {"Weapon.AmmoType Shell", [](T t, C c) { return t.weapon.ammo_type == c.find("Shell"); }},
      {"Weapon.AmmoType1 Clip", [](T t, C c) { return t.weapon.ammo_type == c.find("Clip"); }},
      {"Weapon.AmmoType2 Cell", [](T t, C c) { return t.weapon.ammo_type_2 == c.find("Cell"); }},
      {"Weapon.AmmoUse 2", [](T t, C) { return t.weapon.ammo_use == 2; }},
      {"Weapon.AmmoUse1 3", [](T t, C) { return t.weapon.ammo_use == 3; }},
      {"Weapon.AmmoUse2 4", [](T t, C) { return t.weapon.ammo_use_2 == 4; }},
      {"Weapon.AmmoGive 5", [](T t, C) { return t.weapon.ammo_give == 5; }},
      {"Weapon.AmmoGive1 6", [](T t, C) { return t.weapon.ammo_give == 6; }},
      {"Weapon.AmmoGive2 7", [](T t, C) { return t.weapon.ammo_give_2 == 7; }},
      {"Weapon.SelectionOrder 1234", [](T t, C) { return t.weapon.selection_order == 1234; }},
      {"Weapon.SlotNumber 4", [](T t, C) { return t.weapon.slot == 4 && !t.weapon.slot_of_player; }},
      {"Weapon.SlotPriority 0.5", [](T t, C) { return t.weapon.slot_priority == kFracUnit / 2; }},
      {"Weapon.Kickback 10", [](T t, C) { return t.weapon.kickback == 10; }},
      {"Weapon.DefaultKickback", [](T t, C) { return t.weapon.kickback == 100; }},
      {"Weapon.YAdjust 15", [](T t, C) { return t.weapon.y_adjust == to_fixed(15); }},
      {"Player.JumpZ 12", [](T t, C) { return t.jump_speed == to_fixed(12); }},
      {"Player.ViewHeight 110", [](T t, C) { return t.view_height == to_fixed(110); }},
      {"Player.AttackZOffset 20", [](T t, C) { return t.attack_z_offset == to_fixed(20); }},
      {"Player.MaxHealth 150", [](T t, C) { return t.health == 150; }},
      {"Player.ForwardMove 0.5",
       [](T t, C) { return t.forward_move == std::array<Fixed, 2>{kFracUnit / 2, kFracUnit / 2}; }},
      {"Player.SideMove 1.5, 2.0",
       [](T t, C) { return t.side_move == std::array<Fixed, 2>{kFracUnit * 3 / 2, 2 * kFracUnit}; }},
      {"Player.StartItem \"Clip\", 10",
       [](T t, C c) {
         return t.start_items.size() == 1 && t.start_items[0].type == c.find("Clip") && t.start_items[0].amount == 10;
       }},
      {"Player.WeaponSlot 5, Shotgun, Fist",
       [](T, C c) {
         return c[*c.find("Shotgun")].weapon.slot == 5 && c[*c.find("Fist")].weapon.slot == 5 &&
                c[*c.find("Fist")].weapon.slot_priority > c[*c.find("Shotgun")].weapon.slot_priority;
       }},
      {"Monster",
       [](T t, C) {
         return t.flags.has(ActorFlag::kIsMonster) && t.flags.has(ActorFlag::kCountKill) &&
                t.flags.has(ActorFlag::kSolid) && t.flags.has(ActorFlag::kShootable);
       }},
      {"Projectile",
       [](T t, C) { return t.flags.has(ActorFlag::kMissile) && t.flags.has(ActorFlag::kNoGravity); }},
      {"ClearFlags", [](T t, C) { return t.flags == ActorFlags{}; }},
      {"Skip_Super", [](T t, C) { return t.health == 1000 && t.labels.size() < 4; }},
  };
  for (const PropertyCase& property : cases) {
    SCOPED_TRACE(property.text);
    const Lump before("actor Mine : ZombieMan { }");
    const Lump lump("actor Mine : ZombieMan { " + std::string(property.text) + "\n }");
    ASSERT_EQ(lump.error, "");
    const bool bounces = std::string_view(property.text).starts_with("BounceType");
    EXPECT_EQ(lump.warnings.size(), bounces ? 1u : 0u) << testing::PrintToString(lump.warnings);
    EXPECT_TRUE(property.holds(lump.type("Mine"), lump.catalog));
    const std::string_view text = property.text;
    if (text == "Weapon.DefaultKickback" || text == "Monster" || text == "Weapon.Kickback 100") continue;
    EXPECT_FALSE(property.holds(before.type("Mine"), before.catalog)) << "it holds without the property too";
  }
}

TEST(Decorate, SoundsAndWordsAreReadInSilence) {
  const Lump lump(R"(actor Mine : Shotgun 15003 {
    Tag "Short shotgun" Obituary "%o was hunted." HitObituary "x"
    SeeSound "grunt/sight" DeathSound "a" PainSound "b" ActiveSound "c" AttackSound "d"
    Inventory.PickupMessage "You got it!" Inventory.PickupSound "misc/w_pkup" Inventory.Icon "SHOTA0"
    Weapon.UpSound "x" Weapon.SisterWeapon "Shotgun" Decal BulletChip Game Doom
    +NODECAL +WEAPON.NO_AUTO_SWITCH -NOTDMATCH })");
  ASSERT_EQ(lump.error, "");
  ASSERT_EQ(lump.warnings.size(), 1u);
  EXPECT_EQ(lump.warnings[0], "test.wad:6: unknown flag WEAPON.NO_AUTO_SWITCH");
}

TEST(Decorate, ListsBeginAnewInTheTypeThatNamesOne) {
  const Lump lump(R"(
    actor Rich : ZombieMan { DropItem "Shell" DropItem "Cell" 10 }
    actor Poor : Rich { }
    actor Fresh : Rich { DropItem "Medikit" })");
  ASSERT_EQ(lump.error, "");
  EXPECT_EQ(lump.type("Rich").drop_items.size(), 2u);
  EXPECT_EQ(lump.type("Poor").drop_items.size(), 2u);
  ASSERT_EQ(lump.type("Fresh").drop_items.size(), 1u);
  EXPECT_EQ(lump.type("Fresh").drop_items[0].type, lump.catalog.find("Medikit"));
}

// ---- flags

TEST(Decorate, FlagsAreSetAndClearedByEveryName) {
  // All names in the table of flags; the lump's prefixes do not matter.
  const char* names[] = {"SOLID",
                         "SHOOTABLE",
                         "NOBLOCKMAP",
                         "NOSECTOR",
                         "NOGRAVITY",
                         "LOWGRAVITY",
                         "FLOAT",
                         "FLY",
                         "DROPOFF",
                         "NOCLIP",
                         "CANPASS",
                         "PUSHABLE",
                         "CANNOTPUSH",
                         "SPAWNCEILING",
                         "NOTELEPORT",
                         "TELEPORT",
                         "SLIDESONWALLS",
                         "FLOORCLIP",
                         "SPECIAL",
                         "MISSILE",
                         "RIPPER",
                         "NOEXTREMEDEATH",
                         "EXTREMEDEATH",
                         "BOUNCEONWALLS",
                         "BOUNCEONFLOORS",
                         "SEEKERMISSILE",
                         "FORCERADIUSDMG",
                         "NORADIUSDMG",
                         "RANDOMIZE",
                         "EXPLODEONWATER",
                         "THRUGHOST",
                         "GHOST",
                         "FLOORHUGGER",
                         "CEILINGHUGGER",
                         "DONTSPLASH",
                         "BLOODLESSIMPACT",
                         "STRIFEDAMAGE",
                         "PIERCEARMOR",
                         "HITTARGET",
                         "HITTRACER",
                         "STEPMISSILE",
                         "ISMONSTER",
                         "COUNTKILL",
                         "COUNTITEM",
                         "AMBUSH",
                         "JUSTHIT",
                         "JUSTATTACKED",
                         "SKULLFLY",
                         "INFLOAT",
                         "INCHASE",
                         "FRIENDLY",
                         "FRIGHTENED",
                         "LOOKALLAROUND",
                         "STANDSTILL",
                         "DORMANT",
                         "BOSS",
                         "BOSSDEATH",
                         "NOPAIN",
                         "PAINLESS",
                         "QUICKTORETALIATE",
                         "NOTARGET",
                         "NOINFIGHTING",
                         "DONTHURTSPECIES",
                         "AVOIDMELEE",
                         "MISSILEMORE",
                         "MISSILEEVENMORE",
                         "NEVERTARGET",
                         "ALWAYSFAST",
                         "NEVERRESPAWN",
                         "ALWAYSRESPAWN",
                         "NOFEAR",
                         "FULLVOLACTIVE",
                         "SHORTMISSILERANGE",
                         "LONGMELEERANGE",
                         "CANUSEWALLS",
                         "CANPUSHWALLS",
                         "ACTIVATEIMPACT",
                         "ACTIVATEPCROSS",
                         "ACTIVATEMCROSS",
                         "NOBLOCKMONST",
                         "TOUCHY",
                         "NOTARGETSWITCH",
                         "DONTMORPH",
                         "FALLDAMAGE",
                         "INVULNERABLE",
                         "REFLECTIVE",
                         "BUDDHA",
                         "NOBLOOD",
                         "NODAMAGE",
                         "NODAMAGETHRUST",
                         "NOICEDEATH",
                         "DONTGIB",
                         "CORPSE",
                         "ICECORPSE",
                         "KILLED",
                         "DROPPED",
                         "SHADOW",
                         "DONTFALL",
                         "USESPECIAL",
                         "NONSHOOTABLE",
                         "BRIGHT",
                         "INVISIBLE",
                         "FORCEYBILLBOARD",
                         "NOINTERACTION",
                         "ROCKETTRAIL",
                         "PUFFONACTORS",
                         "PUFFGETSOWNER",
                         "ALWAYSPUFF",
                         "SYNCHRONIZED",
                         "DONTTRANSLATE",
                         "MOVEWITHSECTOR",
                         "SKYEXPLODE",
                         "PICKUP",
                         "INVENTORY.ALWAYSPICKUP",
                         "INVENTORY.AUTOACTIVATE",
                         "INVENTORY.INVBAR",
                         "INVENTORY.UNDROPPABLE",
                         "INVENTORY.QUIET",
                         "INVENTORY.FANCYPICKUPSOUND",
                         "INVENTORY.BIGPOWERUP",
                         "INVENTORY.KEEPDEPLETED",
                         "INVENTORY.IGNORESKILL",
                         "INVENTORY.UNTOSSABLE",
                         "INVENTORY.ADDITIVETIME",
                         "INVENTORY.NOSCREENFLASH",
                         "INVENTORY.TOSSED",
                         "INVENTORY.PERSISTENTPOWER",
                         "WEAPON.NOAUTOFIRE",
                         "WEAPON.NOALERT",
                         "WEAPON.AMMO_OPTIONAL",
                         "WEAPON.ALT_AMMO_OPTIONAL",
                         "WEAPON.MELEEWEAPON",
                         "WEAPON.NOAUTOAIM",
                         "WEAPON.DONTBOB",
                         "WEAPON.EXPLOSIVE",
                         "WEAPON.PRIMARY_USES_BOTH",
                         "WEAPON.WIMPY_WEAPON",
                         "WEAPON.READYSNDHALF",
                         "WEAPON.AMMO_CHECKBOTH",
                         "WEAPON.CHEATNOTWEAPON"};
  for (const std::string name : names) {
    SCOPED_TRACE(name);
    const auto flag = find_flag(name);
    ASSERT_TRUE(flag.has_value());
    const Lump lump("actor On { +" + name + " } actor Off : On { -" + name + " }");
    ASSERT_EQ(lump.error, "");
    EXPECT_EQ(lump.warnings.size(), has_effect(*flag) ? 0u : 1u) << testing::PrintToString(lump.warnings);
    EXPECT_TRUE(lump.type("On").flags.has(*flag));
    EXPECT_FALSE(lump.type("Off").flags.has(*flag));
  }
}

// ---- states

TEST(Decorate, ReadsStatesWithEveryKeyword) {
  const Lump lump(R"(actor Mine : ZombieMan { States {
    Spawn:
      POSS AB 10 A_Look
      loop
    See:
      POSS ABC 3 bright fast A_Chase
      POSS "D" random(2, 6)
      "####" "#" 7
      ---- E -1
    Missile:
    Missile.Special:
      TROO E 4 offset(3, -2) Bright A_FaceTarget()
      TROO F 0 light("X") slow
      goto See+2
    Death:
      TNT1 A 0
      stop
    Wound:
      VILE "[\]" 2
      wait
  } })");
  ASSERT_EQ(lump.error, "");
  EXPECT_TRUE(lump.warnings.empty()) << lump.warnings[0];
  EXPECT_EQ(walk(lump.catalog, lump.label("Mine", "Spawn")), "POSSA10:Look POSSB10:Look @0");
  EXPECT_EQ(walk(lump.catalog, lump.label("Mine", "See")),
            "POSSA3*:Chase POSSB3*:Chase POSSC3*:Chase POSSD2 POSSD7 POSSE-1 TROOE4*:FaceTarget TROOF0 @2");
  EXPECT_TRUE(lump.state("Mine", "See").fast);
  EXPECT_EQ(lump.state("Mine", "See", 3).random_tics, 4);
  EXPECT_EQ(lump.label("Mine", "Missile"), lump.label("Mine", "missile.special"));
  EXPECT_EQ(lump.state("Mine", "Missile").offset_x, 3);
  EXPECT_EQ(lump.state("Mine", "Missile").offset_y, -2);
  EXPECT_EQ(walk(lump.catalog, lump.label("Mine", "Death")), "TNT1A0 .");
  EXPECT_EQ(walk(lump.catalog, lump.label("Mine", "Wound")), "VILE[2 VILE\\2 VILE]2 @2");
}

TEST(Decorate, ALoopLeadsBackToTheLastLabel) {
  const Lump lump(R"(actor Mine { States { Spawn: AAAA A 1 Inner: AAAA BC 2 loop } })");
  ASSERT_EQ(lump.error, "");
  EXPECT_EQ(walk(lump.catalog, lump.label("Mine", "Spawn")), "AAAAA1 AAAAB2 AAAAC2 @1");
}

TEST(Decorate, LabelsOfTheParentAreKeptOverriddenOrLeftOut) {
  const Lump lump(R"(
    actor Base : DoomImp { States { See: TROO A 9 A_Chase loop Special: TROO B 5 goto See } }
    actor Child : Base { States {
      Melee: stop
      Missile: goto Super::Special
      Pain: TROO H 1 goto Super::Death+2
      Own: TROO C 3 goto Base::Special
      Other: TROO D 3 goto DoomImp::See+1 } })");
  ASSERT_EQ(lump.error, "");
  EXPECT_EQ(lump.label("Child", "See"), lump.label("Base", "See"));
  EXPECT_EQ(lump.label("Child", "Spawn"), lump.label("DoomImp", "Spawn"));
  EXPECT_EQ(lump.label("Child", "Melee"), kNoState);
  EXPECT_EQ(lump.label("Child", "Missile"), lump.label("Base", "Special"));
  EXPECT_EQ(lump.state("Child", "Pain").next, lump.label("DoomImp", "Death") + 2);
  EXPECT_EQ(lump.state("Child", "Own").next, lump.label("Base", "Special"));
  EXPECT_EQ(lump.state("Child", "Other").next, lump.label("DoomImp", "See") + 1);
  EXPECT_EQ(lump.type("Child").state(StateLabel::kMissile), lump.label("Base", "Special"));
}

TEST(Decorate, AStateBlockAddsToTheOneBefore) {
  const Lump lump("actor Mine { States { Spawn: AAAA A 1 stop } States { See: AAAA B 2 goto Spawn } }");
  ASSERT_EQ(lump.error, "");
  EXPECT_EQ(walk(lump.catalog, lump.label("Mine", "See")), "AAAAB2 AAAAA1 .");
}

// ---- actions

TEST(Decorate, PassesArgumentsOfEveryKind) {
  const Lump lump(R"(actor Mine : DoomImp { States {
    Missile:
      TROO E 0 A_CustomMissile("DoomImpBall", 32, -4.5, random(-10, 10), CMF_AIMDIRECTION | 1)
      TROO F 0 A_JumpIfInventory("Clip", 2 + 3, "See")
      TROO G 0 A_Jump(128, 2, "Pain+1", "Death")
      TROO H 0 A_SpawnItemEx("Clip", 0, 0, 8, 0, 0, 2.5, 0, SXF_NOCHECKPOSITION | SXF_SETMASTER, 128)
      TROO I 0 A_Log("text of mine")
      TROO I 0 A_ChangeFlag("SOLID", false)
      TROO I 0 A_JumpIf(3 > 2, Death)
      goto See } })");
  ASSERT_EQ(lump.error, "");
  EXPECT_TRUE(lump.warnings.empty()) << lump.warnings[0];
  using Kind = ActionArg::Kind;
  const auto args = [&](uint32_t offset) { return lump.catalog.args(lump.state("Mine", "Missile", offset)); };
  ASSERT_EQ(args(0).size(), 5u);
  EXPECT_EQ(args(0)[0].kind, Kind::kType);
  EXPECT_EQ(args(0)[1].a, 32);
  EXPECT_EQ(args(0)[2].kind, Kind::kFixed);
  EXPECT_EQ(args(0)[2].a, -9 * kFracUnit / 2);
  EXPECT_EQ(args(0)[3].kind, Kind::kRandom);
  EXPECT_EQ(args(0)[3].a, -10);
  EXPECT_EQ(args(0)[3].b, 10);
  EXPECT_EQ(args(0)[4].a, 3);
  EXPECT_EQ(args(1)[1].a, 5);
  EXPECT_EQ(args(1)[2].kind, Kind::kState);
  EXPECT_EQ(static_cast<uint32_t>(args(1)[2].a), lump.label("DoomImp", "See"));
  const uint32_t jump = lump.label("Mine", "Missile") + 2;
  EXPECT_EQ(static_cast<uint32_t>(args(2)[1].a), jump + 2);
  EXPECT_EQ(static_cast<uint32_t>(args(2)[2].a), lump.label("Mine", "Pain") + 1);
  EXPECT_EQ(static_cast<uint32_t>(args(2)[3].a), lump.label("Mine", "Death"));
  EXPECT_EQ(args(3)[6].a, 5 * kFracUnit / 2);
  EXPECT_EQ(args(3)[8].a, 32 | 16);
  EXPECT_EQ(lump.catalog.text(args(4)[0].a), "text of mine");
  EXPECT_EQ(lump.catalog.text(args(5)[0].a), "SOLID");
  EXPECT_EQ(args(5)[1].a, 0);
  EXPECT_EQ(args(6)[0].a, 1);
  EXPECT_EQ(static_cast<uint32_t>(args(6)[1].a), lump.label("Mine", "Death"));
}

TEST(Decorate, StatesMayStartScripts) {
  const Lump lump(R"(actor Prey : Demon { States {
    Death: SARG I 8 ACS_ExecuteAlways(12, 0, 3)
      SARG J 8 A_Scream
      SARG K 4 ACS_NamedExecuteAlways("Prey Caught", 0, 1)
      SARG N -1 stop } })");
  ASSERT_EQ(lump.error, "");
  EXPECT_TRUE(lump.warnings.empty()) << lump.warnings[0];
  EXPECT_EQ(lump.state("Prey", "Death").action, *find_action("ACS_ExecuteAlways"));
  EXPECT_EQ(lump.catalog.args(lump.state("Prey", "Death"))[0].a, 12);
  const State& named = lump.state("Prey", "Death", 2);
  EXPECT_EQ(lump.catalog.text(lump.catalog.args(named)[0].a), "Prey Caught");
}

TEST(Decorate, FindsEveryActionByItsName) {
  for (std::size_t id = 1; id < static_cast<std::size_t>(ActionId::kCount); ++id) {
    const std::string name(action_name(static_cast<ActionId>(id)));
    ASSERT_FALSE(name.empty());
    const bool has_prefix = !name.starts_with("ACS_") && !name.starts_with("Thing_");
    const Lump lump("actor Mine { States { Spawn: AAAA A 1 " + std::string(has_prefix ? "A_" : "") + name +
                    " stop } }");
    ASSERT_EQ(lump.error, "") << name;
    EXPECT_TRUE(lump.warnings.empty()) << lump.warnings[0];
    EXPECT_EQ(lump.state("Mine", "Spawn").action, static_cast<ActionId>(id));
  }
}

// ---- items, weapons, missiles of a lump's own

TEST(Decorate, MakesItemsWeaponsAndMissiles) {
  const Lump lump(R"(
    actor Arrow : Ammo { Inventory.Amount 3 Inventory.MaxAmount 30 Ammo.BackpackMaxAmount 60 }
    actor Quiver : Arrow { Inventory.Amount 10 }
    actor Bow : Weapon { Weapon.AmmoType "Arrow" Weapon.AmmoUse 1 Weapon.AmmoGive 5 Weapon.SlotNumber 2
      States { Ready: PISG A 1 A_WeaponReady loop Deselect: PISG A 1 A_Lower loop Select: PISG A 0 A_Raise loop
               Fire: PISG B 4 A_FireCustomMissile("Shaft", 0, 1) goto Ready } }
    actor Shaft { Projectile Radius 4 Height 4 Speed 40 Damage (12) Scale 0.5
      States { Spawn: MISL A 1 loop Death: MISL B 3 stop } }
    actor Berry : CustomInventory 15040 { +INVENTORY.ALWAYSPICKUP
      States { Spawn: BON1 ABCDCB 6 loop Pickup: TNT1 A 0 ACS_ExecuteAlways(40) stop } }
    actor Helmet : BasicArmorPickup { Armor.SaveAmount 10 Armor.SavePercent 25 }
    actor Vest : BasicArmorBonus { Armor.SaveAmount 2 Armor.MaxSaveAmount 50 }
    actor Heart : Health { Inventory.Amount 5 Inventory.MaxAmount 150 }
    actor Boots : PowerupGiver { Powerup.Type Speed Powerup.Duration -10 }
    actor Token : Inventory { Inventory.MaxAmount 5 }
    actor Gate : Key { })");
  ASSERT_EQ(lump.error, "");
  EXPECT_TRUE(lump.warnings.empty()) << lump.warnings[0];
  EXPECT_EQ(lump.type("Arrow").item_class, ItemClass::kAmmo);
  EXPECT_EQ(lump.type("Arrow").ammo_base, kNoType);
  EXPECT_EQ(lump.type("Quiver").ammo_base, lump.catalog.find("Arrow"));
  EXPECT_EQ(lump.type("Bow").item_class, ItemClass::kWeapon);
  EXPECT_EQ(lump.type("Bow").weapon.slot, 2);
  EXPECT_EQ(lump.type("Bow").weapon.ammo_type, lump.catalog.find("Arrow"));
  EXPECT_TRUE(lump.type("Shaft").damage.exact);
  EXPECT_EQ(lump.type("Shaft").damage.factor, 12);
  EXPECT_EQ(lump.type("Berry").item_class, ItemClass::kCustomInventory);
  EXPECT_NE(lump.type("Berry").state(StateLabel::kPickup), kNoState);
  EXPECT_EQ(lump.type("Helmet").item_class, ItemClass::kArmor);
  EXPECT_EQ(lump.type("Vest").item_class, ItemClass::kArmorBonus);
  EXPECT_EQ(lump.type("Heart").max_amount, 150);
  EXPECT_EQ(lump.type("Boots").power, PowerKind::kSpeed);
  EXPECT_EQ(lump.type("Boots").power_tics, 350);
  EXPECT_EQ(lump.type("Token").item_class, ItemClass::kInventory);
  EXPECT_EQ(lump.type("Gate").item_class, ItemClass::kKey);
}

// ---- what is wrong

TEST(Decorate, ReportsWhereALumpIsBrokenAndLeavesTheCatalogAlone) {
  const std::pair<const char*, const char*> cases[] = {
      {"actor", "test.wad:1:6: the name of an actor is missing"},
      {"health 5", "test.wad:1:1: 'health' where an actor must begin"},
      {"actor A1 : NoSuch { }", "test.wad:1:7: actor A1: unknown parent 'NoSuch'"},
      {"actor A1 : A2 { } actor A2 { }", "test.wad:1:7: actor A1: unknown parent 'A2'"},
      {"actor A1 : A1 { }", "test.wad:1:7: actor A1: unknown parent 'A1'"},
      {"actor Demon : Spectre { }", "test.wad:1:7: actor Demon would be its own ancestor"},
      {"actor A1", "test.wad:1:9: '{' is missing"},
      {"actor A1 {", "test.wad:1:11: actor A1 has no closing '}'"},
      {"actor A1 {\n Health }", "test.wad:2:9: '}' where a value must stand"},
      {"actor A1 { Health \"many\" }", "test.wad:1:12: health: a number is missing"},
      {"actor A1 { DropItem 5 }", "test.wad:1:12: dropitem: a word is missing"},
      {"actor A1 { + }", "test.wad:1:14: the name of a flag is missing"},
      {"actor A1 { ) }", "test.wad:1:12: ')' where a property, a flag or States must stand"},
      {"actor A1 { States { Spawn: TOOLONG A 1 } }",
       "test.wad:1:28: 'TOOLONG' is no sprite: they have four letters"},
      {"actor A1 { States { Spawn: AAAA A } }", "'}' where a value must stand"},
      {"actor A1 { States { Spawn: AAAA 5 1 stop } }", "'5' is no frame"},
      {"actor A1 { States { loop } }", "'loop' without a state before it"},
      {"actor A1 { States { Spawn: AAAA A 1 goto Nowhere } }", "test.wad:1:42: no state label 'Nowhere'"},
      {"actor A1 { States { Spawn: AAAA A 1 A_Jump(1, 9) } }", "the jump leaves this actor's states"},
      {"actor A1 { States { Spawn: AAAA A 1 A_Look A_Chase } }", "'A_Chase' is no sprite"},
      {"actor A1 { States { Spawn: AAAA A 1 A_Jump(1, }", "where a value must stand"},
      {"actor A1 { States { Spawn: AAAA A 1", "States of A1 have no closing '}'"},
      {"actor A1 { Health (1 / 0) }", "a division by zero"},
      {"actor A1 { Alpha (1e308 * 10.0 - 1e308 * 10.0) }", "test.wad:1:25: the result of '*' is too large"},
      {"actor A1 { Scale (1e308 + 1e308) }", "the result of '+' is too large"},
      {"actor A1 { Scale (1e308 / 0.1) }", "the result of '/' is too large"},
      {"actor A1 { Damage (random(1, 8) * 1e308) }", "the result of '*' is too large"},
      {"actor A1 { Health (1 + \"x\") }", "'+' needs a number on both sides"},
      {"actor A1 { Tag \"open }", "a text has no closing quote"},
      {"/* open", "a comment has no end"},
      {"#pragma x", "unknown directive '#pragma'"},
      {"const int a;", "'=' is missing"},
      {"const bool a = 1;", "'int' or 'float' is missing"},
  };
  for (const auto& [text, message] : cases) {
    const Lump lump(text);
    EXPECT_NE(lump.error, "") << text;
    EXPECT_EQ(lump.error.rfind("test.wad:", 0), 0u) << lump.error;
    EXPECT_NE(lump.error.find(message), std::string::npos) << text << "\n" << lump.error;
    EXPECT_EQ(lump.catalog.size(), builtin_catalog().size()) << text;
    EXPECT_EQ(lump.catalog.state_count(), builtin_catalog().state_count()) << text;
  }
}

TEST(Decorate, NestsOnlySoDeep) {
  const std::string deep =
      "actor A1 { Health " + std::string(5000, '(') + "1" + std::string(5000, ')') + " }";
  EXPECT_NE(Lump(deep).error.find("nested too deeply"), std::string::npos);
  const std::string minus = "actor A1 { Health (" + std::string(5000, '-') + "1) }";
  EXPECT_NE(Lump(minus).error.find("nested too deeply"), std::string::npos);
  std::string sums = "actor A1 { Health (1";
  for (int i = 0; i < 1000; ++i) sums += "+1";
  EXPECT_EQ(Lump(sums + ") }").type("A1").health, 1001) << "a long sum is not deep";
}

TEST(Decorate, WarnsOnceOfWhatItDoesNotKnow) {
  const Lump lump(R"(
    actor A1 : NoSuchWord0 replaces Nobody { }
  )");
  EXPECT_NE(lump.error, "");
  const Lump known(R"(
    actor A1 replaces Nobody {
      Radius 3
      Wingspan 30, 40
      +GLITTERING
      +GLITTERING
      DropItem "NoSuchItem"
      RenderStyle Sparkle
      var int user_x;
      States {
      Spawn:
        AAAA A 1 A_Dance(1, "two")
        AAAA A 1 A_Dance
        AAAA A 1 A_SpawnItem("NoSuchItem")
        AAAA A 1 A_JumpIf(health < 5, "Spawn")
        AAAA A 1 { A_Look; A_Chase; }
        loop
      }
    }
    damagetype Fire { Factor 1 }
    #include "more.txt"
  )");
  ASSERT_EQ(known.error, "");
  const auto warned = [&](const std::string& part) {
    int count = 0;
    for (const std::string& warning : known.warnings) {
      EXPECT_EQ(warning.rfind("test.wad:", 0), 0u);
      count += warning.find(part) != std::string::npos ? 1 : 0;
    }
    return count;
  };
  for (const char* part : {"replaces unknown actor 'Nobody'", "unknown property wingspan",
                           "unknown flag GLITTERING", "actor A1: unknown actor 'NoSuchItem'",
                           "RenderStyle 'Sparkle'", "user variables", "unknown action function A_Dance",
                           "A_SpawnItem: unknown actor 'NoSuchItem'", "'health' depends on the running game",
                           "blocks of actions", "damagetype Fire", "#include \"more.txt\""})
    EXPECT_EQ(warned(part), 1) << part << "\n" << testing::PrintToString(known.warnings);
}

TEST(Decorate, IncludesLumpsInTheirPlace) {
  const auto includes = [](std::string_view name) -> std::optional<std::string_view> {
    if (name == "ITEMS") return "#include \"DEEP\"\nactor Prize : Health 12340 { Inventory.Amount AMOUNT }\n";
    if (name == "DEEP") return "const int AMOUNT = 25;\nactor Deep { DropItem Prize wingspan 5 }\n";
    if (name == "BROKEN") return "\nactor Broken { health }\n";
    if (name == "LOOP") return "#include \"LOOP\"\n";
    return std::nullopt;
  };
  const auto read = [&](std::string_view text, ActorCatalog* catalog, std::vector<std::string>* warnings) {
    const Status status = parse_decorate(text, "a.wad", catalog, warnings, includes);
    return status ? std::string() : status.error().message;
  };
  ActorCatalog catalog = builtin_catalog();
  std::vector<std::string> warnings;
  EXPECT_EQ(read("actor First { DropItem Prize }\n#include \"ITEMS\" // more\nactor Last : Deep { "
                 "}\n#include \"none.txt\"",
                 &catalog, &warnings),
            "");
  for (const char* name : {"First", "Prize", "Deep", "Last"})
    EXPECT_TRUE(catalog.find(name).has_value()) << name;
  EXPECT_EQ(catalog[*catalog.find("Prize")].amount, 25);
  ASSERT_EQ(warnings.size(), 2u) << testing::PrintToString(warnings);
  EXPECT_EQ(warnings[0].rfind("a.wad:ITEMS:DEEP:2: ", 0), 0u) << warnings[0];
  EXPECT_EQ(warnings[1], "a.wad:4: #include \"none.txt\": there is no such lump; its actors are left out");

  catalog = builtin_catalog();
  EXPECT_EQ(read("#include \"BROKEN\"", &catalog, &warnings).rfind("a.wad:BROKEN:2:", 0), 0u);
  EXPECT_NE(read("#include \"LOOP\"", &catalog, &warnings).find("include each other more than 16 deep"),
            std::string::npos);
}

}  // namespace decorate_test
}  // namespace comrad::doom::test
