// The scripted team of Co-op Puzzle: whoever has the lit plate stands on it until the partner is through.
#include <array>
#include <cmath>
#include <vector>

#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr double kDoorDepth = 32, kBody = 16, kMargin = 42;
constexpr double kPassable = 60;  // of a door's opening

class Lanes final : public Oracle {
 public:
  explicit Lanes(const DoomGame& game)
      : zones_(number(game, "zones", 10)),
        plates_(number(game, "plates", 2)),
        period_(number(game, "sync_period", 3)),
        length_(number(game, "length", 384)),
        lane_(number(game, "lane", 240)),
        gap_(number(game, "gap", 0)),
        size_(number(game, "plate_size", 72)) {}

  void reset(const doom::World&) override { lit_.clear(); }

  void press(const doom::World& world, std::span<doom::Buttons> buttons) override {
    if (world.tic_count() == 0) return;  // the scripts have lit no plates yet
    if (lit_.empty()) find_lit_plates(world);
    for (int who = 0; who < 2; ++who) {
      const doom::Actor& body = world.body(who);
      const Place goal = destination(world, who);
      walk_to(body, goal, {.backward = false, .stop_units = 10}, buttons[static_cast<std::size_t>(who)]);
    }
  }

 private:
  struct Plate {
    int lane = -1;  // -1: none
    double x = 0;
  };

  void find_lit_plates(const doom::World& world) {
    lit_.assign(static_cast<std::size_t>(zones_) + 1, Plate{});
    for (int zone = 1; zone <= zones_; ++zone)
      for (int lane = 0; lane < 2; ++lane)
        for (int index = 0; index < plates_; ++index)
          if (const doom::Sector* sector = find_sector(world, zone * 1000 + (lane == 0 ? 1 : 101) + index);
              sector != nullptr && sector->floor_texture.starts_with("AQF"))
            lit_[static_cast<std::size_t>(zone)] = {lane,
                                                    west_of(zone) + (index + 1) * length_ / (plates_ + 1)};
  }

  static int number(const DoomGame& game, const char* name, int otherwise) {
    return static_cast<int>(game.layout.parameter(name, otherwise));
  }
  double west_of(int zone) const { return (zone - 1) * length_ - length_ / 2.0; }
  double middle_of(int who) const { return (who == 0 ? 1 : -1) * (gap_ / 2.0 + lane_ / 2.0); }
  double plate_y(int who) const {
    return middle_of(who) + (who == 0 ? 1 : -1) * (lane_ / 2.0 - size_ / 2.0 - kMargin);
  }
  int zone_of(double x) const { return static_cast<int>(std::floor((x + length_ / 2.0) / length_)) + 1; }
  bool is_sync(int pair) const {
    return pair > period_ && (pair - (period_ + 1)) % period_ == 0 && 2 * pair < zones_;
  }

  static const doom::Sector* find_sector(const doom::World& world, int tag) {
    for (const doom::Sector& sector : world.sectors())
      if (sector.tag == tag) return &sector;
    return nullptr;
  }
  bool door_is_open(const doom::World& world, int pair, int who) const {
    const doom::Sector* door = find_sector(world, who == 0 ? pair : pair + 50);
    return door != nullptr && doom::to_double(door->ceiling_height - door->floor_height) >= kPassable;
  }

  Place destination(const doom::World& world, int who) const {
    const double x = place_of(world.body(who)).x, partner_x = place_of(world.body(1 - who)).x;
    const int zone = zone_of(x), pair = (zone + 1) / 2;
    const double door_x = west_of(2 * pair);  // the eastern side of the pair's door
    const Place onward{x + 128, middle_of(who)};
    const auto plate = [&](double plate_x) { return Place{plate_x, plate_y(who)}; };
    const Plate& lit = lit_[static_cast<std::size_t>(std::min(zone, zones_))];
    const bool partner_is_through = partner_x > door_x + kBody + 8;
    if (zone % 2 == 0) {
      if (lit.lane == who && !partner_is_through) return plate(lit.x);
      return zone >= zones_ ? Place{west_of(zone) + length_ / 2.0, middle_of(who)} : onward;
    }
    if (x > door_x - kDoorDepth - kBody || door_is_open(world, pair, who)) {
      if (lit.lane != who || partner_is_through || is_sync(pair)) return onward;
    }
    if (is_sync(pair)) {
      // Wait on the plate until the partner has come into the zone as well, then until the doors open.
      return plate(west_of(zone) + length_ / 3);
    }
    if (lit.lane == who && !partner_is_through) return plate(lit.x);
    return {door_x - kDoorDepth - kBody - 10, middle_of(who)};
  }

  int zones_, plates_, period_, length_, lane_, gap_, size_;
  std::vector<Plate> lit_;  // [zone]
};

}  // namespace

std::unique_ptr<Oracle> make_coop_puzzle_oracle(const DoomGame& game) {
  return std::make_unique<Lanes>(game);
}

}  // namespace comrad::sim
