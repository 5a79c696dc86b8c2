#include "sim_workers/engine/play/spawning.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>
#include <vector>

#include "rollout_buffer/core/check.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/weapons.h"

namespace comrad::doom {
namespace {

void spawn_player(World& world, int index, Fixed x, Fixed y, Angle angle) {
  Player& player = world.state().players[static_cast<std::size_t>(index)];
  Actor& body = *world.actor(player.actor_id);
  body.player_index = index;
  body.angle = angle;
  body.reaction_tics = world.type_of(body).reaction_tics;      // on any skill
  if (world.type_of(body).speed == 0) body.speed = kFracUnit;  // a factor of the keys' pushes
  body.spawn_x = x, body.spawn_y = y, body.spawn_angle = angle;
  player.health = body.health;
  player.alive = true;
  player.state = PlayerState::kAlive;
  // The floor of the whole body, not of its centre alone.
  const PositionCheck check = Movement(world).check_position(world.slot_of(body), x, y, false);
  body.floor_z = check.floor_z, body.ceiling_z = check.ceiling_z;
  body.ground_z = check.ground_z, body.roof_z = check.roof_z;
  body.z = check.floor_z;
  const ActorType& type = world.type_of(body);
  player.eye_height = type.view_height, player.jump_speed = type.jump_speed;
  player.attack_z_offset = type.attack_z_offset;
  player.view_height = player.eye_height;
  player.view_z = clamped_fixed(int64_t{body.z} + player.view_height);
  give_start_items(world, index);
  // A trigger held since before the weapon is up does not fire NOAUTOFIRE ones.
  player.weapon_permissions |= kTriggerHeld;
  raise_weapon(world, index);
}

float scaled(float own, float by) { return std::clamp(own * by, -1000.0f, 1000.0f); }

/// What the map says of a thing besides its place and type.
void apply_thing_fields(World& world, const MapThing& thing, Actor& actor) {
  actor.special = thing.special, actor.args = thing.args;
  if (!thing.arg0_text.empty()) actor.args[0] = world.events().script_number(world, thing.arg0_text);
  const auto is = [&](ThingFlag flag) { return (thing.flags & flag) != 0; };
  if (is(kThingAmbush)) actor.set(ActorFlag::kAmbush);
  if (is(kThingDormant) && actor.has(ActorFlag::kIsMonster)) actor.set(ActorFlag::kDormant);
  if (is(kThingStanding)) actor.set(ActorFlag::kStandStill);
  if (is(kThingFriend)) actor.set(ActorFlag::kFriendly);
  if (is(kThingCountSecret)) actor.set(ActorFlag::kCountSecret);
  if (is(kThingShadow)) actor.render_style = RenderStyle::kTranslucent, actor.alpha = 0.25f;
  if (is(kThingInvisible)) actor.render_style = RenderStyle::kNone;
  if (thing.alpha >= 0) actor.alpha = thing.alpha;
  actor.scale_x = scaled(actor.scale_x, thing.scale_x), actor.scale_y = scaled(actor.scale_y, thing.scale_y);
  actor.pitch = degrees_to_angle(thing.pitch_degrees);
  actor.score = thing.score;
  // A part of a whole counts as none, as in ViZDoom.
  const double factor = std::trunc(double{thing.health}) == thing.health ? thing.health : 0.0;
  const double health = factor < 0 ? -factor : factor * actor.health;
  if (thing.health != 1.0f)
    actor.health = actor.start_health = static_cast<int32_t>(std::clamp(health, 0.0, 1e6));
  actor.gravity = thing.gravity < 0 ? -thing.gravity : fixed_mul(thing.gravity, actor.gravity);
}

}  // namespace

void spawn_players(World& world) {
  const uint32_t type = world.catalog().known().player;
  COMRAD_CHECK(type != kNoType, "the catalog has a player");
  std::vector<const MapThing*> deathmatch_starts;
  if (world.options().start_at_deathmatch_starts || world.options().deathmatch)
    for (const MapThing& thing : world.level().things)
      if (thing.editor_number == kDeathmatchStart) deathmatch_starts.push_back(&thing);
  for (int index = 0; index < world.player_count(); ++index) {
    const MapThing* start = nullptr;
    const bool wants_own = !world.options().deathmatch || deathmatch_starts.empty();
    for (const MapThing& thing : world.level().things)
      if (wants_own && player_of_start(thing.editor_number) == index)
        start = &thing;  // the last of a number counts, as in Doom
    if (start == nullptr && !deathmatch_starts.empty()) {
      // Who plays alone takes the first; of several each draws one of those that nobody has.
      const std::size_t drawn =
          world.player_count() == 1
              ? 0
              : world.state().rng.below(static_cast<uint32_t>(deathmatch_starts.size()));
      start = deathmatch_starts[drawn];
      if (deathmatch_starts.size() > 1)
        deathmatch_starts.erase(deathmatch_starts.begin() + static_cast<std::ptrdiff_t>(drawn));
    }
    const Fixed x = start != nullptr ? start->x : 0, y = start != nullptr ? start->y : 0;
    const Angle angle = start != nullptr ? degrees_to_angle(start->angle_degrees) : 0;
    const std::size_t slot =
        world.append_actor(type, x, y, world.state().sectors[world.sector_at(x, y)].floor_height, angle, 0);
    Player& player = world.state().players[static_cast<std::size_t>(index)];
    player.actor_id = world.state().actors[slot].id;
    spawn_player(world, index, x, y, angle);
  }
}

bool respawn_player(World& world, int index) {
  Player& player = world.state().players[static_cast<std::size_t>(index)];
  Actor* corpse = world.actor(player.actor_id);
  if (corpse == nullptr) return false;
  const Fixed x = corpse->spawn_x, y = corpse->spawn_y;
  const Angle angle = corpse->spawn_angle;
  const uint32_t type = corpse->type;
  const std::size_t slot = world.append_actor(
      type, x, y, world.state().sectors[world.sector_at(x, y)].floor_height, angle, corpse->thing_id);
  Actor& body = world.state().actors[slot];
  if (!Movement(world).check_position(slot, x, y, false).fits) {
    world.remove_slot(slot);
    return false;
  }
  corpse->player_index = -1;
  Player fresh;
  fresh.actor_id = body.id;
  fresh.damage_taken = player.damage_taken, fresh.damage_dealt = player.damage_dealt;
  fresh.hits_taken = player.hits_taken, fresh.hits_dealt = player.hits_dealt;
  fresh.pickup_count = player.pickup_count, fresh.item_count = player.item_count;
  fresh.secret_count = player.secret_count, fresh.frag_count = player.frag_count;
  fresh.death_count = player.death_count;
  fresh.respawn_count = player.respawn_count + 1;
  fresh.buttons = player.buttons;
  fresh.attack_down = fresh.use_down = true;  // a key that is still held does nothing yet
  player = std::move(fresh);
  spawn_player(world, index, x, y, angle);
  if (world.catalog().known().teleport_fog != kNoType) {
    const Fixed ahead_x = x + 20 * fine_cosine(angle), ahead_y = y + 20 * fine_sine(angle);
    world.spawn_unchecked(world.catalog().known().teleport_fog, ahead_x, ahead_y, body.z);
  }
  world.events().player_respawned(world, index, body.id);
  return true;
}

void spawn_map_things(World& world) {
  const uint32_t skill = kThingSkill1 << (std::clamp(world.options().skill, 1, 5) - 1);
  const uint32_t game = world.options().deathmatch ? kThingDeathmatch
                        : world.is_multiplayer()   ? kThingCoop
                                                   : kThingSingle;
  for (const MapThing& thing : world.level().things) {
    if ((thing.flags & skill) == 0 || (thing.flags & game) == 0) continue;
    if (player_of_start(thing.editor_number).has_value() || thing.editor_number == kDeathmatchStart) continue;
    const std::optional<uint32_t> found = world.catalog().find_editor_number(thing.editor_number);
    if (!found.has_value()) continue;  // a kind that this engine does not know
    const uint32_t type_index = world.catalog().replacement(*found);
    const ActorType& type = world.catalog()[type_index];
    if (world.options().no_monsters && type.flags.has(ActorFlag::kIsMonster)) continue;
    if (world.options().deathmatch && type.item_class == ItemClass::kKey) continue;  // players have all
    // Map spots and teleport destinations: hundreds in a map, never seen, never moving. They stay in
    // level().things unless a script may ask for them.
    if (type.state(StateLabel::kSpawn) == kNoState && type.flags.has(ActorFlag::kNoBlockmap) && thing.id == 0)
      continue;
    const Sector& sector = world.state().sectors[world.sector_at(thing.x, thing.y)];
    const Fixed z = clamped_fixed(type.flags.has(ActorFlag::kSpawnCeiling)
                                      ? int64_t{sector.ceiling_height} - type.height - thing.height
                                      : int64_t{sector.floor_height} + thing.height);
    Actor& actor = world.state().actors[world.append_actor(type_index, thing.x, thing.y, z,
                                                           degrees_to_angle(thing.angle_degrees), thing.id)];
    apply_thing_fields(world, thing, actor);
    if (actor.tics > 0 && !actor.has(ActorFlag::kSynchronized))
      actor.tics = 1 + world.random_byte() % actor.tics;
    actor.spawn_x = thing.x, actor.spawn_y = thing.y, actor.spawn_z = actor.z,
    actor.spawn_angle = actor.angle;
    if (actor.has(ActorFlag::kCountKill) && !actor.has(ActorFlag::kFriendly)) ++world.state().monster_count;
    if (actor.has(ActorFlag::kCountSecret)) ++world.state().secret_total;
    if (actor.has(ActorFlag::kDormant)) actor.tics = -1;
    if (actor.health <= 0) kill_actor(world, actor, nullptr, nullptr);  // the map has it dead
  }
}

void discount(World& world, const Actor& actor) {
  WorldState& state = world.state();
  if (actor.has(ActorFlag::kCountKill) && !actor.has(ActorFlag::kFriendly) && actor.health > 0)
    --state.monster_count;
  if (actor.has(ActorFlag::kCountItem)) --state.item_total;
  if (actor.has(ActorFlag::kCountSecret)) --state.secret_total;
}

void respawn_monster(World& world, Actor& corpse) {
  constexpr int32_t kLeastDeadTics = 12 * 35, kLookTics = 32;
  constexpr uint32_t kChance = 5;  // of 256 at each look
  const bool may = corpse.has(ActorFlag::kAlwaysRespawn) || world.options().skill >= 5;
  if (!may || corpse.has(ActorFlag::kNeverRespawn) || !corpse.is_corpse() || corpse.player_index >= 0 ||
      !corpse.has(ActorFlag::kIsMonster) || !world.type_of(corpse).flags.has(ActorFlag::kCountKill))
    return;
  if (++corpse.move_count < kLeastDeadTics || world.tic_count() % kLookTics != 0 ||
      static_cast<uint32_t>(world.random_byte()) >= kChance)
    return;
  if (world.actors().size() >= kActorsMax) return;
  const uint32_t corpse_id = corpse.id, type = corpse.type;
  const Fixed x = corpse.spawn_x, y = corpse.spawn_y, old_x = corpse.x, old_y = corpse.y;
  const Angle angle = corpse.spawn_angle;
  const bool hangs = world.type_of(corpse).flags.has(ActorFlag::kSpawnCeiling),
             waits = corpse.has(ActorFlag::kAmbush), is_friend = corpse.has(ActorFlag::kFriendly);
  Actor& born = world.state().actors[world.append_actor(type, x, y, hangs ? kOnCeiling : kOnFloor, angle, 0)];
  if (!fits_here(world, born)) {
    world.drop_last_actor();
    return;
  }
  born.set(ActorFlag::kAmbush, waits), born.set(ActorFlag::kFriendly, is_friend);
  born.reaction_tics = 18;
  if (!is_friend) ++world.state().monster_count;
  const uint32_t fog = world.catalog().known().teleport_fog;
  if (fog != kNoType)
    for (const auto& [at_x, at_y] : {std::pair(old_x, old_y), std::pair(x, y)})
      world.spawn_unchecked(fog, at_x, at_y, world.state().sectors[world.sector_at(at_x, at_y)].floor_height);
  std::erase(world.state().corpse_ids, corpse_id);
  world.remove(corpse_id);
}

std::optional<uint32_t> spawn_actor(World& world, uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle,
                                    int32_t thing_id, bool force) {
  if (type >= world.catalog().size() || (!force && !world.index().outline.contains(x, y)))
    return std::nullopt;
  if (world.actors().size() >= kActorsMax) return std::nullopt;
  type = world.catalog().replacement(type);
  if (world.options().no_monsters && world.catalog()[type].flags.has(ActorFlag::kIsMonster))
    return std::nullopt;
  Actor& actor = world.state().actors[world.append_actor(type, x, y, z, angle, thing_id)];
  if (!force && !fits_here(world, actor)) {
    world.drop_last_actor();
    return std::nullopt;
  }
  if (actor.has(ActorFlag::kCountKill)) ++world.state().monster_count;
  // An item of a script counts as dropped, and brings all that is in it.
  if (world.type_of(actor).item_class != ItemClass::kNone)
    actor.set(ActorFlag::kDropped), actor.set(ActorFlag::kScriptSpawned);
  return actor.id;
}

}  // namespace comrad::doom
