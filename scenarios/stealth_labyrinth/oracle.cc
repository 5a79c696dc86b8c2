// The scripted team of Stealth Labyrinth: room by room, the torch stands at the near end of the lit zone and
// sidesteps bolts; the gunner comes into range and shoots while it sidesteps too.
#include <algorithm>
#include <cmath>
#include <optional>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int32_t kFirstRoomTag = 102, kFirstCorridorTag = 201, kRoomsMax = 9;
constexpr int32_t kFirstTurretId = 6000, kTurretsMax = 18;
constexpr double kShotRange = 640;      // the gunner comes this near: bolts from further away are dodged
constexpr double kBurstRange = 300;     // from here on shots are single pairs
constexpr double kTurretRadius = 20;    // a little less than it is
constexpr double kBoltLookahead = 300;  // a bolt this far away is dodged

class LabyrinthPair final : public Oracle {
 public:
  explicit LabyrinthPair(int target_lit) : navigator_({.cell_units = 16}), target_lit_(target_lit) {}

  void reset(const doom::World& world) override {
    sidesteps_.assign(2, Sidestep{});
    centres_.clear();
    // Middles of rooms and corridors, by tag.
    for (int32_t room = 0; room < kRoomsMax; ++room) {
      const std::optional<Place> inside = centre_of_tag(world, kFirstRoomTag + room);
      const std::optional<Place> before = centre_of_tag(world, kFirstCorridorTag + room);
      if (inside && before) centres_.push_back({*inside, *before});
    }
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    const doom::Actor& torch = world.body(0);
    const doom::Actor& gunner = world.body(1);
    const doom::Actor* target = nearest_turret(world, place_of(gunner));
    if (target == nullptr) return;
    const Place turret = place_of(*target);
    const Stage* stage = stage_of(turret);
    if (stage == nullptr) return;
    steer_torch(world, torch, *stage, buttons[0]);
    steer_gunner(world, gunner, torch, *stage, turret, buttons[1]);
    for (int agent = 0; agent < 2; ++agent)
      if (!dodging_[agent])
        sidesteps_[static_cast<std::size_t>(agent)].apply(world.body(agent),
                                                          buttons[static_cast<std::size_t>(agent)]);
  }

 private:
  struct Stage {
    Place room, corridor;
  };

  static std::optional<Place> centre_of_tag(const doom::World& world, int32_t tag) {
    const doom::Level& level = world.level();
    double left = 1e9, right = -1e9, bottom = 1e9, top = -1e9;
    for (const doom::Linedef& line : level.linedefs) {
      const auto has_tag = [&](uint32_t side) {
        return world.sectors()[level.sidedefs[side].sector_index].tag == tag;
      };
      if (!has_tag(line.front) && !(line.back && has_tag(*line.back))) continue;
      for (const uint32_t vertex : {line.start, line.end}) {
        const double x = doom::to_double(level.vertices[vertex].x),
                     y = doom::to_double(level.vertices[vertex].y);
        left = std::min(left, x), right = std::max(right, x), bottom = std::min(bottom, y),
        top = std::max(top, y);
      }
    }
    if (left > right) return std::nullopt;
    return Place{(left + right) / 2, (bottom + top) / 2};
  }

  static const doom::Actor* nearest_turret(const doom::World& world, Place from) {
    const doom::Actor* best = nullptr;
    for (const doom::Actor& actor : world.actors()) {
      if (actor.removed || actor.health <= 0 || !actor.has(doom::ActorFlag::kShootable)) continue;
      if (actor.thing_id < kFirstTurretId || actor.thing_id >= kFirstTurretId + kTurretsMax) continue;
      if (best == nullptr ||
          distance_between(from, place_of(actor)) < distance_between(from, place_of(*best)))
        best = &actor;
    }
    return best;
  }

  const Stage* stage_of(Place turret) const {
    const Stage* best = nullptr;
    for (const Stage& stage : centres_)
      if (best == nullptr || distance_between(stage.room, turret) < distance_between(best->room, turret))
        best = &stage;
    return best;
  }

  /// The nearest bolt that flies towards the body, as the side to step to: +1 left of its way, -1 right.
  static std::optional<Place> escape(const doom::World& world, const doom::Actor& body) {
    const Place here = place_of(body);
    std::optional<Place> best;
    double best_distance = kBoltLookahead;
    for (const doom::Actor& bolt : world.actors()) {
      if (bolt.removed || !bolt.has(doom::ActorFlag::kMissile)) continue;
      const Place there = place_of(bolt);
      const double speed = std::hypot(doom::to_double(bolt.velocity_x), doom::to_double(bolt.velocity_y));
      if (speed < 1) continue;
      const double ux = doom::to_double(bolt.velocity_x) / speed,
                   uy = doom::to_double(bolt.velocity_y) / speed;
      const double ahead = (here.x - there.x) * ux + (here.y - there.y) * uy;
      const double aside = (here.x - there.x) * -uy + (here.y - there.y) * ux;
      if (ahead < -20 || ahead > best_distance || std::abs(aside) > 48) continue;
      best_distance = ahead;
      const double side = aside >= 0 ? 1 : -1;
      best = Place{here.x - uy * side * 96, here.y + ux * side * 96};
    }
    return best;
  }

  bool step_aside(const doom::World& world, const doom::Actor& body, int agent, doom::Buttons& buttons) {
    dodging_[agent] = false;
    auto aside = escape(world, body);
    if (!aside) return false;
    const Place here = place_of(body);
    if (!navigator_.is_open(*aside)) *aside = {2 * here.x - aside->x, 2 * here.y - aside->y};
    if (!navigator_.is_open(*aside)) return false;
    walk_to(body, *aside, {.stop_units = 1}, buttons);
    return dodging_[agent] = true;
  }

  void go(const doom::Actor& body, Place goal, doom::Buttons& buttons) {
    const std::optional<Place> next = navigator_.waypoint(place_of(body), goal);
    go_to(body, next.value_or(goal), {}, buttons);
  }

  /// At the room's near end: inside the light box, far from the turret.
  void steer_torch(const doom::World& world, const doom::Actor& torch, const Stage& stage,
                   doom::Buttons& buttons) {
    if (step_aside(world, torch, 0, buttons)) return;
    const double way = distance_between(stage.room, stage.corridor);
    const Place post{stage.corridor.x + (stage.room.x - stage.corridor.x) / way * 32,
                     stage.corridor.y + (stage.room.y - stage.corridor.y) / way * 32};
    if (distance_between(place_of(torch), post) > 40) go(torch, post, buttons);
  }

  void steer_gunner(const doom::World& world, const doom::Actor& gunner, const doom::Actor& torch,
                    const Stage& stage, Place turret, doom::Buttons& buttons) {
    const Place here = place_of(gunner);
    const double distance = distance_between(here, turret);
    const bool lit = world.exported(target_lit_) != 0;
    const bool in_sight = is_clear(world, here, turret);
    const bool aside = step_aside(world, gunner, 1, buttons);
    if (in_sight && distance < kShotRange + 260) {
      const double off = aim_at(world.player(1), gunner, bearing_degrees(here, turret), buttons);
      const double wide = std::atan2(kTurretRadius, distance) * 57.3;
      // Only the first pair of a burst is exact: single pairs at what is far.
      if (off < wide && lit) buttons.attack = distance < kBurstRange || world.player(1).refire == 0;
    }
    if (aside) return;
    if (!lit) {  // wait behind the torch, out of the turret's sight
      const Place torch_place = place_of(torch);
      const double way = distance_between(stage.room, torch_place);
      const Place behind{torch_place.x - (stage.room.x - torch_place.x) / way * 110,
                         torch_place.y - (stage.room.y - torch_place.y) / way * 110};
      const auto open = navigator_.nearest_open(behind);
      if (open && distance_between(here, *open) > 64) {
        doom::Buttons walk;
        go(gunner, *open, walk);
        buttons = walk;
      }
      return;
    }
    if (!in_sight || distance > kShotRange) {
      doom::Buttons walk;
      const std::optional<Place> next = navigator_.waypoint(here, turret);
      if (distance < kShotRange + 260 && in_sight) {
        walk_to(gunner, next.value_or(turret), {}, buttons);
      } else {
        go(gunner, turret, walk);
        walk.attack = buttons.attack;
        buttons = walk;
      }
    }
  }

  Navigator navigator_;
  int target_lit_;  // number of the export
  std::vector<Sidestep> sidesteps_;
  std::vector<Stage> centres_;
  bool dodging_[2] = {false, false};
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_stealth_labyrinth_oracle(const DoomGame& game) {
  COMRAD_TRY_ASSIGN(const int target_lit, game.spec.user_number("target_lit"));
  return std::unique_ptr<Oracle>(std::make_unique<LabyrinthPair>(target_lit));
}

}  // namespace comrad::sim
