// How bodies move: position checks against linedefs and things, steps, sliding along walls, friction and
// gravity. Works on one World. Stage: tic.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "sim_workers/engine/map/blockmap.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

constexpr Fixed kStepUpMax = to_fixed(24);
constexpr Fixed kGravity = kFracUnit;      ///< units/tic^2
constexpr Fixed kGroundFriction = 0xE800;  ///< factor per tic, 0.90625
constexpr Fixed kStopSpeed = 0x1000;       ///< slower than this and nothing pressed: stands still
constexpr Fixed kJumpSpeed = to_fixed(8);
constexpr int kJumpDelayTics = 7;             ///< from a landing to the next jump
constexpr Fixed kHardLanding = to_fixed(-8);  ///< faster ones delay a jump and bend the eye down
constexpr Fixed kSlideGap = kFracUnit / 32;   ///< of a move, kept free before a wall
constexpr std::size_t kTouchedLinesMax = 16;

/// A move, or a wall from its start to its end.
struct Way {
  int64_t x = 0, y = 0;  ///< where it begins
  int64_t dx = 0, dy = 0;
};

/// The part of `way` after which it meets the endless line of `other`: 16.16, rounded to nearest, halves to even;
/// negative where it leads away; 0 where both are parallel; cut off at 2^61.
int64_t meeting_fraction(const Way& way, const Way& other);

/// Turns `move`, of a body whose centre is where it begins, along a wall. The result is the projection on the wall,
/// but made of rounded fractions, as measured in ViZDoom 1.3.2: those of the wall at which the body stands and at
/// which the move would meet it, and the fraction of the move that this takes.
void turn_along(const Way& wall, Way& move);

/// What a body meets at a position.
struct PositionCheck {
  bool fits = true;               ///< no wall and no solid body in the way
  bool blocked_by_actor = false;  ///< the reason is a body, not a wall
  bool steps_onto_actor = false;  ///< a body in the way is low enough to step onto
  uint32_t blocking_actor_id = 0;
  int32_t blocking_line = -1;
  Fixed floor_z = 0;                ///< highest floor below the body, tops of solid bodies below it included
  Fixed ceiling_z = 0;              ///< lowest ceiling above it
  Fixed ground_z = 0, roof_z = 0;   ///< floor_z and ceiling_z without bodies
  Fixed lowest_floor_z = 0;         ///< bottom of the deepest drop it hangs over
  uint32_t sector_index = 0;        ///< of its centre
  uint32_t floor_sector_index = 0;  ///< that gives floor_z
  int32_t ceiling_line = -1;        ///< line that lowers the ceiling, for missiles that vanish in the sky
  std::array<uint32_t, kTouchedLinesMax> touched_lines{};  ///< with specials, two-sided
  std::size_t touched_count = 0;
};

/// How a monster's or missile's step went.
struct MoveResult {
  bool moved = false;
  bool float_ok = false;       ///< it would fit at another height
  int32_t blocking_line = -1;  ///< linedef in the way
  uint32_t blocking_actor_id = 0;
  Fixed floor_z = 0;  ///< at the requested place
  explicit operator bool() const { return moved; }
};

/// Moves the actors of one world.
class Movement {
 public:
  explicit Movement(World& world) : world_(world), state_(world.state()) {}

  /// Looks at (x, y) for the body in `slot`. With `touch` a body that picks up takes the items it overlaps
  /// there, and a missile strikes what it meets.
  PositionCheck check_position(std::size_t slot, Fixed x, Fixed y, bool touch);

  /// The same without regard to bodies.
  PositionCheck check_walls(std::size_t slot, Fixed x, Fixed y);

  /// Whether a step there is not too high and leaves it room. A player takes what lies there.
  bool could_step_to(std::size_t slot, Fixed x, Fixed y);

  /// Moves the body there if it fits and the step is not too high. Leaves z alone. Lines it crosses act.
  bool try_move(std::size_t slot, Fixed x, Fixed y);
  MoveResult try_move_with_result(std::size_t slot, Fixed x, Fixed y);

  /// A tic of inertia: velocity applied, slides, friction. `pushing`: its player holds a direction. `stood_on_body`: it began the tic
  /// on top of another, which slows it as ground does even where it leaves it.
  void move_horizontally(std::size_t slot, bool pushing, bool stood_on_body);

  /// A tic of gravity; floors and ceilings stop it. `left_ledge`: it stood until this tic's way led off the
  /// floor, and gravity counts twice in this tic (as in ZDoom; not for who jumps).
  void move_vertically(std::size_t slot, bool left_ledge);

  /// Looks anew which bodies below and above hold the one in `slot`; its ground stays as it is.
  void look_for_bodies(std::size_t slot);

  /// Ends a missile at what the last try_move met: a line may act, the sky swallows it.
  void stop_missile(std::size_t slot);

  /// Puts the body at (x, y) and renews what it stands on from `check`.
  void place(std::size_t slot, Fixed x, Fixed y, const PositionCheck& check);

 private:
  /// The wall that a corner of the body would meet first on its way by (dx, dy).
  struct WallHit {
    Fixed fraction = kFracUnit + 1;  ///< of the way; above one: none
    bool found = false;
    Way wall;
  };

  MoveResult attempt_move(std::size_t slot, Fixed x, Fixed y);
  bool check_things(std::size_t slot, Fixed x, Fixed y, bool touch, PositionCheck& check);
  bool check_lines(std::size_t slot, Fixed x, Fixed y, PositionCheck& check);
  bool check_line(const BlockLine& line, const Actor& body, PositionCheck& check);
  bool line_stops(const BlockLine& line, uint32_t flags, const Actor& body) const;
  /// A missile meets a body: true where it flies on.
  bool missile_passes(Actor& missile, Actor& other);
  void trace_corner(int64_t x, int64_t y, Fixed dx, Fixed dy, const Actor& body, WallHit& hit) const;
  void slide_along_walls(std::size_t slot, Fixed dx, Fixed dy, int steps);
  void slide_along_body(std::size_t slot, Fixed x, Fixed y);
  void cross_lines(std::size_t slot, Fixed old_x, Fixed old_y, const PositionCheck& check);

  World& world_;
  WorldState& state_;
  PositionCheck last_;        // of the last try_move
  uint32_t last_ripped_ = 0;  // a ripper hurts each body once a tic
};

/// A step of a monster: no deep drops, doors are remembered. Floating ones may adjust their
/// height afterwards.
MoveResult try_move_monster(World& world, Actor& monster, Fixed x, Fixed y);

/// What the ground does to a body on it. Of several sectors of ice or mud under its box the one of the lowest friction counts; a
/// sector whose floor is below its feet does not.
struct Footing {
  Fixed friction = kGroundFriction;
  int32_t move_factor = kSectorMoveFactor;
};
Footing footing_of(const World& world, const Actor& body);

/// The floor and the ceiling at a point, without regard to what a body there would touch.
PositionCheck opening_of_point(const World& world, Fixed x, Fixed y);

/// True where nothing is in the way of a body that was put somewhere. Its height is held against the floor and
/// the ceiling of its centre, so a script may put it half into a ledge (measured: ViZDoom 1.3.2,
/// `SetActorPosition` with 15 of 16 units of the radius over a floor 100 higher), and against the opening under
/// its box, so not half into a shut door. No body is in a player's way (measured: Thing_Move and SetActorPosition onto barrels,
/// pillars and monsters).
bool fits_here(World& world, Actor& actor);

}  // namespace comrad::doom
