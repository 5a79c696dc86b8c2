#include "doomgen/layout/map_builder.h"

#include <algorithm>

namespace comrad::doomgen {
namespace {

/// A directed piece of an area's outline; the area lies to its right.
struct Edge {
  Point start, end;
  int area = 0;
  const std::string* wall_texture = nullptr;
};

/// Repeated and needless repeated corners out, turning sense as wanted.
Polygon normalised(const Polygon& outline, bool clockwise) {
  Polygon result;
  for (const Point& p : outline)
    if (result.empty() || result.back() != p) result.push_back(p);
  while (result.size() > 1 && result.front() == result.back()) result.pop_back();
  if (result.size() >= 3 && (twice_area(result) < 0) != clockwise) std::reverse(result.begin(), result.end());
  return result;
}

/// Cuts an edge at every corner that lies on it, in order along the edge.
void split_at_corners(const Edge& edge, const std::vector<Point>& corners, std::vector<Edge>& out) {
  std::vector<Point> cuts{edge.start, edge.end};
  for (const Point& p : corners) {
    if (p == edge.start || p == edge.end || cross(edge.start, edge.end, p) != 0) continue;
    const Box box = bounds_of(std::array{edge.start, edge.end});
    if (p.x >= box.low.x && p.x <= box.high.x && p.y >= box.low.y && p.y <= box.high.y) cuts.push_back(p);
  }
  std::sort(cuts.begin(), cuts.end(), [&](Point a, Point b) {
    return distance_squared(edge.start, a) < distance_squared(edge.start, b);
  });
  for (std::size_t i = 0; i + 1 < cuts.size(); ++i)
    out.push_back({cuts[i], cuts[i + 1], edge.area, edge.wall_texture});
}

}  // namespace

int MapBuilder::add_area(SectorData sector, std::string wall_texture, Polygon outline) {
  const int area = static_cast<int>(sectors_.size());
  sectors_.push_back(std::move(sector));
  loops_.push_back({area, false, std::move(outline), wall_texture});
  wall_textures_.push_back(std::move(wall_texture));
  return area;
}

void MapBuilder::add_pillar(int area, Polygon outline, std::string wall_texture) {
  COMRAD_CHECK(area >= 0 && area < static_cast<int>(sectors_.size()), "a pillar stands in an area");
  loops_.push_back({area, true, std::move(outline), std::move(wall_texture)});
}

int MapBuilder::add_inset(int parent, SectorData sector, std::string wall_texture, Polygon outline) {
  add_pillar(parent, outline, wall_textures_[parent]);
  return add_area(std::move(sector), std::move(wall_texture), std::move(outline));
}

void MapBuilder::connect(int first, int second, Connection connection) {
  connections_[std::minmax(first, second)] = std::move(connection);
}

Region MapBuilder::region(int area) const {
  Region region;
  for (const Loop& loop : loops_) {
    if (loop.area != area) continue;
    if (loop.is_hole)
      region.holes.push_back(loop.outline);
    else
      region.outline = loop.outline;
  }
  return region;
}

Expected<MapData> MapBuilder::build() const {
  MapData map;
  map.sectors = sectors_;
  map.things = things_;

  std::vector<Edge> outline_edges;
  std::vector<Point> corners;
  for (const Loop& loop : loops_) {
    // The front side of a line is its right side: outlines run clockwise, holes the other way round.
    const Polygon outline = normalised(loop.outline, !loop.is_hole);
    if (outline.size() < 3 || twice_area(outline) == 0)
      return Error{ErrorCode::kBadInput,
                   "area " + std::to_string(loop.area) + (loop.is_hole ? ": a hole" : ": the outline") +
                       " has no area; give at least three corners that are not in line"};
    for (std::size_t i = 0; i < outline.size(); ++i) {
      outline_edges.push_back({outline[i], outline[(i + 1) % outline.size()], loop.area, &loop.wall_texture});
      corners.push_back(outline[i]);
    }
  }
  std::sort(corners.begin(), corners.end());
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  std::vector<Edge> edges;
  for (const Edge& edge : outline_edges) split_at_corners(edge, corners, edges);

  std::map<Point, uint32_t> vertex_of;
  const auto vertex = [&](Point p) {
    const auto [found, is_new] = vertex_of.try_emplace(p, static_cast<uint32_t>(map.vertices.size()));
    if (is_new) map.vertices.push_back(p);
    return found->second;
  };
  std::map<std::pair<Point, Point>, std::size_t> edge_of;  // by direction
  for (std::size_t i = 0; i < edges.size(); ++i)
    if (!edge_of.try_emplace({edges[i].start, edges[i].end}, i).second)
      return Error{ErrorCode::kBadInput,
                   "areas " + std::to_string(edges[edge_of[{edges[i].start, edges[i].end}]].area) + " and " +
                       std::to_string(edges[i].area) + " overlap at the edge " + at(edges[i].start) + " - " +
                       at(edges[i].end)};

  for (std::size_t i = 0; i < edges.size(); ++i) {
    const Edge& edge = edges[i];
    const auto opposite = edge_of.find({edge.end, edge.start});
    if (opposite != edge_of.end() && opposite->second < i) continue;  // made with its partner
    LinedefData line;
    line.start = vertex(edge.start);
    line.end = vertex(edge.end);
    line.front = static_cast<uint32_t>(map.sidedefs.size());
    if (opposite == edge_of.end()) {
      line.blocking = true;
      map.sidedefs.push_back({static_cast<uint32_t>(edge.area), "", *edge.wall_texture, ""});
    } else {
      const Edge& other = edges[opposite->second];
      if (other.area == edge.area) continue;  // an edge inside one area is no line
      Connection connection;
      if (const auto found = connections_.find(std::minmax(edge.area, other.area));
          found != connections_.end())
        connection = found->second;
      line.blocking = connection.blocking;
      line.special = connection.special;
      line.args = connection.args;
      line.id = connection.id;
      line.back = line.front + 1;
      // Floors may move later, so both steps have a texture on both sides: the upper one of the side's own
      // area, the lower one of the area whose step it is.
      map.sidedefs.push_back({static_cast<uint32_t>(edge.area), wall_textures_[edge.area],
                              connection.middle_texture, wall_textures_[other.area]});
      map.sidedefs.push_back({static_cast<uint32_t>(other.area), wall_textures_[other.area],
                              connection.middle_texture, wall_textures_[edge.area]});
    }
    map.linedefs.push_back(line);
  }
  COMRAD_TRY(validate_map(map));
  return map;
}

}  // namespace comrad::doomgen
