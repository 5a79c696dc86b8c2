// What a kind of actor is: its body, its numbers, its flags and its states. Types come from the built-in
// tables and from DECORATE lumps, end in one ActorCatalog and never change while worlds run. Stage: tic
// and render.
#pragma once

#include <array>
#include <bitset>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "sim_workers/engine/actors/action_id.h"
#include "sim_workers/engine/fixed.h"

namespace comrad::doom {

constexpr uint32_t kNoState = UINT32_MAX;  ///< an actor that enters it is removed (Doom's S_NULL)
constexpr uint32_t kNoType = UINT32_MAX;

/// Properties that are on or off. DECORATE spells them +NAME and -NAME (see flag_names.cc); each actor has a
/// copy of its type's, because play and scripts change them.
enum class ActorFlag : uint8_t {
  // The body.
  kSolid,
  kShootable,
  kNoBlockmap,
  kNoSector,
  kNoGravity,
  kLowGravity,
  kFloat,
  kFly,
  kDropOff,
  kNoClip,
  kCanPass,
  kPushable,
  kCannotPush,
  kSpawnCeiling,
  kNoTeleport,
  kTeleport,
  kSlidesOnWalls,
  kFloorClip,
  kSpecial,
  // Missiles.
  kMissile,
  kRipper,
  kNoExtremeDeath,
  kExtremeDeath,
  kBounceOnWalls,
  kBounceOnFloors,
  kSeekerMissile,
  kForceRadiusDamage,
  kNoRadiusDamage,
  kRandomize,
  kExplodeOnWater,
  kThruGhost,
  kGhost,
  kFloorHugger,
  kCeilingHugger,
  kDontSplash,
  kBloodlessImpact,
  kStrifeDamage,
  kPierceArmor,
  kHitTarget,
  kHitTracer,
  kStepMissile,
  // Monsters.
  kIsMonster,
  kCountKill,
  kCountItem,
  kCountSecret,
  kAmbush,
  kJustHit,
  kJustAttacked,
  kSkullFly,
  kInFloat,
  kInChase,
  kFriendly,
  kFrightened,
  kLookAllAround,
  kStandStill,
  kDormant,
  kBoss,
  kBossDeath,
  kNoPain,
  kPainless,
  kQuickToRetaliate,
  kNoTarget,
  kNoInfighting,
  kDontHurtSpecies,
  kAvoidMelee,
  kMissileMore,
  kMissileEvenMore,
  kNeverTarget,
  kFastMelee,
  kNeverRespawn,
  kAlwaysRespawn,
  kOnlyChaseGoal,
  kNoFear,
  kFullVolumeActive,
  kShortMissileRange,
  kLongMeleeRange,
  kCanUseWalls,
  kPushWall,
  kActivateImpact,
  kActivateCross,
  kNoBlockMonsters,
  kTouchy,
  kNoTargetSwitch,
  kDontMorph,
  kFallDamage,
  kNoSightCheck,   ///< Thing_Hate 2, 4, 6: goes after its enemies without seeing them
  kHuntPlayers,    ///< Thing_Hate 3, 4: looks for players as well
  kNoHatePlayers,  ///< Thing_Hate 5, 6: players that hurt it are ignored
  kInCombat,
  kAlwaysFast,
  kSeeInvisible,
  kNoVerticalMeleeRange,
  // What damage does.
  kInvulnerable,
  kReflective,
  kBuddha,
  kNoBlood,
  kNoDamage,
  kNoDamageThrust,
  kNoIceDeath,
  kDontGib,
  kCorpse,
  kIceCorpse,
  kKilled,
  kDropped,
  kShadow,
  kDontFall,
  kUseSpecial,
  kNonShootable,
  // Pictures.
  kBright,
  kInvisible,
  kForceYBillboard,
  kNoInteraction,
  kRocketTrail,
  kPuffOnActors,
  kPuffGetsOwner,
  kAlwaysPuff,
  kSynchronized,
  kDontTranslate,
  kNoSpriteShadow,
  kMoveWithSector,
  kSkyExplode,
  // Players and items.
  kPickup,
  kAlwaysPickup,
  kAutoActivate,
  kInvBar,
  kUndroppable,
  kQuiet,
  kFancyPickup,
  kBigPowerup,
  kKeepDepleted,
  kIgnoreSkill,
  kUntossable,
  kAdditiveTime,
  kNoScreenFlash,
  kTossed,
  kScriptSpawned,  ///< an item of a script; no lump can name it
  kPersistentPower,
  // Weapons.
  kWeaponNoAutoFire,
  kWeaponNoAlert,
  kWeaponAmmoOptional,
  kWeaponAltAmmoOptional,
  kWeaponMelee,
  kWeaponNoAutoaim,
  kWeaponDontBob,
  kWeaponExplosive,
  kWeaponPrimaryUsesBoth,
  kWeaponWimpy,
  kWeaponReadySoundHalf,
  kWeaponAmmoCheckBoth,
  kWeaponCheatNotWeapon,
  kDontThrust,       ///< what hurts it does not push it
  kOldRadiusDamage,  ///< its blasts and blasts at it push as their damage alone
  kCount
};

class ActorFlags {
 public:
  bool has(ActorFlag flag) const { return bits_[static_cast<std::size_t>(flag)]; }
  void set(ActorFlag flag, bool on = true) { bits_[static_cast<std::size_t>(flag)] = on; }
  bool operator==(const ActorFlags&) const = default;
  uint64_t hash() const {
    return std::hash<std::bitset<static_cast<std::size_t>(ActorFlag::kCount)>>{}(bits_);
  }

 private:
  std::bitset<static_cast<std::size_t>(ActorFlag::kCount)> bits_;
};

/// An argument of an action function: a number, a range to draw from, or the name of something.
struct ActionArg {
  enum class Kind : uint8_t { kNone, kInteger, kFixed, kRandom, kType, kState, kText };
  Kind kind = Kind::kNone;
  /// kInteger: the number. kFixed: 16.16. kRandom: lowest and highest, both drawn. kType: index into the
  /// catalog. kState: index of the state, and as b the text of its label (0: none), which a descendant of the
  /// type may have given another state. kText: index into ActorCatalog::text().
  int32_t a = 0, b = 0;
};

/// A picture shown for some tics, and what the actor does when it begins. States of all types lie in
/// one table.
struct State {
  uint32_t sprite = 0;  ///< index into ActorCatalog::sprite_name(); 0 is TNT1, which shows nothing
  uint8_t frame = 0;    ///< letter - 'A'
  bool bright = false;
  bool fast = false;        ///< half the tics in fast-monster skills
  bool fails = false;       ///< the last of a custom item's use that did not work: the item stays
  int16_t tics = -1;        ///< -1: for ever
  int16_t random_tics = 0;  ///< plus 0..this, drawn
  uint32_t next = kNoState;
  ActionId action = ActionId::kNone;
  uint32_t first_arg = 0;  ///< into ActorCatalog::args()
  uint8_t arg_count = 0;
  int16_t offset_x = 0, offset_y = 0;  ///< of a weapon's sprite; (0, 0) leaves it where it is
};

/// Labels that the engine looks for, resolved to states; kNoState where a type has none. Others:
/// ActorType::labels.
enum class StateLabel : uint8_t {
  kSpawn,
  kSee,
  kMelee,
  kMissile,
  kPain,
  kDeath,
  kXDeath,
  kCrash,
  kRaise,
  kHeal,
  kIdle,
  kActive,
  kInactive,
  kWound,
  kReady,
  kSelect,
  kDeselect,
  kFire,
  kHold,
  kFlash,
  kAltFire,
  kPickup,
  kUse,
  kDrop,
  kCrush,
  kCount
};

enum class RenderStyle : uint8_t { kNone, kNormal, kFuzzy, kTranslucent, kAdd, kSubtract, kShadow, kStencil };

/// What an item is to the player who takes it; by its most specific built-in ancestor.
enum class ItemClass : uint8_t {
  kNone,
  kInventory,
  kHealth,
  kMaxHealth,
  kArmor,
  kArmorBonus,
  kAmmo,
  kWeapon,
  kKey,
  kPowerup,
  kBackpack,
  kCustomInventory,
  kMap
};

enum class PowerKind : uint8_t {
  kNone,
  kInvulnerable,
  kStrength,
  kInvisibility,
  kIronFeet,
  kAllMap,
  kLightAmp,
  kTimeFreeze,
  kFlight,
  kSpeed,
  kDoubleDamage,
  kProtection,
  kCount
};

enum class DamageType : uint8_t {
  kNormal,
  kFire,
  kIce,
  kSlime,
  kDrowning,
  kTelefrag,
  kFalling,
  kCrush,
  kSuicide,
  kExit,
  kRailgun,
  kMassacre,
  kInstantDeath,
  kElectric,
  kPoison,
  kFirstOwn,  ///< from here on: types that DECORATE lumps name (ActorCatalog::add_damage_type)
  kCount = kFirstOwn + 16
};

struct DropItem {
  uint32_t type = kNoType;
  int32_t chance = 255;  ///< of 256, drawn against 0..255
  int32_t amount = -1;   ///< -1: the item's own
};

/// How much damage a missile or a melee attack deals.
struct DamageDice {
  int32_t factor = 0;  ///< times 1..8 drawn (a missile's Damage 3), or fixed where `exact`
  bool exact = false;  ///< Damage (40): no dice
};

struct WeaponInfo {
  uint32_t ammo_type = kNoType, ammo_type_2 = kNoType;
  int32_t ammo_use = 0, ammo_give = 0, ammo_use_2 = 0, ammo_give_2 = 0;
  int32_t selection_order = 0;  ///< the lowest usable is chosen when one runs dry
  int32_t slot = -1;            ///< key 0..9; -1 in no slot
  int32_t slot_priority = 0;    ///< place in the slot: its key tries the highest first
  bool slot_of_player = false;  ///< the player class's list put it there; descendants are in no slot
  int32_t kickback = 100;
  Fixed y_adjust = 0;
};

struct ActorType {
  std::string name;             ///< class name, e.g. "Stimpack"; names compare without case
  uint32_t parent = kNoType;    ///< index into the catalog
  uint32_t replaces = kNoType;  ///< "actor A : B replaces C"
  int32_t editor_number = -1;   ///< -1: none
  int32_t spawn_id = 0;         ///< number of ACS's Thing_Spawn; 0 none
  int32_t conversation_id = 0;

  Fixed radius = to_fixed(20), height = to_fixed(16);
  Fixed death_height = -1;  ///< -1: a quarter of height
  Fixed projectile_pass_height = 0;
  int32_t health = 1000, gib_health = INT32_MIN, mass = 100;
  Fixed speed = 0, fast_speed = -1, float_speed = to_fixed(4);
  DamageDice damage;
  DamageType damage_type = DamageType::kNormal;
  std::array<Fixed, static_cast<std::size_t>(DamageType::kCount)> damage_factor = filled(kFracUnit);
  Fixed general_damage_factor = kFracUnit;
  int32_t pain_chance = 0, pain_threshold = 0;
  std::vector<std::pair<DamageType, int32_t>> pain_chances;  ///< of damage types with a separate chance
  int32_t reaction_tics = 8;
  Fixed melee_range = to_fixed(64) - to_fixed(20), max_target_range = 0, melee_threshold = 0;
  int32_t min_missile_chance = 200;
  int32_t melee_damage = 0;
  uint32_t missile_type = kNoType;  ///< of A_MissileAttack and A_ComboAttack
  Fixed gravity = kFracUnit, max_step_height = to_fixed(24), max_dropoff_height = to_fixed(24);
  Fixed bounce_factor = kFracUnit, wall_bounce_factor = kFracUnit;
  int32_t bounce_count = -1;
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  bool keeps_args = false;  ///< DECORATE gave them: a map's special and arguments do not replace its own
  /// A bridge: arguments 0 and 1, where they are not 0, are its radius and height in units. A CustomBridge's are 32 and 4 else.
  enum class Bridge : uint8_t { kNone, kOfItsType, kCustom } bridge = Bridge::kNone;
  uint32_t blood_type = kNoType;
  uint32_t species = kNoType;  ///< type whose kin do not hurt each other
  std::vector<DropItem> drop_items;
  ActorFlags flags;

  // Pictures.
  float scale_x = 1.0f, scale_y = 1.0f;
  RenderStyle render_style = RenderStyle::kNormal;
  float alpha = 1.0f;
  uint8_t translation = 0;  ///< index into ActorCatalog::translation(); 0 none
  std::array<uint8_t, 3> blood_color{};

  // What the engine enters, and every label for scripts and jumps.
  std::array<uint32_t, static_cast<std::size_t>(StateLabel::kCount)> states = filled_states();
  struct Label {
    std::string name;  ///< lower case, e.g. "death.fire"
    uint32_t state = kNoState;
  };
  std::vector<Label> labels;  ///< own and inherited

  // Items.
  ItemClass item_class = ItemClass::kNone;
  int32_t amount = 1,
          max_amount = 1;  ///< Inventory.Amount, .MaxAmount; of health: given, and the limit (0: 100)
  int32_t inter_hub_amount = 1;
  int32_t backpack_amount = 0, backpack_max_amount = 0;  ///< of ammunition
  int32_t drop_amount = 0;
  int32_t save_amount = 0, max_save_amount = 0;  ///< of armour
  Fixed save_percent = 0;                        ///< 16.16 of one
  int32_t respawn_tics = 0;
  PowerKind power = PowerKind::kNone;
  int32_t power_tics = 0;
  std::array<uint8_t, 4> power_color{};  ///< RGB and strength
  int32_t lock_key = 0;                  ///< of a key: the lock number that it opens, 1..6
  uint32_t ammo_base = kNoType;          ///< a ClipBox gives its parent Clip; kNoType: itself
  WeaponInfo weapon;

  // Players.
  bool is_player = false;
  Fixed jump_speed = to_fixed(8), view_height = to_fixed(41), attack_z_offset = to_fixed(8);
  std::vector<DropItem> start_items;
  std::array<Fixed, 2> forward_move = {kFracUnit, kFracUnit}, side_move = {kFracUnit, kFracUnit};

  uint32_t state(StateLabel label) const { return states[static_cast<std::size_t>(label)]; }
  uint32_t find_label(std::string_view label_name) const;  ///< any case; kNoState where there is none

 private:
  static constexpr std::array<Fixed, static_cast<std::size_t>(DamageType::kCount)> filled(Fixed value) {
    std::array<Fixed, static_cast<std::size_t>(DamageType::kCount)> all{};
    all.fill(value);
    return all;
  }
  static constexpr std::array<uint32_t, static_cast<std::size_t>(StateLabel::kCount)> filled_states() {
    std::array<uint32_t, static_cast<std::size_t>(StateLabel::kCount)> all{};
    all.fill(kNoState);
    return all;
  }
};

}  // namespace comrad::doom
