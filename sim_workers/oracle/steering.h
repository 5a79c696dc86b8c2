// From "go there, look there" to the buttons of one decision. Stage: step.
#pragma once

#include "sim_workers/engine/world/world.h"

namespace comrad::sim {

inline constexpr double kPlayerRadius = 16;  ///< map units

/// A place of the map, in map units.
struct Place {
  double x = 0, y = 0;
};

/// The rectangle around one of a level's sectors, as the map was drawn.
struct Extent {
  Place low, high;
  Place middle() const { return {(low.x + high.x) / 2, (low.y + high.y) / 2}; }
};
Extent extent_of(const doom::Level& level, std::size_t sector);

double distance_between(Place a, Place b);
Place place_of(const doom::Actor& actor);
/// The angle from one place to another, degrees, counter-clockwise from east, in (-180, 180].
double bearing_degrees(Place from, Place to);
/// `angle` brought into (-180, 180].
double wrap_degrees(double angle);
double angle_degrees(const doom::Actor& actor);

/// What the scenario's heads leave an oracle to walk with.
struct Gait {
  bool strafes = true;      ///< MOVE_LEFT and MOVE_RIGHT exist
  bool backward = true;     ///< MOVE_BACKWARD exists
  bool runs = false;        ///< hold SPEED as well (it must be a button of the scenario)
  double stop_units = 4.0;  ///< within this distance it stands still
};

/// Turns towards `bearing` when it is off by more than `slack_degrees`; true when it looks there. A
/// decision's smallest turn is some 7 degrees (four tics of slow turning).
bool turn_to(const doom::Actor& body, double bearing, doom::Buttons& buttons, double slack_degrees = 4.0);

/// Turns towards `bearing` as exactly as a decision's turns allow: looks a few decisions ahead for the
/// sequence of turns (of some 7, 12 or 14 degrees, by how long a turn has been held) that ends nearest to it.
/// Returns how far off the body looks now, degrees, without a sign.
double aim_at(const doom::Player& player, const doom::Actor& body, double bearing, doom::Buttons& buttons);

/// True where nothing but actors stands between the two.
bool sees(const doom::World& world, const doom::Actor& looker, const doom::Actor& target);

/// True where no wall (a one-sided line) stands between two places; heights do not count, and a wall that
/// only touches the line between them does not either. For aiming where a body will be, not where it is.
bool is_clear(const doom::World& world, Place from, Place to);

/// Walks to `goal` without changing where it looks where it strafes: the best of eight directions; otherwise
/// turns and walks ahead. True when it is there.
bool walk_to(const doom::Actor& body, Place goal, const Gait& gait, doom::Buttons& buttons);

/// As walk_to(), and turns towards the goal on the way, which makes long ways faster and straighter.
bool go_to(const doom::Actor& body, Place goal, const Gait& gait, doom::Buttons& buttons);

/// Notices a body that pushes and does not get on, against a corner or a partner, and makes it sidestep for a
/// while. One per agent.
class Sidestep {
 public:
  /// Call once per decision after the buttons were chosen; may replace what they do to walk.
  void apply(const doom::Actor& body, doom::Buttons& buttons);

 private:
  Place last_{1e9, 1e9};
  int stuck_decisions_ = 0, left_decisions_ = 0, turn_ = 0;
};

}  // namespace comrad::sim
