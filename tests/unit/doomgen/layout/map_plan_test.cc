#include "doomgen/layout/map_plan.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/udmf_writer.h"

namespace comrad::doomgen {
namespace map_plan_test {

using testing::HasSubstr;

MapData built(const MapPlan& plan) {
  auto map = plan.build();
  EXPECT_TRUE(map) << map.error().message;
  return map ? *map : MapData{};
}

std::string mistake(const MapPlan& plan) {
  const auto map = plan.build();
  return map ? "no error" : map.error().message;
}

/// Twice the surface of a sector, from its lines.
int64_t twice_surface(const MapData& map, uint32_t sector) {
  int64_t sum = 0;
  const auto add = [&](uint32_t side, uint32_t start, uint32_t end) {
    const Point a = map.vertices[start], b = map.vertices[end];
    if (map.sidedefs[side].sector == sector) sum -= int64_t{a.x} * b.y - int64_t{b.x} * a.y;
  };
  for (const LinedefData& line : map.linedefs) {
    add(line.front, line.start, line.end);
    if (line.back) add(*line.back, line.end, line.start);
  }
  return sum;
}

const LinedefData* line_between(const MapData& map, Point a, Point b) {
  for (const LinedefData& line : map.linedefs) {
    const Point start = map.vertices[line.start], end = map.vertices[line.end];
    if ((start == a && end == b) || (start == b && end == a)) return &line;
  }
  return nullptr;
}

TEST(MapPlan, LaterAreasLieOverEarlierOnes) {
  MapPlan plan;
  plan.add_area({.name = "below"}, Box{{0, 0}, {256, 256}});
  plan.add_area({.name = "above"}, Box{{128, 128}, {384, 384}});
  const MapData map = built(plan);
  EXPECT_EQ(twice_surface(map, 0), 2 * (256 * 256 - 128 * 128));
  EXPECT_EQ(twice_surface(map, 1), 2 * 256 * 256);
  EXPECT_EQ(plan.area_at({200, 200}), 1);
}

TEST(MapPlan, AnAreaThatClaimsRockAloneLeavesOthersWhole) {
  MapPlan plan;
  plan.add_area({.name = "room"}, Box{{0, 0}, {256, 256}});
  plan.add_area({.name = "way"}, Box{{128, 64}, {512, 128}}, Claim::kOnlyRock);
  const MapData map = built(plan);
  EXPECT_EQ(twice_surface(map, 0), 2 * 256 * 256);
  EXPECT_EQ(twice_surface(map, 1), 2 * 256 * 64);
  ASSERT_NE(line_between(map, {256, 64}, {256, 128}), nullptr);
  EXPECT_TRUE(line_between(map, {256, 64}, {256, 128})->back.has_value());
}

TEST(MapPlan, ObliqueOutlinesThatCrossAgreeInTheRoundedCrossing) {
  MapPlan plan;
  plan.add_area({.name = "a", .in_pieces = true}, Polygon{{0, 0}, {997, 13}, {1003, 509}, {7, 491}});
  plan.add_area({.name = "b", .in_pieces = true}, Polygon{{501, -201}, {1207, 303}, {703, 799}, {211, 307}});
  plan.add_area({.name = "c", .in_pieces = true}, Polygon{{-103, 211}, {1301, 223}, {1297, 307}, {-97, 301}});
  const MapData map = built(plan);  // validate_map() has looked at every line
  EXPECT_EQ(map.sectors.size(), 3u);
  EXPECT_GT(twice_surface(map, 2), 2 * 100'000);
}

TEST(MapPlan, CornersThatNoRoomNeedsAreLeftOut) {
  MapPlan plan;
  const AreaId room = plan.add_area({.name = "room"}, Box{{0, 0}, {256, 256}});
  plan.extend_area(room, Box{{256, 0}, {512, 256}});
  const MapData map = built(plan);
  EXPECT_EQ(map.linedefs.size(), 4u);
}

TEST(MapPlan, PassagesAreOpenSolidOrWindows) {
  for (const auto& [passage, lines, blocked] :
       {std::tuple(Passage::open(), 7u, false), std::tuple(Passage::window(), 7u, true),
        std::tuple(Passage::solid(), 8u, true)}) {
    MapPlan plan;
    const AreaId west = plan.add_area({.name = "west"}, Box{{0, 0}, {256, 256}});
    const AreaId east = plan.add_area({.name = "east"}, Box{{256, 0}, {512, 256}});
    plan.connect(east, west, passage);
    const MapData map = built(plan);
    EXPECT_EQ(map.linedefs.size(), lines);
    const Point start[] = {{128, 128}};
    EXPECT_EQ(!Reachability(map, start).reaches({384, 128}), blocked);
  }
}

TEST(MapPlan, ADoorIsAShutSlabThatOpens) {
  MapPlan plan;
  const AreaId room = plan.add_area({.name = "room"}, Box{{0, 0}, {256, 256}});
  const AreaId hall = plan.add_area({.name = "hall"}, Box{{256, 64}, {512, 192}});
  const AreaId door = plan.add_door({.name = "door", .wall_texture = "BIGDOOR2", .tag = 5}, room, hall, 32);
  const MapData map = built(plan);
  EXPECT_EQ(twice_surface(map, static_cast<uint32_t>(door)), 2 * 32 * 128);
  const Point from[] = {{64, 64}}, to[] = {{400, 128}};
  EXPECT_TRUE(check_separated(map, from, to, "the hall"));
  EXPECT_TRUE(check_reaches(with_open_sectors(map, {5}), from, to, "the hall"));
  const LinedefData* face = line_between(map, {224, 64}, {224, 192});
  ASSERT_NE(face, nullptr);
  const bool front_is_room = map.sidedefs[face->front].sector == static_cast<uint32_t>(room);
  EXPECT_EQ(map.sidedefs[front_is_room ? face->front : *face->back].top, "BIGDOOR2")
      << "what is seen of a shut door";
}

TEST(MapPlan, CorridorsLeadRoundObstacles) {
  MapPlan plan;
  const AreaId west = plan.add_area({.name = "west"}, Box{{0, 0}, {256, 256}});
  const AreaId east = plan.add_area({.name = "east"}, Box{{900, 0}, {1156, 256}});
  const AreaId tower = plan.add_area({.name = "tower"}, Box{{500, -300}, {600, 400}});
  const AreaId way = plan.add_corridor({.name = "way"}, west, east, {.width = 96});
  const MapData map = built(plan);
  const Point from[] = {{128, 128}}, to[] = {{1028, 128}}, barred[] = {{550, 0}};
  EXPECT_TRUE(check_reaches(map, from, to, "the east"));
  EXPECT_TRUE(check_separated(map, from, barred, "the tower"));
  for (const PlaneEdge& edge : plan.boundary(way)) EXPECT_NE(edge.left, tower);
}

TEST(MapPlan, AStraightCorridorIsOneRectangleOfItsWidth) {
  MapPlan plan;
  const AreaId west = plan.add_area({.name = "west"}, Box{{0, 0}, {256, 256}});
  const AreaId east = plan.add_area({.name = "east"}, Box{{512, 64}, {768, 320}});
  const AreaId way = plan.add_corridor({.name = "way"}, west, east, {.width = 128});
  const MapData map = built(plan);
  const Box box = plan.bounds(way);
  EXPECT_EQ(twice_surface(map, static_cast<uint32_t>(way)), 2 * 256 * 128);
  EXPECT_GE(box.low.y, 64);
  EXPECT_LE(box.high.y, 256);
}

TEST(MapPlan, StairsClimbEvenlyFromAreaToArea) {
  MapPlan plan;
  const AreaId low = plan.add_area({.name = "low"}, Box{{0, 0}, {256, 256}});
  const AreaId high =
      plan.add_area({.name = "high", .floor = 100, .ceiling = 228}, Box{{600, 0}, {856, 256}});
  const std::vector<AreaId> steps =
      plan.add_stairs({.name = "step", .floor_texture = "STEP1"}, low, high, 4, {.width = 96});
  ASSERT_EQ(steps.size(), 4u);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(plan.spec(steps[i]).floor, 20 * (i + 1));
  const MapData map = built(plan);
  const Point from[] = {{128, 128}}, to[] = {{700, 128}};
  EXPECT_TRUE(check_reaches(map, from, to, "the top"));
}

TEST(MapPlan, AFlightFillsItsBox) {
  MapPlan plan;
  plan.add_area({.name = "hall", .ceiling = 256, .in_pieces = true}, Box{{0, 0}, {512, 128}});
  const std::vector<AreaId> steps = plan.add_stairs({.name = "step", .ceiling = 256},
                                                    Box{{128, 0}, {384, 128}}, Direction::kWest, 4, 0, 60);
  built(plan);
  EXPECT_EQ(plan.area_at({360, 64}), steps[0]);
  EXPECT_EQ(plan.area_at({150, 64}), steps[3]);
  EXPECT_EQ(plan.spec(steps[3]).floor, 60);
}

TEST(MapPlan, AGridNumbersItsCells) {
  MapPlan plan;
  const std::vector<AreaId> cells = plan.add_grid({.name = "cell", .tag = 100}, {-256, -256}, 4, 4, 128);
  built(plan);
  ASSERT_EQ(cells.size(), 16u);
  EXPECT_EQ(plan.spec(cells[6]).tag, 106);
  EXPECT_EQ(plan.area_at({-256 + 2 * 128 + 64, -256 + 1 * 128 + 64}), cells[6]);
}

TEST(MapPlan, PillarsShowTheirOwnTexture) {
  MapPlan plan;
  plan.add_area({.name = "hall", .wall_texture = "STONE2"}, Box{{0, 0}, {512, 512}});
  plan.add_pillar(Box{{128, 128}, {192, 192}}, "ASHWALL6");
  plan.add_pillar(Box{{256, 256}, {320, 320}});
  const MapData map = built(plan);
  int own = 0, walls = 0;
  for (const SidedefData& side : map.sidedefs)
    own += side.middle == "ASHWALL6", walls += side.middle == "STONE2";
  EXPECT_EQ(own, 4);
  EXPECT_EQ(walls, 8);
}

TEST(MapPlan, PolyobjectsStandOnControlAreasWithAnchorAndSpot) {
  MapPlan plan;
  plan.add_area({.name = "hall"}, Box{{0, 0}, {512, 512}});
  plan.add_polyobject(
      {.number = 3,
       .outline = Box::around({0, 0}, 56, 20).polygon(),
       .spot = {256, 256},
       .touch = PolyobjectSpec::Touch::kHurting,
       .motions = {{.special = 4, .id = 77, .args = {3, 16, 0, 128, 0}, .repeatable = true}}});
  const MapData map = built(plan);
  int start_lines = 0, motion_lines = 0;
  for (const LinedefData& line : map.linedefs) {
    if (line.special == 1 && line.args[0] == 3) ++start_lines;
    if (line.id == 77 && line.special == 4 && line.repeatable) ++motion_lines;
  }
  EXPECT_EQ(start_lines, 1);
  EXPECT_EQ(motion_lines, 1);
  ASSERT_EQ(map.things.size(), 2u);
  EXPECT_EQ(map.things[0].editor_number, 9300);
  EXPECT_EQ(map.things[0].angle_degrees, 3);
  EXPECT_EQ(map.things[1].editor_number, 9303);
  EXPECT_EQ(map.things[1].position, (Point{256, 256}));
  EXPECT_EQ(sector_at(map, map.things[0].position), -1) << "the anchor lies inside the body's outline";
}

TEST(MapPlan, LinesTakeWhatIsSetOnTheirSegment) {
  MapPlan plan;
  plan.add_area({.name = "hall", .lines = {.special = 80, .args = {7, 0, 0, 0, 0}, .player_use = true}},
                Box{{0, 0}, {512, 512}});
  plan.set_line({0, 0}, {512, 0}, {.special = 13, .id = 9, .args = {1, 2, 3, 0, 0}});
  const MapData map = built(plan);
  EXPECT_EQ(line_between(map, {0, 0}, {512, 0})->special, 13);
  EXPECT_EQ(line_between(map, {0, 0}, {512, 0})->id, 9);
  EXPECT_EQ(line_between(map, {0, 512}, {512, 512})->special, 80);
  EXPECT_TRUE(line_between(map, {0, 512}, {512, 512})->player_use);
}

TEST(MapPlan, RandomPointsKeepTheirDistances) {
  MapPlan plan;
  const AreaId hall = plan.add_area({.name = "hall"}, Box{{0, 0}, {1024, 1024}});
  plan.add_pillar(Box{{400, 400}, {600, 600}});
  plan.add_area({.name = "pool"}, Box{{100, 100}, {200, 200}});
  Rng rng(RngKey(5).split("points"));
  const std::vector<Point> points = plan.random_points(hall, 30, {.clearance = 40, .spacing = 80}, rng);
  ASSERT_EQ(points.size(), 30u);
  for (std::size_t i = 0; i < points.size(); ++i) {
    EXPECT_TRUE(plan.is_clear(hall, points[i], 40));
    for (std::size_t j = 0; j < i; ++j) EXPECT_GE(distance_squared(points[i], points[j]), 80 * 80);
  }
  EXPECT_EQ(plan.random_points(hall, 100'000, {.clearance = 490, .spacing = 0}, rng).size(), 0u);
}

TEST(MapPlan, CentroidsAreThoseOfTheSurface) {
  MapPlan plan;
  const AreaId l =
      plan.add_area({.name = "l"}, Polygon{{0, 0}, {300, 0}, {300, 100}, {100, 100}, {100, 300}, {0, 300}});
  EXPECT_EQ(plan.centroid(l), (Point{110, 110}));  // (30000 * 150 + 20000 * 50) / 50000
}

TEST(MapPlan, MistakesNameTheirArea) {
  MapPlan twice;
  twice.add_area({.name = "hall"}, Box{{0, 0}, {100, 100}});
  twice.add_area({.name = "hall"}, Box{{200, 0}, {300, 100}});
  EXPECT_THAT(mistake(twice), HasSubstr("'hall'"));

  MapPlan flat;
  flat.add_area({.name = "line"}, Polygon{{0, 0}, {100, 0}, {200, 0}});
  EXPECT_THAT(mistake(flat), AllOf(HasSubstr("'line'"), HasSubstr("no surface")));

  MapPlan covered;
  covered.add_area({.name = "plate"}, Box{{0, 0}, {100, 100}});
  covered.add_area({.name = "floor"}, Box{{-100, -100}, {200, 200}});
  EXPECT_THAT(mistake(covered), AllOf(HasSubstr("'plate'"), HasSubstr("no place")));

  MapPlan split;
  split.add_area({.name = "sea"}, Box{{0, 0}, {300, 100}});
  split.add_area({.name = "dam"}, Box{{100, 0}, {200, 100}});
  EXPECT_THAT(mistake(split), AllOf(HasSubstr("'sea'"), HasSubstr("2 pieces")));

  MapPlan apart;
  const AreaId a = apart.add_area({.name = "a"}, Box{{0, 0}, {100, 100}});
  const AreaId b = apart.add_area({.name = "b"}, Box{{200, 0}, {300, 100}});
  apart.add_door({.name = "door"}, a, b);
  EXPECT_THAT(mistake(apart), AllOf(HasSubstr("'door'"), HasSubstr("no common edge")));

  MapPlan walled;
  const AreaId inner = walled.add_area({.name = "inner"}, Box{{0, 0}, {64, 64}});
  walled.add_area({.name = "ring"}, Box{{-200, -200}, {264, 264}});
  walled.add_area({.name = "inner again"}, Box{{0, 0}, {64, 64}});
  const AreaId outer = walled.add_area({.name = "outer"}, Box{{1000, 0}, {1100, 100}});
  walled.add_corridor({.name = "way"}, walled.area("inner again"), outer);
  EXPECT_THAT(mistake(walled), AllOf(HasSubstr("'way'"), HasSubstr("no way")));
  EXPECT_EQ(inner, 0);

  MapPlan nowhere;
  nowhere.add_area({.name = "hall"}, Box{{0, 0}, {100, 100}});
  nowhere.set_line({0, 50}, {100, 50}, {.id = 4});
  EXPECT_THAT(mistake(nowhere), HasSubstr("(0, 50)-(100, 50)"));

  MapPlan low;
  low.add_area({.name = "cellar", .floor = 10, .ceiling = 0}, Box{{0, 0}, {100, 100}});
  EXPECT_THAT(mistake(low), AllOf(HasSubstr("'cellar'"), HasSubstr("ceiling")));
}

TEST(MapPlan, PiecesThatTouchInACornerAreTwo) {
  MapPlan plan;
  const AreaId both = plan.add_area({.name = "both"}, Box{{0, 0}, {100, 100}});
  plan.extend_area(both, Box{{100, 100}, {200, 200}});
  EXPECT_THAT(mistake(plan), HasSubstr("2 pieces"));
}

TEST(MapPlan, ARingIsOnePiece) {
  MapPlan plan;
  plan.add_area({.name = "ring"}, Box{{0, 0}, {300, 300}});
  plan.add_area({.name = "middle"}, Box{{100, 100}, {200, 200}});
  built(plan);
}

/// Random overlapping outlines, rotated rectangles among them: every one of a thousand plans is a valid map
/// or refused with a reason, and the same plan gives the same bytes.
TEST(MapPlanProperty, AThousandRandomPlansAreValidOrRefusedForAReason) {
  int valid = 0;
  for (uint64_t seed = 0; seed < 1000; ++seed) {
    SCOPED_TRACE(seed);
    const auto make = [&] {
      Rng rng(RngKey(seed).split("plan"));
      MapPlan plan;
      plan.add_area({.name = "ground", .in_pieces = true}, Box{{-600, -600}, {600, 600}});
      const int count = rng.between(1, 8);
      for (int i = 0; i < count; ++i) {
        const Point centre{rng.between(-700, 700), rng.between(-700, 700)};
        const int32_t radius = rng.between(40, 300), corners = rng.between(3, 7), turn = rng.between(0, 359);
        Polygon outline;
        for (int32_t k = 0; k < corners; ++k) {
          const Point p = polar_point(radius, turn * corners + 360 * k, 360 * corners);
          outline.push_back({centre.x + p.x, centre.y + p.y});
        }
        if (i % 3 == 2)
          plan.add_pillar(outline, "ASHWALL6");
        else
          plan.add_area({.name = "area " + std::to_string(i), .in_pieces = true}, outline,
                        rng.below(4) == 0 ? Claim::kOnlyRock : Claim::kAll);
      }
      return plan.build();
    };
    const auto map = make();
    if (!map) {
      EXPECT_THAT(map.error().message, HasSubstr("no place"))
          << "the only thing that may be wrong with such a plan";
      continue;
    }
    ++valid;
    EXPECT_EQ(write_udmf(*map), write_udmf(*make()));
  }
  EXPECT_GT(valid, 600);
}

}  // namespace map_plan_test
}  // namespace comrad::doomgen
