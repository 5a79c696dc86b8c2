// Areas with exact outlines become sectors, sidedefs and linedefs. Edges that two areas share become
// two-sided lines whatever order they were drawn in; everything else is a wall. The result is checked before
// anyone sees it.
#pragma once

#include <cstdint>
#include <map>
#include <string>
#include <utility>
#include <vector>

#include "doomgen/layout/map_data.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

/// What lies between two areas along their common edges.
struct Connection {
  bool blocking = false;
  std::string middle_texture = {};  ///< on both sides: a grating, or empty
  int32_t special = 0, id = 0;
  std::array<int32_t, 5> args{};
};

/// Collects areas and things, then builds the map.
///
///   MapBuilder builder;
///   const int arena = builder.add_area({.floor_texture = "FLAT1"}, "BRICK6", outline);
///   builder.add_pillar(arena, box.polygon(), "ASHWALL6");
///   builder.add_thing({.position = {0, 0}, .editor_number = 1});
///   COMRAD_TRY_ASSIGN(MapData map, builder.build());
class MapBuilder {
 public:
  /// A new area of its own; returns its index, which is its sector's index.
  int add_area(SectorData sector, std::string wall_texture, Polygon outline);
  /// Solid rock inside `area`, with walls of its own texture.
  void add_pillar(int area, Polygon outline, std::string wall_texture);
  /// An area cut out of `parent`: a platform, a plate, a pool. Returns its index.
  int add_inset(int parent, SectorData sector, std::string wall_texture, Polygon outline);
  /// Sets what lies between two areas; without it their common edges are open.
  void connect(int first, int second, Connection connection);
  void add_thing(ThingData thing) { things_.push_back(thing); }

  /// The area as a region with its holes, for drawing random points in it.
  Region region(int area) const;

  /// Makes the records: corners merged, edges split where another area's corner lies on them, common edges
  /// paired, then validate_map(). Errors: kBadInput naming the area or the place that is wrong.
  Expected<MapData> build() const;

 private:
  struct Loop {
    int area = 0;
    bool is_hole = false;
    Polygon outline;
    std::string wall_texture;
  };
  std::vector<SectorData> sectors_;
  std::vector<std::string> wall_textures_;
  std::vector<Loop> loops_;
  std::map<std::pair<int, int>, Connection> connections_;
  std::vector<ThingData> things_;
};

/// What every map of ours keeps: coordinates inside +-16384, no line of length zero, no two lines that cross
/// or lie on each other, no corner nearer than one unit to a foreign line, every sector closed and on the
/// side of each line that names it, every one-sided line facing the void, texture names of 1..8 letters.
/// Errors: kBadInput naming the place.
Status validate_map(const MapData& map);

}  // namespace comrad::doomgen
