// The scripted team of Co-op Health Gathering: whoever is weakest takes the kit that pays best, the others
// take what lies within the tether of it, and nobody walks away from a partner who is at the end of it.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr double kTetherSlack = 60;  // kept from the tether's end
constexpr double kPartnersKit = 8;   // health that a partner's kit counts for the leader of more than two
constexpr int kLeadsOnHealth = 6;    // that somebody must be weaker to lead instead, of more than two

struct Kit {
  uint32_t id = 0;
  Place place;
  int heals = 0;
};

/// As the tether measures.
double tether_distance(Place a, Place b) {
  const double dx = std::abs(a.x - b.x), dy = std::abs(a.y - b.y);
  return std::max(dx, dy) + std::min(dx, dy) / 2;
}

class Forager final : public Oracle {
 public:
  explicit Forager(const DoomGame& game)
      : navigator_({.cell_units = 24}), tether_(static_cast<double>(game.layout.parameter("tether", 400))) {}

  void reset(const doom::World& world) override {
    targets_.assign(static_cast<std::size_t>(world.player_count()), 0);
    leader_ = 0;
    sidesteps_.assign(static_cast<std::size_t>(world.player_count()), Sidestep{});
    stimpack_ = world.catalog().find("Stimpack"), medikit_ = world.catalog().find("Medikit");
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    std::vector<Kit> kits;
    for (const doom::Actor& actor : world.actors()) {
      if (actor.removed || (actor.type != stimpack_ && actor.type != medikit_)) continue;
      kits.push_back({actor.id, place_of(actor), actor.type == medikit_ ? 25 : 10});
    }
    const auto count = static_cast<std::size_t>(world.player_count());
    const std::vector<std::size_t> order = order_of(world);
    std::vector<Place> goals(count);
    std::vector<bool> decided(count, false);
    for (const std::size_t agent : order) {
      const doom::Actor& body = world.body(static_cast<int>(agent));
      const Place here = place_of(body);
      const double hunger = 100.0 - body.health;
      const Kit* best = nullptr;
      double best_value = 0;
      for (const Kit& kit : kits) {
        if (taken_by_another(kit.id, agent, decided)) continue;
        if (distance_between(here, kit.place) > 1400) continue;
        if (!within_tether(kit.place, goals, decided, agent)) continue;
        const auto way = navigator_.way_length(here, kit.place);
        if (!way) continue;
        const double gain = std::min<double>(kit.heals, hunger + *way / 10.0 * 5.0 / 32.0);
        if (gain < kit.heals * 0.7) continue;  // it would be wasted
        double value = (gain + for_partners(kit, kits, agent)) / (*way + 90.0);
        if (kit.id == targets_[agent]) value *= 1.25;  // no dithering
        if (value > best_value) best_value = value, best = &kit;
      }
      if (best != nullptr) {
        targets_[agent] = best->id;
        goals[agent] = best->place;
      } else {
        targets_[agent] = 0;
        goals[agent] = fallback(world, kits, goals, decided, agent);
      }
      decided[agent] = true;
    }
    for (std::size_t agent = 0; agent < count; ++agent) {
      walk(world, agent, goals[agent], order, buttons[agent]);
      sidesteps_[agent].apply(world.body(static_cast<int>(agent)), buttons[agent]);
    }
  }

 private:
  /// The weakest leads; then its neighbours in the tether, theirs, and so on: each decides with one neighbour's
  /// goal before it, so that the chain never has two leaders.
  std::vector<std::size_t> order_of(const doom::World& world) {
    const auto count = static_cast<std::size_t>(world.player_count());
    const auto health = [&](std::size_t agent) { return world.player(static_cast<int>(agent)).health; };
    for (std::size_t agent = 0; agent < count; ++agent)
      if (health(agent) + (count > 2 ? kLeadsOnHealth : 0) < health(leader_)) leader_ = agent;
    std::vector<std::size_t> order(count);
    std::iota(order.begin(), order.end(), 0);
    const auto links = [&](std::size_t agent) { return agent > leader_ ? agent - leader_ : leader_ - agent; };
    std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
      return links(a) != links(b) ? links(a) < links(b) : health(a) < health(b);
    });
    return order;
  }

  /// What the leader of more than two finds for those behind it where `kit` lies, as health.
  double for_partners(const Kit& kit, const std::vector<Kit>& kits, std::size_t agent) const {
    if (targets_.size() < 3 || agent != leader_) return 0;
    std::size_t near = 0;
    for (const Kit& other : kits)
      near += other.id != kit.id && tether_distance(kit.place, other.place) < tether_;
    return kPartnersKit * static_cast<double>(std::min(near, targets_.size() - 1));
  }

  /// A place beside the way of a partner that wants to pass; none: nobody does.
  std::optional<Place> aside_of(const doom::World& world, std::size_t agent, std::size_t other,
                                Place goal) const {
    constexpr double kTouching = 72;
    const Place here = place_of(world.body(static_cast<int>(agent))),
                there = place_of(world.body(static_cast<int>(other)));
    if (distance_between(here, there) >= kTouching) return std::nullopt;
    const double way = std::max(1.0, distance_between(there, goal));
    const double across_x = -(goal.y - there.y) / way, across_y = (goal.x - there.x) / way;
    for (const double side : {96.0, -96.0, 64.0, -64.0}) {
      const Place aside{here.x + across_x * side, here.y + across_y * side};
      if (navigator_.is_open(aside)) return aside;
    }
    return goal;  // too narrow: ahead of it
  }

  bool taken_by_another(uint32_t kit, std::size_t agent, const std::vector<bool>& decided) const {
    for (std::size_t other = 0; other < targets_.size(); ++other)
      if (other != agent && decided[other] && targets_[other] == kit) return true;
    return false;
  }

  bool within_tether(Place place, const std::vector<Place>& goals, const std::vector<bool>& decided,
                     std::size_t agent) const {
    for (const std::size_t other : {agent - 1, agent + 1})
      if (other < goals.size() && decided[other] &&
          tether_distance(place, goals[other]) > tether_ - kTetherSlack)
        return false;
    return true;
  }

  /// Nothing to take: beside the neighbour who knows where to go, or where most kits lie.
  Place fallback(const doom::World& world, const std::vector<Kit>& kits, const std::vector<Place>& goals,
                 const std::vector<bool>& decided, std::size_t agent) {
    const Place here = place_of(world.body(static_cast<int>(agent)));
    for (std::size_t other = 0; other < goals.size(); ++other)
      if (other != agent && decided[other])
        if (const auto aside = aside_of(world, agent, other, goals[other])) return *aside;
    for (const std::size_t other : {agent - 1, agent + 1})
      if (other < goals.size() && decided[other]) {
        const double far = distance_between(here, goals[other]);
        if (far < 120) return here;
        return {goals[other].x + (here.x - goals[other].x) * 100 / far,
                goals[other].y + (here.y - goals[other].y) * 100 / far};
      }
    Place best = here;
    double best_value = 0;
    for (const Kit& kit : kits) {
      double near = 0;
      for (const Kit& other : kits)
        if (distance_between(kit.place, other.place) < 400) near += 1;
      const double value = near / (distance_between(here, kit.place) + 300);
      if (value > best_value) best_value = value, best = kit.place;
    }
    // Up to it, not onto it: a kit is for the hungry.
    const double far = distance_between(here, best);
    if (far < 100) return here;
    return {best.x + (here.x - best.x) * 80 / far, best.y + (here.y - best.y) * 80 / far};
  }

  void walk(const doom::World& world, std::size_t agent, Place goal, const std::vector<std::size_t>& order,
            doom::Buttons& buttons) {
    const doom::Actor& body = world.body(static_cast<int>(agent));
    const Place here = place_of(body);
    // A partner at the end of the tether who is weaker leads: close up to it.
    const auto rank = [&](std::size_t who) {
      return std::find(order.begin(), order.end(), who) - order.begin();
    };
    for (const std::size_t other : {agent - 1, agent + 1}) {
      if (other >= order.size()) continue;
      const doom::Actor& partner = world.body(static_cast<int>(other));
      const Place there = place_of(partner);
      const Place ahead{there.x + doom::to_double(partner.velocity_x) * 8,
                        there.y + doom::to_double(partner.velocity_y) * 8};
      const Place me_ahead{here.x + doom::to_double(body.velocity_x) * 8,
                           here.y + doom::to_double(body.velocity_y) * 8};
      const double apart = tether_distance(me_ahead, ahead);
      if (apart < tether_ - 45) continue;
      const bool recedes = tether_distance(goal, there) > tether_distance(here, there);
      if (rank(other) < rank(agent)) {
        goal = there;
      } else if (recedes && tether_distance(here, there) > tether_ - 35) {
        return;  // wait for it
      }
    }
    const std::optional<Place> next = navigator_.waypoint(here, goal);
    go_to(body, next.value_or(goal), {}, buttons);
  }

  Navigator navigator_;
  double tether_;
  std::vector<Sidestep> sidesteps_;  // [N]
  std::size_t leader_ = 0;
  std::vector<uint32_t> targets_;  // [N] actor id of the kit on the way to, 0 none
  std::optional<uint32_t> stimpack_, medikit_;
};

}  // namespace

std::unique_ptr<Oracle> make_coop_health_gathering_oracle(const DoomGame& game) {
  return std::make_unique<Forager>(game);
}

}  // namespace comrad::sim
