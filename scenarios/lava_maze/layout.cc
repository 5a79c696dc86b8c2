#include "scenarios/lava_maze/layout.h"

#include <algorithm>
#include <array>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/picture.h"

namespace comrad::scenarios::lava_maze {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kCell = 128, kFirstCellTag = 100, kPitTag = 99, kFirstGalleryTag = 200, kClosetSpot = 2000;
constexpr int32_t kPitHalf = 1200, kGalleryGap = 64, kGalleryWidth = 100, kGalleryFloor = 350;
constexpr int32_t kTall = 1024;  // of all ceilings, so that no step hangs in the way of the eye
constexpr int32_t kBlackWidth = 32, kBlackHeight = 20;  // of the pictures that cover the navigator's screen

struct Paint {
  const char* name;
  Colour colour;
};
// Walls and floors in one colour.
constexpr std::array<Paint, 7> kPaints = {{{"LMGREY", {200, 200, 200}},
                                           {"LMSTART", {0, 255, 255}},
                                           {"LMGOAL", {255, 0, 255}},
                                           {"LMGREEN", {0, 255, 0}},
                                           {"LMYELLOW", {255, 255, 0}},
                                           {"LMRED", {255, 0, 0}},
                                           {"LMBLUE", {0, 0, 255}}}};
// What covers the navigator's screen, by the value of the signal.
constexpr std::array<Paint, 5> kScreens = {{{"LMSCR0", {0, 0, 0}},
                                            {"LMSCR1", {0, 255, 0}},
                                            {"LMSCR2", {255, 0, 0}},
                                            {"LMSCR3", {255, 255, 0}},
                                            {"LMSCR4", {0, 0, 255}}}};

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t side = wanted.value32("side"), half = side * kCell / 2, lava_floor = -wanted.value32("depth");
  const int32_t inner = half + kGalleryGap, outer = inner + kGalleryWidth, middle = inner + kGalleryWidth / 2;
  MapPlan plan;
  const AreaId pit = plan.add_area({.name = "pit",
                                    .floor = lava_floor,
                                    .ceiling = kTall,
                                    .floor_texture = "LAVA1",
                                    .wall_texture = "LMGREY",
                                    .light = 255,
                                    .tag = kPitTag,
                                    .in_pieces = true}  // inside and outside of the gallery
                                   ,
                                   Box::around({0, 0}, 2 * kPitHalf, 2 * kPitHalf));
  for (int32_t cell = 0; cell < side * side; ++cell) {
    const Point low{-half + cell % side * kCell, -half + cell / side * kCell};
    plan.add_area({.name = "cell " + std::to_string(cell),
                   .floor = lava_floor,
                   .ceiling = kTall,
                   .floor_texture = "LAVA1",
                   .wall_texture = "LMGREY",
                   .light = 255,
                   .tag = kFirstCellTag + cell},
                  Box{low, {low.x + kCell, low.y + kCell}});
  }
  const std::array<std::pair<const char*, Box>, 4> sides = {
      {{"LMGREEN", Box{{inner, -inner}, {outer, inner}}},
       {"LMYELLOW", Box{{-outer, inner}, {outer, outer}}},
       {"LMRED", Box{{-outer, -inner}, {-inner, inner}}},
       {"LMBLUE", Box{{-outer, -outer}, {outer, -inner}}}}};
  for (std::size_t i = 0; i < sides.size(); ++i) {
    const AreaId gallery = plan.add_area({.name = std::string("gallery ") + sides[i].first,
                                          .floor = kGalleryFloor,
                                          .ceiling = kTall,
                                          .floor_texture = sides[i].first,
                                          .wall_texture = sides[i].first,
                                          .light = 255,
                                          .tag = kFirstGalleryTag + static_cast<int32_t>(i)},
                                         sides[i].second);
    plan.connect(gallery, pit, Passage::window(""));
  }
  // What the navigator's eyes are sent to: its screen is covered, and a closet is quickly drawn.
  const Point closet{kPitHalf + 2 * kCell, 0};
  plan.add_area({.name = "closet", .wall_texture = "LMGREY"}, Box::around(closet, kCell, kCell));
  plan.add_spot(kClosetSpot, closet);
  plan.add_start(1, {-half + kCell + kCell / 2, -half + kCell + kCell / 2}, 0);
  plan.add_start(2, {0, -middle}, 90);

  COMRAD_TRY_ASSIGN(MapData map, plan.build());
  COMRAD_TRY(check_starts(map, 2));
  // Raised cells are islands: nobody climbs out of the lava, and nobody leaves the gallery.
  const std::vector<Point> starts = start_points(map);
  const MapData raised = with_floors_at(map, {kFirstCellTag + side + 1}, 0);
  const Point outside{outer + kCell, outer + kCell}, next_cell{starts[0].x + kCell, starts[0].y};
  COMRAD_TRY(check_separated(map, std::span(&starts[1], 1), std::span(&outside, 1), "the pit"));
  if (lava_floor < -24)
    COMRAD_TRY(check_separated(raised, std::span(&next_cell, 1), std::span(&starts[0], 1), "a raised cell"));

  DrawnLayout drawn{.map = std::move(map)};
  drawn.defines = {{"HALF", half},
                   {"RING", middle},
                   {"GALLERY_FLOOR", kGalleryFloor},
                   {"CELL_TAG_FIRST", kFirstCellTag},
                   {"PIT_TAG", kPitTag},
                   {"CLOSET_SPOT", kClosetSpot},
                   {"SCREEN_WIDTH", kBlackWidth},
                   {"SCREEN_HEIGHT", kBlackHeight}};
  for (const Paint& paint : kPaints)
    drawn.textures.push_back({paint.name, encode_png(Picture(16, 16, paint.colour))});
  for (const Paint& paint : kScreens)
    drawn.textures.push_back({paint.name, encode_png(Picture(kBlackWidth, kBlackHeight, paint.colour))});
  return drawn;
}

/// LEVELS of script.acs; the first path is walked even where that is none.
double levels(const LayoutTask& task) {
  return static_cast<double>(std::max<int64_t>(1, (task.value("maximum") - task.value("initial") + 1) / 2));
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = {{"side", 8, 4, 8, "cells of a side of the maze (axis: 4, 6, 8)"},
                         {"initial", 8, 2, 64, "size of the first path (axis: 3, 5, 6, 8, 10)"},
                         {"maximum", 20, 2, 64, "size of the last path; it grows by 2 (axis: 4, 12, 20, 25)"},
                         {"damage", 35, 1, 100, "health that lava takes every 32 tics (axis: 10, 20, 35)"},
                         {"depth", 64, 24, 256,
                          "units from a path down to the lava; 24 can be climbed (axis: 24, 64)"}},
          .draw = draw,
          .axes = {{"initial", {{{"initial", 6}}, {{"initial", 8}}, {{"initial", 10}}}},
                   {"maximum", {{{"maximum", 20}}, {{"maximum", 25}}}}},
          .ceiling = levels};
}

}  // namespace comrad::scenarios::lava_maze
