#include "sim_workers/engine/play/movement.h"

#include <algorithm>
#include <array>
#include <cstdlib>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/play/pickups.h"

namespace comrad::doom {
namespace {

constexpr int kSlideTries = 2;
constexpr std::size_t kItemsPerMove = 32;  // more within one body's reach wait for the next move

/// Bodies that already overlap do not hold each other: a move that brings them no nearer is free.
bool moves_apart(const Actor& body, const Actor& other, Fixed x, Fixed y) {
  const int64_t reach = int64_t{body.radius} + other.radius;
  const auto distance = [&](Fixed from_x, Fixed from_y) {
    return std::max(std::abs(int64_t{from_x} - other.x), std::abs(int64_t{from_y} - other.y));
  };
  const int64_t present = distance(body.x, body.y);
  return present < reach && distance(x, y) >= present && (x != body.x || y != body.y);
}

/// The part of (dx, dy) that runs along `line`.
void project_on(const BlockLine& line, Fixed& dx, Fixed& dy) {
  if (line.dy() == 0) {
    dy = 0;
  } else if (line.dx() == 0) {
    dx = 0;
  } else {
    const __int128 length_squared =
        static_cast<__int128>(line.dx()) * line.dx() + static_cast<__int128>(line.dy()) * line.dy();
    const __int128 along = static_cast<__int128>(line.dx()) * dx + static_cast<__int128>(line.dy()) * dy;
    dx = static_cast<Fixed>(along * line.dx() / length_squared);
    dy = static_cast<Fixed>(along * line.dy() / length_squared);
  }
}

}  // namespace

bool Movement::line_stops(const BlockLine& line, const Actor& body) const {
  if (line.back_sector < 0 || (line.flags & (kLineBlocking | kLineBlockEverything)) != 0) return true;
  const bool is_monster = body.player_index < 0 && world_.catalog()[body.type].shootable;
  return is_monster && (line.flags & kLineBlockMonsters) != 0;
}

bool Movement::check_things(std::size_t slot, Fixed x, Fixed y, bool touch, PositionCheck& check) {
  const ActorType& type = world_.catalog()[world_.actors_[slot].type];
  const bool body_solid = type.solid && !world_.actors_[slot].is_corpse;
  const bool takes_items = touch && world_.actors_[slot].player_index >= 0 && !world_.actors_[slot].is_corpse;
  if (!body_solid && !takes_items) return true;

  const Fixed radius = world_.actors_[slot].radius;
  const Blockmap& blockmap = world_.index_->blockmap;
  const Box reach = Box::around(x, y, radius + world_.radius_max_);
  // Items are taken after the scan, because taking one runs a script that may change the lists.
  std::array<std::size_t, kItemsPerMove> items;
  std::size_t item_count = 0;
  bool fits = true;
  const int first_column = blockmap.column_of(reach.left), last_column = blockmap.column_of(reach.right);
  const int first_row = blockmap.row_of(reach.bottom), last_row = blockmap.row_of(reach.top);
  for (int row = first_row; row <= last_row && fits; ++row) {
    for (int column = first_column; column <= last_column && fits; ++column) {
      int32_t next = world_.cell_heads_[static_cast<std::size_t>(row) * blockmap.columns() + column];
      while (next >= 0) {
        const auto other_slot = static_cast<std::size_t>(next);
        next = world_.links_[other_slot].next;
        if (other_slot == slot) continue;
        const Actor& other = world_.actors_[other_slot];
        const int64_t distance = int64_t{other.radius} + radius;
        if (std::abs(int64_t{other.x} - x) >= distance || std::abs(int64_t{other.y} - y) >= distance)
          continue;
        const ActorType& other_type = world_.catalog()[other.type];
        if (other_type.pickup) {
          if (takes_items && item_count < items.size()) items[item_count++] = other_slot;
          continue;
        }
        // Missiles, crushers and monsters hook in here.
        if (!body_solid || !other_type.solid || other.is_corpse) continue;
        const Actor& body = world_.actors_[slot];
        if (body.z >= other.z + other.height) {
          check.floor_z = std::max(check.floor_z, other.z + other.height);
        } else if (body.z + body.height <= other.z) {
          check.ceiling_z = std::min(check.ceiling_z, other.z);
        } else if (!moves_apart(body, other, x, y)) {
          check.blocked_by_actor = true;
          check.fits = fits = false;
          break;
        }
      }
    }
  }
  for (std::size_t i = 0; i < item_count; ++i) touch_item(slot, items[i]);
  return fits;
}

bool Movement::check_lines(std::size_t slot, Fixed x, Fixed y, PositionCheck& check) {
  const Actor& body = world_.actors_[slot];
  const Box box = Box::around(x, y, body.radius);
  world_.index_->blockmap.for_each_line(box, [&](const BlockLine& line) {
    if (!line.crosses(box)) return true;
    if (line_stops(line, body)) {
      check.fits = false;
      return false;
    }
    const Sector& front = world_.sectors_[static_cast<std::size_t>(line.front_sector)];
    const Sector& back = world_.sectors_[static_cast<std::size_t>(line.back_sector)];
    check.ceiling_z = std::min({check.ceiling_z, front.ceiling_height, back.ceiling_height});
    check.floor_z = std::max({check.floor_z, front.floor_height, back.floor_height});
    check.lowest_floor_z = std::min({check.lowest_floor_z, front.floor_height, back.floor_height});
    return true;
  });
  return check.fits;
}

PositionCheck Movement::check_position(std::size_t slot, Fixed x, Fixed y, bool touch) {
  PositionCheck check;
  check.sector_index = world_.index_->sectors.sector_at(x, y);
  const Sector& sector = world_.sectors_[check.sector_index];
  check.floor_z = check.lowest_floor_z = sector.floor_height;
  check.ceiling_z = sector.ceiling_height;
  // Things first, as in Doom: an item is taken even where a wall then refuses the move.
  if (check_things(slot, x, y, touch, check)) check_lines(slot, x, y, check);
  return check;
}

void Movement::place(std::size_t slot, Fixed x, Fixed y, const PositionCheck& check) {
  Actor& body = world_.actors_[slot];
  world_.unlink(slot);
  body.x = x, body.y = y;
  body.floor_z = check.floor_z, body.ceiling_z = check.ceiling_z;
  body.sector_index = check.sector_index;
  world_.link(slot);
}

bool Movement::try_move(std::size_t slot, Fixed x, Fixed y) {
  const PositionCheck check = check_position(slot, x, y, true);
  blocked_by_actor_ = check.blocked_by_actor;
  if (!check.fits) return false;
  const Actor& body = world_.actors_[slot];
  if (int64_t{check.ceiling_z} - check.floor_z < body.height) return false;
  if (int64_t{check.ceiling_z} - body.z < body.height) return false;
  if (int64_t{check.floor_z} - body.z > kStepUpMax) return false;
  // A monster looks at lowest_floor_z here; a player may walk off any ledge. Lines that act when crossed do
  // so after place(), from the old to the new position.
  place(slot, x, y, check);
  return true;
}

void Movement::trace_corner(int64_t x, int64_t y, Fixed dx, Fixed dy, const Actor& body, WallHit& hit) const {
  const auto clamp_fixed = [](int64_t value) {
    return static_cast<Fixed>(std::clamp<int64_t>(value, INT32_MIN + 1, INT32_MAX));
  };
  const Box box = {clamp_fixed(std::min(x, x + dx) - 1), clamp_fixed(std::max(x, x + dx) + 1),
                   clamp_fixed(std::min(y, y + dy) - 1), clamp_fixed(std::max(y, y + dy) + 1)};
  world_.index_->blockmap.for_each_line(box, [&](const BlockLine& line) {
    // Does the way cross the line? Both pairs of ends on different sides.
    const int start_side = line.side_of(x, y), end_side = line.side_of(x + dx, y + dy);
    if (start_side == end_side) return true;
    const __int128 first =
        static_cast<__int128>(dy) * (line.x1 - x) - static_cast<__int128>(dx) * (line.y1 - y);
    const __int128 second =
        static_cast<__int128>(dy) * (line.x2 - x) - static_cast<__int128>(dx) * (line.y2 - y);
    if ((first > 0 && second > 0) || (first < 0 && second < 0)) return true;
    if (line.back_sector < 0) {
      if (start_side < 0) return true;  // from behind there is nothing
    } else if (!line_stops(line, body)) {
      const Sector& front = world_.sectors_[static_cast<std::size_t>(line.front_sector)];
      const Sector& back = world_.sectors_[static_cast<std::size_t>(line.back_sector)];
      const int64_t ceiling_z = std::min(front.ceiling_height, back.ceiling_height);
      const int64_t floor_z = std::max(front.floor_height, back.floor_height);
      if (ceiling_z - floor_z >= body.height && ceiling_z - body.z >= body.height &&
          floor_z - body.z <= kStepUpMax)
        return true;
    }
    __int128 numerator =
        static_cast<__int128>(line.dy()) * (x - line.x1) - static_cast<__int128>(line.dx()) * (y - line.y1);
    __int128 denominator = static_cast<__int128>(line.dx()) * dy - static_cast<__int128>(line.dy()) * dx;
    if (denominator == 0) return true;
    if (denominator < 0) numerator = -numerator, denominator = -denominator;
    // Rounded to nearest, as the traces show.
    const auto fraction =
        static_cast<int64_t>(((numerator << (kFracBits + 1)) + denominator) / (2 * denominator));
    if (fraction >= 0 && fraction < hit.fraction) hit = {static_cast<Fixed>(fraction), &line};
    return true;
  });
}

void Movement::slide_along_walls(std::size_t slot, Fixed dx, Fixed dy, int steps) {
  for (int attempt = 0; attempt < kSlideTries; ++attempt) {
    // The three corners that lead the way.
    const Actor& body = world_.actors_[slot];
    const int64_t lead_x = int64_t{body.x} + (dx > 0 ? body.radius : -body.radius);
    const int64_t lead_y = int64_t{body.y} + (dy > 0 ? body.radius : -body.radius);
    const int64_t trail_x = int64_t{body.x} - (dx > 0 ? body.radius : -body.radius);
    const int64_t trail_y = int64_t{body.y} - (dy > 0 ? body.radius : -body.radius);
    WallHit hit;
    trace_corner(lead_x, lead_y, dx, dy, body, hit);
    trace_corner(trail_x, lead_y, dx, dy, body, hit);
    trace_corner(lead_x, trail_y, dx, dy, body, hit);
    if (hit.line == nullptr) break;

    // Up to the wall, less a gap; the rest of the way along it.
    const Fixed free_fraction = hit.fraction - kSlideGap;
    if (free_fraction > 0 &&
        !try_move(slot, body.x + fixed_mul(dx, free_fraction), body.y + fixed_mul(dy, free_fraction)))
      break;
    const Fixed rest_fraction = std::min<Fixed>(kFracUnit - hit.fraction, kFracUnit);
    if (rest_fraction <= 0) return;
    // A quirk of corners: the next attempt starts from the rest of the way as it was, not as it was turned.
    dx = fixed_mul(dx, rest_fraction), dy = fixed_mul(dy, rest_fraction);
    Fixed along_x = dx, along_y = dy;
    project_on(*hit.line, along_x, along_y);
    Actor& moved = world_.actors_[slot];
    moved.velocity_x = along_x * steps, moved.velocity_y = along_y * steps;
    if (try_move(slot, moved.x + along_x, moved.y + along_y)) return;
  }
  // Wedged in, or stopped by something between the corners: one axis at a time.
  if (!try_move(slot, world_.actors_[slot].x, world_.actors_[slot].y + dy))
    try_move(slot, world_.actors_[slot].x + dx, world_.actors_[slot].y);
}

void Movement::slide_along_body(std::size_t slot, Fixed x, Fixed y) {
  if (try_move(slot, world_.actors_[slot].x, y)) {
    world_.actors_[slot].velocity_x = 0;
  } else if (try_move(slot, x, world_.actors_[slot].y)) {
    world_.actors_[slot].velocity_y = 0;
  } else {
    world_.actors_[slot].velocity_x = world_.actors_[slot].velocity_y = 0;
  }
}

void Movement::move_horizontally(std::size_t slot, bool pushing) {
  {
    const Actor& body = world_.actors_[slot];
    Fixed move_x = body.velocity_x, move_y = body.velocity_y;
    if (move_x != 0 || move_y != 0) {
      // No step longer than the body is wide, less one unit: nothing thick enough to stop it is jumped over.
      const int64_t step_max = std::max<Fixed>(body.radius - kFracUnit, to_fixed(1));
      const int64_t fastest = std::max(std::abs(int64_t{move_x}), std::abs(int64_t{move_y}));
      const auto steps = static_cast<int>(1 + fastest / step_max);
      Fixed start_x = body.x, start_y = body.y;
      int done = 0;
      for (int step = 1; step <= steps; ++step) {
        const auto x = static_cast<Fixed>(start_x + int64_t{move_x} * (step - done) / steps);
        const auto y = static_cast<Fixed>(start_y + int64_t{move_y} * (step - done) / steps);
        if (try_move(slot, x, y)) continue;
        if (blocked_by_actor_) {
          slide_along_body(slot, x, y);
        } else {
          slide_along_walls(slot, x - world_.actors_[slot].x, y - world_.actors_[slot].y, steps);
        }
        // The steps that are left go on from here with what is left of the velocity.
        const Actor& slid = world_.actors_[slot];
        move_x = slid.velocity_x, move_y = slid.velocity_y;
        start_x = slid.x, start_y = slid.y;
        done = step;
        if (move_x == 0 && move_y == 0) break;
      }
    }
  }

  Actor& body = world_.actors_[slot];
  if (body.z > body.floor_z) return;  // no friction in the air
  if (!pushing && std::abs(body.velocity_x) < kStopSpeed && std::abs(body.velocity_y) < kStopSpeed) {
    body.velocity_x = body.velocity_y = 0;
  } else {
    body.velocity_x = fixed_mul(body.velocity_x, kGroundFriction);
    body.velocity_y = fixed_mul(body.velocity_y, kGroundFriction);
  }
}

void Movement::move_vertically(std::size_t slot) {
  Actor& body = world_.actors_[slot];
  Player* player = body.player_index >= 0 && !body.is_corpse ? &world_.players_[body.player_index] : nullptr;
  if (player != nullptr && body.z < body.floor_z) {
    // Stepped up: the eye stays where it was and catches up.
    player->view_height -= body.floor_z - body.z;
    player->view_height_delta = (to_fixed(41) - player->view_height) >> 3;
  }
  body.z += body.velocity_z;
  if (body.z <= body.floor_z) {
    if (player != nullptr) {
      if (player->jump_tics < 0) player->jump_tics = kJumpDelayTics;
      if (body.velocity_z < -8 * kGravity) player->view_height_delta = body.velocity_z >> 3;
    }
    body.z = body.floor_z;
    if (body.velocity_z < 0) body.velocity_z = 0;
  } else if (!world_.catalog()[body.type].no_gravity) {
    body.velocity_z -= kGravity;
  }
  if (int64_t{body.z} + body.height > body.ceiling_z) {
    if (body.velocity_z > 0) body.velocity_z = 0;
    body.z = std::max(body.ceiling_z - body.height, body.floor_z);
  }
}

void Movement::touch_item(std::size_t body_slot, std::size_t item_slot) {
  const Actor& body = world_.actors_[body_slot];
  const Actor& item = world_.actors_[item_slot];
  if (item.removed || !within_reach(body, item)) return;
  const int player_index = body.player_index;
  if (!take_item(world_.players_[player_index], world_.catalog()[item.type])) return;
  world_.actors_[body_slot].health = world_.players_[player_index].health;
  const Actor taken = item;  // the script may spawn and move actors
  world_.remove_slot(item_slot);
  if (world_.scripts_ != nullptr) world_.scripts_->on_pickup(world_, player_index, taken);
}

}  // namespace comrad::doom
