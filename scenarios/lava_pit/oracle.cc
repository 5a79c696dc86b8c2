// The scripted team of Lava Pit: at every bridge the agent nearer to the green plate holds it, the other
// crosses and holds the red one, the first one follows.
#include <algorithm>
#include <cmath>
#include <map>

#include "scenarios/lava_pit/layout.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

namespace pit = scenarios::lava_pit;
constexpr double kTolerance = 18;  // the push of a single decision moves a body by 33 units

struct Rectangle {
  double left = 1e9, right = -1e9, bottom = 1e9, top = -1e9;
  void add(double x, double y) {
    left = std::min(left, x), right = std::max(right, x), bottom = std::min(bottom, y),
    top = std::max(top, y);
  }
  Place centre() const { return {(left + right) / 2, (bottom + top) / 2}; }
  bool holds(Place p, double margin = 0) const {
    return p.x >= left + margin && p.x <= right - margin && p.y >= bottom + margin && p.y <= top - margin;
  }
};

class Crossers final : public Oracle {
 public:
  /// The numbers of two exports.
  Crossers(int goal, int joint_best) : goal_(goal), joint_best_(joint_best) {}

  void reset(const doom::World& world) override {
    const doom::Level& level = world.level();
    sector_of_tag_.clear();
    for (std::size_t i = 0; i < level.sectors.size(); ++i) sector_of_tag_[level.sectors[i].tag] = i;
    outline_.assign(level.sectors.size(), {});
    for (const doom::Linedef& line : level.linedefs)
      for (const std::optional<uint32_t> side : {std::optional<uint32_t>(line.front), line.back}) {
        if (!side) continue;
        Rectangle& outline = outline_[level.sidedefs[*side].sector_index];
        for (const uint32_t vertex : {line.start, line.end})
          outline.add(doom::to_double(level.vertices[vertex].x), doom::to_double(level.vertices[vertex].y));
      }
    holder_ = -1, stage_ = -1;
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    const int count = world.exported(goal_), joint = world.exported(joint_best_);
    if (count < 2 || joint >= count) return;
    const int bridge = joint - 1;
    const Rectangle near = platform(bridge), far = platform(bridge + 1);
    const Place green = plate(world, pit::kGreenTag, bridge), red = plate(world, pit::kRedTag, bridge);
    if (bridge != stage_) {
      stage_ = bridge;
      following_ = false;
      holder_ =
          distance_between(place_of(world.body(0)), green) <= distance_between(place_of(world.body(1)), green)
              ? 0
              : 1;
    }
    const int crosser = 1 - holder_;
    const Place held = place_of(world.body(holder_)), other = place_of(world.body(crosser));
    const bool crosser_over = far.holds(other) && other.x > far.left + pit::kBridgeBite;
    const bool red_held = on_plate(world, pit::kRedTag, bridge, other) &&
                          on_plate(world, pit::kRedTag, bridge, resting_place(world.body(crosser)), 4);
    const bool is_up = bridge_floor(world, bridge) >= 0;

    // The holder stays until the red plate is taken over, then follows.
    const double follow_lane = lane(bridge, other.y);
    const Place beyond{far.left + pit::kBridgeBite + 40, follow_lane};
    const bool green_held = on_plate(world, pit::kGreenTag, bridge, held);
    const double own_lane = lane(bridge, green_held ? held.y : green.y);
    const bool near_lane = std::abs(own_lane - green.y) < 50;
    // Off the plate's middle, so that the crosser gets past.
    const Place stand{green.x, green.y + (!near_lane ? 0 : own_lane > green.y ? -14 : 14)};
    following_ |= crosser_over && red_held && is_up;
    if (following_ || !near.holds(held))
      cross(world, holder_, bridge, follow_lane, beyond, buttons[holder_]);
    else
      walk(world, holder_, stand, kTolerance, buttons[holder_]);

    // The crosser waits beside the plate's way until the bridge is up.
    if (crosser_over) {
      walk(world, crosser, red, kTolerance, buttons[crosser]);
    } else if (near.holds(other) && (!is_up || !green_held)) {
      make_way(world, crosser, green, near, buttons[crosser]);
    } else {
      cross(world, crosser, bridge, own_lane, red, buttons[crosser]);
    }
  }

 private:
  /// Where a body comes to rest that lets go now.
  static Place resting_place(const doom::Actor& body) {
    constexpr double kLongGlideTics = 10.67;  // friction leaves 0.906 of the speed each tic
    return {doom::to_double(body.x) + doom::to_double(body.velocity_x) * kLongGlideTics,
            doom::to_double(body.y) + doom::to_double(body.velocity_y) * kLongGlideTics};
  }
  Rectangle outline_of_tag(int32_t tag) const {
    const auto found = sector_of_tag_.find(tag);
    return found != sector_of_tag_.end() ? outline_[found->second] : Rectangle{};
  }
  Rectangle platform(int i) const { return outline_of_tag(pit::kPlatformTag + i); }
  double bridge_floor(const doom::World& world, int i) const {
    return doom::to_double(world.sectors()[sector_of_tag_.at(pit::kBridgeTag + i)].floor_height);
  }
  /// Where the bridge can be walked along, as far as both platforms reach: past somebody who stands
  /// at `avoid_y`.
  double lane(int i, double avoid_y) const {
    constexpr double kApart = 40;
    const Rectangle bridge = outline_of_tag(pit::kBridgeTag + i), near = platform(i), far = platform(i + 1);
    const double bottom = std::max({bridge.bottom, near.bottom, far.bottom}) + kPlayerRadius + 4;
    const double top = std::min({bridge.top, near.top, far.top}) - kPlayerRadius - 4;
    const double middle = (bottom + top) / 2;
    if (bottom > top) return middle;
    double best = middle, best_cost = 1e9;
    for (double y = bottom; y <= top; y += 2) {
      const double edge = std::max(0.0, 8 - std::min(y - bottom, top - y));
      const double cost =
          4 * std::max(0.0, kApart - std::abs(y - avoid_y)) + edge + 0.05 * std::abs(y - middle);
      if (cost < best_cost) best_cost = cost, best = y;
    }
    return best;
  }
  /// The active plate of a bridge: the one that shines.
  std::size_t plate_sector(const doom::World& world, int32_t first_tag, int bridge) const {
    std::size_t sector = 0;
    for (int v = 0; v < pit::kCandidatesMax; ++v) {
      const auto found = sector_of_tag_.find(first_tag + pit::kCandidatesMax * bridge + v);
      if (found == sector_of_tag_.end()) continue;
      sector = found->second;
      if (world.sectors()[sector].floor_texture == "FLAT23") break;
    }
    return sector;
  }
  Place plate(const doom::World& world, int32_t first_tag, int bridge) const {
    return outline_[plate_sector(world, first_tag, bridge)].centre();
  }
  bool on_plate(const doom::World& world, int32_t first_tag, int bridge, Place p, double margin = 2) const {
    return outline_[plate_sector(world, first_tag, bridge)].holds(p, margin);
  }

  /// All ways lead east: it looks there, goes ahead and sidesteps, and turns round only for what lies well
  /// behind it.
  void walk(const doom::World& world, int agent, Place goal, double stop, doom::Buttons& buttons) {
    constexpr double kFarBehind = 48, kDegrees = 3.14159265358979323846 / 180;
    const doom::Actor& body = world.body(agent);
    const Place here = place_of(body);
    const Place rest = resting_place(body);
    if (goal.x < here.x - kFarBehind) {
      walk_to(body, goal, {.strafes = true, .backward = false, .stop_units = 24}, buttons);
      return;
    }
    const double angle = angle_degrees(body);
    turn_to(body, 0, buttons, 8);
    if (std::abs(angle) > 50) return;
    const double cosine = std::cos(angle * kDegrees), sine = std::sin(angle * kDegrees);
    double dx = goal.x - rest.x, dy = goal.y - rest.y;
    // A partner straight ahead: past it, on the side of the goal or where there is more room.
    const Place there = place_of(world.body(1 - agent));
    const double to_partner = there.x - here.x, beside = rest.y - there.y;
    if (to_partner > -24 && to_partner < 60 && goal.x > there.x - 20) {
      if (std::abs(beside) >= 34)
        dy = 0;  // straight past it
      else
        dy = here.y >= there.y ? 2 * kTolerance : -2 * kTolerance;
      if (to_partner < 40 && std::abs(here.y - there.y) < 33) dx = 0;
    }
    const double ahead = dx * cosine + dy * sine, left = dy * cosine - dx * sine;
    buttons.forward = ahead > stop;
    buttons.left = left > stop;
    buttons.right = left < -stop;
  }

  /// Stands still, or leaves the straight line from the partner to its plate, towards the wider side.
  void make_way(const doom::World& world, int agent, Place plate, const Rectangle& platform,
                doom::Buttons& buttons) {
    const doom::Actor& body = world.body(agent);
    const Place here = place_of(body), partner = place_of(world.body(1 - agent));
    const double length = std::max(1.0, distance_between(partner, plate));
    const double along =
        ((here.x - partner.x) * (plate.x - partner.x) + (here.y - partner.y) * (plate.y - partner.y)) /
        length;
    const double off =
        ((plate.x - partner.x) * (here.y - partner.y) - (plate.y - partner.y) * (here.x - partner.x)) /
        length;
    turn_to(body, 0, buttons, 8);
    if (along < -10 || along > length + 40 || std::abs(off) > 44) return;
    const bool up = here.y > platform.top - 60 ? false : here.y < platform.bottom + 60 ? true : off >= 0;
    const double rest = resting_place(body).y;
    if (up && rest < platform.top - 36) buttons.left = true;
    if (!up && rest > platform.bottom + 36) buttons.right = true;
  }

  /// Along a lane of a bridge to a place on its far platform.
  void cross(const doom::World& world, int agent, int bridge, double y, Place goal, doom::Buttons& buttons) {
    const Place here = place_of(world.body(agent));
    const Rectangle near = platform(bridge), far = platform(bridge + 1);
    const double entry = near.right - pit::kBridgeBite, exit = far.left + pit::kBridgeBite + 4;
    if (here.x < entry - 20 && std::abs(here.y - y) > kTolerance + 4)
      walk(world, agent, {std::max(here.x, near.right - 150), y}, kTolerance, buttons);
    else if (here.x < exit)
      walk(world, agent, {std::min(here.x + 120, exit + 60), y}, kTolerance, buttons);
    else
      walk(world, agent, goal, kTolerance, buttons);
  }

  std::map<int32_t, std::size_t> sector_of_tag_;
  std::vector<Rectangle> outline_;  // [sector]
  int goal_, joint_best_;           // numbers of the exports
  int holder_ = -1, stage_ = -1;
  bool following_ = false;  // the red plate is held: the holder goes
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_lava_pit_oracle(const DoomGame& game) {
  COMRAD_TRY_ASSIGN(const int goal, game.spec.user_number("goal"));
  COMRAD_TRY_ASSIGN(const int joint_best, game.spec.user_number("joint_best"));
  return std::unique_ptr<Oracle>(std::make_unique<Crossers>(goal, joint_best));
}

}  // namespace comrad::sim
