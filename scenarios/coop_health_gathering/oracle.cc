// The scripted team of Co-op Health Gathering: of all ways to send each agent after one of its best kits, the
// one that together is worth most within the tether, more for the weak; and nobody walks away from a partner
// who is at the end of it.
#include <algorithm>
#include <cmath>
#include <numeric>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr double kTetherSlack = 20;  // goals keep this much from the tether's end
constexpr double kClosesUp = 20;     // and here an agent closes up to the partner who leads
constexpr double kWaits = 10;        // or waits for the one who follows
constexpr int kLeadsOnHealth = 6;    // that somebody must be weaker to lead instead, of more than two
constexpr double kKitSight = 1400;   // kits further away do not count
constexpr std::size_t kOptions = 8;  // kits that an agent chooses from
constexpr double kFurtherLink =
    0.4;                         // of a tether for each link after the first: a chain at full length stalls
constexpr double kPickUp = 60;   // way that turning to a kit costs besides
constexpr double kWaste = 0.7;   // part of a kit that must be of use
constexpr double kKeeps = 1.25;  // factor of the kit on the way to: no dithering
constexpr double kUrgency = 40;  // health at which a kit counts half of what it does for the dying
constexpr double kNeighbours = 600;      // kits this near to a kit make it worth more ...
constexpr double kNeighboursPart = 0.1;  // ... by this part of what they heal
constexpr double kWayGlideTics = 6;      // ways begin where the body is going
constexpr double kRunThrough = 100;      // it aims beyond a kit, so as not to brake

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
      : navigator_({.cell_units = 24}),
        tether_(static_cast<double>(game.layout.parameter("tether", 400))),
        damage_(static_cast<double>(game.layout.parameter("damage", 5))) {}

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
    choose_kits(world, kits);
    const std::vector<std::size_t> order = order_of(world);
    std::vector<Place> goals(count);
    std::vector<bool> decided(count, false);
    for (std::size_t agent = 0; agent < count; ++agent)
      if (chosen_[agent] != nullptr) goals[agent] = chosen_[agent]->place, decided[agent] = true;
    for (const std::size_t agent : order) {
      targets_[agent] = chosen_[agent] != nullptr ? chosen_[agent]->id : 0;
      if (chosen_[agent] == nullptr) goals[agent] = fallback(world, kits, goals, decided, agent);
      decided[agent] = true;
    }
    for (std::size_t agent = 0; agent < count; ++agent) {
      walk(world, agent, goals[agent], order, buttons[agent]);
      sidesteps_[agent].apply(world.body(static_cast<int>(agent)), buttons[agent]);
    }
  }

 private:
  /// A kit that an agent may go for.
  struct Option {
    const Kit* kit = nullptr;
    double value = 0;  // health in a unit of way
  };

  /// What each agent goes for: of its best kits, those that together are worth most within the tether.
  void choose_kits(const doom::World& world, const std::vector<Kit>& kits) {
    const std::size_t count = targets_.size();
    options_.assign(count, {});
    for (std::size_t agent = 0; agent < count; ++agent) {
      const doom::Actor& body = world.body(static_cast<int>(agent));
      const Place here = place_of(body);
      Place from{here.x + doom::to_double(body.velocity_x) * kWayGlideTics,
                 here.y + doom::to_double(body.velocity_y) * kWayGlideTics};
      if (!navigator_.is_open(from)) from = here;
      const double urgency = kUrgency / (body.health + kUrgency);
      for (const Kit& kit : kits) {
        if (distance_between(here, kit.place) > kKitSight) continue;
        const auto way = navigator_.way_length(from, kit.place);
        if (!way) continue;
        const double hunger = 100.0 - body.health + *way / 10.0 * damage_ / 32.0;
        if (hunger < kit.heals * kWaste) continue;  // it would be wasted
        double value = (std::min<double>(kit.heals, hunger) + kNeighboursPart * riches(kit, kits)) * urgency /
                       (*way + kPickUp);
        if (kit.id == targets_[agent]) value *= kKeeps;
        options_[agent].push_back({&kit, value});
      }
      auto& options = options_[agent];
      std::sort(options.begin(), options.end(),
                [](const Option& a, const Option& b) { return a.value > b.value; });
      if (options.size() > kOptions) options.resize(kOptions);
    }
    chosen_.assign(count, nullptr);
    trial_.assign(count, nullptr);
    best_value_ = -1;
    try_options(0, 0);
  }

  /// What lies near a kit, as if it were health: it counts the less the farther it is.
  static double riches(const Kit& kit, const std::vector<Kit>& kits) {
    double sum = 0;
    for (const Kit& other : kits) {
      const double far = distance_between(kit.place, other.place);
      if (&other != &kit && far < kNeighbours) sum += other.heals * (1 - far / kNeighbours);
    }
    return sum;
  }

  void try_options(std::size_t agent, double value) {
    if (agent == options_.size()) {
      if (value > best_value_) best_value_ = value, chosen_ = trial_;
      return;
    }
    trial_[agent] = nullptr;
    try_options(agent + 1, value);
    for (const Option& option : options_[agent]) {
      if (!fits(*option.kit, agent)) continue;
      trial_[agent] = option.kit;
      try_options(agent + 1, value + option.value);
    }
    trial_[agent] = nullptr;
  }

  /// Nobody before `agent` in the chain has it, and the tether reaches there from the last one's.
  bool fits(const Kit& kit, std::size_t agent) const {
    bool is_last = true;
    for (std::size_t links = 1; links <= agent; ++links) {
      const Kit* other = trial_[agent - links];
      if (other == nullptr) continue;
      if (other == &kit) return false;
      const double reach = (1 + kFurtherLink * static_cast<double>(links - 1)) * (tether_ - kTetherSlack);
      if (is_last && tether_distance(kit.place, other->place) > reach) return false;
      is_last = false;
    }
    return true;
  }

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

  /// A place beside the way of a partner that is about to pass; none: there is none.
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

  /// Nothing to take: beside the neighbour with a goal, or where most kits lie.
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
      if (apart < tether_ - kClosesUp) continue;
      const bool recedes = tether_distance(goal, there) > tether_distance(here, there);
      if (rank(other) < rank(agent)) {
        goal = there;
      } else if (recedes && tether_distance(here, there) > tether_ - kWaits) {
        return;  // wait for it
      }
    }
    Place next = navigator_.waypoint(here, goal).value_or(goal);
    if (targets_[agent] != 0) {
      const double far = std::max(1.0, distance_between(here, next));
      const Place beyond{next.x + (next.x - here.x) / far * kRunThrough,
                         next.y + (next.y - here.y) / far * kRunThrough};
      if (far < kRunThrough && navigator_.is_open(beyond)) next = beyond;
    }
    go_to(body, next, {}, buttons);
  }

  Navigator navigator_;
  double tether_, damage_;
  std::vector<std::vector<Option>> options_;  // [N], best first
  std::vector<const Kit*> chosen_, trial_;    // [N], null: none
  double best_value_ = 0;
  std::vector<Sidestep> sidesteps_;  // [N]
  std::size_t leader_ = 0;
  std::vector<uint32_t> targets_;  // [N] actor id of the kit on the way to, 0 none
  std::optional<uint32_t> stimpack_, medikit_;
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_coop_health_gathering_oracle(const DoomGame& game) {
  return std::unique_ptr<Oracle>(std::make_unique<Forager>(game));
}

}  // namespace comrad::sim
