#include "scenarios/stag_hunt_arena/layout.h"

#include <algorithm>
#include <string>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/map_plan.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::stag_hunt_arena {
namespace {

using doomgen::AreaId;
using doomgen::Box;
using doomgen::MapPlan;
using doomgen::Point;

constexpr int32_t kWallToStart = 128, kStartOffset = 64, kStartRows = 64;
constexpr int32_t kHareClearance = 24;  // more than a hare's radius
constexpr int kWallBends = 7;           // of each wall, where it is bent
constexpr int32_t kWallBend = 56;       // units to either side; starts and spots keep their room

std::vector<LayoutParameter> parameters() {
  return {
      {"side", 2048, 1024, 8192, "length of the arena's sides, units (axis: 1792, 2048, 2304)"},
      {"outer_spots", 12, 1, 64, "hares' spots in the outer ring (axis: 8, 12, 16)"},
      {"jitter", 48, 0, 96, "hares' spots are moved by up to this along either axis, units"},
      {"stag_hp", 500, 1, 100000, "the stag's health"},
      {"stag_regen", 4, 0, 1000, "health that it regains every 4 tics while it is shielded"},
      {"stag_first", 175, 0, 18000, "tics until the first stag comes"},
      {"stag_respawn", 500, 4, 18000, "tics from a kill to the next stag"},
      {"stag_age", 2450, 4, 100000, "tics after which a stag leaves"},
      {"stag_retry", 200, 4, 18000, "tics from its leaving to the next"},
      {"coop_radius", 555, 64, 8192, "two hunters so near to the stag drop its shield (axis: 420, 555, 700)"},
      {"hare_interval", 20, 1, 18000, "tics between hares that come"},
      {"hare_cap", 12, 0, 64, "hares that live at most"},
      {"hare_speed", 24, 1, 40, "units that a hare steps every other tic"},
      {"hare_radius", 555, 16, 8192, "a hunter so near makes a hare vulnerable"},
      {"hare_heal", 3, 0, 200, "health for the hare's killer"},
      {"stag_heal", 50, 0, 200, "health for every hunter at a stag's death"},
      {"stag_shells", 20, 0, 200, "shells for every hunter at a stag's death"},
      variety_parameter("1: bent walls, height, textures and light come from the seed (pools set it)"),
  };
}

std::vector<int64_t> column(const std::vector<Point>& points, int32_t Point::*axis) {
  std::vector<int64_t> values;
  for (const Point& p : points) values.push_back(p.*axis);
  return values;
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t half = wanted.value32("side") / 2, jitter = wanted.value32("jitter");
  const int outer_count = wanted.value32("outer_spots");

  const Box square{{-half, -half}, {half, half}};
  doomgen::AreaSpec arena{.name = "arena",
                          .ceiling = 384,
                          .floor_texture = "FLOOR4_8",
                          .ceiling_texture = "CEIL3_5",
                          .wall_texture = "STONE2",
                          .light = 200};
  doomgen::Polygon outline = square.polygon();
  if (wanted.value("variety") != 0) {
    Rng shape(wanted.key.split("shape")), look(wanted.key.split("look"));
    outline = bent_box(square, kWallBends, kWallBend, kWallBend, shape);
    constexpr const char* kFloors[] = {"FLOOR4_8", "FLOOR5_1", "FLAT1", "FLAT5_4",
                                       "MFLR8_1",  "RROCK16",  "GRASS1"};
    constexpr const char* kCeilings[] = {"CEIL3_5", "CEIL5_2", "FLAT10", "RROCK19", "CEIL4_1"};
    constexpr const char* kWalls[] = {"STONE2", "STONE3", "BROWN1", "BRICK7", "GRAY5", "ROCK2", "BIGBRIK1"};
    arena.floor_texture = one_of(kFloors, look);
    arena.ceiling_texture = one_of(kCeilings, look);
    arena.wall_texture = one_of(kWalls, look);
    arena.light = stepped(168, 232, 8, look);
    arena.ceiling = stepped(320, 448, 16, look);
  }

  MapPlan plan;
  plan.add_area(arena, outline);
  for (int player = 0; player < 4; ++player)
    plan.add_start(
        player + 1,
        {player % 2 == 0 ? -kStartOffset : kStartOffset, -half + kWallToStart + (player / 2) * kStartRows},
        90);

  Rng rng(wanted.key.split("hare spots"));
  std::vector<Point> hares;
  const int32_t clearance = kHareClearance + (wanted.value("variety") != 0 ? kWallBend : 0);
  const auto add_ring = [&](int count, int32_t radius, int64_t offset_halves) {
    for (int i = 0; i < count; ++i) {
      Point p = doomgen::polar_point(radius, 2 * i + offset_halves, 2 * count);
      p.x = std::clamp(p.x + rng.between(-jitter, jitter), -half + clearance, half - clearance);
      p.y = std::clamp(p.y + rng.between(-jitter, jitter), -half + clearance, half - clearance);
      hares.push_back(p);
    }
  };
  add_ring(outer_count, half * 85 / 100, 0);
  add_ring(kInnerSpotCount, half / 2, 1);

  DrawnLayout layout;
  COMRAD_TRY_ASSIGN(layout.map, plan.build());
  COMRAD_TRY(doomgen::check_starts(layout.map, 4));
  COMRAD_TRY(doomgen::check_room(layout.map, hares, "a hare's spot", {.radius = 20}));
  COMRAD_TRY(doomgen::check_reaches(layout.map, doomgen::start_points(layout.map), hares, "a hare's spot"));
  layout.defines = {{"OUTER_SPOTS", outer_count}, {"INNER_SPOTS", kInnerSpotCount}};
  layout.arrays = {{"hare_x", column(hares, &Point::x)}, {"hare_y", column(hares, &Point::y)}};
  return layout;
}

/// Stags that fall in the poll after the one that brings them; script.acs counts in polls of 4 tics.
double most_stags(const LayoutTask& task) {
  constexpr int64_t kPollTics = 4;
  const auto in_polls = [](int64_t tics) {
    return std::max<int64_t>(1, (tics + kPollTics - 1) / kPollTics) * kPollTics;
  };
  const int64_t first = in_polls(task.value("stag_first")) + kPollTics,
                next = in_polls(task.value("stag_respawn")) + kPollTics;
  return static_cast<double>(first > task.limit_tics ? 1 : 1 + (task.limit_tics - first) / next);
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = parameters(),
          .draw = draw,
          .axes = {{"side", {{{"side", 1792}}, {{"side", 2048}}, {{"side", 2304}}}},
                   {"outer_spots", {{{"outer_spots", 8}}, {{"outer_spots", 12}}, {{"outer_spots", 16}}}},
                   {"stag",
                    {{{"stag_hp", 400},
                      {"stag_regen", 3},
                      {"stag_first", 210},
                      {"stag_respawn", 420},
                      {"stag_age", 2100},
                      {"stag_retry", 160}},
                     {{"stag_hp", 500},
                      {"stag_regen", 4},
                      {"stag_first", 175},
                      {"stag_respawn", 500},
                      {"stag_age", 2450},
                      {"stag_retry", 200}},
                     {{"stag_hp", 650},
                      {"stag_regen", 5},
                      {"stag_first", 140},
                      {"stag_respawn", 580},
                      {"stag_age", 2800},
                      {"stag_retry", 240}}}},
                   {"coop_radius", {{{"coop_radius", 420}}, {{"coop_radius", 555}}, {{"coop_radius", 700}}}},
                   {"hares",
                    {{{"hare_interval", 28}, {"hare_cap", 8}, {"hare_speed", 20}, {"hare_radius", 480}},
                     {{"hare_interval", 20}, {"hare_cap", 12}, {"hare_speed", 24}, {"hare_radius", 555}},
                     {{"hare_interval", 14}, {"hare_cap", 16}, {"hare_speed", 28}, {"hare_radius", 640}}}},
                   {"payoff",
                    {{{"hare_heal", 4}, {"stag_heal", 40}, {"stag_shells", 16}},
                     {{"hare_heal", 2}, {"stag_heal", 60}, {"stag_shells", 24}}}}},
          .pool_values = {{"variety", 1}},
          .ceiling = most_stags};
}

}  // namespace comrad::scenarios::stag_hunt_arena
