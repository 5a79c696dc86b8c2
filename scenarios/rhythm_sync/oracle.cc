// The scripted pair of Rhythm Sync: each walks to its switch, and both press once both are there.
#include <cmath>

#include "sim_workers/oracle/navigator.h"
#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr int kSwitchX = 33, kInZone = 47;  // exported by the script; lane A, then lane B
constexpr double kZoneSlack = 6;            // kept from the edge of the zone

class Drummers final : public Oracle {
 public:
  explicit Drummers(const DoomGame& game)
      : navigator_({.cell_units = 16}),
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
      const Place torch{static_cast<double>(world.exported(kSwitchX + 2 * lane)),
                        static_cast<double>(world.exported(kSwitchX + 2 * lane + 1))};
      const bool there = std::abs(torch.x - here.x) < reach_ && std::abs(torch.y - here.y) < reach_;
      ready = ready && there && world.exported(kInZone + lane) != 0;
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
  Navigator navigator_;
  double reach_;
  std::vector<Sidestep> sidesteps_;
  bool pressed_ = false;
};

}  // namespace

std::unique_ptr<Oracle> make_rhythm_sync_oracle(const DoomGame& game) {
  return std::make_unique<Drummers>(game);
}

}  // namespace comrad::sim
