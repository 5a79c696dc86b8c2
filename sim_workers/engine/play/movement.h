// How bodies move: position checks against linedefs and things, steps, sliding along walls, friction and
// gravity. Works on one World. Stage: tic.
#pragma once

#include <cstddef>
#include <cstdint>

#include "sim_workers/engine/map/blockmap.h"
#include "sim_workers/engine/play/world.h"

namespace comrad::doom {

constexpr Fixed kStepUpMax = to_fixed(24);
constexpr Fixed kGravity = kFracUnit;      ///< units/tic^2
constexpr Fixed kGroundFriction = 0xE800;  ///< factor per tic, 0.90625
constexpr Fixed kStopSpeed = 0x1000;       ///< slower than this and nothing pressed: stands still
constexpr Fixed kJumpSpeed = to_fixed(8);
constexpr int kJumpDelayTics = 7;            ///< from the landing to the next jump
constexpr Fixed kSlideGap = kFracUnit / 32;  ///< of a move, kept free before a wall

/// What a body meets at a position.
struct PositionCheck {
  bool fits = true;               ///< no wall and no solid body in the way
  bool blocked_by_actor = false;  ///< the reason is a body, not a wall
  Fixed floor_z = 0;              ///< highest floor below the body, tops of solid bodies below it included
  Fixed ceiling_z = 0;            ///< lowest ceiling above it
  Fixed lowest_floor_z = 0;       ///< bottom of the deepest drop it hangs over
  uint32_t sector_index = 0;      ///< of its centre
};

/// Moves the actors of one world.
class Movement {
 public:
  explicit Movement(World& world) : world_(world) {}

  /// Looks at (x, y) for the body in `slot`. With `touch` a player takes the items it overlaps there.
  PositionCheck check_position(std::size_t slot, Fixed x, Fixed y, bool touch);

  /// Moves the body there if it fits and the step is not too high. Leaves z alone.
  bool try_move(std::size_t slot, Fixed x, Fixed y);

  /// A tic of inertia: velocity applied, slides, friction. `pushing`: its player holds a direction.
  void move_horizontally(std::size_t slot, bool pushing);

  /// A tic of gravity; floors and ceilings stop it.
  void move_vertically(std::size_t slot);

  /// Puts the body at (x, y) and renews what it stands on from `check`.
  void place(std::size_t slot, Fixed x, Fixed y, const PositionCheck& check);

 private:
  /// The wall that a corner of the body would meet first on its way by (dx, dy).
  struct WallHit {
    Fixed fraction = kFracUnit + 1;  ///< of the way; above one: none
    const BlockLine* line = nullptr;
  };

  bool check_things(std::size_t slot, Fixed x, Fixed y, bool touch, PositionCheck& check);
  bool check_lines(std::size_t slot, Fixed x, Fixed y, PositionCheck& check);
  bool line_stops(const BlockLine& line, const Actor& body) const;
  void trace_corner(int64_t x, int64_t y, Fixed dx, Fixed dy, const Actor& body, WallHit& hit) const;
  void slide_along_walls(std::size_t slot, Fixed dx, Fixed dy, int steps);
  void slide_along_body(std::size_t slot, Fixed x, Fixed y);
  void touch_item(std::size_t body_slot, std::size_t item_slot);

  World& world_;
  bool blocked_by_actor_ = false;  // why the last try_move failed
};

}  // namespace comrad::doom
