#include "sim_workers/engine/play/sight.h"

#include <algorithm>
#include <cstdlib>

#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/world/polyobject_lines.h"

namespace comrad::doom {
namespace {

constexpr int64_t kPieceUnits = 2 * Blockmap::kCellUnits;
constexpr int64_t kSteepestSlope = int64_t{1} << 62;  // more than any two heights can make

/// The way of a look, and the slopes that are still open. A slope is the rise over the whole way, in 16.16.
struct Look {
  BlockLine way;  // only its ends count
  int64_t eye_z = 0;
  int64_t top = 0, bottom = 0;
};

__int128 side_area(const BlockLine& line, int64_t x, int64_t y) {
  return static_cast<__int128>(line.dy()) * (x - line.x1) - static_cast<__int128>(line.dx()) * (y - line.y1);
}

/// Rise over the whole way of something `rise` above the eye at near/whole of the way.
int64_t slope_at(int64_t rise, __int128 near_area, __int128 whole_area) {
  const __int128 slope = static_cast<__int128>(rise) * whole_area / near_area;
  return static_cast<int64_t>(std::clamp<__int128>(slope, -kSteepestSlope, kSteepestSlope));
}

/// False where the line ends the look. The order in which lines come does not matter.
bool looks_past(const World& world, const BlockLine& line, Look& look) {
  // Ends that lie on the other's line count as in front of it: of two walls that share a corner on the way,
  // one stops it.
  __int128 start = side_area(line, look.way.x1, look.way.y1), end = side_area(line, look.way.x2, look.way.y2);
  if ((start >= 0) == (end >= 0)) return true;
  if ((look.way.side_of(line.x1, line.y1) >= 0) == (look.way.side_of(line.x2, line.y2) >= 0)) return true;

  const uint32_t flags = world.lines()[line.linedef_index].flags;
  if (line.back_sector < 0 || (flags & kLineTwoSided) == 0) return false;
  if ((flags & (kLineBlockSight | kLineBlockEverything)) != 0) return false;
  const Sector& front = world.sectors()[static_cast<std::size_t>(line.front_sector)];
  const Sector& back = world.sectors()[static_cast<std::size_t>(line.back_sector)];
  const Fixed ceiling_z = std::min(front.ceiling_height, back.ceiling_height);
  const Fixed floor_z = std::max(front.floor_height, back.floor_height);
  if (floor_z >= ceiling_z) return false;
  if (start == 0) return true;  // the eye is at the line itself
  if (start < 0) start = -start, end = -end;
  const __int128 whole = start - end;
  if (front.ceiling_height != back.ceiling_height)
    look.top = std::min(look.top, slope_at(ceiling_z - look.eye_z, start, whole));
  if (front.floor_height != back.floor_height)
    look.bottom = std::max(look.bottom, slope_at(floor_z - look.eye_z, start, whole));
  return look.bottom < look.top;
}

/// The box of a part of the way, a little larger so that rounding leaves nothing out.
Box box_of_piece(const BlockLine& way, int64_t piece, int64_t piece_count) {
  const int64_t from_x = way.x1 + way.dx() * piece / piece_count,
                to_x = way.x1 + way.dx() * (piece + 1) / piece_count;
  const int64_t from_y = way.y1 + way.dy() * piece / piece_count,
                to_y = way.y1 + way.dy() * (piece + 1) / piece_count;
  return {clamped_fixed(std::min(from_x, to_x) - 2), clamped_fixed(std::max(from_x, to_x) + 2),
          clamped_fixed(std::min(from_y, to_y) - 2), clamped_fixed(std::max(from_y, to_y) + 2)};
}

}  // namespace

bool can_see(World& world, const Actor& looker, const Actor& target) {
  Look look;
  look.way.x1 = looker.x, look.way.y1 = looker.y, look.way.x2 = target.x, look.way.y2 = target.y;
  look.eye_z = int64_t{looker.z} + looker.height - looker.height / 4;
  look.bottom = target.z - look.eye_z;
  look.top = look.bottom + target.height;

  // A long way is looked at piece by piece, so that the boxes stay close to it.
  const int64_t length = std::max(std::abs(look.way.dx()), std::abs(look.way.dy()));
  const int64_t piece_count = 1 + length / (kPieceUnits << kFracBits);
  const Blockmap& blockmap = world.index().blockmap;
  const bool has_polyobjects = !world.state().movers.polyobjects.empty();
  bool open = true;
  for (int64_t piece = 0; piece < piece_count && open; ++piece) {
    blockmap.for_each_line(box_of_piece(look.way, piece, piece_count), [&](const BlockLine& line) {
      if (has_polyobjects && world.level().linedefs[line.linedef_index].in_polyobject) return true;
      return open = looks_past(world, line, look);
    });
  }
  if (!open || !has_polyobjects) return open;
  const Box whole = box_of_piece(look.way, 0, 1);
  return for_each_polyobject_line(world, whole.left, whole.right, whole.bottom, whole.top,
                                  [&](uint32_t index, Fixed x1, Fixed y1, Fixed x2, Fixed y2) {
                                    BlockLine line = blockmap.lines()[index];
                                    line.x1 = x1, line.y1 = y1, line.x2 = x2, line.y2 = y2;
                                    return looks_past(world, line, look);
                                  });
}

bool can_notice(World& world, const Actor& looker, const Actor& target) {
  if (!looker.has(ActorFlag::kSeeInvisible) &&
      (target.has(ActorFlag::kInvisible) || target.render_style == RenderStyle::kNone) &&
      world.random_byte() > 50)
    return false;
  return can_see(world, looker, target);
}

void alert_monsters(World& world, const Actor& target, const Actor& emitter, Fixed distance_max) {
  // Sectors reached without a line that blocks sound come first, then those behind one of them.
  WorldState& state = world.state();
  const Level& level = world.level();
  constexpr uint8_t kNotReached = 2;
  std::vector<uint8_t>& blocks = state.sound_blocks;
  std::vector<uint32_t>&now = state.sound_queue, &later = state.sound_queue_later;
  blocks.assign(state.sectors.size(), kNotReached);
  now.clear(), later.clear();
  blocks[emitter.sector_index] = 0;
  now.push_back(emitter.sector_index);
  const auto spread = [&](uint8_t passed) {
    for (std::size_t head = 0; head < now.size(); ++head) {
      const uint32_t sector = now[head];
      state.sector_sound_target[sector] = target.id;
      state.sector_sound_tic[sector] = state.tic_count;
      for (const uint32_t line_index : level.sector_linedefs[sector]) {
        const Linedef& linedef = level.linedefs[line_index];
        const uint32_t flags = state.lines[line_index].flags;
        if (!linedef.back || (flags & kLineTwoSided) == 0) continue;
        const uint32_t front = level.sidedefs[linedef.front].sector_index;
        const uint32_t back = level.sidedefs[*linedef.back].sector_index;
        const uint32_t other = front == sector ? back : front;
        if (blocks[other] != kNotReached) continue;
        if (std::min(state.sectors[front].ceiling_height, state.sectors[back].ceiling_height) <=
            std::max(state.sectors[front].floor_height, state.sectors[back].floor_height))
          continue;  // a shut door
        if ((flags & kLineSoundBlock) == 0) {
          blocks[other] = passed;
          now.push_back(other);
        } else if (passed == 0) {
          later.push_back(other);
        }
      }
    }
  };
  spread(0);
  now.clear();
  for (const uint32_t sector : later) {
    if (blocks[sector] != kNotReached) continue;
    blocks[sector] = 1;
    now.push_back(sector);
  }
  spread(1);

  for (Actor& actor : state.actors) {
    if (actor.removed || blocks[actor.sector_index] == kNotReached || actor.id == target.id) continue;
    if (distance_max > 0 &&
        approximate_distance(int64_t{actor.x} - emitter.x, int64_t{actor.y} - emitter.y) > distance_max)
      continue;
    actor.last_heard_id = target.id;
  }
}

}  // namespace comrad::doom
