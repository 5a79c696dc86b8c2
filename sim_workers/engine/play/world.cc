#include "sim_workers/engine/play/world.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <utility>

#include "rollout_buffer/core/check.h"
#include "sim_workers/engine/acs/behavior.h"
#include "sim_workers/engine/acs/machine.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/actions.h"
#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/player_thinker.h"
#include "sim_workers/engine/play/weapons.h"
#include "sim_workers/engine/play/world_hash.h"
#include "sim_workers/engine/specials/line_specials.h"
#include "sim_workers/engine/specials/movers.h"

namespace comrad::doom {
namespace {

constexpr std::size_t kSpareActors = 256;  // room for what scripts spawn, so that the step path rarely grows
constexpr std::size_t kActorsSpare = 64;   // places for those that come when there are too many
constexpr int kStatesAtOnceMax = 64;       // states without tics that one change may run through

}  // namespace

World::World(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog,
             std::shared_ptr<const acs::Behavior> behavior)
    : level_(std::move(level)), catalog_(std::move(catalog)), behavior_(std::move(behavior)) {
  COMRAD_CHECK(level_ != nullptr && catalog_ != nullptr, "a world needs a level and a catalog");
  COMRAD_CHECK(!level_->sectors.empty(), "a level has at least one sector");
  index_ = level_->index != nullptr ? level_->index : LevelIndex::build(*level_);
  state_.sectors = level_->sectors;
}

// ---------------------------------------------------------------- start

void World::reset(const WorldOptions& options, ScriptHost* scripts) {
  COMRAD_CHECK(options.player_count >= 1 && options.player_count <= kPlayersMax, "1 to 8 players");
  options_ = options;
  scripts_ = scripts;
  WorldState fresh;
  fresh.actors = std::move(state_.actors), fresh.links = std::move(state_.links);  // their memory is kept
  state_ = std::move(fresh);
  state_.rng = Rng(RngKey(options.seed).split("world"));
  state_.sectors = level_->sectors;
  state_.lines.resize(level_->linedefs.size());
  for (std::size_t i = 0; i < level_->linedefs.size(); ++i) {
    const Linedef& line = level_->linedefs[i];
    state_.lines[i] = {.special = line.special, .args = line.args, .flags = line.flags, .id = line.id};
  }
  state_.sides.resize(level_->sidedefs.size());
  for (std::size_t i = 0; i < level_->sidedefs.size(); ++i) {
    const Sidedef& side = level_->sidedefs[i];
    state_.sides[i].top = side.top, state_.sides[i].bottom = side.bottom,
    state_.sides[i].middle = side.middle;
  }
  state_.sector_sound_target.assign(level_->sectors.size(), 0);
  state_.sector_sound_tic.assign(level_->sectors.size(), 0);
  state_.actors.clear();
  state_.links.clear();
  state_.actors.reserve(level_->things.size() + kSpareActors);
  state_.links.reserve(level_->things.size() + kSpareActors);
  const Blockmap& blockmap = index_->blockmap;
  state_.cell_heads.assign(static_cast<std::size_t>(blockmap.columns()) * blockmap.rows(), -1);
  state_.type_counts.assign(catalog_->size(), 0);
  state_.players.assign(static_cast<std::size_t>(options.player_count), Player{});

  acs::reset_machine(*this);
  start_sector_specials(*this);
  start_movers(*this);
  spawn_players();
  spawn_map_things();
  // The newest script runs first, so that OPEN comes before ENTER in the first tic.
  for (int player = 0; player < player_count(); ++player)
    acs::start_scripts_of_type(*this, acs::ScriptType::kEnter,
                               state_.players[static_cast<std::size_t>(player)].actor_id);
  acs::start_scripts_of_type(*this, acs::ScriptType::kOpen, 0);
  if (scripts_ != nullptr) {
    scripts_->on_open(*this);
    for (int player = 0; player < player_count(); ++player) scripts_->on_enter(*this, player);
  }
  compact();
}

void World::spawn_players() {
  const uint32_t type = catalog_->known().player;
  COMRAD_CHECK(type != kNoType, "the catalog has a player");
  std::vector<const MapThing*> deathmatch_starts;
  if (options_.start_at_deathmatch_starts || options_.deathmatch)
    for (const MapThing& thing : level_->things)
      if (thing.editor_number == kDeathmatchStart) deathmatch_starts.push_back(&thing);
  for (int index = 0; index < player_count(); ++index) {
    const MapThing* start = nullptr;
    for (const MapThing& thing : level_->things)
      if (player_of_start(thing.editor_number) == index)
        start = &thing;  // the last of a number counts, as in Doom
    if (start == nullptr && !deathmatch_starts.empty()) {
      // Who plays alone takes the first; of several each draws one of those that nobody has.
      const std::size_t drawn =
          player_count() == 1 ? 0 : state_.rng.below(static_cast<uint32_t>(deathmatch_starts.size()));
      start = deathmatch_starts[drawn];
      if (deathmatch_starts.size() > 1)
        deathmatch_starts.erase(deathmatch_starts.begin() + static_cast<std::ptrdiff_t>(drawn));
    }
    const Fixed x = start != nullptr ? start->x : 0, y = start != nullptr ? start->y : 0;
    const Angle angle = start != nullptr ? degrees_to_angle(start->angle_degrees) : 0;
    const std::size_t slot = append_actor(type, x, y, state_.sectors[sector_at(x, y)].floor_height, angle, 0);
    Player& player = state_.players[static_cast<std::size_t>(index)];
    player.actor_id = state_.actors[slot].id;
    spawn_player(index, x, y, angle);
  }
}

void World::spawn_player(int index, Fixed x, Fixed y, Angle angle) {
  Player& player = state_.players[static_cast<std::size_t>(index)];
  Actor& body = *actor(player.actor_id);
  body.player_index = index;
  body.angle = angle;
  body.reaction_tics = type_of(body).reaction_tics;      // on any skill
  if (type_of(body).speed == 0) body.speed = kFracUnit;  // a factor of the keys' pushes
  body.spawn_x = x, body.spawn_y = y, body.spawn_angle = angle;
  player.health = body.health;
  player.alive = true;
  player.state = PlayerState::kAlive;
  // The floor of the whole body, not of its centre alone.
  const PositionCheck check = Movement(*this).check_position(slot_of(body), x, y, false);
  body.floor_z = check.floor_z, body.ceiling_z = check.ceiling_z;
  body.ground_z = check.ground_z, body.roof_z = check.roof_z;
  body.z = check.floor_z;
  const ActorType& type = type_of(body);
  player.eye_height = type.view_height, player.jump_speed = type.jump_speed;
  player.attack_z_offset = type.attack_z_offset;
  player.view_height = player.eye_height;
  player.view_z = body.z + player.view_height;
  give_start_items(*this, index);
  raise_weapon(*this, index);
}

bool World::respawn_player(int index) {
  Player& player = state_.players[static_cast<std::size_t>(index)];
  Actor* corpse = actor(player.actor_id);
  if (corpse == nullptr) return false;
  const Fixed x = corpse->spawn_x, y = corpse->spawn_y;
  const Angle angle = corpse->spawn_angle;
  const uint32_t type = corpse->type;
  const std::size_t slot =
      append_actor(type, x, y, state_.sectors[sector_at(x, y)].floor_height, angle, corpse->thing_id);
  Actor& body = state_.actors[slot];
  if (!Movement(*this).check_position(slot, x, y, false).fits) {
    remove_slot(slot);
    return false;
  }
  corpse->player_index = -1;
  Player fresh;
  fresh.actor_id = body.id;
  fresh.damage_taken = player.damage_taken, fresh.damage_dealt = player.damage_dealt;
  fresh.hits_taken = player.hits_taken, fresh.hits_dealt = player.hits_dealt;
  fresh.pickup_count = player.pickup_count, fresh.kill_count = player.kill_count;
  fresh.item_count = player.item_count, fresh.secret_count = player.secret_count;
  fresh.frag_count = player.frag_count, fresh.death_count = player.death_count;
  fresh.respawn_count = player.respawn_count + 1;
  fresh.buttons = player.buttons;
  fresh.attack_down = fresh.use_down = true;  // a key that is still held does nothing yet
  player = std::move(fresh);
  spawn_player(index, x, y, angle);
  if (catalog_->known().teleport_fog != kNoType) {
    const Fixed ahead_x = x + 20 * fine_cosine(angle), ahead_y = y + 20 * fine_sine(angle);
    spawn_unchecked(catalog_->known().teleport_fog, ahead_x, ahead_y, body.z);
  }
  acs::start_scripts_of_type(*this, acs::ScriptType::kRespawn, body.id);
  return true;
}

void World::spawn_map_things() {
  const uint32_t skill = kThingSkill1 << (std::clamp(options_.skill, 1, 5) - 1);
  const uint32_t game = options_.deathmatch  ? kThingDeathmatch
                        : player_count() > 1 ? kThingCoop
                                             : kThingSingle;
  for (const MapThing& thing : level_->things) {
    if ((thing.flags & skill) == 0 || (thing.flags & game) == 0) continue;
    if (player_of_start(thing.editor_number).has_value() || thing.editor_number == kDeathmatchStart) continue;
    const std::optional<uint32_t> found = catalog_->find_editor_number(thing.editor_number);
    if (!found.has_value()) continue;  // a kind that this engine does not know
    const uint32_t type_index = catalog_->replacement(*found);
    const ActorType& type = (*catalog_)[type_index];
    if (options_.no_monsters && type.flags.has(ActorFlag::kIsMonster)) continue;
    // Map spots and teleport destinations: hundreds in a map, never seen, never moving. They stay in
    // level().things unless a script may ask for them.
    if (type.state(StateLabel::kSpawn) == kNoState && type.flags.has(ActorFlag::kNoBlockmap) && thing.id == 0)
      continue;
    const Sector& sector = state_.sectors[sector_at(thing.x, thing.y)];
    Fixed z = sector.floor_height + thing.height;
    if (type.flags.has(ActorFlag::kSpawnCeiling)) z = sector.ceiling_height - type.height - thing.height;
    Actor& actor = state_.actors[append_actor(type_index, thing.x, thing.y, z,
                                              degrees_to_angle(thing.angle_degrees), thing.id)];
    actor.special = thing.special, actor.args = thing.args;
    if ((thing.flags & kThingAmbush) != 0) actor.set(ActorFlag::kAmbush);
    if ((thing.flags & kThingDormant) != 0) actor.set(ActorFlag::kDormant);
    if (actor.tics > 0 && !actor.has(ActorFlag::kSynchronized)) actor.tics = 1 + random_byte() % actor.tics;
    actor.spawn_x = thing.x, actor.spawn_y = thing.y, actor.spawn_z = actor.z,
    actor.spawn_angle = actor.angle;
    if (actor.has(ActorFlag::kCountKill)) ++state_.monster_count;
    if (actor.has(ActorFlag::kCountItem)) ++state_.item_total;
    if (actor.has(ActorFlag::kDormant)) actor.tics = -1;
  }
}

// ---------------------------------------------------------------- actors

std::size_t World::append_actor(uint32_t type_index, Fixed x, Fixed y, Fixed z, Angle angle,
                                int32_t thing_id) {
  const ActorType& type = (*catalog_)[type_index];
  Actor actor;
  actor.id = state_.next_actor_id++;
  actor.type = type_index;
  actor.x = x, actor.y = y;
  actor.angle = angle;
  actor.radius = type.radius, actor.height = type.height;
  actor.flags = type.flags;
  actor.health = type.health;
  actor.thing_id = thing_id;
  actor.special = type.special, actor.args = type.args;
  actor.sector_index = actor.floor_sector_index = sector_at(x, y);
  actor.floor_z = actor.ground_z = actor.dropoff_z = state_.sectors[actor.sector_index].floor_height;
  actor.ceiling_z = actor.roof_z = state_.sectors[actor.sector_index].ceiling_height;
  actor.z = z == kOnFloor ? actor.floor_z : z == kOnCeiling ? actor.ceiling_z - actor.height : z;
  actor.speed = options_.skill >= 5 && type.fast_speed >= 0 ? type.fast_speed : type.speed;
  actor.float_speed = type.float_speed;
  actor.damage = type.damage, actor.damage_type = type.damage_type;
  actor.damage_factor = type.general_damage_factor;
  actor.gravity = type.gravity, actor.mass = type.mass, actor.amount = type.amount;
  actor.bounce_count = type.bounce_count;
  actor.render_style = type.render_style, actor.alpha = type.alpha;
  actor.scale_x = type.scale_x, actor.scale_y = type.scale_y, actor.translation = type.translation;
  actor.reaction_tics = options_.skill >= 5 ? 0 : type.reaction_tics;
  actor.spawn_x = x, actor.spawn_y = y, actor.spawn_z = actor.z, actor.spawn_angle = angle;
  actor.spawn_tic = state_.tic_count;
  // A quirk of Doom's: whoever is born has been walking east, and does not turn about at once.
  actor.move_direction = kEast;
  // The first state begins without its action, as in Doom.
  actor.state = type.state(StateLabel::kSpawn);
  if (actor.state != kNoState) {
    const State& state = catalog_->state(actor.state);
    actor.tics = state.tics;
    actor.sprite = state.sprite, actor.frame = state.frame;
    if (state.tics > 0 && state.random_tics > 0)
      actor.tics += static_cast<int32_t>(state_.rng.below(static_cast<uint32_t>(state.random_tics) + 1));
  }
  state_.actors.push_back(std::move(actor));
  state_.links.push_back(ThingLink{});
  ++state_.type_counts[type_index];
  const std::size_t slot = state_.actors.size() - 1;
  link_slot(slot);
  return slot;
}

std::optional<std::size_t> World::find_slot(uint32_t id) const {
  // Ids rise along the list: new actors are appended and compact() keeps the order.
  if (id == 0) return std::nullopt;
  std::size_t low = 0, high = state_.actors.size();
  while (low < high) {
    const std::size_t middle = (low + high) / 2;
    if (state_.actors[middle].id < id) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  if (low == state_.actors.size() || state_.actors[low].id != id || state_.actors[low].removed)
    return std::nullopt;
  return low;
}

const Actor* World::find_actor(uint32_t id) const {
  const std::optional<std::size_t> slot = find_slot(id);
  return slot ? &state_.actors[*slot] : nullptr;
}

Actor* World::actor(uint32_t id) {
  const std::optional<std::size_t> slot = find_slot(id);
  return slot ? &state_.actors[*slot] : nullptr;
}

std::size_t World::slot_of(const Actor& actor) const {
  std::size_t low = 0, high = state_.actors.size();
  while (low < high) {
    const std::size_t middle = (low + high) / 2;
    if (state_.actors[middle].id < actor.id) {
      low = middle + 1;
    } else {
      high = middle;
    }
  }
  return low;
}

const Actor& World::body(int index) const {
  const Actor* body = find_actor(state_.players[static_cast<std::size_t>(index)].actor_id);
  COMRAD_CHECK(body != nullptr, "a player's body is never removed");
  return *body;
}

void World::link(Actor& actor) { link_slot(slot_of(actor)); }
void World::unlink(Actor& actor) { unlink_slot(slot_of(actor)); }

void World::link_slot(std::size_t slot) {
  if (state_.links[slot].cell >= 0) unlink_slot(slot);
  const Actor& actor = state_.actors[slot];
  if (actor.removed || actor.has(ActorFlag::kNoBlockmap) ||
      !(actor.has(ActorFlag::kSolid) || actor.has(ActorFlag::kSpecial) || actor.has(ActorFlag::kShootable)))
    return;
  const Blockmap& blockmap = index_->blockmap;
  const int32_t cell = blockmap.row_of(actor.y) * blockmap.columns() + blockmap.column_of(actor.x);
  int32_t& head = state_.cell_heads[static_cast<std::size_t>(cell)];
  state_.links[slot] = {.next = head, .previous = -1, .cell = cell};
  if (head >= 0) state_.links[static_cast<std::size_t>(head)].previous = static_cast<int32_t>(slot);
  head = static_cast<int32_t>(slot);
  state_.radius_max = std::max(state_.radius_max, actor.radius);
}

void World::unlink_slot(std::size_t slot) {
  const ThingLink old = state_.links[slot];
  if (old.cell < 0) return;
  if (old.next >= 0) state_.links[static_cast<std::size_t>(old.next)].previous = old.previous;
  if (old.previous >= 0) {
    state_.links[static_cast<std::size_t>(old.previous)].next = old.next;
  } else {
    state_.cell_heads[static_cast<std::size_t>(old.cell)] = old.next;
  }
  state_.links[slot] = ThingLink{};
}

void World::remove_slot(std::size_t slot) {
  Actor& actor = state_.actors[slot];
  if (actor.removed) return;
  unlink_slot(slot);
  actor.removed = true;
  --state_.type_counts[actor.type];
  state_.has_removed = true;
}

void World::compact() {
  if (!state_.has_removed) return;
  state_.has_removed = false;
  std::size_t kept = 0;
  for (std::size_t slot = 0; slot < state_.actors.size(); ++slot) {
    if (state_.actors[slot].removed) continue;
    if (kept != slot) {
      // Everybody who points to the old slot gets the new one.
      state_.actors[kept] = state_.actors[slot];
      const ThingLink moved = state_.links[slot];
      state_.links[kept] = moved;
      if (moved.cell >= 0) {
        if (moved.next >= 0)
          state_.links[static_cast<std::size_t>(moved.next)].previous = static_cast<int32_t>(kept);
        if (moved.previous >= 0) {
          state_.links[static_cast<std::size_t>(moved.previous)].next = static_cast<int32_t>(kept);
        } else {
          state_.cell_heads[static_cast<std::size_t>(moved.cell)] = static_cast<int32_t>(kept);
        }
      }
    }
    ++kept;
  }
  state_.actors.resize_down(kept);
  state_.links.resize_down(kept);
}

bool World::set_state(Actor& actor, uint32_t state_index) {
  for (int count = 0; count < kStatesAtOnceMax; ++count) {
    if (state_index == kNoState || state_index >= catalog_->state_count()) {
      remove(actor.id);
      return false;
    }
    const State& state = catalog_->state(state_index);
    actor.state = state_index;
    actor.tics = state.tics;
    if (state.fast && options_.skill >= 5 && actor.tics > 1) actor.tics = (actor.tics + 1) / 2;
    if (state.tics > 0 && state.random_tics > 0)
      actor.tics += static_cast<int32_t>(state_.rng.below(static_cast<uint32_t>(state.random_tics) + 1));
    actor.sprite = state.sprite, actor.frame = state.frame;
    if (state.action != ActionId::kNone) {
      ActionCall call{.world = *this, .self = actor, .state = state, .args = catalog_->args(state)};
      run_action(call);
      if (actor.removed) return false;
      if (actor.state != state_index) return true;  // the action chose another state, which has begun
      if (call.has_jump) {
        state_index = call.jump;
        continue;
      }
    }
    if (actor.tics != 0) return true;
    state_index = state.next;
  }
  actor.tics = 1;  // a circle of states without time: go on in the next tic
  return true;
}

bool World::set_label(Actor& actor, StateLabel label) {
  const uint32_t state = type_of(actor).state(label);
  return state != kNoState && set_state(actor, state);
}

void World::set_thing_id(Actor& actor, int32_t thing_id) { actor.thing_id = thing_id; }

Actor* World::find_thing(int32_t thing_id, uint32_t after) {
  if (thing_id == 0) return nullptr;
  for (std::size_t slot = 0; slot < state_.actors.size(); ++slot) {
    Actor& actor = state_.actors[slot];
    if (actor.id > after && actor.thing_id == thing_id && !actor.removed) return &actor;
  }
  return nullptr;
}

Actor& World::spawn_unchecked(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle) {
  // Beyond the limit actors are gone as soon as they are made, and share a few places until the end of the
  // tic.
  const bool full = state_.actors.size() >= kActorsMax;
  if (state_.actors.size() >= kActorsMax + kActorsSpare && state_.actors.back().removed)
    state_.actors.pop_back(), state_.links.pop_back();
  const std::size_t slot = append_actor(type, x, y, z, angle, 0);
  if (full) remove_slot(slot);
  return state_.actors[slot];
}

// ---------------------------------------------------------------- tic

void World::tic_actor(std::size_t slot) {
  Actor& actor = state_.actors[slot];
  if (actor.removed || actor.has(ActorFlag::kDormant)) return;
  Movement movement(*this);
  const int player = actor.player_index;
  const Player* owner = player >= 0 ? &state_.players[static_cast<std::size_t>(player)] : nullptr;
  const bool alive_player = owner != nullptr && owner->alive;
  const bool pushing = alive_player && PlayerThinker::pushes(owner->buttons);
  const Fixed floor_before = actor.floor_z;
  if (actor.velocity_x != 0 || actor.velocity_y != 0 || actor.has(ActorFlag::kSkullFly))
    movement.move_horizontally(slot, pushing);
  if (actor.removed) return;
  const bool left_ledge = actor.floor_z < floor_before && actor.z == floor_before;
  // Above the floor of its sector a body looks anew, each tic, whether another body holds it. Its ground does
  // not change while it stands still.
  const Fixed sector_floor = state_.sectors[actor.sector_index].floor_height;
  if ((player >= 0 || actor.has(ActorFlag::kIsMonster)) &&
      (actor.floor_z != sector_floor || actor.z > sector_floor))
    movement.look_for_bodies(slot);
  if (actor.velocity_z != 0 || actor.z != actor.floor_z) {
    if (actor.velocity_z != 0 || !actor.has(ActorFlag::kNoGravity) || actor.has(ActorFlag::kFloat))
      movement.move_vertically(slot, left_ledge);
  }
  if (actor.removed) return;
  if (alive_player && actor.velocity_x == 0 && actor.velocity_y == 0 && !pushing &&
      PlayerThinker::is_walking(*this, actor))
    set_label(actor, StateLabel::kSpawn);
  if (actor.tics < 0 || --actor.tics > 0 || actor.state == kNoState) return;
  set_state(actor, catalog_->state(actor.state).next);
}

void World::tic(std::span<const Buttons> buttons) {
  if (state_.level_exited) return;
  static constexpr Buttons kNothing{};
  PlayerThinker thinker(*this);
  for (int player = 0; player < player_count(); ++player) {
    const auto index = static_cast<std::size_t>(player);
    thinker.think(player, index < buttons.size() ? buttons[index] : kNothing);
  }
  for (std::size_t slot = 0; slot < state_.actors.size(); ++slot)
    tic_actor(slot);  // grows while things spawn
  tic_movers(*this);
  acs::tic_machine(*this);
  if (scripts_ != nullptr) scripts_->on_tic(*this);
  compact();
  ++state_.tic_count;
}

// ---------------------------------------------------------------- read side

uint32_t World::sector_at(Fixed x, Fixed y) const { return index_->sectors.sector_at(x, y); }

int32_t World::exported(int index) const {
  return index >= 0 && static_cast<std::size_t>(index) < state_.globals.size()
             ? state_.globals[static_cast<std::size_t>(index)]
             : 0;
}

int World::count_actors(uint32_t type) const {
  return type < state_.type_counts.size() ? state_.type_counts[type] : 0;
}

uint64_t World::hash() const { return hash_of(state_); }

// ---------------------------------------------------------------- what scripts do

std::optional<uint32_t> World::spawn(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle, int32_t thing_id,
                                     bool force) {
  if (type >= catalog_->size() || (!force && !index_->outline.contains(x, y))) return std::nullopt;
  if (state_.actors.size() >= kActorsMax) return std::nullopt;
  type = catalog_->replacement(type);
  if (options_.no_monsters && (*catalog_)[type].flags.has(ActorFlag::kIsMonster)) return std::nullopt;
  const std::size_t slot = append_actor(type, x, y, z, angle, thing_id);
  Actor& actor = state_.actors[slot];
  if (!force && !fits_here(*this, actor)) {
    unlink_slot(slot);
    --state_.type_counts[type];
    state_.actors.pop_back();
    state_.links.pop_back();
    --state_.next_actor_id;
    return std::nullopt;
  }
  if (actor.has(ActorFlag::kCountKill)) ++state_.monster_count;
  return actor.id;
}

void World::remove(uint32_t actor_id) {
  const std::optional<std::size_t> slot = find_slot(actor_id);
  if (!slot || state_.actors[*slot].player_index >= 0) return;  // a player's body stays
  remove_slot(*slot);
}

bool World::try_teleport(uint32_t actor_id, Fixed x, Fixed y) {
  const std::optional<std::size_t> slot = find_slot(actor_id);
  if (!slot || !index_->outline.contains(x, y)) return false;  // no line is touched deep inside a pillar
  Movement movement(*this);
  const PositionCheck check = movement.check_position(*slot, x, y, false);
  Actor& actor = state_.actors[*slot];
  if (!check.fits || int64_t{check.ceiling_z} - check.floor_z < actor.height) return false;
  const bool on_ground = actor.z <= actor.floor_z;
  const Fixed z = on_ground ? check.floor_z : std::max(actor.z, check.floor_z);
  if (int64_t{z} + actor.height > check.ceiling_z) return false;
  movement.place(*slot, x, y, check);
  actor.z = z;
  return true;
}

void World::set_position(uint32_t actor_id, Fixed x, Fixed y, Fixed z) {
  const std::optional<std::size_t> slot = find_slot(actor_id);
  if (!slot) return;
  Movement(*this).place(*slot, x, y, opening_of_point(*this, x, y));
  state_.actors[*slot].z = z;
}

void World::set_angle(uint32_t actor_id, Angle angle) {
  if (Actor* found = actor(actor_id)) found->angle = angle;
}

void World::set_sector_damage(int32_t tag, int32_t amount, int32_t interval) {
  for (Sector& sector : state_.sectors) {
    if (sector.tag != tag) continue;
    sector.damage_amount = amount;
    sector.damage_interval = interval;
  }
}

void World::damage_player(int player_index, int32_t amount) {
  if (player_index < 0 || player_index >= player_count() || amount <= 0) return;
  if (Actor* body = body_of(player_index))
    damage_actor(*this, *body, nullptr, nullptr, std::min(amount, 1'000'000), DamageType::kNormal,
                 kDamageNoArmor);
}

void World::set_export(int index, int32_t value) {
  if (index >= 0 && static_cast<std::size_t>(index) < state_.globals.size())
    state_.globals[static_cast<std::size_t>(index)] = value;
}

void World::exit_level() { state_.level_exited = true; }

// ---------------------------------------------------------------- geometry

Fixed approximate_distance(Fixed dx, Fixed dy) {
  const int64_t x = std::abs(int64_t{dx}), y = std::abs(int64_t{dy});
  return static_cast<Fixed>(std::min<int64_t>(x + y - std::min(x, y) / 2, INT32_MAX));
}

Angle angle_to(Fixed from_x, Fixed from_y, Fixed to_x, Fixed to_y) {
  const int64_t dx = int64_t{to_x} - from_x, dy = int64_t{to_y} - from_y;
  if (dx == 0 && dy == 0) return 0;
  // The first octant's arctangent by bisection over the sine table: the largest fine angle whose tangent does
  // not exceed the slope. Twelve steps, integers only.
  const int64_t large = std::max(std::abs(dx), std::abs(dy)), small = std::min(std::abs(dx), std::abs(dy));
  uint32_t low = 0, high = 1024;  // fine angles: 1024 are an eighth of a turn
  while (high - low > 1) {
    const uint32_t middle = (low + high) / 2;
    const int64_t sine = fine_sine(middle << 19), cosine = fine_cosine(middle << 19);
    if (sine * (large >> 8) <= cosine * (small >> 8)) {
      low = middle;
    } else {
      high = middle;
    }
  }
  if (small == large) low = 1024;
  // A quirk of Doom's octants: four of the eight end one short, those that hold due north and west among
  // them. A push due north goes by the fine angle below (measured).
  const Angle part = low << 19;
  const bool steep = std::abs(dy) >= std::abs(dx);
  Angle angle = 0;
  if (dx >= 0 && dy >= 0) {
    angle = steep ? kAngle90 - 1 - part : part;
  } else if (dx >= 0) {
    angle = steep ? kAngle180 + kAngle90 + part : 0u - part;
  } else if (dy >= 0) {
    angle = steep ? kAngle90 + part : kAngle180 - 1 - part;
  } else {
    angle = steep ? kAngle180 + kAngle90 - 1 - part : kAngle180 + part;
  }
  return angle;
}

}  // namespace comrad::doom
