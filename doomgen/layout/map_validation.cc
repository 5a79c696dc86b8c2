// Each check answers one sentence of validate_map()'s declaration.
#include "doomgen/layout/map_validation.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <map>
#include <string>
#include <vector>

namespace comrad::doomgen {
namespace {

Error bad(std::string message) { return Error{ErrorCode::kBadInput, "map: " + std::move(message)}; }

Status check_references(const MapData& map) {
  for (const SidedefData& side : map.sidedefs)
    if (side.sector >= map.sectors.size()) return bad(fmt::format("a sidedef names sector {}", side.sector));
  for (const LinedefData& line : map.linedefs) {
    if (line.start >= map.vertices.size() || line.end >= map.vertices.size())
      return bad("a linedef names a vertex that is not there");
    if (line.front >= map.sidedefs.size() || (line.back && *line.back >= map.sidedefs.size()))
      return bad("a linedef names a sidedef that is not there");
    if (line.start == line.end) return bad("a line of length zero at " + at(map.vertices[line.start]));
  }
  for (const Point& p : map.vertices)
    if (std::abs(p.x) > kMaxCoordinate || std::abs(p.y) > kMaxCoordinate)
      return bad(fmt::format("the corner {} lies outside +-{}", at(p), kMaxCoordinate));
  return {};
}

/// Names are words; values are numbers, true, false, or texts without quotes inside.
Status check_extra(const ExtraFields& fields, const char* what) {
  for (const auto& [name, value] : fields) {
    const bool good_name = !name.empty() && std::all_of(name.begin(), name.end(), [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= '0' && c <= '9') || c == '_';
    });
    const bool is_text = value.size() >= 2 && value.front() == '"' && value.back() == '"' &&
                         value.find_first_of("\"\\\n", 1) == value.size() - 1;
    const bool is_plain = !value.empty() && std::all_of(value.begin(), value.end(), [](char c) {
      return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '.' ||
             c == '-' || c == '+';
    });
    if (!good_name || !(is_text || is_plain))
      return bad(std::string(what) + " has the further field '" + name + " = " + value +
                 "'; names are of a-z 0-9 _, values numbers, true, false or quoted texts");
  }
  return {};
}

Status check_names(const MapData& map) {
  const auto good = [](const std::string& name) {
    return name.size() <= 8 && std::all_of(name.begin(), name.end(), [](char c) {
             return (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_' || c == '-';
           });
  };
  for (const SidedefData& side : map.sidedefs)
    for (const std::string* name : {&side.top, &side.middle, &side.bottom})
      if (!good(*name))
        return bad(name_of(map, side.sector) + ": '" + *name +
                   "' is no texture name (8 of A-Z 0-9 _ - at most)");
  for (uint32_t sector = 0; sector < map.sectors.size(); ++sector)
    for (const std::string* name : {&map.sectors[sector].floor_texture, &map.sectors[sector].ceiling_texture})
      if (name->empty() || !good(*name))
        return bad(name_of(map, sector) + ": '" + *name + "' is no flat name (1 to 8 of A-Z 0-9 _ -)");
  for (const SectorData& sector : map.sectors) COMRAD_TRY(check_extra(sector.extra, "a sector"));
  for (const LinedefData& line : map.linedefs) COMRAD_TRY(check_extra(line.extra, "a line"));
  for (const ThingData& thing : map.things) COMRAD_TRY(check_extra(thing.extra, "a thing"));
  return {};
}

/// Lines may meet in common corners and nowhere else, and no corner comes nearer than one unit to a
/// foreign line.
Status check_crossings(const MapData& map) {
  const std::vector<Point>& v = map.vertices;
  for (std::size_t i = 0; i < map.linedefs.size(); ++i) {
    const LinedefData& first = map.linedefs[i];
    const Point a = v[first.start], b = v[first.end];
    const Box box = bounds_of(std::array{a, b}).grown(1);
    for (std::size_t j = i + 1; j < map.linedefs.size(); ++j) {
      const LinedefData& second = map.linedefs[j];
      const Point c = v[second.start], d = v[second.end];
      if (std::max(c.x, d.x) < box.low.x || std::min(c.x, d.x) > box.high.x ||
          std::max(c.y, d.y) < box.low.y || std::min(c.y, d.y) > box.high.y)
        continue;
      const bool start_is_common = second.start == first.start || second.start == first.end;
      const bool end_is_common = second.end == first.start || second.end == first.end;
      if (start_is_common && end_is_common) {
        // Two walls back to back are a solid partition.
        if (first.start == second.end && !first.back && !second.back) continue;
        return bad("two lines lie between " + at(a) + " and " + at(b));
      }
      if (!start_is_common && !end_is_common && segments_touch(a, b, c, d))
        return bad("the lines " + at(a) + "-" + at(b) + " and " + at(c) + "-" + at(d) + " cross");
      const bool first_start_is_common = first.start == second.start || first.start == second.end;
      const bool first_end_is_common = first.end == second.start || first.end == second.end;
      if ((!start_is_common && nearer_than(c, a, b, 1)) || (!end_is_common && nearer_than(d, a, b, 1)) ||
          (!first_start_is_common && nearer_than(a, c, d, 1)) ||
          (!first_end_is_common && nearer_than(b, c, d, 1)))
        return bad("a corner lies less than one unit from a line it does not belong to, near " + at(c));
    }
  }
  return {};
}

/// At every corner, as many lines of a sector arrive as leave.
Status check_closed(const MapData& map) {
  std::vector<std::pair<std::pair<uint32_t, uint32_t>, int>>
      balance;  // (sector, vertex) -> +1 leaves, -1 arrives
  const auto add = [&](uint32_t side, uint32_t start, uint32_t end) {
    balance.push_back({{map.sidedefs[side].sector, start}, 1});
    balance.push_back({{map.sidedefs[side].sector, end}, -1});
  };
  for (const LinedefData& line : map.linedefs) {
    add(line.front, line.start, line.end);
    if (line.back) add(*line.back, line.end, line.start);
  }
  std::sort(balance.begin(), balance.end());
  std::vector<bool> has_lines(map.sectors.size());
  for (std::size_t i = 0; i < balance.size();) {
    const auto key = balance[i].first;
    int sum = 0;
    for (; i < balance.size() && balance[i].first == key; ++i) sum += balance[i].second;
    if (sum != 0) return bad(name_of(map, key.first) + " is not closed at " + at(map.vertices[key.second]));
    has_lines[key.first] = true;
  }
  for (std::size_t sector = 0; sector < has_lines.size(); ++sector)
    if (!has_lines[sector]) return bad(name_of(map, static_cast<uint32_t>(sector)) + " has no lines");
  return {};
}

/// The sectors that contain `p`, in sixteenths of a unit, by crossing parity towards the east.
void sectors_at(const MapData& map, Point p, std::vector<uint8_t>& contains) {
  std::fill(contains.begin(), contains.end(), uint8_t{0});
  for (const LinedefData& line : map.linedefs) {
    const Point a{map.vertices[line.start].x * 16, map.vertices[line.start].y * 16};
    const Point b{map.vertices[line.end].x * 16, map.vertices[line.end].y * 16};
    if ((a.y > p.y) == (b.y > p.y)) continue;
    if (a.y < b.y ? cross(a, b, p) <= 0 : cross(a, b, p) >= 0) continue;
    contains[map.sidedefs[line.front].sector] ^= 1;
    if (line.back) contains[map.sidedefs[*line.back].sector] ^= 1;
  }
}

/// Right of every line lies its front sector alone, left of it its back sector alone or the void.
Status check_sides(const MapData& map) {
  std::vector<uint8_t> contains(map.sectors.size());
  // What lies behind a wall that has another one at its back.
  std::map<std::pair<uint32_t, uint32_t>, uint32_t> wall_sector;
  for (const LinedefData& line : map.linedefs)
    if (!line.back) wall_sector[{line.start, line.end}] = map.sidedefs[line.front].sector;
  for (const LinedefData& line : map.linedefs) {
    const Point a = map.vertices[line.start], b = map.vertices[line.end];
    // An eighth of a unit off the middle, along the axis the line is steepest to: no foreign line comes so
    // near (check_crossings), and sixteenths keep it exact.
    const Point middle{8 * (a.x + b.x), 8 * (a.y + b.y)};
    const int32_t dx = b.x - a.x, dy = b.y - a.y;
    const Point right = std::abs(dy) >= std::abs(dx) ? Point{dy > 0 ? 2 : -2, 0} : Point{0, dx > 0 ? -2 : 2};
    for (const bool is_front : {true, false}) {
      const Point probe = is_front ? Point{middle.x + right.x, middle.y + right.y}
                                   : Point{middle.x - right.x, middle.y - right.y};
      sectors_at(map, probe, contains);
      const auto count = std::count(contains.begin(), contains.end(), uint8_t{1});
      std::optional<uint32_t> sector;
      if (is_front)
        sector = map.sidedefs[line.front].sector;
      else if (line.back)
        sector = map.sidedefs[*line.back].sector;
      else if (const auto found = wall_sector.find({line.end, line.start}); found != wall_sector.end())
        sector = found->second;
      const bool right_one = sector ? count == 1 && contains[*sector] == 1 : count == 0;
      if (!right_one)
        return bad("areas overlap, or a pillar sticks out of its area, at the line " + at(a) + "-" + at(b) +
                   " of " + name_of(map, map.sidedefs[line.front].sector));
    }
  }
  return {};
}

}  // namespace

Status validate_map(const MapData& map) {
  if (map.sectors.empty() || map.linedefs.empty()) return bad("there is no area");
  COMRAD_TRY(check_references(map));
  COMRAD_TRY(check_names(map));
  COMRAD_TRY(check_crossings(map));
  COMRAD_TRY(check_closed(map));
  COMRAD_TRY(check_sides(map));
  return {};
}

}  // namespace comrad::doomgen
