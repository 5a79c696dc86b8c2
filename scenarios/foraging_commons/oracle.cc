// The scripted team of Foraging Commons: everybody eats what lies nearest; when the field tires, the best fed
// of them go cleaning until it has recovered, the more of them the lower the rate.
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

// Rates from which on one, two (of more than two) and three (of four, where little lies about) clean, and
// until when.
constexpr int kTiredRate = 62, kSpentRate = 45, kBareRate = 35, kFreshRate = 92;
constexpr int kLittle = 16;  // bonuses
constexpr int kFull = 196;   // more would be wasted
constexpr int kHungry = 50;  // an agent with less does not clean
constexpr int kMostHealth = 200, kHeal = 2;
constexpr double kHeap = 40;     // bonuses so near to each other are taken together
constexpr double kTurn = 80;     // units that a turn costs
constexpr double kThrough = 64;  // units
constexpr double kStepOut = 40;  // from the station's edge, to be let clean again

/// The exports that are read, by their numbers.
struct CommonsExports {
  int spawn_rate = 0, bonuses_lying = 0;
  std::vector<int> cleanups;  // [agent]
};

class Foragers final : public Oracle {
 public:
  Foragers(const DoomGame& game, CommonsExports exports)
      : exports_(std::move(exports)),
        navigator_({.cell_units = 24}),
        field_(static_cast<double>(game.layout.parameter("field", 1600))),
        station_(static_cast<double>(game.layout.parameter("station", 384))),
        distance_(std::max(static_cast<double>(game.layout.parameter("distance", 1200)),
                           (field_ + station_) / 2 + 64)) {}

  void reset(const doom::World& world) override {
    bonus_ = world.catalog().find("ForageBonus");
    cleaners_.assign(static_cast<std::size_t>(world.player_count()), {});
    sidesteps_.assign(static_cast<std::size_t>(world.player_count()), {});
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    choose_cleaners(world);
    std::vector<Place> taken;
    for (int agent = 0; agent < world.player_count(); ++agent) {
      const doom::Actor& body = world.body(agent);
      const Place goal = cleaners_[static_cast<std::size_t>(agent)].cleans ? cleaning_place(world, agent)
                                                                           : food(world, agent, taken);
      go_to(body, navigator_.waypoint(place_of(body), goal).value_or(goal), {.stop_units = 8},
            buttons[agent]);
      sidesteps_[static_cast<std::size_t>(agent)].apply(body, buttons[agent]);
    }
  }

 private:
  struct Cleaner {
    bool cleans = false;
    int cleanups = 0;     // when last looked at
    bool leaves = false;  // it must step out first
  };

  void choose_cleaners(const doom::World& world) {
    const int rate = world.exported(exports_.spawn_rate), team = world.player_count();
    int cleaning = 0;
    for (int agent = 0; agent < team; ++agent) {
      Cleaner& one = cleaners_[static_cast<std::size_t>(agent)];
      if (rate >= kFreshRate || world.player(agent).health < kHungry) one.cleans = false;
      cleaning += one.cleans;
    }
    if (rate <= 0) return;  // before the script's first tic
    int wanted = 0;
    if (rate <= kTiredRate) ++wanted;
    if (team > 2 && rate <= kSpentRate) ++wanted;
    if (team > 3 && rate <= kBareRate && world.exported(exports_.bonuses_lying) < kLittle) ++wanted;
    for (; cleaning < wanted; ++cleaning) {
      int best = -1;
      for (int agent = 0; agent < team; ++agent)
        if (!cleaners_[static_cast<std::size_t>(agent)].cleans &&
            (best < 0 || world.player(agent).health > world.player(best).health))
          best = agent;
      if (best < 0 || world.player(best).health <= kHungry) return;
      cleaners_[static_cast<std::size_t>(best)] = {
          true, world.exported(exports_.cleanups[static_cast<std::size_t>(best)]), false};
    }
  }

  /// Into the station just behind its door, each at its own place; out of it after each cleanup, and
  /// in again.
  Place cleaning_place(const doom::World& world, int agent) {
    Cleaner& one = cleaners_[static_cast<std::size_t>(agent)];
    const double top = -distance_ + station_ / 2, y = place_of(world.body(agent)).y;
    if (const int done = world.exported(exports_.cleanups[static_cast<std::size_t>(agent)]);
        done != one.cleanups)
      one.cleanups = done, one.leaves = true;
    if (one.leaves && y > top + 4) one.leaves = false;
    const double x = world.player_count() == 2 ? 0 : agent % 2 == 0 ? -24 : 24;
    return {x, one.leaves ? top + kStepOut : top - 24};
  }

  /// Where most bonuses lie for the way, and nobody before goes; without one, or full, the middle of the
  /// southern half.
  Place food(const doom::World& world, int agent, std::vector<Place>& taken) {
    const Place here = place_of(world.body(agent));
    const Place wait{agent % 2 == 0 ? -96.0 : 96.0, -field_ / 8};
    const int room = (kMostHealth - world.player(agent).health) / kHeal;
    if (world.player(agent).health > kFull || !bonus_) return wait;
    std::vector<std::pair<Place, int>> heaps;
    for (const doom::Actor& actor : world.actors()) {
      if (actor.removed || actor.type != *bonus_) continue;
      const Place there = place_of(actor);
      const auto heap = std::find_if(heaps.begin(), heaps.end(), [&](const auto& one) {
        return distance_between(one.first, there) < kHeap;
      });
      if (heap != heaps.end())
        ++heap->second;
      else
        heaps.emplace_back(there, 1);
    }
    double most = 0;
    Place best = wait;
    for (const auto& [there, count] : heaps) {
      if (std::any_of(taken.begin(), taken.end(),
                      [&](Place place) { return distance_between(place, there) < kHeap; }))
        continue;
      const double value = std::min(count, room) / (distance_between(here, there) + kTurn);
      if (value > most) most = value, best = there;
    }
    if (most == 0) return wait;
    taken.push_back(best);
    // It is taken by touch: on through it rather than to a halt there.
    const double far = distance_between(here, best);
    if (far < 1) return best;
    const Place beyond{best.x + (best.x - here.x) / far * kThrough,
                       best.y + (best.y - here.y) / far * kThrough};
    return navigator_.is_open(beyond) ? beyond : best;
  }

  CommonsExports exports_;
  Navigator navigator_;
  double field_, station_, distance_;
  std::optional<uint32_t> bonus_;
  std::vector<Sidestep> sidesteps_;
  std::vector<Cleaner> cleaners_;  // [N]
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_foraging_commons_oracle(const DoomGame& game) {
  CommonsExports exports;
  COMRAD_TRY_ASSIGN(exports.spawn_rate, game.spec.user_number("spawn_rate"));
  COMRAD_TRY_ASSIGN(exports.bonuses_lying, game.spec.user_number("bonuses_lying"));
  COMRAD_TRY_ASSIGN(exports.cleanups,
                    game.spec.user_numbers({"cleanups_1", "cleanups_2", "cleanups_3", "cleanups_4"}));
  return std::unique_ptr<Oracle>(std::make_unique<Foragers>(game, std::move(exports)));
}

}  // namespace comrad::sim
