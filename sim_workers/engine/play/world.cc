#include "sim_workers/engine/play/world.h"

#include <algorithm>
#include <cstddef>
#include <utility>

#include "rollout_buffer/core/check.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/actor_catalog.h"
#include "sim_workers/engine/play/movement.h"
#include "sim_workers/engine/play/player_thinker.h"

namespace comrad::doom {
namespace {

constexpr std::size_t kSpareActors = 256;  // room for what scripts spawn, so that the step path rarely grows
constexpr int32_t kDamageFlashMax = 100;

}  // namespace

World::World(std::shared_ptr<const Level> level, std::shared_ptr<const ActorCatalog> catalog)
    : level_(std::move(level)), catalog_(std::move(catalog)) {
  COMRAD_CHECK(level_ != nullptr && catalog_ != nullptr, "a world needs a level and a catalog");
  COMRAD_CHECK(!level_->sectors.empty(), "a level has at least one sector");
  index_ = level_->index != nullptr ? level_->index : LevelIndex::build(*level_);
  sectors_ = level_->sectors;
}

// ---------------------------------------------------------------- start

void World::reset(const WorldOptions& options, ScriptHost* scripts) {
  COMRAD_CHECK(options.player_count >= 1 && options.player_count <= kPlayersMax, "1 to 8 players");
  options_ = options;
  scripts_ = scripts;
  rng_ = Rng(RngKey(options.seed).split("world"));
  sectors_ = level_->sectors;
  actors_.clear();
  links_.clear();
  actors_.reserve(level_->things.size() + kSpareActors);
  links_.reserve(level_->things.size() + kSpareActors);
  const Blockmap& blockmap = index_->blockmap;
  cell_heads_.assign(static_cast<std::size_t>(blockmap.columns()) * blockmap.rows(), -1);
  type_counts_.assign(catalog_->size(), 0);
  radius_max_ = 0;
  has_removed_ = false;
  players_.assign(static_cast<std::size_t>(options.player_count), Player{});
  hud_.clear();
  exported_.fill(0);
  tic_count_ = 0;
  next_actor_id_ = 1;
  level_exited_ = false;

  spawn_players();
  spawn_map_things();
  if (scripts_ != nullptr) {
    scripts_->on_open(*this);
    for (int player = 0; player < player_count(); ++player) scripts_->on_enter(*this, player);
  }
  compact();
}

void World::spawn_players() {
  const std::optional<uint32_t> type = catalog_->find("Player");
  COMRAD_CHECK(type.has_value(), "the catalog has a Player");
  for (int index = 0; index < player_count(); ++index) {
    Fixed x = 0, y = 0;
    Angle angle = 0;
    for (const MapThing& thing : level_->things) {
      if (player_of_start(thing.editor_number) != index) continue;
      x = thing.x, y = thing.y;  // the last start of a number counts, as in Doom
      angle = degrees_to_angle(thing.angle_degrees);
    }
    const std::size_t slot = append_actor(*type, x, y, sectors_[sector_at(x, y)].floor_height, angle, 0);
    Actor& body = actors_[slot];
    body.player_index = index;
    Player& player = players_[static_cast<std::size_t>(index)];
    player.actor_id = body.id;
    player.health = body.health;
    // The floor of the whole body, not of its centre alone.
    const PositionCheck check = Movement(*this).check_position(slot, x, y, false);
    body.floor_z = check.floor_z, body.ceiling_z = check.ceiling_z;
    body.z = check.floor_z;
    player.view_height = kEyeHeight;
    player.view_z = body.z + kEyeHeight;
  }
}

void World::spawn_map_things() {
  const uint32_t skill = kThingSkill1 << (std::clamp(options_.skill, 1, 5) - 1);
  const uint32_t game = player_count() > 1 ? kThingCoop : kThingSingle;
  for (const MapThing& thing : level_->things) {
    if ((thing.flags & skill) == 0 || (thing.flags & game) == 0) continue;
    if (player_of_start(thing.editor_number).has_value()) continue;
    const std::optional<uint32_t> type = catalog_->find_editor_number(thing.editor_number);
    if (!type.has_value()) continue;  // a kind that this engine does not know yet
    // Map spots and teleport destinations: hundreds in a map, never seen, never moving. They stay in
    // level().things.
    if ((*catalog_)[*type].sprite.empty() && (*catalog_)[*type].no_blockmap) continue;
    const Fixed floor_z = sectors_[sector_at(thing.x, thing.y)].floor_height;
    append_actor(*type, thing.x, thing.y, floor_z + thing.height, degrees_to_angle(thing.angle_degrees),
                 thing.id);
  }
}

// ---------------------------------------------------------------- actors

std::size_t World::append_actor(uint32_t type_index, Fixed x, Fixed y, Fixed z, Angle angle,
                                int32_t thing_id) {
  const ActorType& type = (*catalog_)[type_index];
  Actor actor;
  actor.id = next_actor_id_++;
  actor.type = type_index;
  actor.x = x, actor.y = y, actor.z = z;
  actor.angle = angle;
  actor.radius = type.radius, actor.height = type.height;
  actor.health = type.health;
  actor.thing_id = thing_id;
  actor.sector_index = sector_at(x, y);
  actor.floor_z = sectors_[actor.sector_index].floor_height;
  actor.ceiling_z = sectors_[actor.sector_index].ceiling_height;
  if (!type.frames.empty()) actor.frame_tics = type.frames.front().tics;
  actors_.push_back(actor);
  links_.emplace_back();
  ++type_counts_[type_index];
  const std::size_t slot = actors_.size() - 1;
  link(slot);
  return slot;
}

std::optional<std::size_t> World::slot_of(uint32_t id) const {
  // Ids rise along the list: new actors are appended and compact() keeps the order.
  const auto found = std::lower_bound(actors_.begin(), actors_.end(), id,
                                      [](const Actor& actor, uint32_t wanted) { return actor.id < wanted; });
  if (found == actors_.end() || found->id != id || found->removed) return std::nullopt;
  return static_cast<std::size_t>(found - actors_.begin());
}

const Actor* World::find_actor(uint32_t id) const {
  const std::optional<std::size_t> slot = slot_of(id);
  return slot ? &actors_[*slot] : nullptr;
}

Actor* World::find_live(uint32_t id) {
  const std::optional<std::size_t> slot = slot_of(id);
  return slot ? &actors_[*slot] : nullptr;
}

const Actor& World::body(int index) const {
  const Actor* body = find_actor(players_[static_cast<std::size_t>(index)].actor_id);
  COMRAD_CHECK(body != nullptr, "a player's body is never removed");
  return *body;
}

void World::link(std::size_t slot) {
  const Actor& actor = actors_[slot];
  const ActorType& type = (*catalog_)[actor.type];
  if (type.no_blockmap || actor.is_corpse || !(type.solid || type.pickup || type.shootable)) return;
  const Blockmap& blockmap = index_->blockmap;
  const int32_t cell = blockmap.row_of(actor.y) * blockmap.columns() + blockmap.column_of(actor.x);
  int32_t& head = cell_heads_[static_cast<std::size_t>(cell)];
  links_[slot] = {.next = head, .previous = -1, .cell = cell};
  if (head >= 0) links_[static_cast<std::size_t>(head)].previous = static_cast<int32_t>(slot);
  head = static_cast<int32_t>(slot);
  radius_max_ = std::max(radius_max_, actor.radius);
}

void World::unlink(std::size_t slot) {
  const ThingLink old = links_[slot];
  if (old.cell < 0) return;
  if (old.next >= 0) links_[static_cast<std::size_t>(old.next)].previous = old.previous;
  if (old.previous >= 0) {
    links_[static_cast<std::size_t>(old.previous)].next = old.next;
  } else {
    cell_heads_[static_cast<std::size_t>(old.cell)] = old.next;
  }
  links_[slot] = ThingLink{};
}

void World::remove_slot(std::size_t slot) {
  Actor& actor = actors_[slot];
  if (actor.removed) return;
  unlink(slot);
  actor.removed = true;
  --type_counts_[actor.type];
  has_removed_ = true;
}

void World::compact() {
  if (!has_removed_) return;
  has_removed_ = false;
  std::size_t kept = 0;
  for (std::size_t slot = 0; slot < actors_.size(); ++slot) {
    if (actors_[slot].removed) continue;
    if (kept != slot) {
      // Everybody who points to the old slot gets the new one.
      actors_[kept] = actors_[slot];
      const ThingLink moved = links_[slot];
      links_[kept] = moved;
      if (moved.cell >= 0) {
        if (moved.next >= 0)
          links_[static_cast<std::size_t>(moved.next)].previous = static_cast<int32_t>(kept);
        if (moved.previous >= 0) {
          links_[static_cast<std::size_t>(moved.previous)].next = static_cast<int32_t>(kept);
        } else {
          cell_heads_[static_cast<std::size_t>(moved.cell)] = static_cast<int32_t>(kept);
        }
      }
    }
    ++kept;
  }
  actors_.resize(kept);
  links_.resize(kept);
}

void World::set_frame(Actor& actor, uint16_t frame_index) {
  const ActorType& type = (*catalog_)[actor.type];
  if (frame_index >= type.frames.size()) return;
  actor.frame_index = frame_index;
  actor.frame_tics = type.frames[frame_index].tics;
}

void World::advance_frames(Actor& actor) {
  if (actor.frame_tics < 0 || --actor.frame_tics > 0) return;
  const ActorType& type = (*catalog_)[actor.type];
  if (type.frames.empty()) return;
  // Action functions of a frame hook in here, when its time begins.
  const int16_t next = type.frames[actor.frame_index].next;
  const std::size_t following =
      next >= 0 ? static_cast<std::size_t>(next) : actor.frame_index + std::size_t{1};
  set_frame(actor, static_cast<uint16_t>(following < type.frames.size() ? following : 0));
}

// ---------------------------------------------------------------- tic

void World::tic(std::span<const Buttons> buttons) {
  if (level_exited_) return;
  static constexpr Buttons kNothing{};
  const auto pressed = [&](int player) -> const Buttons& {
    return static_cast<std::size_t>(player) < buttons.size() ? buttons[static_cast<std::size_t>(player)]
                                                             : kNothing;
  };
  PlayerThinker thinker(*this);
  for (int player = 0; player < player_count(); ++player) thinker.think(player, pressed(player));

  Movement movement(*this);
  for (std::size_t slot = 0; slot < actors_.size(); ++slot) {  // grows while scripts spawn
    if (actors_[slot].removed) continue;
    const int player = actors_[slot].player_index;
    const bool alive_player = player >= 0 && players_[static_cast<std::size_t>(player)].alive;
    if (actors_[slot].velocity_x != 0 || actors_[slot].velocity_y != 0)
      movement.move_horizontally(slot, alive_player && PlayerThinker::pushes(pressed(player)));
    // Above the floor of its sector a body looks anew, each tic, what holds it: a ledge, another body,
    // nothing.
    const Fixed sector_floor = sectors_[actors_[slot].sector_index].floor_height;
    if (player >= 0 && (actors_[slot].floor_z != sector_floor || actors_[slot].z > sector_floor)) {
      const PositionCheck check = movement.check_position(slot, actors_[slot].x, actors_[slot].y, false);
      if (check.fits) actors_[slot].floor_z = check.floor_z, actors_[slot].ceiling_z = check.ceiling_z;
    }
    if (actors_[slot].velocity_z != 0 || actors_[slot].z != actors_[slot].floor_z) {
      if (actors_[slot].velocity_z != 0 || !(*catalog_)[actors_[slot].type].no_gravity)
        movement.move_vertically(slot);
    }
    Actor& actor = actors_[slot];
    if (alive_player && actor.velocity_x == 0 && actor.velocity_y == 0 &&
        actor.frame_index >= kPlayerWalkFrame && actor.frame_index < kPlayerDeathFrame &&
        !PlayerThinker::pushes(pressed(player)))
      set_frame(actor, kPlayerIdleFrame);
    advance_frames(actor);
  }

  if (scripts_ != nullptr) scripts_->on_tic(*this);
  compact();
  ++tic_count_;
}

// ---------------------------------------------------------------- read side

uint32_t World::sector_at(Fixed x, Fixed y) const { return index_->sectors.sector_at(x, y); }

int32_t World::exported(int index) const {
  return index >= 0 && static_cast<std::size_t>(index) < exported_.size()
             ? exported_[static_cast<std::size_t>(index)]
             : 0;
}

int World::count_actors(uint32_t type) const { return type < type_counts_.size() ? type_counts_[type] : 0; }

uint64_t World::hash() const {
  uint64_t state = kGoldenGamma;
  const auto add = [&state](auto value) {
    state = mix64(state ^ static_cast<uint64_t>(value)) + kGoldenGamma;
  };
  const auto add_pair = [&](auto high, auto low) {
    add(static_cast<uint64_t>(static_cast<uint32_t>(high)) << 32 | static_cast<uint32_t>(low));
  };
  add(tic_count_);
  add_pair(next_actor_id_, level_exited_);
  add(rng_.state());
  for (const Actor& actor : actors_) {
    add_pair(actor.id, actor.type);
    add_pair(actor.x, actor.y);
    add_pair(actor.z, actor.angle);
    add_pair(actor.velocity_x, actor.velocity_y);
    add_pair(actor.velocity_z, actor.sector_index);
    add_pair(actor.radius, actor.height);
    add_pair(actor.floor_z, actor.ceiling_z);
    add_pair(actor.health, actor.thing_id);
    add_pair(int32_t{actor.frame_index} << 16 | uint16_t(actor.frame_tics), actor.player_index);
    add_pair(actor.removed, actor.is_corpse);
  }
  for (const Player& player : players_) {
    add_pair(player.actor_id, player.health);
    add_pair(player.armor, player.alive);
    add_pair(player.turn_held_tics, player.jump_tics);
    add_pair(player.damage_flash, player.bonus_flash);
    add_pair(player.view_height, player.view_z);
    add_pair(player.view_height_delta, player.damage_taken);
    add_pair(player.pickup_count, 0);
    add(player.death_tic);
  }
  for (const Sector& sector : sectors_) {
    add_pair(sector.floor_height, sector.ceiling_height);
    add_pair(sector.light, sector.special);
    add_pair(sector.damage_amount, sector.damage_interval);
  }
  for (int32_t value : exported_) add(static_cast<uint32_t>(value));
  return state;
}

// ---------------------------------------------------------------- what scripts do

std::optional<uint32_t> World::spawn(uint32_t type, Fixed x, Fixed y, Fixed z, Angle angle, int32_t thing_id,
                                     bool force) {
  if (type >= catalog_->size() || (!force && !index_->outline.contains(x, y))) return std::nullopt;
  const std::size_t slot = append_actor(type, x, y, z, angle, thing_id);
  if (!force) {
    const PositionCheck check = Movement(*this).check_position(slot, x, y, false);
    const Actor& actor = actors_[slot];
    if (!check.fits || z < check.floor_z || int64_t{z} + actor.height > check.ceiling_z) {
      unlink(slot);
      --type_counts_[type];
      actors_.pop_back();
      links_.pop_back();
      --next_actor_id_;
      return std::nullopt;
    }
    actors_[slot].floor_z = check.floor_z, actors_[slot].ceiling_z = check.ceiling_z;
  }
  return actors_[slot].id;
}

void World::remove(uint32_t actor_id) {
  const std::optional<std::size_t> slot = slot_of(actor_id);
  if (!slot || actors_[*slot].player_index >= 0) return;  // a player's body stays
  remove_slot(*slot);
}

bool World::try_teleport(uint32_t actor_id, Fixed x, Fixed y) {
  const std::optional<std::size_t> slot = slot_of(actor_id);
  if (!slot || !index_->outline.contains(x, y)) return false;  // no line is touched deep inside a pillar
  Movement movement(*this);
  const PositionCheck check = movement.check_position(*slot, x, y, false);
  Actor& actor = actors_[*slot];
  if (!check.fits || int64_t{check.ceiling_z} - check.floor_z < actor.height) return false;
  const bool on_ground = actor.z <= actor.floor_z;
  const Fixed z = on_ground ? check.floor_z : std::max(actor.z, check.floor_z);
  if (int64_t{z} + actor.height > check.ceiling_z) return false;
  movement.place(*slot, x, y, check);
  actor.z = z;
  return true;
}

void World::set_position(uint32_t actor_id, Fixed x, Fixed y, Fixed z) {
  const std::optional<std::size_t> slot = slot_of(actor_id);
  if (!slot) return;
  PositionCheck check;
  check.sector_index = sector_at(x, y);
  check.floor_z = sectors_[check.sector_index].floor_height;
  check.ceiling_z = sectors_[check.sector_index].ceiling_height;
  Movement(*this).place(*slot, x, y, check);
  actors_[*slot].z = z;
}

void World::set_angle(uint32_t actor_id, Angle angle) {
  if (Actor* actor = find_live(actor_id)) actor->angle = angle;
}

void World::set_sector_damage(int32_t tag, int32_t amount, int32_t interval) {
  for (Sector& sector : sectors_) {
    if (sector.tag != tag) continue;
    sector.damage_amount = amount;
    sector.damage_interval = interval;
  }
}

void World::damage_player(int player_index, int32_t amount) {
  if (player_index < 0 || player_index >= player_count() || amount <= 0) return;
  Player& player = players_[static_cast<std::size_t>(player_index)];
  if (!player.alive) return;
  amount = std::min(amount, 1'000'000);
  player.health -= amount;
  player.damage_taken += amount;
  player.damage_flash = std::min(player.damage_flash + amount, kDamageFlashMax);
  if (Actor* body = find_live(player.actor_id)) body->health = std::max(player.health, 0);
  if (player.health > 0) return;

  player.health = 0;
  player.alive = false;
  player.death_tic = tic_count_;
  if (const std::optional<std::size_t> slot = slot_of(player.actor_id)) {
    Actor& body = actors_[*slot];
    unlink(*slot);
    body.is_corpse = true;  // no longer solid; inertia and gravity go on
    body.height /= 4;
    set_frame(body, kPlayerDeathFrame);
  }
  if (scripts_ != nullptr) scripts_->on_death(*this, player_index);
}

void World::set_export(int index, int32_t value) {
  if (index >= 0 && static_cast<std::size_t>(index) < exported_.size())
    exported_[static_cast<std::size_t>(index)] = value;
}

void World::exit_level() { level_exited_ = true; }

}  // namespace comrad::doom
