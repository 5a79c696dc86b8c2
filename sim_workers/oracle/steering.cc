#include "sim_workers/oracle/steering.h"

#include <algorithm>
#include <cmath>

#include "sim_workers/engine/play/sight.h"

namespace comrad::sim {
namespace {

constexpr double kPi = 3.14159265358979323846;
constexpr double kGlideTics = 9.0;  // a body that lets go slides on: 0.906 / (1 - 0.906) of its velocity

/// Where the body comes to rest if it lets go now.
Place resting_place(const doom::Actor& body) {
  return {doom::to_double(body.x) + doom::to_double(body.velocity_x) * kGlideTics,
          doom::to_double(body.y) + doom::to_double(body.velocity_y) * kGlideTics};
}

// Turning, as player_thinker.cc does it: degrees of one decision of four tics.
constexpr int kDecisionTics = 4, kSlowTics = 5;
constexpr double kSlowDegrees = 320 * 360.0 / 65536, kFastDegrees = 640 * 360.0 / 65536;
double turn_of_decision(int held_tics) {
  const int slow = std::clamp(kSlowTics - held_tics, 0, kDecisionTics);
  return slow * kSlowDegrees + (kDecisionTics - slow) * kFastDegrees;
}

/// What the best of all sequences of `depth` more decisions costs: the angle missed, and a little for
/// each decision.
double best_aim(double off, int held_tics, int depth, int* first) {
  constexpr double kDecisionCost = 0.35;
  double best = std::abs(off);
  *first = 0;
  if (depth == 0 || best < 0.9) return best;
  const double turn = turn_of_decision(held_tics);
  int ignored = 0;
  for (const int way : {1, -1, 0}) {
    if (way == 0 && held_tics == 0) continue;
    const double cost = kDecisionCost + best_aim(off - way * turn, way == 0 ? 0 : held_tics + kDecisionTics,
                                                 depth - 1, &ignored);
    if (cost < best) best = cost, *first = way == 0 ? 2 : way;
  }
  return best;
}

}  // namespace

Extent extent_of(const doom::Level& level, std::size_t sector) {
  Extent extent{{1e9, 1e9}, {-1e9, -1e9}};
  for (const uint32_t line : level.sector_linedefs[sector])
    for (const uint32_t end : {level.linedefs[line].start, level.linedefs[line].end}) {
      const double x = doom::to_double(level.vertices[end].x), y = doom::to_double(level.vertices[end].y);
      extent.low = {std::min(extent.low.x, x), std::min(extent.low.y, y)};
      extent.high = {std::max(extent.high.x, x), std::max(extent.high.y, y)};
    }
  return extent;
}

double distance_between(Place a, Place b) { return std::hypot(a.x - b.x, a.y - b.y); }
Place place_of(const doom::Actor& actor) { return {doom::to_double(actor.x), doom::to_double(actor.y)}; }
double bearing_degrees(Place from, Place to) {
  return std::atan2(to.y - from.y, to.x - from.x) * 180.0 / kPi;
}
double wrap_degrees(double angle) {
  angle = std::fmod(angle, 360.0);
  if (angle <= -180.0) angle += 360.0;
  return angle > 180.0 ? angle - 360.0 : angle;
}
double angle_degrees(const doom::Actor& actor) {
  return wrap_degrees(doom::angle_to_radians(actor.angle) * 180.0 / kPi);
}

bool turn_to(const doom::Actor& body, double bearing, doom::Buttons& buttons, double slack_degrees) {
  const double off = wrap_degrees(bearing - angle_degrees(body));
  if (std::abs(off) <= slack_degrees) return true;
  (off > 0 ? buttons.turn_left : buttons.turn_right) = true;
  return false;
}

double aim_at(const doom::Player& player, const doom::Actor& body, double bearing, doom::Buttons& buttons) {
  constexpr double kFarDegrees = 45;
  constexpr int kDepth = 5;
  const double off = wrap_degrees(bearing - angle_degrees(body));
  int first = off > 0 ? 1 : -1;
  if (std::abs(off) < kFarDegrees) best_aim(off, player.turn_held_tics, kDepth, &first);
  if (first == 1) buttons.turn_left = true;
  if (first == -1) buttons.turn_right = true;
  return std::abs(off);
}

bool sees(const doom::World& world, const doom::Actor& looker, const doom::Actor& target) {
  // Looking changes nothing; the engine's function takes a World that it could change like all
  // its neighbours.
  return doom::can_see(const_cast<doom::World&>(world), looker, target);
}

bool is_clear(const doom::World& world, Place from, Place to) {
  const doom::Level& level = world.level();
  const auto place = [&](uint32_t vertex) {
    return Place{doom::to_double(level.vertices[vertex].x), doom::to_double(level.vertices[vertex].y)};
  };
  const auto side = [](Place a, Place b, Place c) {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
  };
  return std::none_of(level.linedefs.begin(), level.linedefs.end(), [&](const doom::Linedef& line) {
    if (line.back) return false;
    const Place a = place(line.start), b = place(line.end);
    return side(from, to, a) * side(from, to, b) < 0 && side(a, b, from) * side(a, b, to) < 0;
  });
}

bool walk_to(const doom::Actor& body, Place goal, const Gait& gait, doom::Buttons& buttons) {
  if (distance_between(place_of(body), goal) <= gait.stop_units) return true;
  if (gait.runs) buttons.speed = true;
  // Steer by where the body would come to rest, so that it neither overshoots nor circles.
  const Place rest = resting_place(body);
  if (distance_between(rest, goal) <= gait.stop_units) return false;
  const double off = wrap_degrees(bearing_degrees(rest, goal) - angle_degrees(body));
  if (gait.strafes && gait.backward) {
    // Eight sectors of 45 degrees.
    if (std::abs(off) < 67.5) buttons.forward = true;
    if (std::abs(off) > 112.5) buttons.backward = true;
    if (off > 22.5 && off < 157.5) buttons.left = true;
    if (off < -22.5 && off > -157.5) buttons.right = true;
    return false;
  }
  if (gait.backward && std::abs(off) > 135 && distance_between(rest, goal) < 96) {
    buttons.backward = true;
    turn_to(body, bearing_degrees(rest, goal) + 180.0, buttons, 10.0);
    return false;
  }
  turn_to(body, bearing_degrees(rest, goal), buttons, 8.0);
  if (std::abs(off) < 35) buttons.forward = true;
  if (gait.strafes && std::abs(off) > 20 && std::abs(off) < 110)
    (off > 0 ? buttons.left : buttons.right) = true;
  return false;
}

bool go_to(const doom::Actor& body, Place goal, const Gait& gait, doom::Buttons& buttons) {
  const bool there = walk_to(body, goal, gait, buttons);
  if (there || !gait.strafes || !gait.backward || distance_between(place_of(body), goal) < 64) return there;
  // The pushes forward and to a side add up: the fastest way is askance, 45 degrees off to either side.
  const double bearing = bearing_degrees(place_of(body), goal);
  const double off = wrap_degrees(bearing - angle_degrees(body));
  turn_to(body, bearing + (off > 0 ? -45.0 : 45.0), buttons, 8.0);
  return false;
}

void Sidestep::apply(const doom::Actor& body, doom::Buttons& buttons) {
  constexpr int kPatienceDecisions = 4, kSidestepDecisions = 6;
  constexpr double kProgressUnits = 3.0;
  const Place here = place_of(body);
  const bool pushes = buttons.forward || buttons.backward || buttons.left || buttons.right;
  stuck_decisions_ = pushes && distance_between(here, last_) < kProgressUnits ? stuck_decisions_ + 1 : 0;
  last_ = here;
  if (stuck_decisions_ >= kPatienceDecisions && left_decisions_ == 0) {
    left_decisions_ = kSidestepDecisions;
    turn_ = (turn_ + 3) % 8;  // another way each time, all eight in turn
    stuck_decisions_ = 0;
  }
  if (left_decisions_ == 0) return;
  --left_decisions_;
  buttons.forward = turn_ == 0 || turn_ == 1 || turn_ == 7;
  buttons.backward = turn_ >= 3 && turn_ <= 5;
  buttons.left = turn_ >= 1 && turn_ <= 3;
  buttons.right = turn_ >= 5;
}

}  // namespace comrad::sim
