// Action functions of Doom's monsters, its boss brain, its barrels and ZDoom's marines: numbers as in Doom.
#include <algorithm>
#include <array>
#include <cstdlib>

#include "sim_workers/engine/play/actions.h"
#include "sim_workers/engine/play/actor_states.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/hitscan.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/missiles.h"
#include "sim_workers/engine/play/monster_attacks.h"
#include "sim_workers/engine/play/monsters.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/sight.h"

namespace comrad::doom {
namespace {

constexpr Fixed kSkullSpeed = to_fixed(20);
constexpr Angle kMancubusSpread = kAngle90 / 8;
constexpr Angle kTracerTurn = 0x0C000000u;  // 17 degrees
constexpr Fixed kFireDistance = to_fixed(24);

void bite(ActionCall& call, int32_t sides, int32_t factor) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr || !check_melee_range(call.world, call.self)) return;
  damage_actor(call.world, *target, &call.self, &call.self, roll(call.world, sides, factor));
}

/// Back to hunting: what it fired at is gone. Does not apply to friends that do not hunt.
void stop_firing(ActionCall& call) {
  const uint32_t see = call.world.type_of(call.self).state(StateLabel::kSee);
  if (see != kNoState) call.go_to(see);
}

/// Keeps a machine gun on its target; `chance` of 256 not to look.
void keep_firing(ActionCall& call, int32_t chance) {
  face_target(call.world, call.self);
  if (call.world.random_byte() < chance) return;
  const Actor* target = target_of(call.world, call.self);
  if (target == nullptr || target->health <= 0 || is_friend(call.self, *target) ||
      !can_see(call.world, call.self, *target))
    stop_firing(call);
}

void charge(World& world, Actor& skull, Fixed speed) {
  const Actor* target = target_of(world, skull);
  if (target == nullptr) return;
  skull.set(ActorFlag::kSkullFly);
  face_target(world, skull);
  skull.velocity_x = fixed_mul(speed, fine_cosine(skull.angle));
  skull.velocity_y = fixed_mul(speed, fine_sine(skull.angle));
  const int64_t tics = std::max<int64_t>(distance_between(skull, *target) / std::max(speed, Fixed{1}), 1);
  skull.velocity_z = clamped_fixed((int64_t{target->z} + target->height / 2 - skull.z) / tics);
}

/// A pain elemental spits a lost soul, which dies where it has no room.
void spit_skull(ActionCall& call, Angle angle) {
  World& world = call.world;
  Actor& parent = call.self;
  const uint32_t asked = call.type(0, world.catalog().known().lost_soul);
  if (asked == kNoType) return;
  const uint32_t type = world.catalog().replacement(asked);
  const ActorType& kind = world.catalog()[type];
  const int64_t ahead = to_fixed(4) + 3 * (int64_t{parent.radius} + kind.radius) / 2;
  const Fixed x = clamped_fixed(parent.x + ((ahead * fine_cosine(angle)) >> kFracBits));
  const Fixed y = clamped_fixed(parent.y + ((ahead * fine_sine(angle)) >> kFracBits));
  const Fixed z = clamped_fixed(int64_t{parent.z} + to_fixed(8));
  Actor& skull = world.spawn_unchecked(type, x, y, z, angle);
  skull.set(ActorFlag::kFriendly, parent.has(ActorFlag::kFriendly));
  skull.target_id = parent.target_id;

  // Through a wall it must not come: a way that no body of its size could go.
  bool fits = fits_here(world, skull);
  trace_path(world, parent.x, parent.y, clamped_fixed(int64_t{x} - parent.x),
             clamped_fixed(int64_t{y} - parent.y), true, false, [&](const PathCrossing& crossing) {
               const auto line = static_cast<std::size_t>(crossing.line);
               const uint32_t flags = world.lines()[line].flags;
               if (!world.level().linedefs[line].back ||
                   (flags & (kLineBlocking | kLineBlockMonsters | kLineBlockEverything)) != 0)
                 fits = false;
               return fits;
             });
  if (!fits) {
    damage_actor(world, skull, &parent, &parent, 1'000'000, DamageType::kTelefrag, kDamageForced);
    return;
  }
  charge(world, skull, kSkullSpeed);
}

// ---------------------------------------------------------------- arch-vile

/// A corpse in reach of the vile's next step that can rise and has room for it.
Actor* find_corpse(World& world, const Actor& vile) {
  if (vile.move_direction >= kNoDirection) return nullptr;
  const Angle way = static_cast<Angle>(vile.move_direction) << 29;
  const int64_t x = vile.x + ((int64_t{vile.speed} * fine_cosine(way)) >> kFracBits);
  const int64_t y = vile.y + ((int64_t{vile.speed} * fine_sine(way)) >> kFracBits);
  std::vector<uint32_t>& corpses = world.state().corpse_ids;
  std::erase_if(corpses, [&](uint32_t id) { return world.actor(id) == nullptr; });
  for (const uint32_t id : corpses) {
    Actor& corpse = *world.actor(id);
    if (!corpse.is_corpse() || corpse.tics != -1) continue;
    const ActorType& type = world.type_of(corpse);
    if (type.state(StateLabel::kRaise) == kNoState) continue;
    const int64_t reach = int64_t{type.radius} + vile.radius;
    if (std::abs(corpse.x - x) > reach || std::abs(corpse.y - y) > reach) continue;
    if (corpse.z > int64_t{vile.z} + vile.height || int64_t{corpse.z} + type.height < vile.z) continue;
    // At full size, and solid: is there room?
    const Actor before = corpse;
    corpse.velocity_x = corpse.velocity_y = 0;
    corpse.radius = type.radius, corpse.height = type.height;
    corpse.set(ActorFlag::kCorpse, false);
    corpse.set(ActorFlag::kSolid);
    const bool fits = fits_here(world, corpse);
    corpse.radius = before.radius, corpse.height = before.height, corpse.flags = before.flags;
    if (fits) return &corpse;
  }
  return nullptr;
}

void raise_corpse(World& world, Actor& corpse, const Actor& vile) {
  const ActorType& type = world.type_of(corpse);
  std::erase(world.state().corpse_ids, corpse.id);
  world.unlink(corpse);
  const bool friendly = vile.has(ActorFlag::kFriendly);
  corpse.flags = type.flags;
  corpse.set(ActorFlag::kFriendly, friendly);
  corpse.health = type.health;
  corpse.radius = type.radius, corpse.height = type.height;
  corpse.target_id = corpse.tracer_id = corpse.last_enemy_id = 0;
  corpse.threshold = 0;
  corpse.last_heard_id = vile.last_heard_id;
  world.link(corpse);
  if (corpse.has(ActorFlag::kCountKill)) ++world.state().monster_count;
  set_label(world, corpse, StateLabel::kRaise);
}

/// Keeps the fire in front of the eyes of its victim, as long as the vile sees it.
void move_fire(World& world, Actor& fire) {
  const Actor* victim = world.actor(fire.tracer_id);
  const Actor* vile = target_of(world, fire);
  if (victim == nullptr || vile == nullptr || !can_see(world, *vile, *victim)) return;
  set_position(world, fire.id,
               clamped_fixed(int64_t{victim->x} + fixed_mul(kFireDistance, fine_cosine(victim->angle))),
               clamped_fixed(int64_t{victim->y} + fixed_mul(kFireDistance, fine_sine(victim->angle))),
               victim->z);
}

// ---------------------------------------------------------------- boss brain

/// The target after the last one, in a circle. The map's targets become actors with the first cube.
Actor* next_brain_target(World& world) {
  const ActorCatalog& catalog = world.catalog();
  const std::optional<uint32_t> kind = catalog.find("BossTarget");
  if (!kind) return nullptr;
  for (int attempt = 0; attempt < 2; ++attempt) {
    Actor* first = nullptr;
    for (Actor& actor : world.state().actors) {
      if (actor.removed || !catalog.is_a(actor.type, *kind)) continue;
      if (first == nullptr) first = &actor;
      if (actor.id <= world.state().brain.next_spot) continue;
      world.state().brain.next_spot = actor.id;
      return &actor;
    }
    if (first != nullptr) {
      world.state().brain.next_spot = first->id;
      return first;
    }
    for (const MapThing& thing : world.level().things)
      if (thing.editor_number == catalog[*kind].editor_number)
        world.spawn_unchecked(*kind, thing.x, thing.y, kOnFloor);
  }
  return nullptr;
}

/// A fire cube has arrived: what comes out of it.
void hatch(World& world, Actor& cube) {
  struct Brood {
    int below;
    const char* name;
  };
  static constexpr std::array<Brood, 11> kBrood = {{{50, "DoomImp"},
                                                    {90, "Demon"},
                                                    {120, "Spectre"},
                                                    {130, "PainElemental"},
                                                    {160, "Cacodemon"},
                                                    {162, "Archvile"},
                                                    {172, "Revenant"},
                                                    {192, "Arachnotron"},
                                                    {222, "Fatso"},
                                                    {246, "HellKnight"},
                                                    {256, "BaronOfHell"}}};
  Fixed x = cube.x, y = cube.y, z = cube.z;
  if (const Actor* spot = target_of(world, cube)) x = spot->x, y = spot->y, z = spot->z;
  if (const uint32_t fire = type_named(world, "SpawnFire"); fire != kNoType)
    world.spawn_unchecked(fire, x, y, z);
  const int draw = world.random_byte();
  const auto chosen =
      std::find_if(kBrood.begin(), kBrood.end(), [&](const Brood& b) { return draw < b.below; });
  const uint32_t type = type_named(world, chosen->name);
  if (type != kNoType) {
    Actor& monster = world.spawn_unchecked(type, x, y, z);
    if (monster.has(ActorFlag::kCountKill)) ++world.state().monster_count;
    if (look_for_players(world, monster, true)) set_label(world, monster, StateLabel::kSee);
    if (!monster.removed) teleport_move(world, monster, x, y, z, monster.angle, false, false, true);
  }
  world.remove(cube.id);
}

// ---------------------------------------------------------------- marines

/// Marines' states stop firing by continuing to the state behind the present one.
void next_in_table(ActionCall& call) {
  const uint32_t next = call.self.state + 1;
  call.go_to(next < call.world.catalog().state_count() ? next : call.state.next);
}

void marine_bullet(ActionCall& call, int32_t pitch, int spread_bits, bool accurate) {
  World& world = call.world;
  const int32_t damage = 5 * (world.random_byte() % 3 + 1);
  Angle angle = call.self.angle;
  if (!accurate) angle += static_cast<Angle>(world.random_triangle()) << spread_bits;
  line_attack(world, call.self, angle, kMissileRange, pitch, damage, DamageType::kNormal,
              world.catalog().known().bullet_puff);
}

void marine_bullets(ActionCall& call, int count, bool accurate) {
  if (face_and_get_target(call) == nullptr) return;
  const int32_t pitch = aim_line(call.world, call.self, call.self.angle, kMissileRange).pitch;
  for (int i = 0; i < count && !call.self.removed; ++i) marine_bullet(call, pitch, 18, accurate);
}

void marine_punch(ActionCall& call, int32_t factor) {
  World& world = call.world;
  if (target_of(world, call.self) == nullptr) return;
  const int32_t damage = roll(world, 10, 2 * factor);
  face_target(world, call.self);
  if (!check_melee_range(world, call.self)) return;
  const Angle angle = call.self.angle + (static_cast<Angle>(world.random_triangle()) << 18);
  const int32_t pitch = aim_line(world, call.self, angle, kBlowRange).pitch;
  if (Actor* struck = line_attack(world, call.self, angle, kBlowRange, pitch, damage, DamageType::kNormal,
                                  world.catalog().known().bullet_puff))
    call.self.angle = angle_between(call.self, *struck);
}

/// Energy weapons rest a while after a shot.
void rest_until(ActionCall& call, uint64_t tics) {
  call.self.special_1 = static_cast<int32_t>(std::min<uint64_t>(call.world.tic_count() + tics, INT32_MAX));
}
void end_rest(ActionCall& call) {
  if (call.self.special_1 > 0 && static_cast<uint64_t>(call.self.special_1) <= call.world.tic_count())
    call.self.special_1 = 0;
}

}  // namespace

// ---------------------------------------------------------------- soldiers

void action_PosAttack(ActionCall& call) {
  if (face_and_get_target(call) != nullptr) fire_bullets(call.world, call.self, 1);
}
void action_SPosAttackUseAtkSound(ActionCall& call) {
  if (face_and_get_target(call) != nullptr) fire_bullets(call.world, call.self, 3);
}
void action_CPosAttack(ActionCall& call) { action_PosAttack(call); }
void action_CPosRefire(ActionCall& call) { keep_firing(call, 40); }
void action_SpidRefire(ActionCall& call) { keep_firing(call, 10); }

// ---------------------------------------------------------------- claws and missiles

void action_TroopAttack(ActionCall& call) { claw_or_shoot(call, 8, 3, "DoomImpBall"); }
void action_SargAttack(ActionCall& call) { bite(call, 10, 4); }
void action_HeadAttack(ActionCall& call) { claw_or_shoot(call, 6, 10, "CacodemonBall"); }
void action_BruisAttack(ActionCall& call) { claw_or_shoot(call, 8, 10, "BaronBall"); }

void action_BspiAttack(ActionCall& call) {
  if (Actor* target = face_and_get_target(call)) {
    const uint32_t plasma = call.world.catalog().known().arachnotron_plasma;
    if (plasma != kNoType) shoot(call, *target, call.world.catalog().replacement(plasma));
  }
}

void action_CyberAttack(ActionCall& call) {
  if (Actor* target = face_and_get_target(call)) shoot(call, *target, type_named(call.world, "Rocket"));
}

void action_SkullAttack(ActionCall& call) {
  const Fixed speed = call.fixed(0, kSkullSpeed);
  charge(call.world, call.self, speed > 0 ? speed : kSkullSpeed);
}

void action_BetaSkullAttack(ActionCall& call) {
  Actor* target = target_of(call.world, call.self);
  if (target == nullptr || target->type == call.self.type) return;
  face_target(call.world, call.self);
  damage_actor(call.world, *target, &call.self, &call.self, roll_damage(call.world, call.self.damage));
}

void action_PainAttack(ActionCall& call) {
  if (face_and_get_target(call) != nullptr) spit_skull(call, call.self.angle);
}
void action_DualPainAttack(ActionCall& call) {
  if (face_and_get_target(call) == nullptr) return;
  spit_skull(call, call.self.angle + kAngle45);
  spit_skull(call, call.self.angle - kAngle45);
}
void action_PainDie(ActionCall& call) {
  call.self.set(ActorFlag::kSolid, false);
  relink(call.world, call.self);
  for (const Angle turn : {kAngle90, kAngle180, kAngle180 + kAngle90})
    spit_skull(call, call.self.angle + turn);
}

// ---------------------------------------------------------------- revenant

void action_SkelWhoosh(ActionCall& call) { face_target(call.world, call.self); }
void action_SkelFist(ActionCall& call) { bite(call, 10, 6); }

void action_SkelMissile(ActionCall& call) {
  Actor* target = face_and_get_target(call);
  const uint32_t type = type_named(call.world, "RevenantTracer");
  if (target == nullptr || type == kNoType) return;
  const Fixed z = clamped_fixed(int64_t{call.self.z} + to_fixed(48));
  Actor* missile = spawn_missile_z(call.world, call.self, z, *target, type);
  if (missile == nullptr) return;
  missile->tracer_id = target->id;
  // A step ahead of its shoulder.
  set_position(call.world, missile->id, clamped_fixed(int64_t{missile->x} + missile->velocity_x),
               clamped_fixed(int64_t{missile->y} + missile->velocity_y), missile->z);
}

void action_Tracer(ActionCall& call) {
  World& world = call.world;
  Actor& self = call.self;
  if ((world.tic_count() & 3) != 0) return;
  if (const uint32_t smoke = world.catalog().known().tracer_smoke; smoke != kNoType) {
    Actor& puff = world.spawn_unchecked(world.catalog().replacement(smoke),
                                        clamped_fixed(int64_t{self.x} - self.velocity_x),
                                        clamped_fixed(int64_t{self.y} - self.velocity_y), self.z);
    puff.velocity_z = kFracUnit;
    puff.tics = std::max(1, puff.tics - (world.random_byte() & 3));
  }
  const Actor* target = world.actor(self.tracer_id);
  if (target == nullptr || target->health <= 0 || self.speed <= 0) return;

  // It turns by no more than a step, and rises and sinks slowly.
  const Angle exact = angle_between(self, *target);
  if (exact != self.angle) {
    const bool clockwise = exact - self.angle > kAngle180;
    self.angle += clockwise ? Angle{0} - kTracerTurn : kTracerTurn;
    const bool passed = clockwise ? exact - self.angle < kAngle180 : exact - self.angle > kAngle180;
    if (passed) self.angle = exact;
  }
  redirect(self, self.angle, self.speed);
  if (self.has(ActorFlag::kFloorHugger) || self.has(ActorFlag::kCeilingHugger)) return;
  const int64_t tics = std::max<int64_t>(distance_between(self, *target) / self.speed, 1);
  const int64_t aim_height = target->height >= to_fixed(56) ? to_fixed(40) : int64_t{self.height} * 2 / 3;
  const int64_t rise = (int64_t{target->z} + aim_height - self.z) / tics;
  self.velocity_z =
      clamped_fixed(int64_t{self.velocity_z} + (rise < self.velocity_z ? -kFracUnit / 8 : kFracUnit / 8));
}

// ---------------------------------------------------------------- mancubus

namespace {

/// Two missiles; `first` and `second` are the angles by which they miss the target.
void mancubus_attack(ActionCall& call, Angle turn, Angle first, Angle second) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr) return;
  const uint32_t type = call.type(0, kNoType) != kNoType ? call.world.catalog().replacement(call.type(0))
                                                         : type_named(call.world, "FatShot");
  call.self.angle += turn;
  for (const Angle miss : {first, second}) {
    Actor* missile = shoot(call, *target, type);
    if (missile != nullptr && miss != 0) redirect(*missile, missile->angle + miss, missile->speed);
  }
}

}  // namespace

void action_FatRaise(ActionCall& call) { face_target(call.world, call.self); }
void action_FatAttack1(ActionCall& call) { mancubus_attack(call, kMancubusSpread, 0, kMancubusSpread); }
void action_FatAttack2(ActionCall& call) {
  mancubus_attack(call, Angle{0} - kMancubusSpread, 0, Angle{0} - 2 * kMancubusSpread);
}
void action_FatAttack3(ActionCall& call) {
  mancubus_attack(call, 0, Angle{0} - kMancubusSpread / 2, kMancubusSpread / 2);
}

// ---------------------------------------------------------------- arch-vile

void action_VileChase(ActionCall& call) {
  if (!vile_raises(call.world, call.self)) action_Chase(call);
}

bool vile_raises(World& world, Actor& vile) {
  Actor* corpse = find_corpse(world, vile);
  if (corpse == nullptr) return false;
  vile.angle = angle_between(vile, *corpse);
  vile.set(ActorFlag::kAmbush, false);
  raise_corpse(world, *corpse, vile);
  set_label(world, vile, StateLabel::kHeal);
  return true;
}

void action_VileStart(ActionCall&) {}

void action_VileTarget(ActionCall& call) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr) return;
  uint32_t type = call.type(0, call.world.catalog().known().archvile_fire);
  if (type == kNoType) return;
  type = call.world.catalog().replacement(type);
  Actor& fire = call.world.spawn_unchecked(type, target->x, target->y, target->z);
  call.self.tracer_id = fire.id;
  fire.target_id = call.self.id;
  fire.tracer_id = target->id;
  move_fire(call.world, fire);
}

void action_VileAttack(ActionCall& call) {
  World& world = call.world;
  Actor* target = face_and_get_target(call);
  if (target == nullptr || !can_see(world, call.self, *target)) return;
  constexpr int32_t kDirect = 20, kBlast = 70;
  damage_actor(world, *target, &call.self, &call.self, kDirect);
  const uint32_t target_id = target->id;
  if (Actor* fire = world.actor(call.self.tracer_id)) {
    // Between the two, so that the blast throws the victim away from the vile.
    set_position(world, fire->id,
                 clamped_fixed(int64_t{target->x} - fixed_mul(kFireDistance, fine_cosine(call.self.angle))),
                 clamped_fixed(int64_t{target->y} - fixed_mul(kFireDistance, fine_sine(call.self.angle))),
                 target->z);
    radius_attack(world, *fire, &call.self, kBlast, to_fixed(kBlast), DamageType::kFire);
  }
  // Whatever the blast did: 10 for a player in ViZDoom.
  target = world.actor(target_id);
  if (target != nullptr && !target->has(ActorFlag::kNoDamageThrust) && target->mass > 0)
    target->velocity_z = clamped_fixed(int64_t{to_fixed(1000)} / target->mass);
}

void action_StartFire(ActionCall& call) { move_fire(call.world, call.self); }
void action_Fire(ActionCall& call) { move_fire(call.world, call.self); }
void action_FireCrackle(ActionCall& call) { move_fire(call.world, call.self); }

// ---------------------------------------------------------------- deaths that matter

void action_BossDeath(ActionCall& call) { boss_death(call.world, call.self); }

void action_KeenDie(ActionCall& call) {
  action_NoBlocking(call);
  for (const Actor& other : call.world.actors())
    if (other.id != call.self.id && !other.removed && other.type == call.self.type && other.health > 0)
      return;
  const int32_t tag = call.integer(0, 666);
  call.world.events().run_special(call.world,
                                  {.number = Special::kDoor_Open, .args = {tag != 0 ? tag : 666, 16}});
}

void action_BarrelDestroy(ActionCall& call) {
  if (!call.world.has(wad::GameFlag::kBarrelsReturn)) call.world.remove(call.self.id);
}

// ---------------------------------------------------------------- boss brain

void action_BrainAwake(ActionCall&) {}
void action_BrainPain(ActionCall&) {}
void action_BrainScream(ActionCall&) {}
void action_BrainExplode(ActionCall&) {}
void action_BrainDie(ActionCall& call) { call.world.exit_level(); }

void action_BrainSpit(ActionCall& call) {
  World& world = call.world;
  if (world.options().skill <= 2) {  // the easy skills get every second cube
    bool& skip = world.state().brain.easy_skip;
    skip = !skip;
    if (!skip) return;
  }
  Actor* spot = next_brain_target(world);
  if (spot == nullptr) return;
  uint32_t type = call.type(0, kNoType);
  type = type != kNoType ? world.catalog().replacement(type) : type_named(world, "SpawnShot");
  if (type == kNoType) return;
  Actor* cube = spawn_missile(world, call.self, *spot, type);
  if (cube == nullptr) return;
  cube->target_id = spot->id;
  cube->master_id = call.self.id;
  const Fixed speed_x = cube->velocity_x, speed_y = cube->velocity_y;
  int64_t tics = 0;
  if (std::abs(int64_t{speed_y}) > std::abs(int64_t{speed_x})) {
    tics = (int64_t{spot->y} - cube->y) / speed_y;
  } else if (speed_x != 0) {
    tics = (int64_t{spot->x} - cube->x) / speed_x;
  }
  const int64_t state_tics = std::max<int64_t>(world.catalog().state(cube->state).tics, 1);
  cube->reaction_tics = static_cast<int32_t>(std::clamp<int64_t>(tics / state_tics, 1, INT32_MAX));
}

void action_SpawnFly(ActionCall& call) {
  if (--call.self.reaction_tics > 0) return;
  hatch(call.world, call.self);
}
void action_SpawnSound(ActionCall& call) { action_SpawnFly(call); }

// ---------------------------------------------------------------- steps that sound

void action_BabyMetal(ActionCall& call) { action_Chase(call); }
void action_Hoof(ActionCall& call) { action_Chase(call); }
void action_Metal(ActionCall& call) { action_Chase(call); }

// ---------------------------------------------------------------- marines

void action_M_Refire(ActionCall& call) {
  World& world = call.world;
  const bool shoots = !call.boolean(0) && world.type_of(call.self).state(StateLabel::kMissile) != kNoState;
  const Actor* target = target_of(world, call.self);
  if (target == nullptr || target->health <= 0) {
    if (shoots && world.random_byte() < 160 && look_for_players(world, call.self, true) &&
        check_missile_range(world, call.self))
      return;
    next_in_table(call);
    return;
  }
  if ((!shoots && !check_melee_range(world, call.self)) || !can_see(world, call.self, *target) ||
      world.random_byte() < 4)
    next_in_table(call);
}

void action_M_CheckAttack(ActionCall& call) {
  if (call.self.special_1 != 0 || target_of(call.world, call.self) == nullptr) {
    const uint32_t skip = call.world.type_of(call.self).find_label("skipattack");
    if (skip != kNoState) call.go_to(skip);
  } else {
    face_target(call.world, call.self);
  }
}
void action_M_CheckAttack2(ActionCall& call) { action_M_CheckAttack(call); }

void action_M_Saw(ActionCall& call) {
  World& world = call.world;
  Actor& self = call.self;
  if (target_of(world, self) == nullptr) return;
  face_target(world, self);
  if (!check_melee_range(world, self)) return;
  const int32_t damage = roll(world, 10, call.integer(2, 2));
  const Angle angle = self.angle + (static_cast<Angle>(world.random_triangle()) << 18);
  const Fixed range = kBlowRange + 1;
  const int32_t pitch = aim_line(world, self, angle, range).pitch;
  const Actor* struck = line_attack(world, self, angle, range, pitch, damage, DamageType::kNormal,
                                    call.type(3, world.catalog().known().bullet_puff));
  if (struck == nullptr) return;
  // The saw pulls it towards what it cuts.
  constexpr Angle kStep = kAngle90 / 20, kJitter = kAngle90 / 21;
  const Angle wanted = angle_between(self, *struck);
  const auto difference = static_cast<int32_t>(wanted - self.angle);
  if (difference < 0) {
    self.angle = difference < -static_cast<int32_t>(kStep) ? wanted + kJitter : self.angle - kStep;
  } else {
    self.angle = difference > static_cast<int32_t>(kStep) ? wanted - kJitter : self.angle + kStep;
  }
}

void action_M_SawRefire(ActionCall& call) {
  const Actor* target = target_of(call.world, call.self);
  if (target == nullptr || target->health <= 0 || !check_melee_range(call.world, call.self))
    next_in_table(call);
}

void action_M_Punch(ActionCall& call) { marine_punch(call, std::clamp(call.integer(0, 1), 0, 1000)); }
void action_M_BerserkPunch(ActionCall& call) { marine_punch(call, 10); }
void action_M_FirePistol(ActionCall& call) { marine_bullets(call, 1, call.boolean(0)); }
void action_M_FireCGun(ActionCall& call) { marine_bullets(call, 1, call.boolean(0)); }
void action_M_FireShotgun(ActionCall& call) { marine_bullets(call, 7, false); }

void action_M_FireShotgun2(ActionCall& call) {
  constexpr int32_t kRise = 332063;  // 7.1 degrees up and down, as an angle per step
  World& world = call.world;
  if (face_and_get_target(call) == nullptr) return;
  const int32_t pitch = aim_line(world, call.self, call.self.angle, kMissileRange).pitch;
  for (int i = 0; i < 20 && !call.self.removed; ++i)
    marine_bullet(call, pitch - kRise * world.random_triangle(), 19, false);
}

void action_M_FireMissile(ActionCall& call) {
  Actor* target = target_of(call.world, call.self);
  if (target == nullptr) return;
  if (check_melee_range(call.world, call.self)) {  // too near for a rocket
    marine_punch(call, 1);
    return;
  }
  face_target(call.world, call.self);
  shoot(call, *target, type_named(call.world, "Rocket"));
}

void action_M_FireRailgun(ActionCall& call) {
  action_MonsterRail(call);
  rest_until(call, 50);
}

void action_M_FirePlasma(ActionCall& call) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr) return;
  shoot(call, *target, type_named(call.world, "PlasmaBall"));
  rest_until(call, 20);
}

void action_M_FireBFG(ActionCall& call) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr) return;
  shoot(call, *target, type_named(call.world, "BFGBall"));
  rest_until(call, 30);
}

void action_MarineNoise(ActionCall&) {}

void action_MarineLook(ActionCall& call) {
  end_rest(call);
  action_Look(call);
}
void action_MarineChase(ActionCall& call) {
  end_rest(call);
  action_Chase(call);
}

}  // namespace comrad::doom
