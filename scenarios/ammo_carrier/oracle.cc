// The scripted team of Ammo Carrier: the defender shoots the nearest monster it sees, in bursts that suit the
// distance; the runner fetches a full load when the defender needs one and the way is clear, and hides behind
// the defender meanwhile.
#include <algorithm>
#include <cmath>

#include "sim_workers/engine/play/inventory.h"
#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int32_t kMonsterId = 700;
constexpr int kDefender = 0, kRunner = 1;
constexpr int kEnough = 150;  // bullets of the defender's that need no more
constexpr int kUrgent = 40;   // so few, and the runner goes whatever is in the way
constexpr int kFullLoad = 150;
constexpr double kHandOver = 220;  // the rules say 256
constexpr double kDanger = 450;    // a monster so near to an item spoils it

class Carriers final : public Oracle {
 public:
  void reset(const doom::World& world) override {
    clip_ = world.catalog().find("Clip"), box_ = world.catalog().find("ClipBox");
    decision_ = 0, returning_ = false, sidestep_ = {};
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    ++decision_;
    monsters_.clear();
    for (const doom::Actor& actor : world.actors())
      if (!actor.removed && actor.thing_id == kMonsterId && actor.health > 0) monsters_.push_back(&actor);
    defend(world, buttons[kDefender]);
    run(world, buttons[kRunner]);
    sidestep_.apply(world.body(kRunner), buttons[kRunner]);
    buttons[kRunner].backward = false;  // no such button here
  }

 private:
  int bullets(const doom::World& world, int player) const {
    return clip_ ? doom::count_item(world, player, *clip_) : 0;
  }

  void defend(const doom::World& world, doom::Buttons& buttons) {
    const doom::Actor& body = world.body(kDefender);
    const Place here = place_of(body);
    const doom::Actor* target = nullptr;
    double best = 1e9;
    for (const doom::Actor* monster : monsters_) {
      if (!sees(world, body, *monster)) continue;
      const double far = distance_between(here, place_of(*monster));
      const double turn =
          std::abs(wrap_degrees(bearing_degrees(here, place_of(*monster)) - angle_degrees(body)));
      const double cost = far + 2.5 * turn;
      if (cost < best) best = cost, target = monster;
    }
    if (target == nullptr) return;
    const Place there{doom::to_double(target->x) + doom::to_double(target->velocity_x) * 2,
                      doom::to_double(target->y) + doom::to_double(target->velocity_y) * 2};
    const double far = std::max(1.0, distance_between(here, there));
    const double off = aim_at(world.player(kDefender), body, bearing_degrees(here, there), buttons);
    const double wide = std::atan2(doom::to_double(target->radius) * 0.9, far) * 180 / 3.14159265;
    if (off > std::max(wide, 2.0)) return;
    // Only the first shot of a burst is exact: single pairs of shots at what is far.
    const bool burst = far < 260 || decision_ % 3 != 0;
    buttons.attack = burst && (far < 260 || world.player(kDefender).refire == 0);
  }

  /// How near the nearest monster comes to `place`; those that cannot see it count less.
  double danger_at(const doom::World& world, Place place) const {
    double nearest = 1e9;
    for (const doom::Actor* monster : monsters_)
      nearest = std::min(nearest, distance_between(place, place_of(*monster)));
    (void)world;
    return nearest;
  }

  void run(const doom::World& world, doom::Buttons& buttons) {
    const doom::Actor& body = world.body(kRunner);
    const Place here = place_of(body), hub = place_of(world.body(kDefender));
    const int load = bullets(world, kRunner), stock = bullets(world, kDefender);
    // The best item: near, and far from monsters.
    const doom::Actor* item = nullptr;
    double best = 1e9;
    for (const doom::Actor& actor : world.actors()) {
      if (actor.removed || !((clip_ && actor.type == *clip_) || (box_ && actor.type == *box_))) continue;
      const Place place = place_of(actor);
      const double danger = danger_at(world, place);
      if (danger < kDanger && stock >= kUrgent) continue;
      const auto way = navigator_.way_length(here, place);
      if (!way) continue;
      const double cost =
          *way / (box_ && actor.type == *box_ ? 2.5 : 1.0) + (danger < kDanger ? 2000 - 4 * danger : 0);
      if (cost < best) best = cost, item = &actor;
    }
    const bool wanted = stock < kEnough;
    if (load >= kFullLoad || (load > 0 && (item == nullptr || stock < kUrgent))) returning_ = true;
    if (load == 0) returning_ = false;
    Place goal;
    if (returning_) {
      goal = hub;
      if (distance_between(here, hub) < kHandOver) goal = hiding_place(world, here, hub);
    } else if (wanted && item != nullptr) {
      goal = place_of(*item);
    } else {
      if (load > 0) returning_ = true;
      goal = hiding_place(world, here, hub);
    }
    const Gait gait{.strafes = true, .backward = false, .stop_units = 12};
    go(body, navigator_.waypoint(here, goal).value_or(goal), gait, buttons);
  }

  /// Behind the defender, as the nearest monster sees it.
  Place hiding_place(const doom::World& world, Place here, Place hub) const {
    const doom::Actor* nearest = nullptr;
    double best = 1e9;
    for (const doom::Actor* monster : monsters_) {
      const double far =
          distance_between(hub, place_of(*monster)) + (sees(world, world.body(kRunner), *monster) ? 0 : 800);
      if (far < best) best = far, nearest = monster;
    }
    Place threat{here.x * -2 + hub.x * 3, here.y * -2 + hub.y * 3};  // nobody: stay on this side
    if (nearest != nullptr) threat = place_of(*nearest);
    const double far = std::max(1.0, distance_between(hub, threat));
    const Place behind{hub.x - (threat.x - hub.x) * 56 / far, hub.y - (threat.y - hub.y) * 56 / far};
    // Not through the defender.
    const double cross = (behind.x - here.x) * (hub.x - here.x) + (behind.y - here.y) * (hub.y - here.y);
    if (cross > 0 && distance_between(here, behind) > 80) {
      const double side_x = -(hub.y - here.y), side_y = hub.x - here.x;
      const double length = std::max(1.0, std::hypot(side_x, side_y));
      const double sign = (behind.x - hub.x) * side_x + (behind.y - hub.y) * side_y >= 0 ? 1 : -1;
      return {hub.x + sign * side_x / length * 72, hub.y + sign * side_y / length * 72};
    }
    return behind;
  }

  static void go(const doom::Actor& body, Place goal, const Gait& gait, doom::Buttons& buttons) {
    walk_to(body, goal, gait, buttons);
  }

  Navigator navigator_{{.cell_units = 24}};
  std::vector<const doom::Actor*> monsters_;
  std::optional<uint32_t> clip_, box_;
  Sidestep sidestep_;
  int decision_ = 0;
  bool returning_ = false;
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_ammo_carrier_oracle(const DoomGame&) {
  return std::unique_ptr<Oracle>(std::make_unique<Carriers>());
}

}  // namespace comrad::sim
