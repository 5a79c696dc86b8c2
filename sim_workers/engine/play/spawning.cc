#include "sim_workers/engine/play/spawning.h"

#include <algorithm>
#include <cstddef>
#include <string_view>
#include <utility>
#include <vector>

#include "rollout_buffer/core/check.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/weapons.h"

namespace comrad::doom {
namespace {

constexpr int32_t kProtectionTics = 105;  // 3 s of a fresh body that nothing hurts

std::vector<const MapThing*> deathmatch_starts_of(const World& world) {
  std::vector<const MapThing*> starts;
  for (const MapThing& thing : world.level().things)
    if (thing.editor_number == kDeathmatchStart) starts.push_back(&thing);
  return starts;
}

/// Index of the start with the most room to the nearest other living player; the first, where there is none.
std::size_t farthest_start(const World& world, int index, const std::vector<const MapThing*>& starts) {
  const auto room = [&](const MapThing& start) {
    Fixed nearest = INT32_MAX;
    for (int other = 0; other < world.player_count(); ++other)
      if (const Actor* body = world.find_actor(world.player(other).actor_id);
          other != index && body != nullptr && world.player(other).alive)
        nearest = std::min(nearest, approximate_distance(start.x - body->x, start.y - body->y));
    return nearest;
  };
  std::size_t best = 0;
  for (std::size_t i = 1; i < starts.size(); ++i)
    if (room(*starts[i]) > room(*starts[best])) best = i;
  return best;
}

/// `before`: what it was when it died, where it keeps what it had then.
void spawn_player(World& world, int index, Fixed x, Fixed y, Angle angle, const Player* before = nullptr) {
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
  give_start_items(world, index, before);
  if (world.is_multiplayer() && world.has(wad::GameFlag::kRespawnProtection))
    player.powers.push_back({PowerKind::kInvulnerable, kNoType, kProtectionTics});
  // A trigger held since before the weapon is up does not fire NOAUTOFIRE ones.
  player.weapon_permissions |= kTriggerHeld;
  raise_weapon(world, index);
}

struct StartPlace {
  Fixed x = 0, y = 0;
  Angle angle = 0;
};

/// Where one that died comes back: its start, one of a deathmatch's, or where it died.
StartPlace respawn_place(World& world, int index, const Actor& corpse) {
  using enum wad::GameFlag;
  if (world.options().deathmatch) {
    const std::vector<const MapThing*> starts = deathmatch_starts_of(world);
    if (starts.size() > 1) {
      const MapThing& start =
          *starts[world.has(kSpawnFarthest) ? farthest_start(world, index, starts)
                                            : world.state().rng.below(static_cast<uint32_t>(starts.size()))];
      return {start.x, start.y, degrees_to_angle(start.angle_degrees)};
    }
  } else if (world.has(kRespawnWhereDied) && world.options().network_game) {
    return {corpse.x, corpse.y, corpse.angle};
  }
  return {corpse.spawn_x, corpse.spawn_y, corpse.spawn_angle};
}

/// The same player in a new body: its counts, and nothing in its hands.
Player reborn(const Player& before, uint32_t body_id) {
  Player fresh;
  fresh.actor_id = body_id;
  fresh.damage_taken = before.damage_taken, fresh.damage_dealt = before.damage_dealt;
  fresh.hits_taken = before.hits_taken, fresh.hits_dealt = before.hits_dealt;
  fresh.pickup_count = before.pickup_count, fresh.item_count = before.item_count;
  fresh.secret_count = before.secret_count, fresh.frag_count = before.frag_count;
  fresh.death_count = before.death_count;
  fresh.respawn_count = before.respawn_count + 1;
  fresh.buttons = before.buttons;
  fresh.attack_down = fresh.use_down = true;  // a key that is still held does nothing yet
  return fresh;
}

/// By the game's flags; and in a deathmatch players have all keys.
bool is_left_out(const World& world, const MapThing& thing, const ActorType& type) {
  using enum wad::GameFlag;
  const ItemClass kind = type.item_class;
  if (!world.options().deathmatch)
    return kind == ItemClass::kWeapon && (thing.flags & kThingSingle) == 0 && world.is_multiplayer() &&
           world.has(kNoCooperativeWeapons);
  const auto is_a = [&](std::string_view name) { return same_ignoring_case(type.name, name); };
  const bool heals = kind == ItemClass::kHealth || kind == ItemClass::kMaxHealth || is_a("Berserk"),
             armors = kind == ItemClass::kArmor || kind == ItemClass::kArmorBonus;
  return kind == ItemClass::kKey || (world.has(kNoHealth) && (heals || is_a("Megasphere"))) ||
         (world.has(kNoArmor) && (armors || is_a("Megasphere")));
}

float scaled(float own, float by) { return std::clamp(own * by, -1000.0f, 1000.0f); }

/// The map's properties of a thing besides its place and type.
void apply_thing_fields(World& world, const MapThing& thing, Actor& actor) {
  if (!world.type_of(actor).keeps_args) {
    actor.special = thing.special, actor.args = thing.args;
    world.size_bridge(actor);
  }
  if (!thing.arg0_text.empty() && !world.type_of(actor).keeps_args)
    actor.args[0] = world.events().script_number(world, thing.arg0_text);
  const auto is = [&](ThingFlag flag) { return (thing.flags & flag) != 0; };
  if (is(kThingAmbush)) actor.set(ActorFlag::kAmbush);
  if (is(kThingDormant) && actor.has(ActorFlag::kIsMonster)) actor.set(ActorFlag::kDormant);
  if (is(kThingStanding)) actor.set(ActorFlag::kStandStill);
  if (is(kThingFriend)) {
    // One that is a friend already is taken from the monsters all the same, as in ViZDoom.
    if (actor.has(ActorFlag::kFriendly) && actor.has(ActorFlag::kCountKill)) --world.state().monster_count;
    actor.set(ActorFlag::kFriendly);
  }
  if (is(kThingCountSecret)) actor.set(ActorFlag::kCountSecret);
  if (is(kThingInvisible)) actor.render_style = RenderStyle::kNone;
  if (thing.alpha >= 0) actor.alpha = thing.alpha;
  if (is(kThingShadow))
    actor.render_style = RenderStyle::kTranslucent, actor.alpha = 0.25f;  // goes before both in ViZDoom
  actor.scale_x = scaled(actor.scale_x, thing.scale_x), actor.scale_y = scaled(actor.scale_y, thing.scale_y);
  actor.pitch = degrees_to_angle(thing.pitch_degrees);
  actor.score = thing.score;
  const int64_t health = thing.health < 0 ? -int64_t{thing.health} : int64_t{thing.health} * actor.health;
  if (thing.health != 1)
    actor.health = actor.start_health = static_cast<int32_t>(std::min<int64_t>(health, 1'000'000));
  actor.gravity = thing.gravity < 0 ? -thing.gravity : fixed_mul(thing.gravity, actor.gravity);
}

}  // namespace

void spawn_players(World& world) {
  const uint32_t type = world.catalog().known().player;
  COMRAD_CHECK(type != kNoType, "the catalog has a player");
  std::vector<const MapThing*> deathmatch_starts;
  if (world.options().start_at_deathmatch_starts || world.options().deathmatch)
    deathmatch_starts = deathmatch_starts_of(world);
  for (int index = 0; index < world.player_count(); ++index) {
    const MapThing* start = nullptr;
    const bool wants_own = !world.options().deathmatch || deathmatch_starts.empty();
    for (const MapThing& thing : world.level().things)
      if (wants_own && player_of_start(thing.editor_number) == index)
        start = &thing;  // the last of a number counts, as in Doom
    if (start == nullptr && !deathmatch_starts.empty()) {
      // A lone player takes the first; each of several draws one of those that are free.
      const std::size_t drawn =
          world.player_count() == 1 ? 0
          : world.has(wad::GameFlag::kSpawnFarthest)
              ? farthest_start(world, index, deathmatch_starts)
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
  const auto [x, y, angle] = respawn_place(world, index, *corpse);
  const bool is_network = world.options().network_game;
  const std::size_t slot =
      world.append_actor(corpse->type, x, y, world.state().sectors[world.sector_at(x, y)].floor_height, angle,
                         is_network ? 0 : corpse->thing_id);
  Actor& body = world.state().actors[slot];
  if (!Movement(world).check_position(slot, x, y, false).fits) {
    world.remove_slot(slot);
    return false;
  }
  corpse->player_index = -1;
  // The dead one's scripts continue with the new body, as in ViZDoom's network games.
  if (is_network)
    for (acs::Thread& thread : world.state().scripts.threads)
      if (thread.activator_id == corpse->id) thread.activator_id = body.id;
  const bool keeps = is_network && !world.options().deathmatch && !world.has(wad::GameFlag::kLoseInventory);
  const Player before = std::exchange(player, reborn(player, body.id));
  spawn_player(world, index, x, y, angle, keeps ? &before : nullptr);
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
    if (is_left_out(world, thing, type)) continue;
    // Map spots and teleport destinations: hundreds in a map, never seen, never moving. They stay in
    // level().things unless a script may query them.
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
  const bool may = corpse.has(ActorFlag::kAlwaysRespawn) || world.options().skill >= 5 ||
                   world.has(wad::GameFlag::kMonstersReturn);
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
