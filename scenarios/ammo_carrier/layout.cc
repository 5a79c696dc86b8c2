#include "scenarios/ammo_carrier/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <string>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/map_plan.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::ammo_carrier {
namespace {

using doomgen::AreaId;
using doomgen::Box;
using doomgen::MapPlan;
using doomgen::Point;

constexpr int32_t kHubSize = 700, kDepotSize = 400, kPadSize = 96, kPadOffset = 200;
constexpr int32_t kSpokeWidth = 256, kRingWidth = 192;
constexpr int32_t kFieldMargin = 512, kFieldCells = 8'000;  // of organic outlines
constexpr int32_t kJaggedWall = 40;  // that such a wall may reach inwards, and a little
constexpr int32_t kHubSpotDistance = 320;
constexpr int32_t kBodyClearance = 32;  // the widest monster has radius 30
constexpr int32_t kItemClearance = 48;  // a runner takes an item without touching a wall

std::vector<LayoutParameter> parameters() {
  return {
      {"radius", 1200, 800, 4000, "depots lie at 0.8 of it from the hub, units (axis: 1000, 1200, 1400)"},
      {"depots", 1, 1, 3, "places where bullets appear (axis: 1, 2, 3)"},
      {"density", 1000, 250, 4000, "how many monsters come, thousandths (axis: 750, 1000, 1250)"},
      {"jitter", 64, 0, 128, "depots are moved by up to this along either axis, units"},
      organic_parameter(),
  };
}

/// numerator / denominator, rounded to the nearest whole number.
int64_t rounded(int64_t numerator, int64_t denominator) {
  return (2 * numerator + denominator) / (2 * denominator);
}

std::vector<int64_t> column(const std::vector<Point>& points, int32_t Point::*axis) {
  std::vector<int64_t> values;
  for (const Point& p : points) values.push_back(p.*axis);
  return values;
}

Error refused(const std::string& what) { return Error{ErrorCode::kBadInput, "ammo_carrier: " + what}; }

/// How often monsters come: one in so many spots brings one, in the first wave and in later ones.
struct Waves {
  int64_t first_odds, odds, tics;
};
Waves waves_of(int64_t density) {
  return {1 + std::max<int64_t>(1, rounded(2000, density) - 1),
          1 + std::max<int64_t>(1, rounded(3000, density)), std::max<int64_t>(70, rounded(175'000, density))};
}

/// The bullets that appear in an episode against those that its monsters take, on average.
Status check_resources(const LayoutTask& task) {
  // Of script.acs: every 70 tics a box of 50 one time of five, else a clip of 10; kinds of monsters in elevenths.
  constexpr double kStartBullets = 50, kItemTics = 70, kItem = (50 + 4 * 10) / 5.0, kFirstWaveTics = 70;
  constexpr double kHealth = (1 * 150 + 1 * 30 + 3 * 60 + 6 * 20) / 11.0;
  constexpr double kDamage = 10;  // of a bullet on average; the last one is half wasted
  constexpr double kHits = 0.5;   // of the bullets, at what comes through doors far away
  const Waves waves = waves_of(task.value("density"));
  const double tics = task.limit_tics;
  const double monsters = static_cast<double>(kHubSpotCount) / static_cast<double>(waves.first_odds) +
                          (tics - kFirstWaveTics) / static_cast<double>(waves.tics) *
                              static_cast<double>(kHubSpotCount + task.value("depots")) /
                              static_cast<double>(waves.odds);
  const double needed = monsters * (kHealth / kDamage + 0.5) / kHits;
  const double given = kStartBullets + tics / kItemTics * kItem;
  if (needed <= given) return {};
  return Error{
      ErrorCode::kBadInput,
      fmt::format("some {} monsters take {} bullets, and {} appear; lower density or depots",
                  static_cast<int64_t>(monsters), static_cast<int64_t>(needed), static_cast<int64_t>(given))};
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int depot_count = wanted.value32("depots");
  const int32_t jitter = wanted.value32("jitter");
  const Waves waves = waves_of(wanted.value("density"));

  MapPlan plan;
  const int32_t field = 2 * (wanted.value32("radius") + kFieldMargin);
  use_organic_outlines(plan, wanted, Box::around({0, 0}, field, field), kFieldCells);
  const AreaId hub = plan.add_area(
      {.name = "hub", .ceiling = 256, .floor_texture = "FLOOR4_8", .wall_texture = "STONE3", .light = 224},
      Box::around({0, 0}, kHubSize, kHubSize));
  std::vector<AreaId> depots;
  Rng places(wanted.key.split("depots"));
  for (int k = 0; k < depot_count; ++k) {
    Point centre = doomgen::polar_point(wanted.value32("radius") * 8 / 10, k, depot_count);
    centre.x += places.between(-jitter, jitter);
    centre.y += places.between(-jitter, jitter);
    depots.push_back(plan.add_area({.name = fmt::format("depot {}", k + 1),
                                    .ceiling = 200,
                                    .floor_texture = "CEIL5_1",
                                    .wall_texture = "BROWN96",
                                    .light = 216},
                                   Box::around(centre, kDepotSize, kDepotSize)));
  }
  for (int k = 0; k < depot_count; ++k)
    plan.add_corridor({.name = fmt::format("spoke {}", k + 1), .floor_texture = "FLOOR4_8", .light = 208},
                      hub, depots[k], {.width = kSpokeWidth});
  // Two depots need one way between them, a single one none.
  for (int k = 0; k < (depot_count < 3 ? depot_count - 1 : depot_count); ++k)
    plan.add_corridor({.name = fmt::format("ring {}", k + 1), .floor_texture = "FLOOR5_1", .light = 196},
                      depots[k], depots[(k + 1) % depot_count], {.width = kRingWidth});
  for (const auto& [x, y] : {std::pair{1, 1}, {-1, 1}, {-1, -1}, {1, -1}})
    plan.add_area({.name = std::string("pad ") + (y > 0 ? "north " : "south ") + (x > 0 ? "east" : "west"),
                   .ceiling = 256,
                   .floor_texture = "FLAT19",
                   .wall_texture = "STONE3",
                   .light = 224},
                  Box::around({x * kPadOffset, y * kPadOffset}, kPadSize, kPadSize));

  // Monsters: one place in every depot, then four in the hub.
  std::vector<Point> enemies, ammo, runners;
  Rng enemy_rng(wanted.key.split("enemy spots")), ammo_rng(wanted.key.split("ammo spots")),
      runner_rng(wanted.key.split("runner spots"));
  for (const AreaId depot : depots) {
    for (const Point& p : plan.random_points(depot, 1, {.clearance = kBodyClearance}, enemy_rng))
      enemies.push_back(p);
    for (const Point& p : plan.random_points(depot, kAmmoSpotsPerDepot,
                                             {.clearance = kItemClearance, .spacing = 64}, ammo_rng))
      ammo.push_back(p);
  }
  if (static_cast<int>(enemies.size()) != depot_count ||
      static_cast<int>(ammo.size()) != kAmmoSpotsPerDepot * depot_count)
    return refused("a depot has no room for its spots");
  const int32_t hub_spot = kHubSpotDistance - (wanted.value("organic") != 0 ? kJaggedWall : 0);
  for (const Point& p : {Point{0, hub_spot}, Point{hub_spot, 0}, Point{0, -hub_spot}, Point{-hub_spot, 0}})
    enemies.push_back(p);
  for (int i = 0; i < kRunnerSpotCount; ++i) {
    const AreaId depot = depots[runner_rng.below(static_cast<uint32_t>(depot_count))];
    const auto p = plan.random_point(depot, kBodyClearance, runner_rng);
    if (!p) return refused("a depot has no room for its spots");
    runners.push_back(*p);
  }
  const Point starts[] = {{0, 0}, {64, 0}, {-64, 0}, {0, 64}};
  for (int player = 0; player < 4; ++player) plan.add_start(player + 1, starts[player], 0);

  DrawnLayout layout;
  COMRAD_TRY_ASSIGN(layout.map, plan.build());
  COMRAD_TRY(doomgen::check_starts(layout.map, 4));
  const auto hub_start = std::span(starts, 1);
  COMRAD_TRY(doomgen::check_room(layout.map, enemies, "a monster's spot", {.radius = 30}));
  COMRAD_TRY(doomgen::check_reaches(layout.map, hub_start, enemies, "a monster's spot", {.radius = 30}));
  COMRAD_TRY(doomgen::check_reaches(layout.map, hub_start, ammo, "an ammunition spot"));
  COMRAD_TRY(doomgen::check_reaches(layout.map, hub_start, runners, "a runner's spot"));
  layout.defines = {
      {"DEPOTS", depot_count},
      {"HUB_SPOTS", kHubSpotCount},
      {"AMMO_SPOTS", static_cast<int64_t>(ammo.size())},
      {"RUNNER_SPOTS", kRunnerSpotCount},
      {"FIRST_WAVE_ODDS", waves.first_odds},
      {"WAVE_ODDS", waves.odds},
      {"WAVE_TICS", waves.tics},
  };
  layout.arrays = {{"enemy_x", column(enemies, &Point::x)},  {"enemy_y", column(enemies, &Point::y)},
                   {"ammo_x", column(ammo, &Point::x)},      {"ammo_y", column(ammo, &Point::y)},
                   {"runner_x", column(runners, &Point::x)}, {"runner_y", column(runners, &Point::y)}};
  return layout;
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = parameters(),
          .draw = draw,
          .axes = {{"radius", {{{"radius", 1000}}, {{"radius", 1200}}, {{"radius", 1400}}}},
                   {"depots", {{{"depots", 1}}, {{"depots", 2}}, {{"depots", 3}}}},
                   {"density", {{{"density", 750}}, {{"density", 1000}}, {{"density", 1250}}}}},
          .check_resources = check_resources};
}

}  // namespace comrad::scenarios::ammo_carrier
