#include "sim_workers/engine/world/world.h"

#include <algorithm>
#include <utility>

#include "rollout_buffer/core/check.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/world/world_hash.h"

namespace comrad::doom {
namespace {

constexpr std::size_t kSpareActors = 256;  // room for what scripts spawn, so that the step path rarely grows
constexpr std::size_t kActorsSpare = 64;   // places for those that come when there are too many

}  // namespace

World::World(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog,
             std::shared_ptr<const acs::Behavior> behavior)
    : level_(std::move(level)), catalog_(std::move(catalog)), behavior_(std::move(behavior)) {
  COMRAD_CHECK(level_ != nullptr && catalog_ != nullptr, "a world needs a level and a catalog");
  COMRAD_CHECK(!level_->sectors.empty(), "a level has at least one sector");
  index_ = level_->index != nullptr ? level_->index : LevelIndex::build(*level_);
  state_.sectors = level_->sectors;
}

void World::start(const WorldOptions& options, const WorldEvents* events) {
  COMRAD_CHECK(options.player_count >= 1 && options.player_count <= kPlayersMax, "1 to 8 players");
  options_ = options;
  events_ = events;
  WorldState fresh;
  fresh.actors = std::move(state_.actors), fresh.links = std::move(state_.links);  // their memory is kept
  state_ = std::move(fresh);
  state_.rng = Rng(RngKey(options.seed).split("world"));
  state_.sectors = level_->sectors;
  state_.gravity = fixed_mul(level_->rules.gravity, options.gravity);
  state_.air_control = options.air_control.value_or(state_.air_control);
  using enum wad::GameFlag;
  options_.allow_jump &= !level_->rules.no_jump || has(kAllowJump);
  options_.allow_crouch &= !level_->rules.no_crouch || has(kAllowCrouch);
  if (options.deathmatch) options_.flags.set(kWeaponsStay), options_.flags.set(kItemsReturn);
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
}

// ---------------------------------------------------------------- actors

void World::size_bridge(Actor& actor) const {
  const ActorType& type = (*catalog_)[actor.type];
  if (type.bridge == ActorType::Bridge::kNone) return;
  const bool custom = type.bridge == ActorType::Bridge::kCustom;
  const auto sized = [](int32_t argument, Fixed otherwise) {
    return argument != 0 ? to_fixed(std::clamp(argument, 0, 32'000)) : otherwise;
  };
  actor.radius = sized(actor.args[0], custom ? to_fixed(32) : type.radius);
  actor.height = sized(actor.args[1], custom ? to_fixed(4) : type.height);
}

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
  actor.health = actor.start_health = type.health;
  set_thing_id(actor, thing_id);
  actor.special = type.special, actor.args = type.args;
  size_bridge(actor);
  actor.sector_index = actor.floor_sector_index = sector_at(x, y);
  actor.floor_z = actor.ground_z = actor.dropoff_z = state_.sectors[actor.sector_index].floor_height;
  actor.ceiling_z = actor.roof_z = state_.sectors[actor.sector_index].ceiling_height;
  actor.z = z == kOnFloor ? actor.floor_z : z == kOnCeiling ? actor.hanging_z() : z;
  actor.speed = is_fast() && type.fast_speed >= 0 ? type.fast_speed : type.speed;
  actor.float_speed = type.float_speed;
  actor.damage = type.damage, actor.damage_type = type.damage_type;
  actor.damage_factor = type.general_damage_factor;
  actor.gravity = type.gravity, actor.mass = type.mass, actor.amount = type.amount;
  actor.bounce_count = type.bounce_count;
  actor.render_style = type.render_style, actor.alpha = type.alpha;
  actor.scale_x = type.scale_x, actor.scale_y = type.scale_y, actor.translation = type.translation;
  actor.reaction_tics = is_fast() && type.flags.has(ActorFlag::kIsMonster) ? 0 : type.reaction_tics;
  actor.spawn_x = x, actor.spawn_y = y, actor.spawn_z = actor.z, actor.spawn_angle = angle;
  actor.spawn_tic = state_.tic_count;
  // A quirk of Doom's: a newly spawned monster faces east and cannot reverse on its first step.
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
  if (type.flags.has(ActorFlag::kCountItem)) ++state_.item_total;
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

void World::remove(uint32_t actor_id) {
  const std::optional<std::size_t> slot = find_slot(actor_id);
  if (!slot || state_.actors[*slot].player_index >= 0) return;  // a player's body stays
  remove_slot(*slot);
}

void World::drop_last_actor() {
  const std::size_t slot = state_.actors.size() - 1;
  unlink_slot(slot);
  --state_.type_counts[state_.actors[slot].type];
  if (state_.actors[slot].has(ActorFlag::kCountItem)) --state_.item_total;
  state_.actors.pop_back();
  state_.links.pop_back();
  --state_.next_actor_id;
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

Actor* World::find_thing(int32_t thing_id, uint32_t before) {
  if (thing_id == 0) return nullptr;
  Actor* found = nullptr;
  for (std::size_t slot = 0; slot < state_.actors.size(); ++slot) {
    Actor& actor = state_.actors[slot];
    if (actor.thing_id == thing_id && !actor.removed && actor.thing_order < before &&
        (found == nullptr || actor.thing_order > found->thing_order))
      found = &actor;
  }
  return found;
}

Actor& World::spawn_unchecked(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle) {
  // Beyond the limit actors are gone as soon as they are made, and share a few places until the end of
  // the tic.
  const bool full = state_.actors.size() >= kActorsMax;
  if (state_.actors.size() >= kActorsMax + kActorsSpare && state_.actors.back().removed)
    state_.actors.pop_back(), state_.links.pop_back();
  const std::size_t slot = append_actor(type, x, y, z, angle, 0);
  if (full) remove_slot(slot);
  return state_.actors[slot];
}

void World::set_angle(uint32_t actor_id, Angle angle) {
  if (Actor* found = actor(actor_id)) found->angle = angle;
}

// ---------------------------------------------------------------- the rest

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

void World::set_sector_damage(int32_t tag, int32_t amount, int32_t interval) {
  for (Sector& sector : state_.sectors) {
    if (sector.tag != tag) continue;
    sector.damage_amount = amount;
    sector.damage_interval = interval;
  }
}

void World::set_export(int index, int32_t value) {
  if (index >= 0 && static_cast<std::size_t>(index) < state_.globals.size())
    state_.globals[static_cast<std::size_t>(index)] = value;
}

}  // namespace comrad::doom
