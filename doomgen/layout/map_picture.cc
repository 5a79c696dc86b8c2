#include "doomgen/layout/map_picture.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <initializer_list>
#include <limits>

namespace comrad::doomgen {
namespace {

constexpr Colour kBackground{16, 16, 20}, kWall{240, 240, 240}, kOpening{110, 110, 110},
    kBarred{220, 180, 40};
enum Kind : std::size_t { kStart, kSpot, kMonster, kWeapon, kAmmo, kHealth, kKey, kOther };
constexpr ThingKind kKinds[] = {{"player starts", "green", {60, 220, 60}},
                                {"map spots", "blue", {80, 140, 255}},
                                {"monsters", "red", {230, 50, 50}},
                                {"weapons", "orange", {255, 140, 20}},
                                {"ammunition", "sand", {200, 170, 110}},
                                {"health, armour and power-ups", "cyan", {60, 220, 230}},
                                {"keys and skulls", "magenta", {240, 80, 240}},
                                {"other things", "violet", {140, 110, 200}}};

/// Doom II's editor numbers (the Unofficial Doom Specs, section 5-1).
constexpr struct {
  Kind kind;
  std::initializer_list<int32_t> editor_numbers;
} kNumbers[] = {{kStart, {1, 2, 3, 4, 4001, 4002, 4003, 4004}},
                {kSpot, {9001}},
                {kMonster, {7,  9,  16, 58, 64,   65,   66,   67,   68,   69,  71,
                            72, 84, 88, 89, 3001, 3002, 3003, 3004, 3005, 3006}},
                {kWeapon, {82, 2001, 2002, 2003, 2004, 2005, 2006}},
                {kAmmo, {8, 17, 2007, 2008, 2010, 2046, 2047, 2048, 2049}},
                {kHealth, {83, 2011, 2012, 2013, 2014, 2015, 2018, 2019, 2022, 2023, 2024, 2025, 2026, 2045}},
                {kKey, {5, 6, 13, 38, 39, 40}}};
constexpr int kMargin = 8;

struct Canvas {
  Picture picture;
  double low_x = 0, high_y = 0, scale = 1;
  double column(double x) const { return kMargin + (x - low_x) * scale; }
  double row(double y) const { return kMargin + (high_y - y) * scale; }
  void dot(int x, int y, Colour colour) {
    if (x >= 0 && y >= 0 && x < picture.width && y < picture.height) picture.at(x, y) = colour;
  }
  void line(double x0, double y0, double x1, double y1, Colour colour) {
    const double length = std::max({1.0, std::abs(x1 - x0), std::abs(y1 - y0)});
    const int steps = static_cast<int>(std::min(length, 100'000.0));
    for (int i = 0; i <= steps; ++i)
      dot(static_cast<int>(x0 + (x1 - x0) * i / steps), static_cast<int>(y0 + (y1 - y0) * i / steps), colour);
  }
  void disc(double x, double y, int radius, Colour colour) {
    for (int dy = -radius; dy <= radius; ++dy)
      for (int dx = -radius; dx <= radius; ++dx)
        if (dx * dx + dy * dy <= radius * radius)
          dot(static_cast<int>(x) + dx, static_cast<int>(y) + dy, colour);
  }
};

/// A line of the map with the sectors on its sides, -1 where there is none; ends that do not exist are
/// left out.
struct Edge {
  double x0, y0, x1, y1;
  int right, left;
};

}  // namespace

std::span<const ThingKind> thing_kinds() { return kKinds; }

const ThingKind& kind_of_thing(int32_t editor_number) {
  for (const auto& [kind, editor_numbers] : kNumbers)
    if (std::ranges::find(editor_numbers, editor_number) != editor_numbers.end()) return kKinds[kind];
  return kKinds[kOther];
}

Expected<Picture> draw_map(const wad::UdmfMap& map, int side) {
  if (side < 16 || side > 8192)
    return Error{ErrorCode::kBadInput, fmt::format("a picture's side is 16..8192 pixels, not {}", side)};
  if (map.vertices.empty()) return Error{ErrorCode::kBadInput, "the map has no vertices"};
  const auto vertex_count = static_cast<int32_t>(map.vertices.size());
  const auto sector_of = [&](int32_t sidedef) {
    if (sidedef < 0 || sidedef >= static_cast<int32_t>(map.sidedefs.size())) return -1;
    const int32_t sector = map.sidedefs[sidedef].sector;
    return sector >= 0 && sector < static_cast<int32_t>(map.sectors.size()) ? sector : -1;
  };
  double low_x = std::numeric_limits<double>::infinity(), low_y = low_x, high_x = -low_x, high_y = -low_x;
  for (const wad::UdmfVertex& v : map.vertices) {
    if (!(std::abs(v.x) <= 65536 && std::abs(v.y) <= 65536))
      return Error{ErrorCode::kBadInput, "a vertex lies beyond 65536 units"};
    low_x = std::min(low_x, v.x), high_x = std::max(high_x, v.x);
    low_y = std::min(low_y, v.y), high_y = std::max(high_y, v.y);
  }
  Canvas canvas;
  canvas.low_x = low_x, canvas.high_y = high_y;
  canvas.scale = (side - 1.0 - 2.0 * kMargin) / std::max({1.0, high_x - low_x, high_y - low_y});
  if (canvas.scale <= 0) canvas.scale = 1e-3;
  canvas.picture = Picture(static_cast<int>((high_x - low_x) * canvas.scale) + 2 * kMargin + 1,
                           static_cast<int>((high_y - low_y) * canvas.scale) + 2 * kMargin + 1, kBackground);

  std::vector<Edge> edges;
  for (const wad::UdmfLinedef& line : map.linedefs) {
    if (line.v1 < 0 || line.v2 < 0 || line.v1 >= vertex_count || line.v2 >= vertex_count) continue;
    const wad::UdmfVertex &a = map.vertices[line.v1], &b = map.vertices[line.v2];
    edges.push_back({canvas.column(a.x), canvas.row(a.y), canvas.column(b.x), canvas.row(b.y),
                     sector_of(line.side_front), sector_of(line.side_back)});
  }
  double lowest = std::numeric_limits<double>::infinity(), highest = -lowest;
  for (const wad::UdmfSector& sector : map.sectors)
    lowest = std::min(lowest, sector.height_floor), highest = std::max(highest, sector.height_floor);
  // Fill row by row: between two crossings lies the sector on the right side of the first one.
  struct Crossing {
    double x;
    int sector;  // that begins here, going east
  };
  std::vector<Crossing> crossings;
  for (int y = 0; y < canvas.picture.height; ++y) {
    crossings.clear();
    const double middle = y + 0.5;
    for (const Edge& edge : edges) {
      if ((edge.y0 > middle) == (edge.y1 > middle)) continue;
      const double x = edge.x0 + (edge.x1 - edge.x0) * (middle - edge.y0) / (edge.y1 - edge.y0);
      // Rows grow to the south: a line that goes up in rows runs south, its right side is the west.
      crossings.push_back({x, edge.y1 > edge.y0 ? edge.left : edge.right});
    }
    std::sort(crossings.begin(), crossings.end(),
              [](const Crossing& a, const Crossing& b) { return a.x < b.x; });
    for (std::size_t i = 0; i + 1 < crossings.size(); ++i) {
      const int sector = crossings[i].sector;
      if (sector < 0) continue;
      const double height = map.sectors[sector].height_floor;
      const double share = highest > lowest ? (height - lowest) / (highest - lowest) : 0.5;
      const auto grey = static_cast<uint8_t>(40 + 110 * std::clamp(share, 0.0, 1.0));
      const bool is_shut = map.sectors[sector].height_ceiling <= height;
      const Colour colour =
          is_shut ? Colour{120, 60, 20} : Colour{grey, grey, static_cast<uint8_t>(grey + 12)};
      const int first = std::max(0, static_cast<int>(crossings[i].x)),
                last = std::min(canvas.picture.width - 1, static_cast<int>(crossings[i + 1].x));
      for (int x = first; x <= last; ++x) canvas.dot(x, y, colour);
    }
  }
  for (const bool walls : {false, true})
    for (const wad::UdmfLinedef& line : map.linedefs) {
      if (line.v1 < 0 || line.v2 < 0 || line.v1 >= vertex_count || line.v2 >= vertex_count) continue;
      const bool is_wall = line.side_back < 0;
      if (is_wall != walls) continue;
      const wad::UdmfVertex &a = map.vertices[line.v1], &b = map.vertices[line.v2];
      canvas.line(canvas.column(a.x), canvas.row(a.y), canvas.column(b.x), canvas.row(b.y),
                  is_wall         ? kWall
                  : line.blocking ? kBarred
                                  : kOpening);
    }
  for (const wad::UdmfThing& thing : map.things) {
    const ThingKind& kind = kind_of_thing(thing.type);
    const bool is_start = &kind == &kKinds[kStart], is_spot = &kind == &kKinds[kSpot];
    const int radius = std::clamp(static_cast<int>(16 * canvas.scale), 2, 12);
    const double x = canvas.column(std::clamp(thing.x, -65536.0, 65536.0)),
                 y = canvas.row(std::clamp(thing.y, -65536.0, 65536.0));
    canvas.disc(x, y, is_spot ? std::max(1, radius / 2) : radius, kind.colour);
    if (is_start) {
      const double angle = thing.angle * (3.14159265358979 / 180.0);
      canvas.line(x, y, x + 2.5 * radius * std::cos(angle), y - 2.5 * radius * std::sin(angle), kind.colour);
    }
  }
  return canvas.picture;
}

}  // namespace comrad::doomgen
