// The scripted hunters of Smart Enemies, and those of Dumb Enemies: they differ in whether they keep apart or
// together. Each runs after a demon, takes aim within reach of its pellets and fires.
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <optional>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int32_t kFirstDemonId = 10000, kDemonsMax = 32;
constexpr double kDemonRadius = 30;
constexpr double kFireRange = 480;   // pellets fly 500
constexpr double kAimSlack = 1.2;    // of the angle that a demon takes up: pellets spread, turning costs time
constexpr double kCloseRange = 140;  // no nearer than this
constexpr double kLeadTics = 5;      // from the decision to the shot
constexpr int kWeighEvery = 4;       // decisions
constexpr double kCrowdMargin = 60;  // kept from the distance at which a second hunter counts
constexpr int kRetreats = 12;        // places at the wall to which a hunter without prey may withdraw

class Hunters final : public Oracle {
 public:
  Hunters(const DoomGame& game, bool together)
      : navigator_({.cell_units = 16}),
        together_(together),
        proximity_(static_cast<double>(game.layout.parameter("proximity", 512))),
        radius_(static_cast<double>(game.layout.parameter("radius", 800))) {}

  void reset(const doom::World& world) override {
    const auto count = static_cast<std::size_t>(world.player_count());
    sidesteps_.assign(count, Sidestep{});
    targets_.assign(count, 0);
    decision_ = 0;
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    std::vector<const doom::Actor*> demons;
    for (const doom::Actor& actor : world.actors())
      if (!actor.removed && actor.health > 0 && actor.thing_id >= kFirstDemonId &&
          actor.thing_id < kFirstDemonId + kDemonsMax)
        demons.push_back(&actor);
    // Ways are dear: targets are weighed anew every few decisions, and when one is gone.
    const bool gone = std::any_of(targets_.begin(), targets_.end(),
                                  [&](uint32_t id) { return find(demons, id) == nullptr; });
    if (decision_++ % kWeighEvery == 0 || gone) {
      if (together_) {
        choose_together(world, demons);
      } else {
        choose_apart(world, demons);
      }
    }
    for (std::size_t agent = 0; agent < buttons.size(); ++agent) {
      hunt(world, demons, agent, buttons[agent]);
      sidesteps_[agent].apply(world.body(static_cast<int>(agent)), buttons[agent]);
    }
  }

 private:
  static const doom::Actor* find(const std::vector<const doom::Actor*>& demons, uint32_t id) {
    for (const doom::Actor* demon : demons)
      if (demon->id == id) return demon;
    return nullptr;
  }

  Place body_place(const doom::World& world, std::size_t agent) const {
    return place_of(world.body(static_cast<int>(agent)));
  }

  /// Pairs of hunter and demon by rising cost: the way there, and whom else the hunter would meet.
  void choose_apart(const doom::World& world, const std::vector<const doom::Actor*>& demons) {
    const std::size_t count = targets_.size();
    std::vector<uint32_t> chosen(count, 0);
    std::vector<bool> taken(demons.size(), false);
    for (std::size_t round = 0; round < count; ++round) {
      double best_cost = std::numeric_limits<double>::infinity();
      std::size_t best_agent = count, best_demon = 0;
      for (std::size_t agent = 0; agent < count; ++agent) {
        if (chosen[agent] != 0) continue;
        const Place here = body_place(world, agent);
        for (std::size_t i = 0; i < demons.size(); ++i) {
          if (taken[i]) continue;
          const Place there = place_of(*demons[i]);
          double cost = distance_between(here, there);
          if (cost < best_cost) cost = navigator_.way_length(here, there).value_or(5000);  // never shorter
          for (std::size_t other = 0; other < count; ++other) {
            if (other == agent) continue;
            const double apart = distance_between(body_place(world, other), there);
            if (apart < proximity_ + kCrowdMargin) cost += 2 * (proximity_ + kCrowdMargin - apart);
          }
          if (demons[i]->id == targets_[agent]) cost *= 0.75;
          if (cost < best_cost) best_cost = cost, best_agent = agent, best_demon = i;
        }
      }
      if (best_agent == count) break;
      chosen[best_agent] = demons[best_demon]->id;
      taken[best_demon] = true;
    }
    targets_ = chosen;
  }

  /// One demon for all: nearest to the team.
  void choose_together(const doom::World& world, const std::vector<const doom::Actor*>& demons) {
    double best_cost = std::numeric_limits<double>::infinity();
    uint32_t best = 0;
    for (const doom::Actor* demon : demons) {
      double cost = 0;
      for (std::size_t agent = 0; agent < targets_.size(); ++agent)
        cost += distance_between(body_place(world, agent), place_of(*demon));
      if (cost * 0.75 >= best_cost) continue;  // ways are never shorter
      cost = 0;
      for (std::size_t agent = 0; agent < targets_.size(); ++agent)
        cost += navigator_.way_length(body_place(world, agent), place_of(*demon)).value_or(5000);
      if (demon->id == targets_[0]) cost *= 0.75;
      if (cost < best_cost) best_cost = cost, best = demon->id;
    }
    std::fill(targets_.begin(), targets_.end(), best);
  }

  int near_count(const doom::World& world, Place place) const {
    int count = 0;
    for (std::size_t agent = 0; agent < targets_.size(); ++agent)
      count += distance_between(body_place(world, agent), place) < proximity_;
    return count;
  }

  /// The demon to fire at now: near, in sight, worth a shell.
  const doom::Actor* mark_of(const doom::World& world, const std::vector<const doom::Actor*>& demons,
                             std::size_t agent) const {
    const Place here = body_place(world, agent);
    const double facing = angle_degrees(world.body(static_cast<int>(agent)));
    const doom::Actor* best = nullptr;
    double best_cost = std::numeric_limits<double>::infinity();
    for (const doom::Actor* demon : demons) {
      const Place there = place_of(*demon);
      const double distance = distance_between(here, there);
      if (distance > kFireRange || !is_clear(world, here, there)) continue;
      const bool frail = (near_count(world, there) >= 2) == together_;
      if (!frail && demon->health > 120) continue;
      const double cost = distance + 1.5 * std::abs(wrap_degrees(bearing_degrees(here, there) - facing)) +
                          (demon->id == targets_[agent] ? -60 : 0) + demon->health;
      if (cost < best_cost) best_cost = cost, best = demon;
    }
    return best;
  }

  /// Where a hunter without prey is in nobody's way: it stays where it is as long as no hunted demon is near, else
  /// it goes to the place at the wall that is farthest from them, for the way there.
  Place retreat(const doom::World& world, const std::vector<const doom::Actor*>& demons, std::size_t agent) {
    const Place here = body_place(world, agent);
    const auto room = [&](Place place) {
      double nearest = proximity_ + 2 * kCrowdMargin;
      for (std::size_t other = 0; other < targets_.size(); ++other)
        if (const doom::Actor* prey = other != agent ? find(demons, targets_[other]) : nullptr)
          nearest = std::min(nearest, distance_between(place, place_of(*prey)));
      return nearest;
    };
    Place best = here;
    double most = room(here) + kCrowdMargin;
    for (int i = 0; i < kRetreats; ++i) {
      const double angle = 2 * std::numbers::pi * i / kRetreats;
      const auto open =
          navigator_.nearest_open({0.85 * radius_ * std::cos(angle), 0.85 * radius_ * std::sin(angle)}, 160);
      if (!open) continue;
      const double value = room(*open) - 0.1 * distance_between(here, *open);
      if (value > most) most = value, best = *open;
    }
    return best;
  }

  void hunt(const doom::World& world, const std::vector<const doom::Actor*>& demons, std::size_t agent,
            doom::Buttons& buttons) {
    const doom::Actor& body = world.body(static_cast<int>(agent));
    const Place here = place_of(body);
    const doom::Actor* target = find(demons, targets_[agent]);
    const doom::Actor* mark = mark_of(world, demons, agent);
    Place goal = target != nullptr ? place_of(*target) : here;
    bool stays = target == nullptr;
    if (target == nullptr && !together_) {
      goal = retreat(world, demons, agent);
      stays = distance_between(here, goal) < kCrowdMargin;
    } else if (target != nullptr && !together_) {
      // Not into a crowd: a partner who is nearer to it has the right of way.
      for (std::size_t other = 0; other < targets_.size(); ++other) {
        if (other == agent || targets_[other] == 0) continue;
        const doom::Actor* theirs = find(demons, targets_[other]);
        if (theirs == nullptr || theirs == target) continue;
        if (distance_between(here, place_of(*theirs)) < proximity_ + kCrowdMargin &&
            distance_between(body_place(world, other), place_of(*theirs)) < distance_between(here, goal) &&
            mark == nullptr) {
          // Back off from their prey, unless the own one leads away from it anyway.
          const Place away = place_of(*theirs);
          const double far = std::max(1.0, distance_between(here, away));
          const Place back{here.x + (here.x - away.x) / far * 200, here.y + (here.y - away.y) / far * 200};
          const bool leads_away = distance_between(goal, away) > distance_between(here, away);
          if (!leads_away)
            if (const auto open = navigator_.nearest_open(back, 160)) goal = *open;
        }
      }
    }
    if (mark != nullptr) {
      const Place seen = place_of(*mark);
      const Place there{seen.x + lead(*mark, true), seen.y + lead(*mark, false)};
      const double distance = distance_between(here, seen);
      const double half_angle = std::atan2(kDemonRadius, distance) * 57.3;
      if (turn_to(body, bearing_degrees(here, there), buttons, std::max(3.6, half_angle * kAimSlack)))
        buttons.attack = true;
      if (mark->id == targets_[agent] || together_) goal = seen, stays = distance < kCloseRange;
      if (stays) return;
      const auto next = navigator_.waypoint(here, goal);
      walk_to(body, next.value_or(goal), {}, buttons);
      return;
    }
    if (stays) return;
    const auto next = navigator_.waypoint(here, goal);
    go_to(body, next.value_or(goal), {}, buttons);
  }

  /// How far a demon comes until the shot: its steps are as long as its speed, every other tic.
  static double lead(const doom::Actor& demon, bool along_x) {
    constexpr double kDiagonal = 0.7071;
    constexpr double kX[] = {1, kDiagonal, 0, -kDiagonal, -1, -kDiagonal, 0, kDiagonal, 0};
    constexpr double kY[] = {0, kDiagonal, 1, kDiagonal, 0, -kDiagonal, -1, -kDiagonal, 0};
    const double way = doom::to_double(demon.speed) / 2 * kLeadTics;
    return (along_x ? kX : kY)[demon.move_direction] * std::min(way, 60.0);
  }

  Navigator navigator_;
  bool together_;
  double proximity_, radius_;
  std::vector<Sidestep> sidesteps_;  // [N]
  int decision_ = 0;
  std::vector<uint32_t> targets_;  // [N] actor id of the demon that it is after, 0 none
};

}  // namespace

std::unique_ptr<Oracle> make_hunters(const DoomGame& game, bool together) {
  return std::make_unique<Hunters>(game, together);
}

Expected<std::unique_ptr<Oracle>> make_smart_enemies_oracle(const DoomGame& game) {
  return make_hunters(game, false);
}

}  // namespace comrad::sim
