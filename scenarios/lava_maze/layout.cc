#include "scenarios/lava_maze/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/picture.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::lava_maze {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kCell = 128, kFirstCellTag = 100, kPitTag = 99, kFirstGalleryTag = 200, kClosetSpot = 2000;
constexpr int32_t kPitHalf = 1200, kGalleryGap = 64, kGalleryWidth = 100, kGalleryFloor = 350;
constexpr int32_t kTall = 1024;  // of all ceilings, so that no step hangs in the way of the eye
constexpr int32_t kFieldHalf = 1600, kFieldCells = 12'000;  // of organic outlines
constexpr int32_t kRocksMax = 3, kRockTries = 40;
constexpr int32_t kRockHeight = 32;  // nobody steps up so far, and nothing is hidden from the gallery
constexpr int32_t kPathFloors = 8;   // of the script
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

/// What the seed varies where `variety` is 1; as published otherwise.
struct Variety {
  int32_t gallery_gap = kGalleryGap, gallery_width = kGalleryWidth, gallery_floor = kGalleryFloor;
  Polygon pit = Box::around({0, 0}, 2 * kPitHalf, 2 * kPitHalf).polygon();
  const char* walls = "LMGREY";
  int32_t path_floor = 0;  ///< of the script's textures for paths
  int32_t light = 255;
  std::vector<int64_t> rocks;  ///< [cell] 1: a rock in the lava, which paths go round
};

/// Cells of the neighbour `far` cells away in direction 0..3; -1 outside the maze.
int32_t neighbour(int32_t cell, int direction, int32_t far, int32_t side) {
  constexpr int32_t kDx[] = {1, 0, -1, 0}, kDy[] = {0, 1, 0, -1};
  const int32_t x = cell % side + kDx[direction] * far, y = cell / side + kDy[direction] * far;
  return x < 0 || y < 0 || x >= side || y >= side ? -1 : y * side + x;
}

/// How many of the cells that a path from `start` may turn on can be got to: every other one.
int32_t path_nodes(int32_t start, int32_t side, const std::vector<int64_t>& rocks) {
  std::vector<int32_t> nodes{start};
  for (std::size_t i = 0; i < nodes.size(); ++i)
    for (int d = 0; d < 4; ++d) {
      const int32_t between = neighbour(nodes[i], d, 1, side), next = neighbour(nodes[i], d, 2, side);
      if (next < 0 || rocks[between] != 0 || rocks[next] != 0) continue;
      if (std::find(nodes.begin(), nodes.end(), next) == nodes.end()) nodes.push_back(next);
    }
  return static_cast<int32_t>(nodes.size());
}

/// Rocks keep no path from its full size: from every free cell as many cells can be got to as the longest
/// path requests, or as there are without rocks.
bool paths_fit(const LayoutDraw& wanted, const std::vector<int64_t>& rocks) {
  const int32_t side = wanted.value32("side");
  const int32_t longest = std::max(wanted.value32("initial"), wanted.value32("maximum"));
  const std::vector<int64_t> none(rocks.size(), 0);
  for (int32_t cell = 0; cell < side * side; ++cell)
    if (rocks[cell] == 0 &&
        path_nodes(cell, side, rocks) < std::min(longest / 2 + 1, path_nodes(cell, side, none)))
      return false;
  return true;
}

Variety draw_variety(const LayoutDraw& wanted) {
  Variety drawn;
  const int32_t side = wanted.value32("side");
  drawn.rocks.assign(static_cast<std::size_t>(side * side), 0);
  if (wanted.value("variety") == 0) return drawn;
  Rng shape(wanted.key.split("shape")), look(wanted.key.split("look")), rocks(wanted.key.split("rocks"));
  drawn.gallery_gap = stepped(kGalleryGap, 128, 8, shape);
  drawn.gallery_width = stepped(80, 144, 8, shape);
  drawn.gallery_floor = stepped(320, 416, 8, shape);
  drawn.pit = bent_box(Box::around({0, 0}, 2 * kPitHalf, 2 * kPitHalf), 4, 200, 96, shape);
  constexpr const char* kWalls[] = {"LMGREY", "ASHWALL2", "ASHWALL4", "ROCK4", "STONE4", "BSTONE1"};
  drawn.walls = one_of(kWalls, look);
  drawn.path_floor = look.between(0, kPathFloors - 1);
  drawn.light = stepped(207, 255, 8, look);
  const int wanted_rocks = rocks.between(0, kRocksMax);
  for (int i = 0, tries = 0; i < wanted_rocks && tries < kRockTries; ++tries) {
    const auto cell = static_cast<int32_t>(rocks.below(static_cast<uint32_t>(side * side)));
    // The cell where player 1 starts and the one beside it, which the checks ask about, stay free.
    if (drawn.rocks[cell] != 0 || cell == side + 1 || cell == side + 2) continue;
    drawn.rocks[cell] = 1;
    if (paths_fit(wanted, drawn.rocks))
      ++i;
    else
      drawn.rocks[cell] = 0;
  }
  return drawn;
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t side = wanted.value32("side"), half = side * kCell / 2, lava_floor = -wanted.value32("depth");
  const Variety variety = draw_variety(wanted);
  const int32_t inner = half + variety.gallery_gap, outer = inner + variety.gallery_width,
                middle = inner + variety.gallery_width / 2;
  MapPlan plan;
  use_organic_outlines(plan, wanted, Box::around({0, 0}, 2 * kFieldHalf, 2 * kFieldHalf), kFieldCells);
  const AreaId pit = plan.add_area({.name = "pit",
                                    .floor = lava_floor,
                                    .ceiling = kTall,
                                    .floor_texture = "LAVA1",
                                    .wall_texture = variety.walls,
                                    .light = variety.light,
                                    .tag = kPitTag,
                                    .in_pieces = true}  // inside and outside of the gallery
                                   ,
                                   variety.pit);
  for (int32_t cell = 0; cell < side * side; ++cell) {
    const Point low{-half + cell % side * kCell, -half + cell / side * kCell};
    const bool is_rock = variety.rocks[cell] != 0;
    plan.add_area({.name = fmt::format("cell {}", cell),
                   .floor = is_rock ? kRockHeight : lava_floor,
                   .ceiling = kTall,
                   .floor_texture = is_rock ? "RROCK10" : "LAVA1",
                   .wall_texture = is_rock ? "ASHWALL3" : variety.walls,
                   .light = variety.light,
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
                                          .floor = variety.gallery_floor,
                                          .ceiling = kTall,
                                          .floor_texture = sides[i].first,
                                          .wall_texture = sides[i].first,
                                          .light = variety.light,
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
                   {"GALLERY_FLOOR", variety.gallery_floor},
                   {"CELL_TAG_FIRST", kFirstCellTag},
                   {"PIT_TAG", kPitTag},
                   {"CLOSET_SPOT", kClosetSpot},
                   {"SCREEN_WIDTH", kBlackWidth},
                   {"SCREEN_HEIGHT", kBlackHeight},
                   {"PATH_FLOOR", variety.path_floor}};
  drawn.arrays = {{"rock", variety.rocks}};
  if (const int64_t guide = wanted.value("guide"), wait = wanted.value("wait"); guide > 0 || wait > 0) {
    drawn.more_scripts = {"guide.acs"};
    drawn.defines.insert(drawn.defines.end(), {{"GUIDE_PERCENT", guide}, {"GUIDE_WAIT", wait}});
  }
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

/// Stages of our own. On the default map neither side can begin: no flash means anything before the navigator follows
/// it, and nothing is worth following before flashes mean something. So the map puts flashes right at first, on short
/// paths; then fewer of them, until the signaler's own colours are all there is. It also keeps the first flash back for
/// a while, for who flashes in the first decision has not seen the path yet; last, the signaler has to wait by itself.
/// Lava kills at its first bite, which saves the frames of dying; in nothing else the last stage differs from the default
/// map, which is a held-out one, for it is the same for all seeds.
CurriculumRecipe curriculum() {
  return {.parameters = {"guide", "wait", "damage", "initial", "maximum"},
          .stages = {{"shown_one_hop", 42, {100, 16, 100, 3, 4}},
                     {"shown_two_hops", 42, {100, 16, 100, 5, 6}},
                     {"shown", 42, {100, 16, 100, 8, 20}},
                     {"half_shown_one_hop", 42, {50, 16, 100, 3, 4}},
                     {"half_shown_two_hops", 42, {50, 16, 100, 5, 6}},
                     {"half_shown", 42, {50, 16, 100, 8, 20}},
                     {"one_hop", 42, {0, 16, 100, 3, 4}},
                     {"two_hops", 42, {0, 16, 100, 5, 6}},
                     {"two_hops_at_once", 42, {0, 0, 100, 5, 6}},
                     {"three_hops", 42, {0, 0, 100, 7, 8}},
                     {"six_levels", 42, {0, 0, 100, 8, 20}}}};
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters =
              {{"side", 8, 4, 8, "cells of a side of the maze (axis: 4, 6, 8)"},
               {"initial", 8, 2, 64, "size of the first path (axis: 3, 5, 6, 8, 10)"},
               {"maximum", 20, 2, 64, "size of the last path; it grows by 2 (axis: 4, 12, 20, 25)"},
               {"damage", 35, 1, 100, "health that lava takes every 32 tics (axis: 10, 20, 35)"},
               {"depth", 64, 24, 256, "units from a path down to the lava; 24 can be climbed (axis: 24, 64)"},
               {"guide", 0, 0, 100,
                "percent of flashes that show the colour of the way, whatever lamp flashes (our curriculum)",
                /*hide_default=*/true},
               {"wait", 0, 0, 1000, "tics before the first flash may begin (our curriculum)",
                /*hide_default=*/true},
               variety_parameter("1: outline of the pit, gallery, up to 3 rocks that paths go round, "
                                 "textures and light come from the seed (pools set it)"),
               organic_parameter()},
          .draw = draw,
          .axes = {{"initial", {{{"initial", 6}}, {{"initial", 8}}, {{"initial", 10}}}},
                   {"maximum", {{{"maximum", 20}}, {{"maximum", 25}}}}},
          .pool_values = {{"variety", 1}},
          .curriculum = curriculum(),
          .ceiling = levels};
}

}  // namespace comrad::scenarios::lava_maze
