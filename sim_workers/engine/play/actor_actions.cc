// Action functions of every actor: looking and chasing, generic attacks, spawning, jumps, flags, fades. What
// only sounds or draws is empty here. See actors/action_id.h for the list.
#include <algorithm>
#include <array>
#include <cstdlib>
#include <optional>
#include <string>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/actors/flag_names.h"
#include "sim_workers/engine/play/actions.h"
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

// ---------------------------------------------------------------- shared with monster_actions.cc

uint32_t type_named(const World& world, std::string_view name) {
  const std::optional<uint32_t> index = world.catalog().find(name);
  return index ? world.catalog().replacement(*index) : kNoType;
}

int32_t roll(World& world, int32_t sides, int32_t factor) {
  return clamped_fixed(int64_t{factor} * (1 + world.random_byte() % sides));
}

Angle angle_of_degrees(Fixed degrees) {
  return static_cast<Angle>((int64_t{degrees} * (int64_t{1} << 16)) / 360);
}

Actor* face_and_get_target(ActionCall& call) {
  Actor* target = target_of(call.world, call.self);
  if (target != nullptr) face_target(call.world, call.self);
  return target;
}

void fire_bullets(World& world, Actor& monster, int count, uint32_t puff_type) {
  const Angle ahead = monster.angle;
  const int32_t pitch = aim_line(world, monster, ahead, kMissileRange).pitch;
  if (puff_type == kNoType) puff_type = world.catalog().known().bullet_puff;
  for (int i = 0; i < count && !monster.removed; ++i) {
    const Angle angle = ahead + (static_cast<Angle>(world.random_triangle()) << 20);
    const int32_t damage = roll(world, 5, 3);
    line_attack(world, monster, angle, kMissileRange, pitch, damage, DamageType::kNormal, puff_type);
  }
}

Actor* shoot(ActionCall& call, Actor& target, uint32_t type) {
  return type != kNoType ? spawn_missile(call.world, call.self, target, type) : nullptr;
}

void claw_or_shoot(ActionCall& call, int32_t sides, int32_t factor, std::string_view missile) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr) return;
  if (check_melee_range(call.world, call.self)) {
    damage_actor(call.world, *target, &call.self, &call.self, roll(call.world, sides, factor));
    return;
  }
  shoot(call, *target, type_named(call.world, missile));
}

void redirect(Actor& missile, Angle angle, Fixed flat_speed) {
  missile.angle = angle;
  missile.velocity_x = fixed_mul(flat_speed, fine_cosine(angle));
  missile.velocity_y = fixed_mul(flat_speed, fine_sine(angle));
}

void relink(World& world, Actor& actor) {
  world.unlink(actor);
  if (!actor.removed) world.link(actor);
}

namespace {

/// Whom an action means by ZDoom's AAPTR_ numbers; 0 is `fallback`.
Actor* pointed(ActionCall& call, std::size_t index, Actor* fallback) {
  switch (call.integer(index, 0)) {
    case 0:
      return fallback;
    case 2:
      return target_of(call.world, call.self);
    case 4:
      return call.world.actor(call.self.master_id);
    case 8:
      return call.world.actor(call.self.tracer_id);
    default:
      return nullptr;
  }
}

void jump(ActionCall& call, std::size_t label_index) {
  const uint32_t state = call.label(label_index);
  if (state != kNoState) call.go_to(state);
}

std::string_view text_of(const ActionCall& call, std::size_t index) {
  if (index >= call.args.size() || call.args[index].kind != ActionArg::Kind::kText) return {};
  return call.world.catalog().text(call.args[index].a);
}

/// Damage type by its DECORATE name; normal for others.
DamageType damage_type_named(const ActionCall& call, std::size_t index) {
  return call.world.catalog().find_damage_type(text_of(call, index)).value_or(DamageType::kNormal);
}

void set_flag(ActionCall& call, ActorFlag flag, bool on) {
  call.self.set(flag, on);
  relink(call.world, call.self);
}

/// The place `forward` and `right` of an actor, as it looks.
struct Place {
  Fixed x = 0, y = 0;
};
Place beside(const Actor& actor, Angle angle, Fixed forward, Fixed right) {
  const int64_t cosine = fine_cosine(angle), sine = fine_sine(angle);
  return {clamped_fixed(actor.x + ((forward * cosine + right * sine) >> kFracBits)),
          clamped_fixed(actor.y + ((forward * sine - right * cosine) >> kFracBits))};
}

/// The true shooter: a missile of a missile belongs to the actor that fired the first.
Actor* first_owner(World& world, Actor& actor) {
  Actor* owner = &actor;
  for (int step = 0; step < 16 && owner->has(ActorFlag::kMissile); ++step) {
    Actor* next = target_of(world, *owner);
    if (next == nullptr) break;
    owner = next;
  }
  return owner;
}

/// floor(sqrt(value)).
int64_t wide_square_root(unsigned __int128 value) {
  unsigned __int128 low = 0, high = static_cast<unsigned __int128>(1) << 40;
  while (high - low > 1) {
    const unsigned __int128 middle = (low + high) / 2;
    (middle * middle <= value ? low : high) = middle;
  }
  return static_cast<int64_t>(low);
}

/// A missile from (x, y, z) with the direction of a straight way from `from` to `target`, turned by `turn`.
/// Where `pitch` is given it climbs by that angle instead.
struct Launch {
  Fixed x = 0, y = 0, z = 0;
  Angle angle = 0;
  Fixed flat_speed = 0, velocity_z = 0;
};
Actor* launch(World& world, Actor& source, uint32_t type, const Launch& way, bool tracks_owner) {
  Actor& missile = world.spawn_unchecked(type, way.x, way.y, way.z, way.angle);
  redirect(missile, way.angle, way.flat_speed);
  missile.velocity_z = way.velocity_z;
  Actor* owner = source.has(ActorFlag::kMissile) || tracks_owner ? first_owner(world, source) : &source;
  missile.target_id = owner->id;
  if (missile.has(ActorFlag::kSeekerMissile))
    missile.tracer_id = source.has(ActorFlag::kMissile) ? source.tracer_id : source.target_id;
  return check_missile_spawn(world, missile, source.radius) ? &missile : nullptr;
}

/// Speeds along the ground and upwards of a missile that flies from (x, y, z) at `target`.
void aim_at(const Actor& target, Fixed x, Fixed y, Fixed z, Fixed feet_z, Fixed speed, Launch& way) {
  const int64_t dx = int64_t{target.x} - x, dy = int64_t{target.y} - y;
  int64_t dz = int64_t{target.z} - feet_z;
  if (z >= int64_t{target.z} + target.height) dz = int64_t{target.z} + target.height - z;
  using Wide = unsigned __int128;
  const Wide flat_squared =
      static_cast<Wide>(dx * static_cast<__int128>(dx)) + static_cast<Wide>(dy * static_cast<__int128>(dy));
  const int64_t flat = wide_square_root(flat_squared);
  const int64_t length = std::max<int64_t>(
      wide_square_root(flat_squared + static_cast<Wide>(dz * static_cast<__int128>(dz))), 1);
  way.flat_speed = clamped_fixed(static_cast<int64_t>(static_cast<__int128>(speed) * flat / length));
  way.velocity_z = clamped_fixed(static_cast<int64_t>(static_cast<__int128>(speed) * dz / length));
}

/// Alpha in 16.16: sums of it are the same on every machine.
Fixed alpha_of(const Actor& actor) { return static_cast<Fixed>(actor.alpha * 65536.0f); }
void set_alpha(Actor& actor, Fixed alpha) {
  actor.alpha = static_cast<float>(std::max(alpha, 0)) / 65536.0f;  // may rise above 1, as in ViZDoom
  if (actor.render_style == RenderStyle::kNormal && alpha < kFracUnit)
    actor.render_style = RenderStyle::kTranslucent;
}

/// A player that an action stopped does not sway on.
void settle(ActionCall& call) {
  const Actor& self = call.self;
  Player* const player = call.world.player_of(self);
  if (player != nullptr && self.velocity_x == 0 && self.velocity_y == 0 && self.velocity_z == 0)
    player->walk_x = player->walk_y = 0;
}

void remove_self(ActionCall& call) {
  if (call.self.player_index < 0) call.world.remove(call.self.id);
}

void kill(World& world, Actor& actor, Actor* source) {
  if (actor.health > 0)
    damage_actor(world, actor, source, source, actor.health, DamageType::kNormal,
                 kDamageForced | kDamageNoArmor | kDamageThrustless);
}

/// Hurts, or heals where `amount` is below zero.
void hurt(World& world, Actor* victim, Actor& source, int32_t amount, DamageType type) {
  if (victim == nullptr) return;
  if (amount > 0) damage_actor(world, *victim, &source, &source, amount, type, kDamageThrustless);
  if (amount < 0) heal_actor(world, *victim, amount == INT32_MIN ? INT32_MAX : -amount);
}

template <typename Visit>
void for_each_child(ActionCall& call, Visit visit) {
  for (Actor& actor : call.world.state().actors)
    if (!actor.removed && actor.master_id == call.self.id && actor.id != call.self.id) visit(actor);
}

/// A special of scripts and things, called by a state.
void call_special(ActionCall& call, int32_t number) {
  SpecialCall special{.number = number, .activator = &call.self};
  for (std::size_t i = 0; i < special.args.size(); ++i) special.args[i] = call.integer(i, 0);
  call.succeeded = call.world.events().run_special(call.world, special) != 0;
}

/// Gives to a player, or heals another actor. Health is given so many times over, armour once, other items that many of.
bool give(World& world, Actor* taker, uint32_t type, int32_t amount) {
  if (taker == nullptr || type == kNoType) return false;
  const ActorType& item = world.catalog()[type];
  const bool heals = item.item_class == ItemClass::kHealth;
  if (heals) amount = clamped_fixed(int64_t{amount} * item.amount);
  if (item.item_class == ItemClass::kArmor || item.item_class == ItemClass::kArmorBonus) amount = 1;
  if (taker->player_index >= 0) return give_item(world, taker->player_index, type, amount);
  return heals && heal_actor(world, *taker, amount) > 0;
}
bool take(World& world, Actor* owner, uint32_t type, int32_t amount) {
  return owner != nullptr && type != kNoType && owner->player_index >= 0 &&
         take_item(world, owner->player_index, type, amount) > 0;
}
bool owns(World& world, const Actor* owner, uint32_t type, int32_t amount) {
  if (owner == nullptr || type == kNoType || owner->player_index < 0) return false;
  const int32_t count = count_item(world, owner->player_index, type);
  return amount > 0 ? count >= amount : count >= max_item(world, owner->player_index, type);
}

bool is_within(const Actor& self, const Actor* other, Fixed distance, bool ignores_height) {
  if (other == nullptr || distance_between(self, *other) >= distance) return false;
  if (ignores_height) return true;
  const int64_t above = int64_t{self.z} - (int64_t{other->z} + other->height);
  const int64_t below = int64_t{other->z} - (int64_t{self.z} + self.height);
  return std::max(above, below) < distance;
}

/// Who heard or saw somebody begins to hunt, unless it waits for its patrol.
void start_hunt(ActionCall& call, uint32_t see) {
  Actor& self = call.self;
  if (self.goal_id != 0 && self.target_id == self.goal_id && self.reaction_tics > 0 &&
      static_cast<uint64_t>(self.reaction_tics) > call.world.tic_count()) {
    self.target_id = 0;
    return;
  }
  if (see != kNoState) call.go_to(see);
}

/// A map gives patrols to its monsters by Thing_SetGoal as their special.
void take_goal_of_special(World& world, Actor& self) {
  if (self.special != Special::kThing_SetGoal || self.args[0] != 0) return;
  self.special = 0;
  for (Actor* point = world.find_thing(self.args[1]); point != nullptr;
       point = world.find_thing(self.args[1], point->thing_order)) {
    if (!world.catalog().is_a(point->type, "PatrolPoint")) continue;
    self.goal_id = point->id;
    const int64_t wait = int64_t{std::clamp(self.args[2], 0, 1 << 20)} * 35;
    self.reaction_tics = clamped_fixed(wait + static_cast<int64_t>(world.tic_count()));
    self.set(ActorFlag::kOnlyChaseGoal, self.args[3] != 0);
    return;
  }
}

struct Senses {
  bool deaf = false, blind = false;
  Fixed hears_within = 0;  // 0: however far
  LookRange range;
  uint32_t see_state = kNoState;
};

void look(ActionCall& call, const Senses& senses) {
  World& world = call.world;
  Actor& self = call.self;
  if (self.has(ActorFlag::kDormant)) return;
  take_goal_of_special(world, self);
  self.threshold = 0;
  if (!senses.deaf) {
    Actor* heard = self.last_heard_id != 0 ? world.actor(self.last_heard_id) : nullptr;
    const Player* player = heard != nullptr ? world.player_of(*heard) : nullptr;
    const bool too_far =
        heard != nullptr && senses.hears_within > 0 && distance_between(self, *heard) > senses.hears_within;
    if (heard != nullptr && heard->has(ActorFlag::kShootable) && !too_far &&
        !(player != nullptr && player->no_target)) {
      if (is_friend(self, *heard)) {
        // The shots of friends tell it to look round.
        if (!look_for_players(world, self, senses.range) && !self.has(ActorFlag::kStandStill))
          wander(world, self);
        if (target_of(world, self) != nullptr) start_hunt(call, senses.see_state);
        return;
      }
      // A monster in ambush waits until it sees the source of the noise.
      if (!self.has(ActorFlag::kAmbush) || can_see(world, self, *heard)) {
        self.target_id = heard->id;
        start_hunt(call, senses.see_state);
        return;
      }
    }
  }
  if (!senses.blind && look_for_players(world, self, senses.range)) start_hunt(call, senses.see_state);
}

constexpr int kChaseDontMove = 16, kChaseResurrect = 8;

void chase_by_args(ActionCall& call, int extra_flags) {
  const ActorType& type = call.world.type_of(call.self);
  ChaseOptions options{.melee_state = type.state(StateLabel::kMelee),
                       .missile_state = type.state(StateLabel::kMissile)};
  const int flags = call.integer(2, 0) | extra_flags;
  if (call.arg_count() > 0) {
    options.melee_state = call.label(0);
    options.missile_state = call.label(1);
  }
  options.stands = (flags & kChaseDontMove) != 0;
  if ((flags & kChaseResurrect) != 0 && vile_raises(call.world, call.self)) return;
  chase(call.world, call.self, options);
}

}  // namespace

// ---------------------------------------------------------------- looking, chasing

void action_Look(ActionCall& call) {
  const ActorType& type = call.world.type_of(call.self);
  look(call, {.range = {.all_around = call.self.has(ActorFlag::kLookAllAround)},
              .see_state = type.state(StateLabel::kSee)});
}

void action_LookEx(ActionCall& call) {
  constexpr int kNoSight = 1, kNoSound = 2, kNoJump = 32;
  const int flags = call.integer(0, 0);
  Senses senses{.deaf = (flags & kNoSound) != 0,
                .blind = (flags & kNoSight) != 0,
                .hears_within = call.fixed(3, 0),
                .range = {.all_around = call.self.has(ActorFlag::kLookAllAround),
                          .nearest = call.fixed(1, 0),
                          .farthest = call.fixed(2, 0),
                          .field_of_view = angle_of_degrees(std::clamp(call.fixed(4, 0), 0, to_fixed(359)))},
                .see_state = call.world.type_of(call.self).state(StateLabel::kSee)};
  if (call.fixed(4, 0) >= to_fixed(360)) senses.range.all_around = true;
  if (call.label(5) != kNoState) senses.see_state = call.label(5);
  if ((flags & kNoJump) != 0) senses.see_state = kNoState;
  look(call, senses);
}

void action_Chase(ActionCall& call) {
  if (call.state.action == ActionId::kChase) {
    chase_by_args(call, 0);
    return;
  }
  // Called by another action, whose arguments mean something else.
  const ActorType& type = call.world.type_of(call.self);
  chase(call.world, call.self,
        {.melee_state = type.state(StateLabel::kMelee), .missile_state = type.state(StateLabel::kMissile)});
}
void action_FastChase(ActionCall& call) { action_Chase(call); }

void action_Wander(ActionCall& call) { wander(call.world, call.self); }
void action_FaceTarget(ActionCall& call) { face_target(call.world, call.self); }
void action_FaceMaster(ActionCall& call) {
  if (const Actor* master = call.world.actor(call.self.master_id))
    call.self.angle = angle_between(call.self, *master);
}
void action_FaceTracer(ActionCall& call) {
  if (const Actor* tracer = call.world.actor(call.self.tracer_id))
    call.self.angle = angle_between(call.self, *tracer);
}
void action_ClearTarget(ActionCall& call) {
  call.self.target_id = call.self.last_heard_id = call.self.last_enemy_id = 0;
}
void action_ClearLastHeard(ActionCall& call) { call.self.last_heard_id = 0; }

void action_AlertMonsters(ActionCall& call) {
  constexpr int kTargetEmits = 1, kAnyTarget = 2, kEmitFromTarget = 4;
  const int flags = call.integer(1, 0);
  Actor* target = target_of(call.world, call.self);
  Actor* heard = nullptr;
  Actor* emitter = &call.self;
  if (call.self.player_index >= 0 || (flags & kTargetEmits) != 0) {
    heard = &call.self;
  } else if (target != nullptr && (target->player_index >= 0 || (flags & kAnyTarget) != 0)) {
    heard = target;
  }
  if ((flags & kEmitFromTarget) != 0 && target != nullptr) emitter = target;
  if (heard != nullptr) alert_monsters(call.world, *heard, *emitter, call.fixed(0, 0));
}

// ---------------------------------------------------------------- dying

void action_NoBlocking(ActionCall& call) {
  set_flag(call, ActorFlag::kSolid, false);
  if (call.self.player_index >= 0) return;
  for (const DropItem& item : call.world.type_of(call.self).drop_items)
    if (item.type != kNoType) drop_item(call.world, call.self, item.type, item.amount, item.chance);
}
void action_Fall(ActionCall& call) { action_NoBlocking(call); }

void action_Die(ActionCall& call) { kill(call.world, call.self, nullptr); }

void action_Burst(ActionCall& call) { remove_self(call); }

void action_Respawn(ActionCall& call) {
  World& world = call.world;
  Actor& self = call.self;
  if (self.player_index >= 0) return;
  constexpr int kFog = 1, kKeepTarget = 2;
  const int flags = call.integer(0, kFog);
  const ActorType& type = world.type_of(self);
  const Actor before = self;
  const auto revive = [&] {
    self.flags = type.flags;
    self.set(ActorFlag::kFriendly, before.has(ActorFlag::kFriendly));
    self.radius = type.radius, self.height = type.height;
    self.health = type.health;
    self.velocity_x = self.velocity_y = self.velocity_z = 0;
  };
  revive();
  set_position(world, self.id, self.spawn_x, self.spawn_y, self.spawn_z);
  if (!fits_here(world, self)) {  // somebody stands there: not yet
    self.flags = before.flags, self.health = before.health;
    self.radius = before.radius, self.height = before.height;
    set_position(world, self.id, before.x, before.y, before.z);
    relink(world, self);
    return;
  }
  std::erase(world.state().corpse_ids, self.id);
  if ((flags & kKeepTarget) == 0) self.target_id = self.last_enemy_id = 0;
  self.angle = self.spawn_angle;
  if (self.has(ActorFlag::kCountKill)) ++world.state().monster_count;
  relink(world, self);
  if ((flags & kFog) != 0 && world.catalog().known().teleport_fog != kNoType)
    world.spawn_unchecked(world.catalog().replacement(world.catalog().known().teleport_fog), self.x, self.y,
                          self.z);
  call.go_to(type.state(StateLabel::kSpawn));
}

void action_FreezeDeath(ActionCall& call) {
  constexpr int kThawTics = 75;
  Actor& self = call.self;
  self.tics = kThawTics + call.world.random_byte() + call.world.random_byte();
  for (const ActorFlag flag :
       {ActorFlag::kSolid, ActorFlag::kShootable, ActorFlag::kNoBlood, ActorFlag::kIceCorpse})
    self.set(flag);
  self.height = call.world.type_of(self).height;
  relink(call.world, self);
}
void action_GenericFreezeDeath(ActionCall& call) { action_FreezeDeath(call); }
void action_FreezeDeathChunks(ActionCall& call) { remove_self(call); }

// ---------------------------------------------------------------- generic attacks

void action_MeleeAttack(ActionCall& call) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr || !check_melee_range(call.world, call.self)) return;
  const int32_t damage = roll(call.world, 8, call.world.type_of(call.self).melee_damage);
  damage_actor(call.world, *target, &call.self, &call.self, damage);
}

void action_MissileAttack(ActionCall& call) {
  const uint32_t type = call.world.type_of(call.self).missile_type;
  Actor* target = face_and_get_target(call);
  if (target != nullptr && type != kNoType) shoot(call, *target, call.world.catalog().replacement(type));
}

void action_ComboAttack(ActionCall& call) {
  if (check_melee_range(call.world, call.self)) {
    action_MeleeAttack(call);
  } else {
    action_MissileAttack(call);
  }
}

void action_BulletAttack(ActionCall& call) {
  if (face_and_get_target(call) == nullptr) return;
  const int32_t count = std::clamp(roll_damage(call.world, call.self.damage), 0, 100);
  fire_bullets(call.world, call.self, count);
}

void action_CustomMissile(ActionCall& call) {
  constexpr int kAimModes = 3, kAimOffset = 1, kAimDirection = 2, kTrackOwner = 4, kCheckDead = 8,
                kAbsolutePitch = 16, kOffsetPitch = 32, kAbsoluteAngle = 128;
  World& world = call.world;
  Actor& self = call.self;
  const int flags = call.integer(4, 0);
  const int aim_mode = flags & kAimModes;
  uint32_t type = call.type(0);
  Actor* target = pointed(call, 6, target_of(world, self));
  if (target == nullptr && aim_mode != kAimDirection) return;
  if ((flags & kCheckDead) != 0 && target != nullptr && target->health <= 0) {
    const uint32_t see = world.type_of(self).state(StateLabel::kSee);
    if (see != kNoState && (self.health > 0 || !self.has(ActorFlag::kIsMonster))) call.go_to(see);
    return;
  }
  if (type == kNoType) return;
  type = world.catalog().replacement(type);
  const Fixed height = call.fixed(1, to_fixed(32)), sideways = call.fixed(2, 0);
  const Angle turn = angle_of_degrees(call.fixed(3, 0));
  const ActorType& kind = world.catalog()[type];
  const bool fast = is_fast(world, self) && kind.fast_speed >= 0;
  const Fixed speed = fast ? kind.fast_speed : kind.speed;

  Launch way;
  const Place muzzle = beside(self, self.angle, 0, sideways);
  way.x = muzzle.x, way.y = muzzle.y, way.z = clamped_fixed(int64_t{self.z} + height);
  bool uses_pitch = (flags & (kAbsolutePitch | kOffsetPitch)) != 0;
  if (aim_mode == kAimDirection || target == nullptr) {
    way.angle = self.angle;
    way.flat_speed = speed;
    uses_pitch = true;
  } else {
    const bool from_muzzle = aim_mode == kAimOffset;
    const Fixed from_x = from_muzzle ? way.x : self.x, from_y = from_muzzle ? way.y : self.y;
    way.angle = angle_to(from_x, from_y, target->x, target->y);
    const Fixed feet_z = from_muzzle ? clamped_fixed(int64_t{way.z} - to_fixed(32)) : self.z;
    aim_at(*target, from_x, from_y, way.z, feet_z, speed, way);
    if (target->has(ActorFlag::kShadow)) way.angle += static_cast<Angle>(world.random_triangle()) << 20;
  }
  if (uses_pitch) {
    Angle pitch = angle_of_degrees(call.fixed(5, 0));  // positive up
    if ((flags & kOffsetPitch) != 0) pitch += angle_to(0, 0, way.flat_speed, way.velocity_z);
    way.flat_speed = fixed_mul(speed, fine_cosine(pitch));
    way.velocity_z = fixed_mul(speed, fine_sine(pitch));
  }
  way.angle = (flags & kAbsoluteAngle) != 0 ? turn : way.angle + turn;
  launch(world, self, type, way, (flags & kTrackOwner) != 0);
}
void action_SpawnProjectile(ActionCall& call) { action_CustomMissile(call); }

void action_CustomBulletAttack(ActionCall& call) {
  constexpr int kAimFacing = 1, kNoRandom = 2, kExplicitAngle = 4;
  World& world = call.world;
  Actor& self = call.self;
  const Angle spread_xy = angle_of_degrees(std::clamp(call.fixed(0, 0), 0, to_fixed(180)));
  const int64_t spread_z = angle_of_degrees(std::clamp(call.fixed(1, 0), 0, to_fixed(89)));
  const int32_t count = std::clamp(call.integer(2, 1), 0, 1000);
  uint32_t puff = call.type(4, world.catalog().known().bullet_puff);
  const Fixed range = call.fixed(5, 0) > 0 ? call.fixed(5, 0) : kMissileRange;
  const int flags = call.integer(6, 0);
  if ((flags & kAimFacing) == 0 && face_and_get_target(call) == nullptr) return;
  const Angle ahead = self.angle;
  const int32_t aimed = aim_line(world, self, ahead, range).pitch;
  for (int32_t i = 0; i < count && !self.removed; ++i) {
    Angle angle = ahead;
    int64_t pitch = aimed;
    if ((flags & kExplicitAngle) != 0) {
      angle += spread_xy;
      pitch -= spread_z;
    } else {
      angle += static_cast<Angle>(int64_t{world.random_triangle()} * static_cast<int64_t>(spread_xy) / 255);
      pitch -= int64_t{world.random_triangle()} * spread_z / 255;
    }
    int64_t damage = call.integer(3, 0);
    if ((flags & kNoRandom) == 0) damage *= world.random_byte() % 3 + 1;
    line_attack(world, self, angle, range, clamped_fixed(pitch), clamped_fixed(damage), DamageType::kNormal,
                puff);
  }
}

void action_CustomMeleeAttack(ActionCall& call) {
  Actor* target = face_and_get_target(call);
  if (target == nullptr || !check_melee_range(call.world, call.self)) return;
  damage_actor(call.world, *target, &call.self, &call.self, call.integer(0, 0), damage_type_named(call, 3));
}

void action_CustomComboAttack(ActionCall& call) {
  // Missile, its height, damage of the blow, sound, damage type.
  Actor* target = face_and_get_target(call);
  if (target == nullptr) return;
  if (check_melee_range(call.world, call.self)) {
    damage_actor(call.world, *target, &call.self, &call.self, call.integer(2, 0), damage_type_named(call, 4));
    return;
  }
  const uint32_t type = call.type(0);
  if (type == kNoType) return;
  spawn_missile_z(call.world, call.self, clamped_fixed(int64_t{call.self.z} + call.fixed(1, to_fixed(32))),
                  *target, call.world.catalog().replacement(type));
}

void action_MonsterRail(ActionCall& call) {
  if (face_and_get_target(call) == nullptr) return;
  const int32_t damage = roll_damage(call.world, call.self.damage);
  rail_attack(call.world, call.self, damage, 0, call.world.catalog().known().bullet_puff);
}

void action_CustomRailgun(ActionCall& call) {
  if (face_and_get_target(call) == nullptr) return;
  rail_attack(call.world, call.self, call.integer(0, 0), 0,
              call.type(7, call.world.catalog().known().bullet_puff));
}

void action_Explode(ActionCall& call) {
  constexpr int kHurtSource = 1;
  const int32_t damage = call.integer(0, -1) >= 0 ? call.integer(0, -1) : 128;
  const int32_t distance = call.integer(1, -1) > 0 ? call.integer(1, -1) : damage;
  Actor* source = target_of(call.world, call.self);
  radius_attack(call.world, call.self, source, damage, to_fixed(std::clamp(distance, 0, 32000)),
                call.self.damage_type, (call.integer(2, kHurtSource) & kHurtSource) != 0,
                to_fixed(std::clamp(call.integer(4, 0), 0, 32000)));
  if (call.boolean(3) && source != nullptr && source->player_index >= 0)
    alert_monsters(call.world, *source, call.self);
}

void action_RadiusThrust(ActionCall& call) {
  constexpr int kAffectSource = 1;
  const int32_t force = call.integer(0, 128) != 0 ? call.integer(0, 128) : 128;
  const int32_t distance = call.integer(1, -1) > 0
                               ? call.integer(1, -1)
                               : static_cast<int32_t>(std::min<int64_t>(std::abs(int64_t{force}), 32000));
  radius_thrust(call.world, call.self, force, to_fixed(std::clamp(distance, 0, 32000)),
                (call.integer(2, kAffectSource) & kAffectSource) != 0,
                to_fixed(std::clamp(call.integer(3, 0), 0, 32000)));
}

void action_Detonate(ActionCall& call) {
  const int32_t damage = roll_damage(call.world, call.self.damage);
  radius_attack(call.world, call.self, target_of(call.world, call.self), damage,
                to_fixed(std::clamp(damage, 0, 32000)), call.self.damage_type);
}

void action_SeekerMissile(ActionCall& call) {
  // Threshold: turns of less are made at once. Most: no more than this per call. Both in degrees.
  World& world = call.world;
  Actor& self = call.self;
  const Angle at_once = angle_of_degrees(std::clamp(call.fixed(0, 0), 0, to_fixed(90)));
  const Angle most = angle_of_degrees(std::clamp(call.fixed(1, 0), 0, to_fixed(90)));
  Actor* target = world.actor(self.tracer_id);
  if (target == nullptr || !target->has(ActorFlag::kShootable) || target->health <= 0) {
    self.tracer_id = 0;
    return;
  }
  const auto difference = static_cast<int32_t>(angle_between(self, *target) - self.angle);
  Angle turn = difference < 0 ? Angle{0} - static_cast<Angle>(difference) : static_cast<Angle>(difference);
  if (turn > at_once) turn = std::min(turn / 2, most);
  redirect(self, difference < 0 ? self.angle - turn : self.angle + turn, self.speed);
  if (int64_t{self.z} + self.height < target->z || int64_t{target->z} + target->height < self.z) {
    const int64_t tics =
        std::max<int64_t>(distance_between(self, *target) / std::max(self.speed, Fixed{1}), 1);
    self.velocity_z = clamped_fixed((int64_t{target->z} + target->height / 2 - self.z) / tics);
  }
}

// ---------------------------------------------------------------- spawning

void action_SpawnItem(ActionCall& call) {
  // Type, distance ahead, height, uses ammunition (of players' weapons), copies its translation.
  const uint32_t asked = call.type(0);
  if (asked == kNoType) return;
  World& world = call.world;
  const uint32_t type = world.catalog().replacement(asked);
  // A quirk of ViZDoom's: without a distance it is a 65536th of both radii, all but none.
  Fixed ahead = call.fixed(1, 0);
  if (ahead == 0)
    ahead = static_cast<Fixed>((int64_t{call.self.radius} + world.catalog()[type].radius) >> kFracBits);
  const Place place = beside(call.self, call.self.angle, ahead, 0);
  Actor& item = world.spawn_unchecked(
      type, place.x, place.y, clamped_fixed(int64_t{call.self.z} + call.fixed(2, 0)), call.self.angle);
  if (item.has(ActorFlag::kIsMonster)) {
    if (!fits_here(world, item)) {
      world.remove(item.id);
      return;
    }
    item.set(ActorFlag::kFriendly, call.self.player_index >= 0 || call.self.has(ActorFlag::kFriendly));
  } else {
    item.target_id = first_owner(world, call.self)->id;
  }
}

void action_SpawnItemEx(ActionCall& call) {
  constexpr int kAbsolutePosition = 2, kAbsoluteAngle = 4, kAbsoluteVelocity = 8, kSetMaster = 16,
                kNoCheckPosition = 32, kTelefrag = 64, kTransferAmbush = 256, kTransferPitch = 512,
                kTransferPointers = 1024, kClearCallerTid = 4096, kMultiplySpeed = 8192,
                kTransferScale = 16384, kTransferSpecial = 32768, kClearCallerSpecial = 65536,
                kTransferAlpha = 1 << 18, kTransferStyle = 1 << 19, kSetTarget = 1 << 20,
                kSetTracer = 1 << 21, kNoPointers = 1 << 22, kOriginator = 1 << 23;
  World& world = call.world;
  Actor& self = call.self;
  const uint32_t asked = call.type(0);
  const int32_t fail_chance = call.integer(9, 0);
  if (asked == kNoType || (fail_chance > 0 && world.random_byte() < fail_chance)) return;
  const uint32_t type = world.catalog().replacement(asked);
  const int flags = call.integer(8, 0);
  const Fixed forward = call.fixed(1, 0), right = call.fixed(2, 0), up = call.fixed(3, 0);
  Angle angle = angle_of_degrees(call.fixed(7, 0));
  if ((flags & kAbsoluteAngle) == 0) angle += self.angle;

  Place place{clamped_fixed(int64_t{self.x} + forward), clamped_fixed(int64_t{self.y} + right)};
  if ((flags & kAbsolutePosition) == 0) place = beside(self, angle, forward, right);
  Fixed velocity_x = call.fixed(4, 0), velocity_y = call.fixed(5, 0);
  if ((flags & kAbsoluteVelocity) == 0) {
    const int64_t ahead = velocity_x, aside = velocity_y, cosine = fine_cosine(angle),
                  sine = fine_sine(angle);
    velocity_x = clamped_fixed((ahead * cosine + aside * sine) >> kFracBits);
    velocity_y = clamped_fixed((ahead * sine - aside * cosine) >> kFracBits);
  }
  Fixed velocity_z = call.fixed(6, 0);

  Actor& made = world.spawn_unchecked(type, place.x, place.y, clamped_fixed(int64_t{self.z} + up), angle);
  if ((flags & kMultiplySpeed) != 0) {
    velocity_x = fixed_mul(velocity_x, made.speed), velocity_y = fixed_mul(velocity_y, made.speed);
    velocity_z = fixed_mul(velocity_z, made.speed);
  }
  made.velocity_x = velocity_x, made.velocity_y = velocity_y, made.velocity_z = velocity_z;

  Actor* origin = (flags & kOriginator) != 0 ? &self : first_owner(world, self);
  if ((flags & kTelefrag) != 0) {
    teleport_move(world, made, made.x, made.y, made.z, made.angle, false, true, true);
    if (made.removed) return;
  }
  if (made.has(ActorFlag::kIsMonster)) {
    if ((flags & (kNoCheckPosition | kTelefrag)) == 0 && !fits_here(world, made)) {
      world.remove(made.id);  // blocked
      return;
    }
    if ((flags & kNoPointers) == 0) {
      made.set(ActorFlag::kFriendly, origin->player_index >= 0 || origin->has(ActorFlag::kFriendly));
      made.hate_thing_id = origin->hate_thing_id;
    }
    if (made.has(ActorFlag::kCountKill)) ++world.state().monster_count;
  } else if ((flags & kTransferPointers) == 0) {
    made.target_id = origin->id;
  }
  if ((flags & kTransferPointers) != 0)
    made.target_id = self.target_id, made.master_id = self.master_id, made.tracer_id = self.tracer_id;
  if ((flags & kTransferAmbush) != 0) made.set(ActorFlag::kAmbush, self.has(ActorFlag::kAmbush));
  if ((flags & kTransferPitch) != 0) made.pitch = self.pitch;
  if ((flags & kTransferScale) != 0) made.scale_x = self.scale_x, made.scale_y = self.scale_y;
  if ((flags & 1) != 0) made.translation = self.translation;
  if ((flags & kTransferAlpha) != 0) made.alpha = self.alpha;
  if ((flags & kTransferStyle) != 0) made.render_style = self.render_style;
  if ((flags & kTransferSpecial) != 0) made.special = self.special, made.args = self.args;
  if ((flags & kSetMaster) != 0) made.master_id = origin->id;
  if ((flags & kSetTarget) != 0) made.target_id = self.id;
  if ((flags & kSetTracer) != 0) made.tracer_id = self.id;
  if ((flags & kClearCallerTid) != 0) world.set_thing_id(self, 0);
  if ((flags & kClearCallerSpecial) != 0) self.special = 0, self.args = {};
  if (call.integer(10, 0) != 0) world.set_thing_id(made, call.integer(10, 0));
}

void action_DropItem(ActionCall& call) {
  if (call.type(0) == kNoType) return;
  drop_item(call.world, call.self, call.type(0), call.integer(1, -1), call.integer(2, 256));
}

// ---------------------------------------------------------------- jumps

void action_Jump(ActionCall& call) {
  const auto choices = static_cast<int32_t>(call.arg_count()) - 1;
  if (choices <= 0 || call.world.random_byte() >= call.integer(0, 256)) return;
  const int32_t chosen = choices == 1 ? 0 : call.world.random_byte() % choices;
  jump(call, static_cast<std::size_t>(chosen) + 1);
}

void action_JumpIfHealthLower(ActionCall& call) {
  const Actor* measured = pointed(call, 2, &call.self);
  if (measured != nullptr && measured->health < call.integer(0, 0)) jump(call, 1);
}

void action_JumpIfCloser(ActionCall& call) {
  const Actor* target = call.player != nullptr
                            ? aim_line(call.world, call.self, call.self.angle, kMissileRange).target
                            : target_of(call.world, call.self);
  if (is_within(call.self, target, call.fixed(0, 0), call.boolean(2))) jump(call, 1);
}
void action_JumpIfMasterCloser(ActionCall& call) {
  if (is_within(call.self, call.world.actor(call.self.master_id), call.fixed(0, 0), call.boolean(2)))
    jump(call, 1);
}
void action_JumpIfTracerCloser(ActionCall& call) {
  if (is_within(call.self, call.world.actor(call.self.tracer_id), call.fixed(0, 0), call.boolean(2)))
    jump(call, 1);
}

void action_JumpIfTargetInLOS(ActionCall& call) {
  constexpr int kNoSight = 2, kCheckMaster = 32, kCheckTracer = 64;
  const int flags = call.integer(2, 0);
  Actor* target = call.player != nullptr
                      ? aim_line(call.world, call.self, call.self.angle, kMissileRange).target
                  : (flags & kCheckMaster) != 0 ? call.world.actor(call.self.master_id)
                  : (flags & kCheckTracer) != 0 ? call.world.actor(call.self.tracer_id)
                                                : target_of(call.world, call.self);
  if (target == nullptr || target->health <= 0) return;
  const Fixed farthest = call.fixed(3, 0), nearest = call.fixed(4, 0);
  const Fixed distance = distance_between(call.self, *target);
  if (farthest > 0 && distance > farthest) return;
  if (nearest <= 0 || distance >= nearest) {
    const Fixed view = call.fixed(1, 0);
    if (view > 0 && view < to_fixed(360)) {
      const Angle half = angle_of_degrees(view) / 2;
      const Angle angle = angle_between(call.self, *target) - call.self.angle;
      if (angle > half && angle < Angle{0} - half) return;
    }
    if ((flags & kNoSight) == 0 && !can_see(call.world, call.self, *target)) return;
  }
  jump(call, 0);
}

void action_JumpIfInventory(ActionCall& call) {
  if (owns(call.world, pointed(call, 3, &call.self), call.type(0), call.integer(1, 1))) jump(call, 2);
}
void action_JumpIfInTargetInventory(ActionCall& call) {
  if (owns(call.world, target_of(call.world, call.self), call.type(0), call.integer(1, 1))) jump(call, 2);
}
void action_JumpIf(ActionCall& call) {
  if (call.fixed(0, 0) != 0) jump(call, 1);
}

void action_CheckSight(ActionCall& call) {
  for (int player = 0; player < call.world.player_count(); ++player) {
    const Actor* body = call.world.body_of(player);
    if (body != nullptr && can_see(call.world, *body, call.self)) return;
  }
  jump(call, 0);
}
void action_CheckFloor(ActionCall& call) {
  if (call.self.z <= call.self.floor_z) jump(call, 0);
}
void action_CheckCeiling(ActionCall& call) {
  if (int64_t{call.self.z} + call.self.height >= call.self.ceiling_z) jump(call, 0);
}

void action_MonsterRefire(ActionCall& call) {
  face_target(call.world, call.self);
  if (call.world.random_byte() < call.integer(0, 0)) return;
  const Actor* target = target_of(call.world, call.self);
  if (target == nullptr || target->health <= 0 || is_friend(call.self, *target) ||
      !can_see(call.world, call.self, *target))
    jump(call, 1);
}

// ---------------------------------------------------------------- items, specials, scripts

void action_GiveInventory(ActionCall& call) {
  call.succeeded =
      give(call.world, pointed(call, 2, &call.self), call.type(0), std::max(call.integer(1, 1), 1));
}
void action_TakeInventory(ActionCall& call) {
  call.succeeded =
      take(call.world, pointed(call, 2, &call.self), call.type(0), std::max(call.integer(1, 0), 0));
}
void action_GiveToTarget(ActionCall& call) {
  call.succeeded =
      give(call.world, target_of(call.world, call.self), call.type(0), std::max(call.integer(1, 1), 1));
}
/// Item, distance, flags, amount, class, species, least distance: gives to all that the flags name and whose middle is so near.
void action_RadiusGive(ActionCall& call) {
  enum Flag : int32_t {
    kSelf = 1,
    kPlayers = 2,
    kMonsters = 4,
    kObjects = 8,
    kCorpses = 32,
    kNoTarget = 64,
    kNoTracer = 128,
    kNoMaster = 256,
    kCube = 512,
    kNoSight = 1024,
    kMissiles = 2048,
    kItems = 8192,
    kKilled = 16384,
    kExceptClass = 32768,
    kExceptSpecies = 65536,
    kEither = 131072
  };
  World& world = call.world;
  Actor& self = call.self;
  const Fixed distance = call.fixed(1, 0), least = call.fixed(6, 0);
  const int32_t flags = call.integer(2, 0);
  const auto has = [flags](Flag flag) { return (flags & flag) != 0; };
  const uint32_t item = call.type(0), filter = call.type(4);
  const std::string_view species = text_of(call, 5);
  if (distance <= 0 || item == kNoType || call.integer(3, 1) < 0) return;
  const auto is_kind = [&](const Actor& actor) {
    const bool monster = actor.has(ActorFlag::kIsMonster);
    if (actor.player_index >= 0) return actor.health > 0 ? has(kPlayers) : has(kCorpses);
    if (actor.is_corpse()) return has(kCorpses) || (monster && has(kKilled));
    if (monster) return actor.health > 0 ? has(kMonsters) : has(kKilled);
    if (actor.has(ActorFlag::kMissile)) return has(kMissiles);
    if (world.type_of(actor).item_class != ItemClass::kNone) return has(kItems);
    return (actor.has(ActorFlag::kShootable) || actor.has(ActorFlag::kTouchy)) && has(kObjects);
  };
  const auto passes = [&](const Actor& actor) {
    const bool by_class = filter == kNoType || (actor.type == filter) != has(kExceptClass);
    const uint32_t own = world.type_of(actor).species;
    const bool by_species =
        species.empty() ||
        same_ignoring_case(species, world.catalog()[own != kNoType ? own : actor.type].name) !=
            has(kExceptSpecies);
    return has(kEither) && filter != kNoType && !species.empty() ? by_class || by_species
                                                                 : by_class && by_species;
  };
  const auto is_near = [&](const Actor& actor) {
    const int64_t x = std::abs(int64_t{actor.x} - self.x), y = std::abs(int64_t{actor.y} - self.y),
                  z = std::abs(int64_t{actor.z} + actor.height / 2 - self.z - self.height / 2);
    const auto square = [](int64_t length) { return static_cast<__int128>(length) * length; };
    const __int128 away = has(kCube) ? square(std::max({x, y, z})) : square(x) + square(y) + square(z);
    return away <= square(distance) && (least <= 0 || away >= square(least));
  };
  int32_t count = 0;
  const std::size_t slots = world.actors().size();  // what an item's states spawn gets nothing
  for (std::size_t slot = 0; slot < slots; ++slot) {
    Actor& actor = world.state().actors[slot];
    if (actor.removed) continue;
    if (actor.id == self.id) {
      if (!has(kSelf)) continue;
    } else if (!is_kind(actor) || !passes(actor) || !is_near(actor) ||
               (has(kNoTarget) && actor.id == self.target_id) ||
               (has(kNoTracer) && actor.id == self.tracer_id) ||
               (has(kNoMaster) && actor.id == self.master_id) ||
               (!has(kNoSight) && !can_see(world, actor, self))) {
      continue;
    }
    count += give(world, &actor, item, std::max(call.integer(3, 1), 1));
  }
  call.succeeded = count > 0;
}
void action_TakeFromTarget(ActionCall& call) {
  call.succeeded =
      take(call.world, target_of(call.world, call.self), call.type(0), std::max(call.integer(1, 0), 0));
}

void action_SetSpecial(ActionCall& call) {
  call.self.special = call.integer(0, 0);
  for (std::size_t i = 0; i < call.self.args.size(); ++i) call.self.args[i] = call.integer(i + 1, 0);
}
void action_SetArg(ActionCall& call) {
  const int32_t index = call.integer(0, 0);
  if (index >= 0 && index < static_cast<int32_t>(call.self.args.size()))
    call.self.args[static_cast<std::size_t>(index)] = call.integer(1, 0);
}

void action_ChangeFlag(ActionCall& call) {
  if (const std::optional<ActorFlag> flag = find_flag(text_of(call, 0)))
    set_flag(call, *flag, call.boolean(1));
}

void action_CallSpecial(ActionCall& call) {
  // A number, then up to five arguments.
  SpecialCall special{.number = call.integer(0, 0), .activator = &call.self};
  for (std::size_t i = 0; i < special.args.size(); ++i) special.args[i] = call.integer(i + 1, 0);
  call.succeeded = call.world.events().run_special(call.world, special) != 0;
}

void action_ACS_Execute(ActionCall& call) { call_special(call, Special::kACS_Execute); }
void action_ACS_ExecuteAlways(ActionCall& call) { call_special(call, Special::kACS_ExecuteAlways); }
void action_ACS_ExecuteWithResult(ActionCall& call) { call_special(call, Special::kACS_ExecuteWithResult); }
void action_ACS_Terminate(ActionCall& call) { call_special(call, Special::kACS_Terminate); }
void action_ACS_NamedExecuteAlways(ActionCall& call) {
  std::array<int32_t, 4> args{};
  for (std::size_t i = 0; i < 3; ++i) args[i] = call.integer(i + 2, 0);
  call.world.events().start_named_script(call.world, text_of(call, 0), call.self.id, args);
}
void action_Thing_Remove(ActionCall& call) {
  if (call.integer(0, 0) == 0) {
    remove_self(call);
  } else {
    call_special(call, Special::kThing_Remove);
  }
}

// ---------------------------------------------------------------- looks

void action_FadeIn(ActionCall& call) {
  const Fixed step = call.fixed(0, kFracUnit / 10);
  set_alpha(call.self, clamped_fixed(int64_t{alpha_of(call.self)} + (step != 0 ? step : kFracUnit / 10)));
}
void action_FadeOut(ActionCall& call) {
  const Fixed step = call.fixed(0, kFracUnit / 10);
  const Fixed left = clamped_fixed(int64_t{alpha_of(call.self)} - (step != 0 ? step : kFracUnit / 10));
  set_alpha(call.self, left);
  if (left <= 0 && call.boolean(1, true)) remove_self(call);
}
void action_FadeTo(ActionCall& call) {
  const Fixed target = call.fixed(0, 0), step = std::max(call.fixed(1, kFracUnit / 10), 0);
  const Fixed present = alpha_of(call.self);
  const Fixed next = present > target ? std::max<Fixed>(clamped_fixed(int64_t{present} - step), target)
                                      : std::min<Fixed>(clamped_fixed(int64_t{present} + step), target);
  set_alpha(call.self, next);
  if (next == target && call.boolean(2)) remove_self(call);
}
void action_SetTranslucent(ActionCall& call) {
  call.self.render_style = call.integer(1, 0) == 0   ? RenderStyle::kTranslucent
                           : call.integer(1, 0) == 1 ? RenderStyle::kAdd
                                                     : RenderStyle::kFuzzy;
  call.self.alpha = static_cast<float>(std::clamp(call.fixed(0, kFracUnit), 0, kFracUnit)) / 65536.0f;
}
void action_SetScale(ActionCall& call) {
  const Fixed x = call.fixed(0, kFracUnit), y = call.fixed(1, 0);
  call.self.scale_x = to_float(x);
  call.self.scale_y = to_float(y != 0 ? y : x);
}

// ---------------------------------------------------------------- motion

void action_ScaleVelocity(ActionCall& call) {
  const int64_t factor = call.fixed(0, kFracUnit);
  Actor& self = call.self;
  for (Fixed* part : {&self.velocity_x, &self.velocity_y, &self.velocity_z})
    *part = clamped_fixed((*part * factor) >> kFracBits);
  settle(call);
}
void action_ChangeVelocity(ActionCall& call) {
  constexpr int kRelative = 1, kReplace = 2;
  Actor& self = call.self;
  const int flags = call.integer(3, 0);
  int64_t x = call.fixed(0, 0), y = call.fixed(1, 0);
  const int64_t z = call.fixed(2, 0);
  if ((flags & kRelative) != 0) {
    const int64_t cosine = fine_cosine(self.angle), sine = fine_sine(self.angle), ahead = x, aside = y;
    x = (ahead * cosine - aside * sine) >> kFracBits;
    y = (ahead * sine + aside * cosine) >> kFracBits;
  }
  const bool replaces = (flags & kReplace) != 0;
  self.velocity_x = clamped_fixed(x + (replaces ? 0 : self.velocity_x));
  self.velocity_y = clamped_fixed(y + (replaces ? 0 : self.velocity_y));
  self.velocity_z = clamped_fixed(z + (replaces ? 0 : self.velocity_z));
  settle(call);
}
void action_SetAngle(ActionCall& call) { call.self.angle = angle_of_degrees(call.fixed(0, 0)); }
void action_SetPitch(ActionCall& call) { call.self.pitch = angle_of_degrees(call.fixed(0, 0)); }
void action_Turn(ActionCall& call) { call.self.angle += angle_of_degrees(call.fixed(0, 0)); }
void action_Gravity(ActionCall& call) {
  call.self.set(ActorFlag::kNoGravity, false);
  call.self.gravity = kFracUnit;
}
void action_NoGravity(ActionCall& call) { call.self.set(ActorFlag::kNoGravity); }
void action_LowGravity(ActionCall& call) {
  call.self.set(ActorFlag::kNoGravity, false);
  call.self.gravity = kFracUnit / 8;
}
void action_SetGravity(ActionCall& call) {
  call.self.gravity = std::clamp(call.fixed(0, kFracUnit), 0, to_fixed(10));
}
void action_Stop(ActionCall& call) {
  call.self.velocity_x = call.self.velocity_y = call.self.velocity_z = 0;
  settle(call);
}

void action_ThrustThing(ActionCall& call) {
  // Angle in 256ths of a turn, force; at most 30 unless the third argument lifts the limit.
  const Fixed force = to_fixed(std::clamp(call.integer(1, 0), -1000, call.boolean(2) ? 1000 : 30));
  call.self.push(static_cast<Angle>(call.integer(0, 0)) << 24, force);
}
void action_Recoil(ActionCall& call) { call.self.push(call.self.angle + kAngle180, call.fixed(0, 0)); }
void action_SetSpeed(ActionCall& call) {
  if (Actor* actor = pointed(call, 1, &call.self)) actor->speed = call.fixed(0, 0);
}

void action_Warp(ActionCall& call) {
  constexpr int kAbsoluteOffset = 1, kAbsoluteAngle = 2, kNoCheck = 4, kToFloor = 16, kStop = 128,
                kCopyVelocity = 8192;
  World& world = call.world;
  Actor& self = call.self;
  const Actor* base = pointed(call, 0, &self);
  if (base == nullptr) return;
  const int flags = call.integer(5, 0);
  const Angle turn = angle_of_degrees(call.fixed(4, 0));
  const Angle angle = (flags & kAbsoluteAngle) != 0 ? turn : base->angle + turn;
  const Fixed forward = call.fixed(1, 0), right = call.fixed(2, 0), up = call.fixed(3, 0);
  Place place{clamped_fixed(int64_t{base->x} + forward), clamped_fixed(int64_t{base->y} + right)};
  if ((flags & kAbsoluteOffset) == 0) place = beside(*base, angle, forward, right);
  const Fixed z = clamped_fixed(int64_t{(flags & kToFloor) != 0 ? base->floor_z : base->z} + up);
  const Fixed old_x = self.x, old_y = self.y, old_z = self.z;
  set_position(world, self.id, place.x, place.y, z);
  if ((flags & kNoCheck) == 0 && !fits_here(world, self)) {
    set_position(world, self.id, old_x, old_y, old_z);
    return;
  }
  self.angle = angle;
  if ((flags & kStop) != 0) self.velocity_x = self.velocity_y = self.velocity_z = 0;
  if ((flags & kCopyVelocity) != 0)
    self.velocity_x = base->velocity_x, self.velocity_y = base->velocity_y,
    self.velocity_z = base->velocity_z;
  jump(call, 6);
}

// ---------------------------------------------------------------- flags

void action_SetSolid(ActionCall& call) { set_flag(call, ActorFlag::kSolid, true); }
void action_UnsetSolid(ActionCall& call) { set_flag(call, ActorFlag::kSolid, false); }
void action_SetShootable(ActionCall& call) {
  call.self.set(ActorFlag::kNonShootable, false);
  set_flag(call, ActorFlag::kShootable, true);
}
void action_UnSetShootable(ActionCall& call) {
  call.self.set(ActorFlag::kNonShootable);
  set_flag(call, ActorFlag::kShootable, false);
}
void action_SetFloat(ActionCall& call) { call.self.set(ActorFlag::kFloat); }
void action_UnSetFloat(ActionCall& call) { call.self.set(ActorFlag::kFloat, false); }
void action_SetInvulnerable(ActionCall& call) { call.self.set(ActorFlag::kInvulnerable); }
void action_UnSetInvulnerable(ActionCall& call) { call.self.set(ActorFlag::kInvulnerable, false); }
void action_SetReflective(ActionCall& call) { call.self.set(ActorFlag::kReflective); }
void action_UnSetReflective(ActionCall& call) { call.self.set(ActorFlag::kReflective, false); }
void action_UnsetFloorClip(ActionCall& call) { call.self.set(ActorFlag::kFloorClip, false); }
void action_SetDamageType(ActionCall& call) { call.self.damage_type = damage_type_named(call, 0); }

// ---------------------------------------------------------------- counting down

void action_Countdown(ActionCall& call) {
  if (--call.self.reaction_tics > 0) return;
  call.self.set(ActorFlag::kSkullFly, false);
  explode_missile(call.world, call.self, nullptr);
}
void action_CountdownArg(ActionCall& call) {
  const int32_t index = call.integer(0, 0);
  if (index < 0 || index >= static_cast<int32_t>(call.self.args.size())) return;
  int32_t& left = call.self.args[static_cast<std::size_t>(index)];
  if (left > 0) {
    --left;
    return;
  }
  if (call.self.has(ActorFlag::kMissile)) {
    explode_missile(call.world, call.self, nullptr);
  } else if (call.self.has(ActorFlag::kShootable)) {
    kill(call.world, call.self, nullptr);
  } else {
    const uint32_t death =
        call.label(1) != kNoState ? call.label(1) : call.world.type_of(call.self).state(StateLabel::kDeath);
    call.go_to(death);
  }
}

// ---------------------------------------------------------------- masters and children

void action_KillMaster(ActionCall& call) {
  if (Actor* master = call.world.actor(call.self.master_id)) kill(call.world, *master, &call.self);
}
void action_KillChildren(ActionCall& call) {
  for_each_child(call, [&](Actor& child) { kill(call.world, child, &call.self); });
}
void action_DamageMaster(ActionCall& call) {
  hurt(call.world, call.world.actor(call.self.master_id), call.self, call.integer(0, 0),
       damage_type_named(call, 1));
}
void action_DamageChildren(ActionCall& call) {
  const int32_t amount = call.integer(0, 0);
  for_each_child(
      call, [&](Actor& child) { hurt(call.world, &child, call.self, amount, damage_type_named(call, 1)); });
}
void action_DamageSelf(ActionCall& call) {
  hurt(call.world, &call.self, call.self, call.integer(0, 0), damage_type_named(call, 1));
}
void action_DamageTarget(ActionCall& call) {
  hurt(call.world, target_of(call.world, call.self), call.self, call.integer(0, 0),
       damage_type_named(call, 1));
}
void action_RemoveMaster(ActionCall& call) {
  Actor* master = call.world.actor(call.self.master_id);
  if (master != nullptr && master->player_index < 0) call.world.remove(master->id);
}
void action_RemoveChildren(ActionCall& call) {
  const bool all = call.boolean(0);
  for_each_child(call, [&](Actor& child) {
    if (child.player_index < 0 && (all || child.health <= 0)) call.world.remove(child.id);
  });
}

// ---------------------------------------------------------------- only heard or seen

#define COMRAD_EMPTY_ACTION(name) \
  void action_##name(ActionCall&) {}
COMRAD_EMPTY_ACTION(Pain)
COMRAD_EMPTY_ACTION(Scream)
COMRAD_EMPTY_ACTION(XScream)
COMRAD_EMPTY_ACTION(PlayerScream)
COMRAD_EMPTY_ACTION(ActiveSound)
COMRAD_EMPTY_ACTION(SpawnDebris)
COMRAD_EMPTY_ACTION(PlaySound)
COMRAD_EMPTY_ACTION(PlaySoundEx)
COMRAD_EMPTY_ACTION(PlayWeaponSound)
COMRAD_EMPTY_ACTION(StopSound)
COMRAD_EMPTY_ACTION(StopSoundEx)
COMRAD_EMPTY_ACTION(Log)
COMRAD_EMPTY_ACTION(Print)
COMRAD_EMPTY_ACTION(PrintBold)
COMRAD_EMPTY_ACTION(Quake)
COMRAD_EMPTY_ACTION(Weave)
COMRAD_EMPTY_ACTION(Bang4Cloud)
COMRAD_EMPTY_ACTION(SkullPop)
COMRAD_EMPTY_ACTION(QueueCorpse)
COMRAD_EMPTY_ACTION(ResetReloadCounter)
COMRAD_EMPTY_ACTION(SetUserVar)
COMRAD_EMPTY_ACTION(SentinelBob)
#undef COMRAD_EMPTY_ACTION

}  // namespace comrad::doom
