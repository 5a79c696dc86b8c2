// The scripted team of Co-op Puzzle: the agent with the lit plate stands on it until the partner is through.
#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <utility>
#include <vector>

#include "sim_workers/oracle/oracle.h"
#include "sim_workers/oracle/steering.h"

namespace comrad::sim {
namespace {

constexpr double kDoorDepth = 32;
constexpr int kFirstSyncTag = 100, kFirstZoneTag = 200, kTagsPerZone = 1000;
constexpr double kPassable = 60;  // of a door's opening

class Lanes final : public Oracle {
 public:
  explicit Lanes(const DoomGame& game)
      : zones_(number(game, "zones", 10)), period_(number(game, "sync_period", 3)) {
    edge_.assign(static_cast<std::size_t>(zones_) + 2, 0);
    for (std::size_t sector = 0; sector < game.level->sectors.size(); ++sector) {
      const int tag = game.level->sectors[sector].tag;
      const Extent extent = extent_of(*game.level, sector);
      if (const int zone = tag - kFirstZoneTag; zone >= 1 && zone <= zones_) {
        const auto index = static_cast<std::size_t>(zone);
        edge_[index] = extent.low.x;
        if (zone == zones_) edge_[index + 1] = extent.high.x;
        middle_ = std::max(middle_, extent.middle().y);
      }
      if (const int zone = tag - kFirstSyncTag; zone >= 1 && zone <= zones_)
        sync_[{zone, extent.middle().y > 0 ? 0 : 1}] = extent.middle();
    }
  }

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
    Place middle;
  };

  void find_lit_plates(const doom::World& world) {
    lit_.assign(static_cast<std::size_t>(zones_) + 1, Plate{});
    for (std::size_t i = 0; i < world.sectors().size(); ++i) {
      const doom::Sector& sector = world.sectors()[i];
      const int zone = sector.tag / kTagsPerZone;
      if (zone >= 1 && zone <= zones_ && sector.floor_texture.starts_with("AQF")) {
        const Place middle = extent_of(world.level(), i).middle();
        lit_[static_cast<std::size_t>(zone)] = {middle.y > 0 ? 0 : 1, middle};
      }
    }
  }

  static int number(const DoomGame& game, const char* name, int otherwise) {
    return static_cast<int>(game.layout.parameter(name, otherwise));
  }
  double west_of(int zone) const { return edge_[static_cast<std::size_t>(zone)]; }
  double middle_of(int who) const { return who == 0 ? middle_ : -middle_; }
  int zone_of(double x) const {
    int zone = 1;
    while (zone < zones_ && x >= west_of(zone + 1)) ++zone;
    return zone;
  }
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
    const Plate& lit = lit_[static_cast<std::size_t>(std::min(zone, zones_))];
    const bool partner_is_through = partner_x > door_x + kPlayerRadius + 8;
    if (zone % 2 == 0) {
      if (lit.lane == who && !partner_is_through) return lit.middle;
      return zone >= zones_ ? Place{(west_of(zone) + west_of(zone + 1)) / 2, middle_of(who)} : onward;
    }
    if (x > door_x - kDoorDepth - kPlayerRadius || door_is_open(world, pair, who)) {
      if (lit.lane != who || partner_is_through || is_sync(pair)) return onward;
    }
    if (is_sync(pair)) {
      // Wait on the plate until the partner has come into the zone as well, then until the doors open.
      return sync_.at({zone, who});
    }
    if (lit.lane == who && !partner_is_through) return lit.middle;
    return {door_x - kDoorDepth - kPlayerRadius - 10, middle_of(who)};
  }

  int zones_, period_;
  std::vector<double> edge_;                   // [zone] its west; one more: the last one's east
  double middle_ = 0;                          // of lane A; lane B's lies opposite
  std::map<std::pair<int, int>, Place> sync_;  // (zone, lane) -> its plate
  std::vector<Plate> lit_;                     // [zone]
};

}  // namespace

Expected<std::unique_ptr<Oracle>> make_coop_puzzle_oracle(const DoomGame& game) {
  return std::unique_ptr<Oracle>(std::make_unique<Lanes>(game));
}

}  // namespace comrad::sim
