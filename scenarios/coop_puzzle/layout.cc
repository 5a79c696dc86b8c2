#include "scenarios/coop_puzzle/layout.h"

namespace comrad::scenarios::coop_puzzle {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kDoorThickness = 32, kLaneBDoorTag = 50, kFirstZoneTag = 200, kFirstSyncTag = 100;
constexpr int32_t kPlateMargin = 42;  // between a plate and the outer wall

/// Pairs (zones 2p - 1 and 2p) that are passed by standing on both plates at once; never the last one.
bool is_sync_pair(int32_t pair, int32_t period, int32_t pair_count) {
  return pair > period && (pair - (period + 1)) % period == 0 && pair < pair_count;
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t zones = wanted.value32("zones"), length = wanted.value32("length"),
                lane = wanted.value32("lane"), gap = wanted.value32("gap"), plates = wanted.value32("plates"),
                size = wanted.value32("plate_size"), period = wanted.value32("sync_period");
  if (zones % 2 != 0) return Error{ErrorCode::kBadInput, "zones must be even: they come in pairs"};
  const bool swapped = wanted.value("colours") != 0;
  const char* const plain = swapped ? "CEIL5_2" : "CEIL5_1";
  const char* const colour_a = swapped ? "AQF038" : "AQF044";
  const char* const colour_b = swapped ? "AQF044" : "AQF038";
  const int32_t inner = gap / 2, middle = inner + lane / 2;
  MapPlan plan;
  std::vector<AreaId> lane_a, lane_b;
  const auto west_of = [&](int32_t zone) { return (zone - 1) * length - length / 2; };
  for (int32_t zone = 1; zone <= zones; ++zone) {
    const int32_t west = west_of(zone), east = west + length;
    AreaSpec spec{.wall_texture = "STONE2", .light = 224, .tag = kFirstZoneTag + zone};
    spec.name = "A" + std::to_string(zone);
    lane_a.push_back(plan.add_area(spec, Box{{west, inner}, {east, inner + lane}}));
    spec.name = "B" + std::to_string(zone);
    lane_b.push_back(plan.add_area(spec, Box{{west, -inner - lane}, {east, -inner}}));
    plan.connect(lane_a.back(), lane_b.back(), Passage::window());
  }
  std::vector<int64_t> sync(static_cast<std::size_t>(zones / 2) + 1);
  std::vector<int32_t> door_tags;
  std::vector<Point> plate_points;
  for (int32_t zone = 1; zone <= zones; ++zone) {
    const int32_t west = west_of(zone), east = west + length, pair = (zone + 1) / 2;
    const bool is_odd = zone % 2 == 1, is_sync = is_odd && is_sync_pair(pair, period, zones / 2);
    if (is_odd) {
      sync[pair] = is_sync;
      AreaSpec door{.wall_texture = "BIGDOOR2", .light = 224};
      door.name = "door A" + std::to_string(pair), door.tag = pair;
      const AreaId a = plan.add_door(door, Box{{east - kDoorThickness, inner}, {east, inner + lane}});
      door.name = "door B" + std::to_string(pair), door.tag = pair + kLaneBDoorTag;
      const AreaId b = plan.add_door(door, Box{{east - kDoorThickness, -inner - lane}, {east, -inner}});
      // Solid: a door opens to the lowest ceiling beside it, which a shut neighbour would hold down.
      plan.connect(a, b, Passage::solid());
      door_tags.push_back(pair), door_tags.push_back(pair + kLaneBDoorTag);
    }
    const int32_t off_middle = lane / 2 - size / 2 - kPlateMargin, count = is_sync ? 1 : plates;
    for (int32_t j = 0; j < count; ++j)
      for (const bool is_a : {true, false}) {
        const int32_t x = west + (is_sync ? length / 3 : (j + 1) * length / (plates + 1));
        const Point centre{x, is_a ? middle + off_middle : -middle - off_middle};
        const int32_t tag = is_sync ? kFirstSyncTag + zone : zone * 1000 + (is_a ? 1 : 101) + j;
        plan.add_area({.name = "plate " + std::to_string(tag) + (is_a ? " A" : " B"),
                       .floor_texture = !is_sync ? plain
                                        : is_a   ? colour_a
                                                 : colour_b,
                       .wall_texture = "STONE2",
                       .light = 224,
                       .tag = tag},
                      Box::around(centre, size, size));
        plate_points.push_back(centre);
      }
  }
  plan.add_start(1, {-(length / 2 - 80), middle}, 0);
  plan.add_start(2, {-(length / 2 - 80), -middle}, 0);

  COMRAD_TRY_ASSIGN(MapData map, plan.build());
  COMRAD_TRY(check_starts(map, 2));
  const std::vector<Point> starts = start_points(map);
  const MapData open = with_open_sectors(map, door_tags);
  for (const Point& p : plate_points)
    COMRAD_TRY(check_reaches(open, std::span(&starts[p.y > 0 ? 0 : 1], 1), std::span(&p, 1), "a plate"));
  const Point beyond_a{length, middle}, beyond_b{length, -middle};
  COMRAD_TRY(check_separated(map, starts, std::span(&beyond_a, 1), "zone 2"));
  COMRAD_TRY(check_separated(open, std::span(&starts[0], 1), std::span(&beyond_b, 1), "lane B"));
  return DrawnLayout{.map = std::move(map),
                     .defines = {{"PAIRS", zones / 2},
                                 {"ZONE_TAG_FIRST", kFirstZoneTag},
                                 {"SYNC_TAG_FIRST", kFirstSyncTag},
                                 {"DOOR_B_OFFSET", kLaneBDoorTag},
                                 {"COLOURS_SWAPPED", swapped}},
                     .arrays = {{"sync_pair", sync}}};
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
                         {"colours", 0, 0, 1, "1: the other colours of plates"}},
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
          .ceiling = [](const LayoutTask& task) { return static_cast<double>(task.value("zones") / 2); }};
}

}  // namespace comrad::scenarios::coop_puzzle
