// What a recipe writes its map down in: named areas laid over one another, what lies between them, and
// things. build() cuts the plane into sectors with exact outlines, or with jagged ones that follow random
// cells. Mistakes are noted where they are made and reported by build(), by the area's name, so a recipe
// reads without checks between its lines.
#pragma once

#include <cstdint>
#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "doomgen/layout/geometry.h"
#include "doomgen/layout/map_data.h"
#include "doomgen/layout/organic.h"
#include "doomgen/layout/subdivision.h"
#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

/// An area's number in its plan, counted from 0 in the order of declaration; its sector has the same number.
using AreaId = int;
constexpr AreaId kRock = -1;

/// One area = one sector.
struct AreaSpec {
  std::string name = {};  ///< unique; messages and area() use it
  int32_t floor = 0, ceiling = 128;
  std::string floor_texture = "FLOOR4_8", ceiling_texture = "CEIL3_5", wall_texture = "STARTAN3";
  std::string upper_texture = {}, lower_texture = {};  ///< of its steps; empty: the wall's
  int32_t light = 160, special = 0, tag = 0;
  LineSpec lines = {};     ///< of every line of the area without a special
  bool in_pieces = false;  ///< it may consist of parts that do not touch
  ExtraFields extra = {};
};

/// What lies between two areas along their common edges.
struct Passage {
  enum class Kind { kOpen, kSolid };
  Kind kind = Kind::kOpen;
  std::string middle_texture = {};  ///< on both sides: a grating, or empty
  LineSpec line = {};

  static Passage open() { return {}; }
  /// Two walls back to back.
  static Passage solid() { return {.kind = Kind::kSolid}; }
  /// Seen through, not walked through; "" is an invisible barrier.
  static Passage window(std::string texture = "MIDGRATE") {
    return {.middle_texture = std::move(texture), .line = {.blocking = true}};
  }
};

/// What an outline takes from the shapes before it.
enum class Claim {
  kAll,       ///< whatever lay there
  kOnlyRock,  ///< only what was rock
};

enum class Direction { kEast, kNorth, kWest, kSouth };

struct CorridorOptions {
  int32_t width = 96;
  int32_t grid = 16;  ///< units between the places the way may bend at
};

/// A solid body that scripts move: lines on a control area off the map, an anchor, a start spot.
struct PolyobjectSpec {
  enum class Touch { kHarmless, kCrushing, kHurting };
  int32_t number = 1, mirror = 0, sound = 0;
  Polygon outline;  ///< around (0, 0), which is its anchor
  Point spot;       ///< where the anchor stands when the map begins
  std::string wall_texture = "METAL";
  Touch touch = Touch::kHarmless;
  std::vector<LineSpec> motions = {};  ///< at most 4: lines of its control area, for scripts to set off by id
  int32_t floor = 0,
          ceiling = 128;  ///< of the control area: how high the body's walls are drawn before it moves
};

/// Where random points may lie.
struct PointOptions {
  int32_t clearance = 32;  ///< units to the area's edges
  int32_t spacing = 0;     ///< units between the points; given up where there is no room for it
};

/// A map in the making.
///
///   MapPlan plan;
///   const AreaId hall = plan.add_area({.name = "hall", .ceiling = 192}, Box::around({0, 0}, 512, 512));
///   const AreaId room = plan.add_area({.name = "room"}, Box::around({600, 0}, 256, 256));
///   plan.add_corridor({.name = "way", .floor_texture = "RROCK19"}, hall, room, {.width = 128});
///   plan.add_door({.name = "door", .wall_texture = "BIGDOOR2", .tag = 10}, room, plan.area("way"), 32);
///   plan.add_area({.name = "plate", .floor_texture = "FLAT23", .tag = 7}, Box::around({0, 64}, 64, 64));
///   plan.add_pillar(Box::around({128, 128}, 48, 48).polygon(), "ASHWALL6");
///   plan.add_start(1, {-64, 0}, 90);
///   COMRAD_TRY_ASSIGN(MapData map, plan.build());
class MapPlan {
 public:
  // --- areas: later ones lie over earlier ones ---
  AreaId add_area(AreaSpec spec, Polygon outline, Claim claim = Claim::kAll);
  AreaId add_area(AreaSpec spec, const Box& box, Claim claim = Claim::kAll);
  /// One more piece of an area.
  void extend_area(AreaId area, Polygon outline, Claim claim = Claim::kAll);
  void extend_area(AreaId area, const Box& box, Claim claim = Claim::kAll);
  /// Rock again. `wall_texture` is what its walls show; empty: the texture of the area they face.
  void add_pillar(Polygon outline, std::string wall_texture = {});
  void add_pillar(const Box& box, std::string wall_texture = {});

  // --- ways ---
  /// The shortest way through rock from `from` to `to`, as wide as requested: found on a grid (A*), made of
  /// rectangles. The way begins and ends at the areas' edges. Noted as a mistake where there is none.
  AreaId add_corridor(AreaSpec spec, AreaId from, AreaId to, const CorridorOptions& options = {});
  /// The same way cut into `count` steps whose floors go evenly from the one area's to the other's (rounded
  /// towards zero); names get a number, ceilings are the higher of the two areas'.
  std::vector<AreaId> add_stairs(const AreaSpec& spec, AreaId from, AreaId to, int count = 4,
                                 const CorridorOptions& options = {});
  /// A straight flight of `count` steps that fills `box`; the first begins at the side that `up` points away
  /// from and has floor `low`, the last has `high`.
  std::vector<AreaId> add_stairs(const AreaSpec& spec, const Box& box, Direction up, int count, int32_t low,
                                 int32_t high);
  /// A shut door (ceiling = floor): a slab of `area`, `thickness` deep, along its common edges with `beyond`.
  /// Heights other than the ceiling's are the area's. Noted as a mistake where the two do not touch.
  AreaId add_door(AreaSpec spec, AreaId area, AreaId beyond, int32_t thickness = 32);
  /// A shut door of a given place.
  AreaId add_door(AreaSpec spec, const Box& box);
  /// A maze's floor: areas of cell x cell units, row by row from `low`, tags counting up from
  /// the specification's.
  std::vector<AreaId> add_grid(const AreaSpec& spec, Point low, int columns, int rows, int32_t cell);

  // --- what lies between areas, and on single lines ---
  /// Without it their common edges are open.
  void connect(AreaId first, AreaId second, Passage passage);
  /// Gives this to every line that lies on the segment a - b; noted as a mistake if there is none.
  void set_line(Point a, Point b, LineSpec line);
  void add_polyobject(PolyobjectSpec spec);

  // --- things ---
  void add_thing(ThingData thing) { things_.push_back(std::move(thing)); }
  void add_start(int player, Point position, int32_t angle_degrees);  ///< player 1..8
  /// A map spot (editor number 9001), which scripts find by its id.
  void add_spot(int32_t id, Point position, int32_t angle_degrees = 0);

  // --- questions ---
  AreaId area(const std::string& name) const;  ///< kRock where there is none
  const AreaSpec& spec(AreaId area) const { return specs_[area]; }
  int area_count() const { return static_cast<int>(specs_.size()); }
  AreaId area_at(Point p) const;
  const std::vector<PlaneEdge>& edges() const;  ///< all edges as they stand; owners are areas, below 0 rock
  std::vector<PlaneEdge> boundary(AreaId area) const;  ///< its edges, the area to the right
  Box bounds(AreaId area) const;                       ///< of its edges; empty at (0, 0) where it has none
  Point centroid(AreaId area) const;                   ///< of its surface, rounded
  /// True where `p` lies in the area and `clearance` from every edge of it.
  bool is_clear(AreaId area, Point p, int32_t clearance) const;
  /// A uniform point of the area that is_clear(), or nothing after many tries.
  std::optional<Point> random_point(AreaId area, int32_t clearance, Rng& rng) const;
  /// `count` different points; fewer where there is no room.
  std::vector<Point> random_points(AreaId area, int count, const PointOptions& options, Rng& rng) const;

  // --- the end ---
  /// Jagged outlines that follow `cell_count` random cells. Call before the first question.
  void use_organic_outlines(const Box& bounds, int cell_count, RngKey key);
  /// Notes a mistake of the recipe's own; build() reports the first one.
  void fail(std::string message);
  /// Sectors, lines, things, checked by validate_map(); every area must have a place and, unless it sets
  /// otherwise, be in one piece. Errors: kBadInput naming the area, line or place.
  Expected<MapData> build() const;

 private:
  struct NamedLine {
    Point a, b;
    LineSpec line;
  };
  AreaId declare(AreaSpec spec);
  void add_shape(int owner, Polygon outline, Claim claim, const std::string& what);
  std::vector<Point> find_way(AreaId from, AreaId to, const CorridorOptions& options,
                              const std::string& name);
  AreaId add_slab(AreaSpec spec, AreaId area, AreaId beyond, int32_t thickness);
  void place_polyobjects(MapPlan& plan) const;
  Expected<MapData> build_plain() const;
  Status check_pieces(const std::vector<PlaneEdge>& edges) const;
  const Passage& passage(AreaId first, AreaId second) const;
  std::vector<PlaneEdge> organic_edges() const;

  std::vector<AreaSpec> specs_;
  std::vector<Shape> shapes_;  ///< owner below -1: rock with texture number -2 - owner
  std::vector<std::string> rock_textures_;
  std::map<std::pair<AreaId, AreaId>, Passage> passages_;
  std::vector<NamedLine> lines_;
  std::vector<PolyobjectSpec> polyobjects_;
  std::vector<ThingData> things_;
  std::optional<CellField> field_;
  std::string mistake_;                                  ///< the first one
  mutable std::optional<std::vector<PlaneEdge>> edges_;  ///< of shapes_ as they stand
};

}  // namespace comrad::doomgen
