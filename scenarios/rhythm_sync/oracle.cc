// The scripted pair of Rhythm Sync: each walks to its switch, and both press once both are there.
#include <cmath>
#include <utility>
#include <vector>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr double kZoneSlack = 6;  // kept from the edge of the zone

/// The exports that are read, by their numbers; lane A, then lane B.
struct RhythmExports {
  std::vector<int> switch_x, switch_y, in_zone;
};

class Drummers final : public Oracle {
 public:
  Drummers(const DoomGame& game, RhythmExports exports)
      : exports_(std::move(exports)),
        navigator_({.cell_units = 16}),
        reach_(static_cast<double>(game.layout.parameter("use_range", 64)) - kZoneSlack) {}

  void reset(const doom::World& world) override {
    (void)world;
    sidesteps_.assign(2, Sidestep{});
    pressed_ = false;
  }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    navigator_.refresh(world);
    bool ready = true;
    for (int lane = 0; lane < 2; ++lane) {
      const auto index = static_cast<std::size_t>(lane);
      const doom::Actor& body = world.body(lane);
      const Place here = place_of(body);
      const Place torch{static_cast<double>(world.exported(exports_.switch_x[index])),
                        static_cast<double>(world.exported(exports_.switch_y[index]))};
      const bool there = std::abs(torch.x - here.x) < reach_ && std::abs(torch.y - here.y) < reach_;
      ready = ready && there && world.exported(exports_.in_zone[index]) != 0;
      if (there) continue;
      const auto next = navigator_.waypoint(here, torch);
      go_to(body, next.value_or(torch), {}, buttons[index]);
      sidesteps_[index].apply(body, buttons[index]);
    }
    // Only a fresh press counts.
    pressed_ = ready && !pressed_;
    for (doom::Buttons& one : buttons) one.use = pressed_;
  }

 private:
  RhythmExports exports_;
  Navigator navigator_;
  double reach_;
  std::vector<Sidestep> sidesteps_;
  bool pressed_ = false;
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_rhythm_sync_oracle(const DoomGame& game) {
  RhythmExports exports;
  COMRAD_TRY_ASSIGN(exports.switch_x, game.spec.user_numbers({"switch_ax", "switch_bx"}));
  COMRAD_TRY_ASSIGN(exports.switch_y, game.spec.user_numbers({"switch_ay", "switch_by"}));
  COMRAD_TRY_ASSIGN(exports.in_zone, game.spec.user_numbers({"in_zone_a", "in_zone_b"}));
  return std::unique_ptr<Oracle>(std::make_unique<Drummers>(game, std::move(exports)));
}

}  // namespace comrad::sim
