// The scripted team of Foraging Commons: everybody eats what lies nearest; when the field tires, the best fed
// one goes cleaning until it has recovered.
#include <algorithm>
#include <cmath>
#include <optional>
#include <vector>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int kRateVariable = 1, kFirstCleanupVariable = 8;
constexpr int kTiredRate = 62, kFreshRate = 92;
constexpr int kFull = 196;       // more would be wasted
constexpr int kHungry = 50;      // whoever has less than this does not clean
constexpr double kStepOut = 40;  // from the station's edge, to be let clean again

class Foragers final : public Oracle {
 public:
  explicit Foragers(const DoomGame& game)
      : navigator_({.cell_units = 24}),
        field_(static_cast<double>(game.layout.parameter("field", 1600))),
        station_(static_cast<double>(game.layout.parameter("station", 384))),
        distance_(std::max(static_cast<double>(game.layout.parameter("distance", 1200)),
                           (field_ + station_) / 2 + 64)) {}

  void reset(const doom::World& world) override {
    bonus_ = world.catalog().find("ForageBonus");
    cleaner_ = -1;
    sidesteps_.assign(static_cast<std::size_t>(world.player_count()), {});
    cleanups_ = 0;
    leaves_ = false;
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    choose_cleaner(world);
    std::vector<uint32_t> taken;
    for (int agent = 0; agent < world.player_count(); ++agent) {
      const doom::Actor& body = world.body(agent);
      const Place goal = agent == cleaner_ ? cleaning_place(world, agent) : food(world, agent, taken);
      go_to(body, navigator_.waypoint(place_of(body), goal).value_or(goal), {.stop_units = 8},
            buttons[agent]);
      sidesteps_[static_cast<std::size_t>(agent)].apply(body, buttons[agent]);
    }
  }

 private:
  void choose_cleaner(const doom::World& world) {
    const int rate = world.exported(kRateVariable);
    if (cleaner_ >= 0 && (rate >= kFreshRate || world.player(cleaner_).health < kHungry)) cleaner_ = -1;
    if (cleaner_ >= 0 || rate > kTiredRate) return;
    int best = 0;
    for (int agent = 1; agent < world.player_count(); ++agent)
      if (world.player(agent).health > world.player(best).health) best = agent;
    if (world.player(best).health <= kHungry) return;
    cleaner_ = best;
    cleanups_ = world.exported(kFirstCleanupVariable + best);
    leaves_ = false;
  }

  /// Into the station just behind its door; out of it after each cleanup, and in again.
  Place cleaning_place(const doom::World& world, int agent) {
    const double top = -distance_ + station_ / 2, y = place_of(world.body(agent)).y;
    if (const int done = world.exported(kFirstCleanupVariable + agent); done != cleanups_)
      cleanups_ = done, leaves_ = true;
    if (leaves_ && y > top + 4) leaves_ = false;
    return {0, leaves_ ? top + kStepOut : top - 24};
  }

  /// The nearest bonus that nobody before goes for; without one, or full, the middle of the southern half.
  Place food(const doom::World& world, int agent, std::vector<uint32_t>& taken) {
    const Place here = place_of(world.body(agent));
    Place best{agent % 2 == 0 ? -96.0 : 96.0, -field_ / 8};
    if (world.player(agent).health > kFull || !bonus_) return best;
    uint32_t chosen = 0;
    double nearest = 1e9;
    for (const doom::Actor& actor : world.actors()) {
      if (actor.removed || actor.type != *bonus_ ||
          std::find(taken.begin(), taken.end(), actor.id) != taken.end())
        continue;
      const double away = distance_between(here, place_of(actor));
      if (away < nearest) nearest = away, chosen = actor.id, best = place_of(actor);
    }
    if (chosen != 0) taken.push_back(chosen);
    return best;
  }

  Navigator navigator_;
  double field_, station_, distance_;
  std::optional<uint32_t> bonus_;
  std::vector<Sidestep> sidesteps_;
  int cleaner_ = -1;     // who cleans; -1 nobody
  int cleanups_ = 0;     // of the cleaner, when last looked at
  bool leaves_ = false;  // it must step out first
};

}  // namespace

std::unique_ptr<Oracle> make_foraging_commons_oracle(const DoomGame& game) {
  return std::make_unique<Foragers>(game);
}

}  // namespace comrad::sim
