#include "sim_workers/engine/acs/actor_properties.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <string>

#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/acs/strings.h"
#include "sim_workers/engine/play/damage.h"

namespace comrad::doom::acs {
namespace {

// clang-format off
constexpr std::array<std::string_view, kActorPropertyCount> kNames = {
    "Health",      "Speed",        "Damage",    "Alpha",         "RenderStyle", "SeeSound",    "AttackSound",
    "PainSound",   "DeathSound",   "ActiveSound", "Ambush",      "Invulnerable", "JumpZ",      "ChaseGoal",
    "Frightened",  "Gravity",      "Friendly",  "SpawnHealth",   "Dropped",     "NoTarget",    "Species",
    "NameTag",     "Score",        "NoTrigger", "DamageFactor",  "MasterTID",   "TargetTID",   "TracerTID",
    "WaterLevel",  "ScaleX",       "ScaleY",    "Dormant",       "Mass",        "Accuracy",    "Stamina",
    "Height",      "Radius",       "ReactionTime", "MeleeRange", "ViewHeight",  "AttackZOffset", "StencilColor",
    "Friction",    "DamageMultiplier", "MaxStepHeight", "MaxDropOffHeight", "DamageType"};
// clang-format on

// Numbers of STYLE_ constants.
struct StyleNumber {
  int32_t number;
  RenderStyle style;
};
constexpr std::array<StyleNumber, 12> kStyles = {{{0, RenderStyle::kNone},
                                                  {1, RenderStyle::kNormal},
                                                  {2, RenderStyle::kFuzzy},
                                                  {64, RenderStyle::kTranslucent},
                                                  {65, RenderStyle::kAdd},
                                                  {69, RenderStyle::kSubtract},
                                                  {68, RenderStyle::kShadow},
                                                  {5, RenderStyle::kStencil},
                                                  {3, RenderStyle::kTranslucent},
                                                  {4, RenderStyle::kFuzzy},
                                                  {66, RenderStyle::kStencil},
                                                  {67, RenderStyle::kStencil}}};

Fixed from_float(float value) {
  const float scaled = value * static_cast<float>(kFracUnit);
  return scaled >= 2147483520.0f    ? INT32_MAX
         : scaled <= -2147483520.0f ? INT32_MIN
                                    : static_cast<Fixed>(scaled);
}

int32_t thing_id_of(World& world, uint32_t actor_id) {
  const Actor* actor = world.actor(actor_id);
  return actor != nullptr ? actor->thing_id : 0;
}

void set_health(const Caller& caller, Actor& actor, int32_t value) {
  Player* player = caller.world.player_of(actor);
  if (actor.health <= 0 || (player != nullptr && !player->alive)) return;  // the dead stay dead
  actor.health = value;
  if (player != nullptr) player->health = value;
  if (value <= 0) kill_actor(caller.world, actor, nullptr, caller.activator());
}

// Whom the script names by thing id: the activator's own id does for itself as well.
uint32_t id_of_thing(const Caller& caller, int32_t thing_id) {
  const Actor* actor = caller.one_actor(thing_id);
  return actor != nullptr ? actor->id : 0;
}

}  // namespace

std::string_view actor_property_name(int32_t property) {
  return property >= 0 && property < kActorPropertyCount ? kNames[static_cast<std::size_t>(property)]
                                                         : std::string_view();
}

void set_actor_property(const Caller& caller, Actor& actor, int32_t property, int32_t value) {
  World& world = caller.world;
  switch (static_cast<ActorProperty>(property)) {
    case ActorProperty::kHealth:
      return set_health(caller, actor, value);
    case ActorProperty::kSpeed:
      actor.speed = value;
      return;
    case ActorProperty::kDamage:
      actor.damage.factor = value;
      return;
    case ActorProperty::kAlpha:
      actor.alpha = std::clamp(to_float(value), 0.0f, 1.0f);
      return;
    case ActorProperty::kRenderStyle:
      for (const StyleNumber& entry : kStyles)
        if (entry.number == value) actor.render_style = entry.style;
      return;
    case ActorProperty::kSeeSound:
    case ActorProperty::kAttackSound:
    case ActorProperty::kPainSound:
    case ActorProperty::kDeathSound:
    case ActorProperty::kActiveSound:
    case ActorProperty::kNameTag:
    case ActorProperty::kStencilColor:
      return;  // there is no sound, and nobody reads names
    case ActorProperty::kJumpZ:
    case ActorProperty::kViewHeight:
    case ActorProperty::kAttackZOffset: {
      Player* player = world.player_of(actor);
      if (player == nullptr) return;
      const Fixed height = std::clamp(value, 0, to_fixed(1024));
      if (property == static_cast<int32_t>(ActorProperty::kJumpZ)) {
        player->jump_speed = height;
      } else if (property == static_cast<int32_t>(ActorProperty::kAttackZOffset)) {
        player->attack_z_offset = std::clamp(value, -to_fixed(1024), to_fixed(1024));
      } else {
        player->eye_height = player->view_height = height;
        player->view_height_delta = 0;
      }
      return;
    }
    case ActorProperty::kAmbush:
      return actor.set(ActorFlag::kAmbush, value != 0);
    case ActorProperty::kInvulnerable:
      return actor.set(ActorFlag::kInvulnerable, value != 0);
    case ActorProperty::kChaseGoal:
      return actor.set(ActorFlag::kOnlyChaseGoal, value != 0);
    case ActorProperty::kFrightened:
      return actor.set(ActorFlag::kFrightened, value != 0);
    case ActorProperty::kGravity:
      actor.gravity = value;
      return;
    case ActorProperty::kFriendly: {
      const bool counts = actor.has(ActorFlag::kCountKill);
      if (counts && !actor.has(ActorFlag::kFriendly)) --world.state().monster_count;
      actor.set(ActorFlag::kFriendly, value != 0);
      if (counts && value == 0) ++world.state().monster_count;
      return;
    }
    case ActorProperty::kDropped:
      return actor.set(ActorFlag::kDropped, value != 0);
    case ActorProperty::kNoTarget:
      return actor.set(ActorFlag::kNoTarget, value != 0);
    case ActorProperty::kDamageFactor:
      actor.damage_factor = value;
      return;
    case ActorProperty::kMasterTid:
      actor.master_id = id_of_thing(caller, value);
      return;
    case ActorProperty::kTargetTid:
      actor.target_id = id_of_thing(caller, value);
      return;
    case ActorProperty::kTracerTid:
      actor.tracer_id = id_of_thing(caller, value);
      return;
    case ActorProperty::kScore:
      actor.score = value;
      return;
    case ActorProperty::kScaleX:
      actor.scale_x = to_float(value);
      return;
    case ActorProperty::kScaleY:
      actor.scale_y = to_float(value);
      return;
    case ActorProperty::kDormant:
      return actor.set(ActorFlag::kDormant, value != 0);
    case ActorProperty::kMass:
      actor.mass = value;
      return;
    case ActorProperty::kReactionTime:
      actor.reaction_tics = value;
      return;
    case ActorProperty::kDamageType:
      if (const std::optional<DamageType> type = world.catalog().find_damage_type(caller.text(value))) {
        actor.damage_type = *type;
        return;
      }
      break;
    default:
      break;
  }
  const std::string_view name = actor_property_name(property);
  caller.unsupported(
      kWarnProperty + (name.empty() ? kActorPropertyCount : static_cast<std::size_t>(property)),
      name.empty() ? fmt::format("SetActorProperty {}", property) : "SetActorProperty " + std::string(name));
}

int32_t get_actor_property(const Caller& caller, const Actor* actor, int32_t property) {
  if (actor == nullptr) return 0;
  World& world = caller.world;
  const ActorType& type = world.type_of(*actor);
  switch (static_cast<ActorProperty>(property)) {
    case ActorProperty::kHealth:
      return actor->health;
    case ActorProperty::kSpeed:
      return actor->speed;
    case ActorProperty::kDamage:
      return actor->damage.factor;
    case ActorProperty::kAlpha:
      return from_float(actor->alpha);
    case ActorProperty::kRenderStyle: {
      // An item that waits to come back keeps its style.
      const bool waits = actor->state == kNoState && actor->render_style == RenderStyle::kNone;
      const RenderStyle style = waits ? type.render_style : actor->render_style;
      for (const StyleNumber& entry : kStyles)
        if (entry.style == style) return entry.number;
      return 1;
    }
    case ActorProperty::kAmbush:
      return actor->has(ActorFlag::kAmbush);
    case ActorProperty::kInvulnerable:
      return actor->has(ActorFlag::kInvulnerable);
    case ActorProperty::kJumpZ:
      return actor->player_index >= 0 ? world.player(actor->player_index).jump_speed : 0;
    case ActorProperty::kChaseGoal:
      return actor->has(ActorFlag::kOnlyChaseGoal);
    case ActorProperty::kFrightened:
      return actor->has(ActorFlag::kFrightened);
    case ActorProperty::kGravity:
      return actor->gravity;
    case ActorProperty::kFriendly:
      return actor->player_index >= 0 || actor->has(ActorFlag::kFriendly);
    case ActorProperty::kSpawnHealth:
      return actor->player_index >= 0 ? 0 : actor->start_health;
    case ActorProperty::kDropped:
      return actor->has(ActorFlag::kDropped);
    case ActorProperty::kNoTarget:
      return actor->has(ActorFlag::kNoTarget);
    case ActorProperty::kDamageFactor:
      return actor->damage_factor;
    case ActorProperty::kMasterTid:
      return thing_id_of(world, actor->master_id);
    case ActorProperty::kTargetTid:
      return thing_id_of(world, actor->target_id);
    case ActorProperty::kTracerTid:
      return thing_id_of(world, actor->tracer_id);
    case ActorProperty::kScore:
      return actor->score;
    case ActorProperty::kScaleX:
      return from_float(actor->scale_x);
    case ActorProperty::kScaleY:
      return from_float(actor->scale_y);
    case ActorProperty::kDormant:
      return actor->has(ActorFlag::kDormant);
    case ActorProperty::kMass:
      return actor->mass;
    case ActorProperty::kHeight:
      return actor->height;
    case ActorProperty::kRadius:
      return actor->radius;
    case ActorProperty::kReactionTime:
      return actor->reaction_tics;
    case ActorProperty::kMeleeRange:
      return type.melee_range;
    case ActorProperty::kViewHeight:
      return actor->player_index >= 0 ? world.player(actor->player_index).eye_height : 0;
    case ActorProperty::kAttackZOffset:
      return actor->player_index >= 0 ? world.player(actor->player_index).attack_z_offset : 0;
    case ActorProperty::kFriction:
    case ActorProperty::kDamageMultiplier:
      return kFracUnit;
    case ActorProperty::kMaxStepHeight:
      return type.max_step_height;
    case ActorProperty::kMaxDropOffHeight:
      return type.max_dropoff_height;
    default:
      return 0;
  }
}

bool check_actor_property(const Caller& caller, const Actor* actor, int32_t property, int32_t value) {
  if (actor == nullptr) return false;
  const ActorType& type = caller.world.type_of(*actor);
  switch (static_cast<ActorProperty>(property)) {
    case ActorProperty::kNameTag:
      return same_ignoring_case(type.name, caller.text(value));
    case ActorProperty::kSpecies: {
      const uint32_t species = type.species != kNoType ? type.species : actor->type;
      return same_ignoring_case(caller.world.catalog()[species].name, caller.text(value));
    }
    case ActorProperty::kDamageType:
      return caller.world.catalog().find_damage_type(caller.text(value)) == actor->damage_type;
    case ActorProperty::kSeeSound:
    case ActorProperty::kAttackSound:
    case ActorProperty::kPainSound:
    case ActorProperty::kDeathSound:
    case ActorProperty::kActiveSound:
      return false;
    default:
      return get_actor_property(caller, actor, property) == value;
  }
}

}  // namespace comrad::doom::acs
