// What the states of weapons in a player's hand do: raising, firing, lights. Numbers of Doom's own weapons
// stand here, their states in actors/. Stage: tic.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <string_view>

#include "sim_workers/engine/play/actions.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/weapons.h"

namespace comrad::doom {
namespace {

constexpr Fixed kLowerSpeed = to_fixed(6), kRaiseSpeed = to_fixed(6);
constexpr Fixed kPlayerRange = to_fixed(8192), kMeleeRange = to_fixed(64);
constexpr int kBulletSpreadShift = 18;           // triangular, 5.6 degrees at most
constexpr Fixed kSawSpread = to_fixed(45) / 16;  // degrees, half of a fist's
constexpr int kSuperShotgunSpreadShift = 19;     // 11.2 degrees
constexpr int32_t kSuperShotgunRise = 332063;    // 7.1 degrees up and down, as an angle per step
constexpr int kShotgunPellets = 7, kSuperShotgunPellets = 20;
constexpr int32_t kBulletDamage = 5;  // times 1..3

// Bits of arguments, as DECORATE writes them.
constexpr int32_t kReadyNoBob = 1, kReadyNoSwitch = 2, kReadyNoPrimary = 4, kReadyNoSecondary = 8,
                  kReadyDisableSwitch = 64;
constexpr int32_t kBulletsUseAmmo = 1, kBulletsExact = 2, kBulletsExplicitAngle = 4, kBulletsNoPitch = 8,
                  kBulletsNoFlash = 16;
constexpr int32_t kMissileAimAtAngle = 1;
constexpr int32_t kPunchUseAmmo = 1, kPunchPullIn = 4, kPunchNoTurn = 16;
constexpr int32_t kSawNoUseAmmoMiss = 1, kSawNoUseAmmo = 2, kSawNoPullIn = 4, kSawNoTurn = 8;

int player_index(const ActionCall& call) { return call.self.player_index; }

/// The weapon in hand; null where the state is not that of a player's weapon.
const ActorType* weapon_of(const ActionCall& call) {
  if (call.player == nullptr || player_index(call) < 0 || call.player->ready_weapon == kNoType)
    return nullptr;
  return &call.world.catalog()[call.player->ready_weapon];
}

Angle degrees(Fixed value) { return static_cast<Angle>((int64_t{value} << kFracBits) / 360); }

/// A turn by -255..255 steps, as likely near the middle as a sum of two dice.
Angle spread(World& world, int shift) {
  return static_cast<Angle>(int64_t{world.random_triangle()} * (int64_t{1} << shift));
}

int32_t times(int64_t a, int64_t b) { return clamped_fixed(a * b); }

/// The body shows the flash of its weapon.
void show_attack(ActionCall& call) {
  if (call.world.type_of(call.self).state(StateLabel::kMelee) != kNoState)
    set_label(call.world, call.self, StateLabel::kMelee);
}

void show_flash(ActionCall& call, uint32_t offset = 0) {
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr) return;
  const uint32_t flash = weapon->state(StateLabel::kFlash);
  if (flash != kNoState) set_weapon_state(call.world, player_index(call), 1, flash + offset);
}

uint32_t find_type(const World& world, std::string_view name) {
  return world.catalog().find(name).value_or(kNoType);
}

/// One bullet of the pistol, the shotgun and the chaingun.
void shoot(ActionCall& call, bool exact, int32_t pitch) {
  World& world = call.world;
  const int32_t damage = kBulletDamage * (1 + static_cast<int32_t>(world.rng().below(3)));
  Angle angle = call.self.angle;
  if (!exact) angle += spread(world, kBulletSpreadShift);
  line_attack(world, call.self, angle, kPlayerRange, pitch, damage, DamageType::kNormal,
              world.catalog().known().bullet_puff);
}

void face(ActionCall& call, const Actor& target) {
  call.self.angle = angle_to(call.self.x, call.self.y, target.x, target.y);
}

/// A saw pulls the player round to what it cuts, a few degrees at a time.
void saw_towards(Actor& self, Angle wanted) {
  constexpr Angle kTurn = kAngle90 / 20, kShortOf = kAngle90 / 21;
  const auto missing = static_cast<int32_t>(wanted - self.angle);
  if (missing < 0) {
    self.angle = missing < -static_cast<int32_t>(kTurn) ? wanted + kShortOf : self.angle - kTurn;
  } else {
    self.angle = missing > static_cast<int32_t>(kTurn) ? wanted - kShortOf : self.angle + kTurn;
  }
}

/// Missile of Doom's own weapons.
void launch(ActionCall& call, std::string_view name) {
  const uint32_t type = find_type(call.world, name);
  if (weapon_of(call) == nullptr || type == kNoType || !use_ammo(call.world, player_index(call))) return;
  spawn_player_missile(call.world, call.self, type, call.self.angle);
}

}  // namespace

// ---------------------------------------------------------------- up, down, ready

void action_WeaponReady(ActionCall& call) {
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr || call.layer != 0) return;
  Player& player = *call.player;
  const int32_t flags = call.integer(0);
  if ((flags & kReadyNoBob) == 0) player.weapon_permissions |= kMayBob;
  player.weapon_sprites[0].own_x = 0;
  player.weapon_sprites[0].own_y = kWeaponTop;
  if ((flags & kReadyDisableSwitch) != 0) player.weapon_permissions |= kNoSwitch;
  player.weapon_permissions &= static_cast<uint8_t>(~kMaySwitchInBurst);
  if ((flags & kReadyNoSwitch) == 0 && (player.weapon_permissions & kNoSwitch) == 0)
    player.weapon_permissions |= kMaySwitch | kMaySwitchInBurst;
  if ((flags & kReadyNoPrimary) == 0) player.weapon_permissions |= kMayFire;
  if ((flags & kReadyNoSecondary) == 0) player.weapon_permissions |= kMayFireAlternately;
  player.weapon_ready = (player.weapon_permissions & kMayFire) != 0;
  if (!player.alive) player.pending_weapon = kNoType;

  // The body has finished its attack.
  const ActorType& type = call.world.type_of(call.self);
  const uint32_t idle = type.state(StateLabel::kSpawn);
  for (const StateLabel label : {StateLabel::kMissile, StateLabel::kMelee}) {
    uint32_t state = type.state(label);
    for (int i = 0; i < 8 && state != kNoState && state != idle; ++i) {
      if (call.self.state == state) {
        set_state(call.world, call.self, idle);
        return;
      }
      state = call.world.catalog().state(state).next;
    }
  }
}

void action_Lower(ActionCall& call) {
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr) return;
  WeaponSprite& sprite = call.player->weapon_sprites[0];
  const Fixed speed = call.integer(0) > 0 ? to_fixed(std::min(call.integer(0), 128)) : kLowerSpeed;
  sprite.own_y = call.player->instant_switch ? kWeaponBottom : clamped_fixed(int64_t{sprite.own_y} + speed);
  if (sprite.own_y < kWeaponBottom) return;
  if (!call.player->alive) {
    sprite.own_y = kWeaponBottom;  // and nothing comes up
    return;
  }
  set_weapon_state(call.world, player_index(call), 1, kNoState);
  raise_weapon(call.world, player_index(call));
}

void action_Raise(ActionCall& call) {
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr) return;
  if (call.player->pending_weapon != kNoType) {
    drop_weapon(call.world, player_index(call));
    return;
  }
  WeaponSprite& sprite = call.player->weapon_sprites[0];
  const Fixed speed = call.integer(0) > 0 ? to_fixed(std::min(call.integer(0), 128)) : kRaiseSpeed;
  sprite.own_y = clamped_fixed(int64_t{sprite.own_y} - speed);
  if (sprite.own_y > kWeaponTop) return;
  sprite.own_y = kWeaponTop;
  set_weapon_state(call.world, player_index(call), 0, weapon->state(StateLabel::kReady));
}

void action_ReFire(ActionCall& call) {
  if (weapon_of(call) == nullptr) return;
  Player& player = *call.player;
  const bool leaves =
      player.pending_weapon != kNoType && (player.weapon_permissions & kMaySwitchInBurst) != 0;
  const Buttons buttons = player.effective_buttons();
  const bool held = player.fires_alternately ? buttons.alt_attack : buttons.attack;
  if (held && !leaves && player.alive) {
    player.refire = std::min(player.refire + 1, 1'000'000);
    fire_weapon(call.world, player_index(call), player.fires_alternately);
  } else {
    player.refire = 0;
    check_ammo(call.world, player_index(call), true, player.fires_alternately);
  }
}

void action_ClearReFire(ActionCall& call) {
  if (call.player != nullptr) call.player->refire = 0;
}

void action_CheckReload(ActionCall& call) {
  if (weapon_of(call) != nullptr) check_ammo(call.world, player_index(call), true);
}

void action_CheckForReload(ActionCall& call) {
  if (weapon_of(call) == nullptr) return;
  const int32_t count = call.integer(0);
  int32_t& shots = call.player->reload_counter;
  const bool keeps = call.boolean(2);
  if (keeps && shots == 0) return;
  if (count > 0) shots = (std::max(shots, 0) % count + 1) % count;
  if (shots != 0) {
    call.go_to(call.label(1));
  } else if (!check_ammo(call.world, player_index(call), false)) {
    shots = 0;
  }
}

void action_SelectWeapon(ActionCall& call) {
  if (call.player == nullptr || player_index(call) < 0) return;
  call.succeeded = select_weapon(call.world, player_index(call), call.type(0));
}

void action_JumpIfNoAmmo(ActionCall& call) {
  if (weapon_of(call) != nullptr && !check_ammo(call.world, player_index(call), false))
    call.go_to(call.label(0));
}

// ---------------------------------------------------------------- flash and light

void action_GunFlash(ActionCall& call) {
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr) return;
  constexpr int32_t kNoBodyChange = 1;
  if ((call.integer(1) & kNoBodyChange) == 0) show_attack(call);
  const uint32_t flash = call.arg_count() > 0 ? call.label(0) : weapon->state(StateLabel::kFlash);
  set_weapon_state(call.world, player_index(call), 1, flash);
}

void action_Light(ActionCall& call) {
  if (call.player != nullptr) call.player->extra_light = std::clamp(call.integer(0), -20, 20);
}
void action_Light0(ActionCall& call) {
  if (call.player != nullptr) call.player->extra_light = 0;
}
void action_Light1(ActionCall& call) {
  if (call.player != nullptr) call.player->extra_light = 1;
}
void action_Light2(ActionCall& call) {
  if (call.player != nullptr) call.player->extra_light = 2;
}

// ---------------------------------------------------------------- Doom's weapons

void action_Punch(ActionCall& call) {
  World& world = call.world;
  if (weapon_of(call) != nullptr && !use_ammo(world, player_index(call))) return;
  int32_t damage = 2 * (1 + static_cast<int32_t>(world.rng().below(10)));
  if (call.player != nullptr && call.player->has_power(PowerKind::kStrength)) damage *= 10;
  const Angle angle = call.self.angle + spread(world, kBulletSpreadShift);
  const Aim aim = aim_line(world, call.self, angle, kMeleeRange);
  const Actor* struck = line_attack(world, call.self, angle, kMeleeRange, aim.pitch, damage,
                                    DamageType::kNormal, world.catalog().known().bullet_puff);
  if (struck != nullptr) face(call, *struck);
}

void action_Saw(ActionCall& call) {
  World& world = call.world;
  // A_Saw (full sound, hit sound, damage, puff, flags, range, spread up and down, ...).
  const int32_t flags = call.integer(4);
  const bool uses_ammo = weapon_of(call) != nullptr && (flags & kSawNoUseAmmo) == 0;
  if (uses_ammo && (flags & kSawNoUseAmmoMiss) == 0 && !use_ammo(world, player_index(call))) return;
  const int32_t unit = call.integer(2) != 0 ? call.integer(2) : 2;
  const int32_t damage = times(unit, 1 + static_cast<int64_t>(world.rng().below(10)));
  const Fixed range = call.fixed(5) > 0 ? call.fixed(5) : kMeleeRange + kFracUnit;
  const uint32_t puff = call.type(3, world.catalog().known().bullet_puff);
  const auto wide = static_cast<int32_t>(degrees(call.fixed(6) > 0 ? call.fixed(6) : kSawSpread));
  const Angle angle = call.self.angle + static_cast<Angle>(int64_t{world.random_triangle()} * (wide / 255));
  const Aim aim = aim_line(world, call.self, angle, range);
  const Actor* struck =
      line_attack(world, call.self, angle, range, aim.pitch, damage, DamageType::kNormal, puff);
  if (struck == nullptr) return;
  if (uses_ammo && (flags & kSawNoUseAmmoMiss) != 0 && !use_ammo(world, player_index(call))) return;
  if ((flags & kSawNoTurn) == 0)
    saw_towards(call.self, angle_to(call.self.x, call.self.y, struck->x, struck->y));
  if ((flags & kSawNoPullIn) == 0) call.self.set(ActorFlag::kJustAttacked);
}

void action_FirePistol(ActionCall& call) {
  if (weapon_of(call) == nullptr || !use_ammo(call.world, player_index(call))) return;
  show_flash(call);
  show_attack(call);
  const Aim aim = aim_bullet(call.world, call.self);
  shoot(call, call.player->refire == 0, aim.pitch);
}

void action_FireShotgun(ActionCall& call) {
  if (weapon_of(call) == nullptr || !use_ammo(call.world, player_index(call))) return;
  show_flash(call);
  show_attack(call);
  const Aim aim = aim_bullet(call.world, call.self);
  for (int pellet = 0; pellet < kShotgunPellets; ++pellet) shoot(call, false, aim.pitch);
}

void action_FireShotgun2(ActionCall& call) {
  World& world = call.world;
  if (weapon_of(call) == nullptr || !use_ammo(world, player_index(call))) return;
  show_flash(call);
  show_attack(call);
  const Aim aim = aim_bullet(world, call.self);
  for (int pellet = 0; pellet < kSuperShotgunPellets; ++pellet) {
    const int32_t damage = kBulletDamage * (1 + static_cast<int32_t>(world.rng().below(3)));
    const Angle angle = call.self.angle + spread(world, kSuperShotgunSpreadShift);
    const int32_t pitch = aim.pitch - kSuperShotgunRise * world.random_triangle();
    line_attack(world, call.self, angle, kPlayerRange, pitch, damage, DamageType::kNormal,
                world.catalog().known().bullet_puff);
  }
}

void action_OpenShotgun2(ActionCall&) {}  // a sound
void action_LoadShotgun2(ActionCall&) {}  // a sound
void action_CloseShotgun2(ActionCall& call) { action_ReFire(call); }

void action_FireCGun(ActionCall& call) {
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr || !use_ammo(call.world, player_index(call))) return;
  show_attack(call);
  // The first two states of the burst have a flash each.
  const uint32_t fire = weapon->state(StateLabel::kFire), flash = weapon->state(StateLabel::kFlash);
  const uint32_t present = call.player->weapon_sprites[0].state;
  const ActorCatalog& catalog = call.world.catalog();
  const bool second = fire != kNoState && flash != kNoState && present == fire + 1 &&
                      flash + 1 < catalog.state_count() &&
                      catalog.state(flash + 1).sprite == catalog.state(flash).sprite;
  show_flash(call, second ? 1 : 0);
  const Aim aim = aim_bullet(call.world, call.self);
  shoot(call, call.player->refire == 0, aim.pitch);
}

void action_FireMissile(ActionCall& call) { launch(call, "Rocket"); }

void action_FirePlasma(ActionCall& call) {
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr || !use_ammo(call.world, player_index(call))) return;
  const uint32_t flash = weapon->state(StateLabel::kFlash);
  const ActorCatalog& catalog = call.world.catalog();
  const uint32_t which = call.world.rng().below(2);
  const bool has_two = flash != kNoState && flash + 1 < catalog.state_count() &&
                       catalog.state(flash + 1).sprite == catalog.state(flash).sprite;
  show_flash(call, has_two ? which : 0);
  const uint32_t type = find_type(call.world, "PlasmaBall");
  if (type != kNoType) spawn_player_missile(call.world, call.self, type, call.self.angle);
}

void action_BFGsound(ActionCall&) {}  // a sound

void action_FireBFG(ActionCall& call) { launch(call, "BFGBall"); }

void action_BFGSpray(ActionCall& call) {
  World& world = call.world;
  Actor* owner = world.actor(call.self.target_id);
  if (owner == nullptr) return;
  const uint32_t spray_type = call.type(0, find_type(world, "BFGExtra"));
  const auto or_default = [](int32_t value, int32_t fallback) { return value > 0 ? value : fallback; };
  const int32_t rays = std::min(or_default(call.integer(1), 40), 360);
  const int32_t dice = std::min(or_default(call.integer(2), 15), 1000);
  const Fixed wide = call.fixed(3) > 0 ? call.fixed(3) : to_fixed(90);
  const Fixed distance = call.fixed(4) > 0 ? call.fixed(4) : to_fixed(1024);
  const Fixed high = call.fixed(5) > 0 ? call.fixed(5) : to_fixed(32);
  const int32_t exact_damage = call.integer(6);
  for (int32_t ray = 0; ray < rays; ++ray) {
    const Angle angle = call.self.angle - degrees(wide / 2) +
                        degrees(wide) / static_cast<uint32_t>(rays) * static_cast<uint32_t>(ray);
    // The rays start at the shooter, wherever its ball burst.
    const Aim aim = aim_line(world, *owner, angle, distance, high);
    if (aim.target == nullptr) continue;
    Actor& target = *aim.target;
    if (spray_type != kNoType) {
      Actor& spray = world.spawn_unchecked(spray_type, target.x, target.y,
                                           clamped_fixed(int64_t{target.z} + target.height / 4));
      spray.target_id = owner->id;
    }
    int32_t damage = exact_damage;
    if (damage == 0)
      for (int32_t i = 0; i < dice; ++i) damage += 1 + static_cast<int32_t>(world.rng().below(8));
    damage_actor(world, target, owner, owner, damage);
    if (owner->removed) return;
  }
}

// ---------------------------------------------------------------- for weapons of DECORATE

void action_FireBullets(ActionCall& call) {
  World& world = call.world;
  // A_FireBullets (spread, spread up and down, count, damage, puff, flags, range).
  const Angle wide = degrees(call.fixed(0)), high = degrees(call.fixed(1));
  int32_t count = call.integer(2, 1);
  const int32_t unit = call.integer(3);
  const uint32_t puff = call.type(4, world.catalog().known().bullet_puff);
  const int32_t flags = call.integer(5, kBulletsUseAmmo);
  const Fixed range = call.fixed(6) > 0 ? call.fixed(6) : kPlayerRange;
  if (weapon_of(call) == nullptr) return;
  if ((flags & kBulletsUseAmmo) != 0 && !use_ammo(world, player_index(call))) return;
  if ((flags & kBulletsNoFlash) == 0) show_attack(call);
  const int32_t aimed = (flags & kBulletsNoPitch) != 0 ? 0 : aim_bullet(world, call.self).pitch;
  const bool exact = count == 0 || (count == 1 && call.player->refire == 0);
  count = std::clamp(count < 0 ? 1 : count, 1, 1000);
  for (int32_t bullet = 0; bullet < count; ++bullet) {
    Angle angle = call.self.angle;
    int64_t pitch = aimed;
    if (!exact && (flags & kBulletsExplicitAngle) != 0) {
      angle += wide;
      pitch += static_cast<int32_t>(high);
    } else if (!exact) {
      angle += static_cast<Angle>(int64_t{world.random_triangle()} * (static_cast<int32_t>(wide) / 255));
      pitch -= int64_t{world.random_triangle()} * (static_cast<int32_t>(high) / 255);
    }
    int32_t damage = unit;
    if ((flags & kBulletsExact) == 0) damage = times(unit, 1 + static_cast<int64_t>(world.rng().below(3)));
    line_attack(world, call.self, angle, range, clamped_fixed(pitch), damage, DamageType::kNormal, puff);
  }
}

void action_FireCustomMissile(ActionCall& call) {
  World& world = call.world;
  // A_FireCustomMissile (missile, angle, use ammo, offset to the side, height, flags, pitch).
  const uint32_t type = call.type(0);
  const Angle turn = degrees(call.fixed(1));
  const Fixed aside = call.fixed(3), height = call.fixed(4);
  const int32_t flags = call.integer(5);
  const Angle pitch = degrees(call.fixed(6));
  if (weapon_of(call) == nullptr || type == kNoType) return;
  if (call.boolean(2, true) && !use_ammo(world, player_index(call))) return;
  const bool aims_there = (flags & kMissileAimAtAngle) != 0;
  const Angle right = call.self.angle - kAngle90;
  const Angle held_pitch = call.self.pitch;
  call.self.pitch += pitch;
  Actor* missile =
      spawn_player_missile(world, call.self, type, call.self.angle + (aims_there ? turn : 0),
                           fixed_mul(aside, fine_cosine(right)), fixed_mul(aside, fine_sine(right)), height);
  call.self.pitch = held_pitch;
  if (missile == nullptr || aims_there) return;
  // Aimed straight ahead, then turned: the speed along the floor stays.
  const int64_t speed_x = missile->velocity_x, speed_y = missile->velocity_y;
  const auto ahead = clamped_fixed(
      static_cast<int64_t>(std::sqrt(static_cast<double>(speed_x * speed_x + speed_y * speed_y))));
  missile->angle += turn;
  missile->velocity_x = fixed_mul(ahead, fine_cosine(missile->angle));
  missile->velocity_y = fixed_mul(ahead, fine_sine(missile->angle));
}

void action_FireProjectile(ActionCall& call) { action_FireCustomMissile(call); }

void action_CustomPunch(ActionCall& call) {
  World& world = call.world;
  // A_CustomPunch (damage, no dice, flags, puff, range, life stolen).
  int32_t damage = call.integer(0);
  if (!call.boolean(1)) damage = times(damage, 1 + static_cast<int64_t>(world.rng().below(8)));
  const int32_t flags = call.integer(2, kPunchUseAmmo);
  const uint32_t puff = call.type(3, world.catalog().known().bullet_puff);
  const Fixed range = call.fixed(4) > 0 ? call.fixed(4) : kMeleeRange;
  const Fixed stolen = call.fixed(5);
  const ActorType* weapon = weapon_of(call);
  if (weapon == nullptr) return;
  const Angle angle = call.self.angle + spread(world, kBulletSpreadShift);
  const Aim aim = aim_line(world, call.self, angle, range);
  // It costs only when it hits.
  if ((flags & kPunchUseAmmo) != 0 && aim.target != nullptr && !use_ammo(world, player_index(call))) return;
  const Actor* struck =
      line_attack(world, call.self, angle, range, aim.pitch, damage, DamageType::kNormal, puff);
  if (struck == nullptr) return;
  if (stolen > 0) heal_actor(world, call.self, fixed_mul(damage, stolen));
  if ((flags & kPunchNoTurn) == 0) face(call, *struck);
  if ((flags & kPunchPullIn) != 0) call.self.set(ActorFlag::kJustAttacked);
}

void action_RailAttack(ActionCall& call) {
  World& world = call.world;
  // A_RailAttack (damage, offset to the side, use ammo, colour, colour, flags, jitter, puff, spread, ...).
  if (weapon_of(call) == nullptr) return;
  if (call.boolean(2, true) && !use_ammo(world, player_index(call))) return;
  const auto wide = static_cast<int32_t>(degrees(call.fixed(8)));
  const auto turn = static_cast<Angle>(int64_t{world.random_triangle()} * (wide / 255));
  rail_attack(world, call.self, call.integer(0), turn, call.type(7, world.catalog().known().bullet_puff));
}

// ---------------------------------------------------------------- what only shows or sounds

void action_WeaponBob(ActionCall&) {}
void action_ZoomFactor(ActionCall&) {}
void action_SetCrosshair(ActionCall&) {}

void action_KickBack(ActionCall& call) {
  if (call.player != nullptr) call.self.set(ActorFlag::kJustAttacked);
}

// ---------------------------------------------------------------- items that come back

void action_RestoreSpecialPosition(ActionCall& call) {
  Actor& item = call.self;
  if (call.player != nullptr) return;
  set_position(call.world, item.id, item.spawn_x, item.spawn_y, item.spawn_z);
}

void action_RestoreSpecialThing1(ActionCall& call) { call.self.set(ActorFlag::kInvisible, false); }

void action_RestoreSpecialThing2(ActionCall& call) {
  if (call.player != nullptr) return;
  call.self.set(ActorFlag::kPickup);
  call.world.link(call.self);
  call.go_to(call.world.type_of(call.self).state(StateLabel::kSpawn));
}

void action_RestoreSpecialDoomThing(ActionCall& call) {
  call.self.set(ActorFlag::kInvisible, false);
  action_RestoreSpecialThing2(call);
}

}  // namespace comrad::doom
