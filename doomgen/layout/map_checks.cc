#include "doomgen/layout/map_checks.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdlib>

namespace comrad::doomgen {
namespace {

Error refused(const std::string& what) { return Error{ErrorCode::kBadInput, what}; }

int player_of(int32_t editor_number) {
  if (editor_number >= 1 && editor_number <= 4) return editor_number;
  if (editor_number >= 4001 && editor_number <= 4004) return editor_number - 4001 + 5;
  return 0;
}

bool has_tag(const std::vector<int32_t>& tags, int32_t tag) {
  return tag != 0 && std::find(tags.begin(), tags.end(), tag) != tags.end();
}

}  // namespace

std::vector<Point> start_points(const MapData& map) {
  std::vector<Point> starts;
  for (int player = 1; player <= 8; ++player)
    for (const ThingData& thing : map.things)
      if (player_of(thing.editor_number) == player) {
        starts.push_back(thing.position);
        break;
      }
  return starts;
}

std::vector<Point> spot_points(const MapData& map, int32_t first, int32_t last) {
  std::vector<std::pair<int32_t, Point>> found;
  for (const ThingData& thing : map.things)
    if (thing.editor_number == 9001 && thing.id >= first && thing.id <= last)
      found.push_back({thing.id, thing.position});
  std::stable_sort(found.begin(), found.end(),
                   [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<Point> points;
  for (const auto& [id, p] : found) points.push_back(p);
  return points;
}

int sector_at(const MapData& map, Point p) {
  std::vector<uint8_t> contains(map.sectors.size());
  for (const LinedefData& line : map.linedefs) {
    const Point a = map.vertices[line.start], b = map.vertices[line.end];
    if ((a.y > p.y) == (b.y > p.y)) continue;
    if (a.y < b.y ? cross(a, b, p) <= 0 : cross(a, b, p) >= 0) continue;
    contains[map.sidedefs[line.front].sector] ^= 1;
    if (line.back) contains[map.sidedefs[*line.back].sector] ^= 1;
  }
  for (std::size_t sector = 0; sector < contains.size(); ++sector)
    if (contains[sector] != 0) return static_cast<int>(sector);
  return -1;
}

Status check_room(const MapData& map, std::span<const Point> points, const std::string& what,
                  const Body& body) {
  for (const Point& p : points) {
    const int sector = sector_at(map, p);
    if (sector < 0) return refused(what + " at " + at(p) + " lies in rock");
    const SectorData& here = map.sectors[sector];
    if (here.ceiling_height - here.floor_height < body.height)
      return refused(what + " at " + at(p) + " has no headroom in " +
                     name_of(map, static_cast<uint32_t>(sector)));
    const Box box = Box{p, p}.grown(body.radius);
    for (const LinedefData& line : map.linedefs)
      if (stops(map, line, body) && crosses_box(map.vertices[line.start], map.vertices[line.end], box))
        return refused(what + " at " + at(p) + " is too near to the line " + at(map.vertices[line.start]) +
                       "-" + at(map.vertices[line.end]));
  }
  return {};
}

Status check_starts(const MapData& map, int players) {
  const std::vector<Point> starts = start_points(map);
  for (int player = 1; player <= players; ++player)
    if (std::none_of(map.things.begin(), map.things.end(),
                     [&](const ThingData& thing) { return player_of(thing.editor_number) == player; }))
      return refused(fmt::format("player {} has no start", player));
  const Body body;
  COMRAD_TRY(check_room(map, starts, "a player's start", body));
  for (std::size_t i = 0; i < starts.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      if (std::max(std::abs(starts[i].x - starts[j].x), std::abs(starts[i].y - starts[j].y)) <
          2 * body.radius)
        return refused("the starts at " + at(starts[j]) + " and " + at(starts[i]) + " overlap");
  return {};
}

Status check_reaches(const MapData& map, std::span<const Point> starts, std::span<const Point> goals,
                     const std::string& what, const Body& body) {
  if (starts.empty()) return refused("there is no start to walk from");
  for (const Point& start : starts) {
    const Reachability walk(map, std::span(&start, 1), body);
    for (const Point& goal : goals)
      if (!walk.reaches(goal))
        return refused(what + " at " + at(goal) + " cannot be reached from " + at(start));
  }
  return {};
}

Status check_separated(const MapData& map, std::span<const Point> starts, std::span<const Point> goals,
                       const std::string& what, const Body& body) {
  const Reachability walk(map, starts, body);
  for (const Point& goal : goals)
    if (walk.reaches(goal)) return refused(what + " at " + at(goal) + " can be reached past its barrier");
  return {};
}

MapData with_open_sectors(MapData map, const std::vector<int32_t>& tags) {
  std::vector<int32_t> ceiling(map.sectors.size(), INT32_MIN);
  for (const LinedefData& line : map.linedefs) {
    if (!line.back) continue;
    const uint32_t front = map.sidedefs[line.front].sector, back = map.sidedefs[*line.back].sector;
    ceiling[front] = std::max(ceiling[front], map.sectors[back].ceiling_height);
    ceiling[back] = std::max(ceiling[back], map.sectors[front].ceiling_height);
  }
  for (std::size_t i = 0; i < map.sectors.size(); ++i)
    if (has_tag(tags, map.sectors[i].tag) && ceiling[i] != INT32_MIN)
      map.sectors[i].ceiling_height = std::max(map.sectors[i].ceiling_height, ceiling[i]);
  return map;
}

MapData with_floors_at(MapData map, const std::vector<int32_t>& tags, int32_t height) {
  for (SectorData& sector : map.sectors)
    if (has_tag(tags, sector.tag)) sector.floor_height = height;
  return map;
}

}  // namespace comrad::doomgen
