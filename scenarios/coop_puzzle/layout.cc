#include "scenarios/coop_puzzle/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "scenarios/spec/variety.h"

namespace comrad::scenarios::coop_puzzle {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kDoorThickness = 32, kLaneBDoorTag = 50, kFirstZoneTag = 200, kFirstSyncTag = 100;
constexpr int32_t kLengthMin = 256, kWestToStart = 80;
constexpr std::size_t kPlatesMax = 3;
constexpr int32_t kPlateGap = 8;      // around plates that are moved
constexpr int32_t kPlateMargin = 42;  // between a plate and the outer wall

/// Pairs (zones 2p - 1 and 2p) that are passed by standing on both plates at once; never the last one.
bool is_sync_pair(int32_t pair, int32_t period, int32_t pair_count) {
  return pair > period && (pair - (period + 1)) % period == 0 && pair < pair_count;
}

/// What the seed varies where `variety` is 1; as published otherwise.
struct Variety {
  int32_t lane = 0;                                    ///< width of a lane
  std::vector<int32_t> edge;                           ///< [zone] its west; one more: the last one's east
  std::vector<const char*> floor, ceiling, wall;       ///< [zone]
  std::vector<int32_t> light;                          ///< [zone]
  std::vector<std::vector<std::vector<Point>>> plate;  ///< [zone][lane A, B][index] its centre
};

Variety draw_variety(const LayoutDraw& wanted) {
  Variety drawn;
  const int32_t zones = wanted.value32("zones"), length = wanted.value32("length"),
                gap = wanted.value32("gap"), plates = wanted.value32("plates"),
                size = wanted.value32("plate_size"), period = wanted.value32("sync_period");
  const bool varies = wanted.value("variety") != 0;
  Rng shape(wanted.key.split("shape")), look(wanted.key.split("look")), spots(wanted.key.split("plates"));
  drawn.lane = wanted.value32("lane") + (varies ? stepped(-16, 32, 8, shape) : 0);
  const int32_t middle = gap / 2 + drawn.lane / 2, off_middle = drawn.lane / 2 - size / 2 - kPlateMargin;
  // Not the ones of plates.
  constexpr const char* kFloors[] = {"FLOOR4_8", "FLOOR5_2", "FLAT5_4", "MFLR8_1", "RROCK10", "FLAT19"};
  constexpr const char* kCeilings[] = {"CEIL3_5", "FLAT10", "RROCK19", "CEIL4_1"};
  constexpr const char* kWalls[] = {"STONE2", "STONE3", "BROWN1", "BRICK7", "GRAY5", "METAL1"};
  drawn.edge = {0, -length / 2};  // zones are counted from 1
  for (int32_t zone = 0; zone <= zones; ++zone) {
    drawn.floor.push_back(varies ? one_of(kFloors, look) : "FLOOR4_8");
    drawn.ceiling.push_back(varies ? one_of(kCeilings, look) : "CEIL3_5");
    drawn.wall.push_back(varies ? one_of(kWalls, look) : "STONE2");
    drawn.light.push_back(varies ? stepped(176, 240, 8, look) : 224);
    std::vector<std::vector<Point>>& places = drawn.plate.emplace_back(2);
    if (zone == 0) continue;
    const int32_t west = drawn.edge.back();
    const int32_t own_length = std::max(kLengthMin, length + (varies ? stepped(-64, 64, 16, shape) : 0));
    drawn.edge.push_back(west + own_length);
    const bool is_sync = zone % 2 == 1 && is_sync_pair((zone + 1) / 2, period, zones / 2);
    const int32_t count = is_sync ? 1 : plates, slot = own_length / (plates + 1);
    for (int32_t j = 0; j < count; ++j)
      for (const bool is_a : {true, false}) {
        Point at{west + (is_sync ? own_length / 3 : (j + 1) * own_length / (plates + 1)), off_middle};
        if (varies) {
          const int32_t along = std::max(0, (slot - size) / 2 - kPlateGap),
                        across = drawn.lane / 2 - size / 2 - kPlateGap;
          at.x += spots.between(-along, along);
          at.x = std::min(at.x, west + own_length - kDoorThickness - size / 2 - kPlateGap);
          at.y = spots.between(-across, across);
        }
        places[is_a ? 0 : 1].push_back({at.x, is_a ? middle + at.y : -middle - at.y});
      }
  }
  return drawn;
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t zones = wanted.value32("zones"), gap = wanted.value32("gap"),
                size = wanted.value32("plate_size"), period = wanted.value32("sync_period");
  if (zones % 2 != 0) return Error{ErrorCode::kBadInput, "zones must be even: they come in pairs"};
  const bool swapped = wanted.value("colours") != 0;
  const char* const plain = swapped ? "CEIL5_2" : "CEIL5_1";
  const char* const colour_a = swapped ? "AQF038" : "AQF044";
  const char* const colour_b = swapped ? "AQF044" : "AQF038";
  const Variety variety = draw_variety(wanted);
  const int32_t lane = variety.lane, inner = gap / 2, middle = inner + lane / 2;
  MapPlan plan;
  std::vector<AreaId> lane_a, lane_b;
  for (int32_t zone = 1; zone <= zones; ++zone) {
    const int32_t west = variety.edge[zone], east = variety.edge[zone + 1];
    AreaSpec spec{.floor_texture = variety.floor[zone],
                  .ceiling_texture = variety.ceiling[zone],
                  .wall_texture = variety.wall[zone],
                  .light = variety.light[zone],
                  .tag = kFirstZoneTag + zone};
    spec.name = fmt::format("A{}", zone);
    lane_a.push_back(plan.add_area(spec, Box{{west, inner}, {east, inner + lane}}));
    spec.name = fmt::format("B{}", zone);
    lane_b.push_back(plan.add_area(spec, Box{{west, -inner - lane}, {east, -inner}}));
    plan.connect(lane_a.back(), lane_b.back(), Passage::window());
  }
  std::vector<int64_t> sync(static_cast<std::size_t>(zones / 2) + 1);
  std::vector<int32_t> door_tags;
  std::vector<Point> plate_points;
  std::vector<int64_t> plate_x, plate_y;
  for (int32_t zone = 0; zone <= zones; ++zone)
    for (const std::vector<Point>& places : variety.plate[zone])
      for (std::size_t j = 0; j < kPlatesMax; ++j) {
        plate_x.push_back(j < places.size() ? places[j].x : 0);
        plate_y.push_back(j < places.size() ? places[j].y : 0);
      }
  for (int32_t zone = 1; zone <= zones; ++zone) {
    const int32_t east = variety.edge[zone + 1], pair = (zone + 1) / 2;
    const bool is_odd = zone % 2 == 1, is_sync = is_odd && is_sync_pair(pair, period, zones / 2);
    if (is_odd) {
      sync[pair] = is_sync;
      AreaSpec door{.floor_texture = variety.floor[zone],
                    .ceiling_texture = variety.ceiling[zone],
                    .wall_texture = "BIGDOOR2",
                    .light = variety.light[zone]};
      door.name = fmt::format("door A{}", pair), door.tag = pair;
      const AreaId a = plan.add_door(door, Box{{east - kDoorThickness, inner}, {east, inner + lane}});
      door.name = fmt::format("door B{}", pair), door.tag = pair + kLaneBDoorTag;
      const AreaId b = plan.add_door(door, Box{{east - kDoorThickness, -inner - lane}, {east, -inner}});
      // Solid: a door opens to the lowest ceiling beside it, which a shut neighbour would hold down.
      plan.connect(a, b, Passage::solid());
      door_tags.push_back(pair), door_tags.push_back(pair + kLaneBDoorTag);
    }
    for (std::size_t j = 0; j < variety.plate[zone][0].size(); ++j)
      for (const bool is_a : {true, false}) {
        const Point centre = variety.plate[zone][is_a ? 0 : 1][j];
        const auto index = static_cast<int32_t>(j);
        const int32_t tag = is_sync ? kFirstSyncTag + zone : zone * 1000 + (is_a ? 1 : 101) + index;
        plan.add_area({.name = fmt::format("plate {}{}", tag, (is_a ? " A" : " B")),
                       .floor_texture = !is_sync ? plain
                                        : is_a   ? colour_a
                                                 : colour_b,
                       .ceiling_texture = variety.ceiling[zone],
                       .wall_texture = variety.wall[zone],
                       .light = variety.light[zone],
                       .tag = tag},
                      Box::around(centre, size, size));
        plate_points.push_back(centre);
      }
  }
  plan.add_start(1, {variety.edge[1] + kWestToStart, middle}, 0);
  plan.add_start(2, {variety.edge[1] + kWestToStart, -middle}, 0);

  COMRAD_TRY_ASSIGN(MapData map, plan.build());
  COMRAD_TRY(check_starts(map, 2));
  const std::vector<Point> starts = start_points(map);
  const MapData open = with_open_sectors(map, door_tags);
  for (const Point& p : plate_points)
    COMRAD_TRY(check_reaches(open, std::span(&starts[p.y > 0 ? 0 : 1], 1), std::span(&p, 1), "a plate"));
  const int32_t second_x = (variety.edge[2] + variety.edge[3]) / 2;
  const Point beyond_a{second_x, middle}, beyond_b{second_x, -middle};
  COMRAD_TRY(check_separated(map, starts, std::span(&beyond_a, 1), "zone 2"));
  COMRAD_TRY(check_separated(open, std::span(&starts[0], 1), std::span(&beyond_b, 1), "lane B"));
  return DrawnLayout{.map = std::move(map),
                     .defines = {{"PAIRS", zones / 2},
                                 {"ZONE_TAG_FIRST", kFirstZoneTag},
                                 {"SYNC_TAG_FIRST", kFirstSyncTag},
                                 {"DOOR_B_OFFSET", kLaneBDoorTag},
                                 {"COLOURS_SWAPPED", swapped}},
                     .arrays = {{"sync_pair", sync},
                                {"zone_edge", {variety.edge.begin(), variety.edge.end()}},
                                {"plate_places_x", plate_x},
                                {"plate_places_y", plate_y}}};
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = {{"zones", 10, 2, 24, "zones of each lane, even (axis: 8, 10, 12)"},
                         {"length", 384, 256, 512, "length of a zone, units (axis: 320, 384, 448)"},
                         {"lane", 240, 180, 400, "width of a lane, units (axis: 220, 240, 280)"},
                         {"gap", 0, 0, 256,
                          "rock between the lanes, units; above 0 nobody sees the partner (axis: 0, 32, 64)"},
                         {"plates", 2, 1, 3, "plates of each zone and lane (axis: 1, 2, 3)"},
                         {"plate_size", 72, 40, 96, "side of a plate, units (axis: 96, 72, 56)"},
                         {"sync_period", 3, 1, 12,
                          "every so many pairs both must stand on plates (axis: 2, 3, 4)"},
                         {"colours", 0, 0, 1, "1: the other colours of plates"},
                         variety_parameter("1: lengths of zones, width of lanes, places of plates, textures "
                                           "and light come from the seed (pools set it)")},
          .draw = draw,
          .axes = {{"zones", {{{"zones", 8}}, {{"zones", 10}}, {{"zones", 12}}}},
                   {"size",
                    {{{"length", 320}, {"lane", 220}, {"gap", 0}},
                     {{"length", 384}, {"lane", 240}, {"gap", 32}},
                     {{"length", 448}, {"lane", 280}, {"gap", 64}}}},
                   {"plates",
                    {{{"plates", 1}, {"plate_size", 96}},
                     {{"plates", 2}, {"plate_size", 72}},
                     {{"plates", 3}, {"plate_size", 56}}}},
                   {"sync", {{{"sync_period", 2}}, {{"sync_period", 3}}, {{"sync_period", 4}}}},
                   {"colours", {{{"colours", 0}}, {{"colours", 1}}}}},
          .pool_values = {{"variety", 1}},
          .ceiling = [](const LayoutTask& task) { return static_cast<double>(task.value("zones") / 2); }};
}

}  // namespace comrad::scenarios::coop_puzzle
