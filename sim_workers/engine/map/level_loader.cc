#include "sim_workers/engine/map/level_loader.h"

#include <cmath>
#include <cstdint>
#include <utility>

#include "sim_workers/engine/map/level_index.h"

namespace comrad::doom {
namespace {

// Coordinates beyond this do not fit 16.16 with room for a body; map units.
constexpr double kCoordinateMax = 32000.0;
constexpr double kLengthMax = 32000.0;

Fixed fixed_from(double units) { return static_cast<Fixed>(std::lround(units * kFracUnit)); }

/// Checks one map and builds the Level beside it; every message names the line of the text.
class Loader {
 public:
  Loader(const wad::UdmfMap& map, std::string name, const std::string& label) : map_(map), label_(label) {
    level_.name = std::move(name);
  }

  Expected<std::shared_ptr<const Level>> load() {
    // Namespaces differ in the numbers of line specials; ours are Hexen's, as in zdoom.
    if (map_.name_space != "zdoom")
      return Error{ErrorCode::kUnsupported,
                   label_ + ": namespace \"" + map_.name_space + "\"; this engine reads \"zdoom\""};
    if (map_.sectors.empty()) return Error{ErrorCode::kBadFormat, label_ + ": a map without sectors"};
    if (map_.linedefs.empty()) return Error{ErrorCode::kBadFormat, label_ + ": a map without linedefs"};
    COMRAD_TRY(add_vertices());
    COMRAD_TRY(add_sectors());
    COMRAD_TRY(add_sidedefs());
    COMRAD_TRY(add_linedefs());
    COMRAD_TRY(add_things());
    complete_level(level_);
    return std::make_shared<const Level>(std::move(level_));
  }

 private:
  Error wrong(int text_line, const std::string& what) const {
    return Error{ErrorCode::kBadFormat, label_ + ":" + std::to_string(text_line) + ": " + what};
  }
  /// Checks that `index` is below `count`.
  Status in_range(int text_line, const char* what, int32_t index, std::size_t count) const {
    if (index >= 0 && static_cast<std::size_t>(index) < count) return {};
    return wrong(text_line, std::string(what) + " " + std::to_string(index) + ", but there are " +
                                std::to_string(count));
  }
  Status in_bounds(int text_line, const char* what, double value) const {
    if (std::abs(value) <= kCoordinateMax) return {};
    return wrong(text_line, std::string(what) + " " + std::to_string(value) + " lies outside -32000..32000");
  }

  Status add_vertices() {
    for (const wad::UdmfVertex& vertex : map_.vertices) {
      COMRAD_TRY(in_bounds(vertex.text_line, "vertex at x", vertex.x));
      COMRAD_TRY(in_bounds(vertex.text_line, "vertex at y", vertex.y));
      level_.vertices.push_back({fixed_from(vertex.x), fixed_from(vertex.y)});
    }
    return {};
  }

  Status add_sectors() {
    for (const wad::UdmfSector& from : map_.sectors) {
      COMRAD_TRY(in_bounds(from.text_line, "sector with heightfloor", from.height_floor));
      COMRAD_TRY(in_bounds(from.text_line, "sector with heightceiling", from.height_ceiling));
      Sector sector;
      sector.floor_height = fixed_from(from.height_floor);
      sector.ceiling_height = fixed_from(from.height_ceiling);
      if (sector.ceiling_height < sector.floor_height)
        return wrong(from.text_line, "this sector's ceiling lies below its floor");
      sector.floor_texture = from.texture_floor, sector.ceiling_texture = from.texture_ceiling;
      sector.light = from.light_level < 0 ? 0 : from.light_level > 255 ? 255 : from.light_level;
      sector.special = from.special;
      sector.tag = from.id;
      sector.damage_amount = from.damage_amount, sector.damage_interval = from.damage_interval;
      level_.sectors.push_back(std::move(sector));
    }
    return {};
  }

  Status add_sidedefs() {
    for (const wad::UdmfSidedef& from : map_.sidedefs) {
      COMRAD_TRY(in_range(from.text_line, "sidedef of sector", from.sector, level_.sectors.size()));
      level_.sidedefs.push_back({from.texture_top, from.texture_bottom, from.texture_middle, from.offset_x,
                                 from.offset_y, static_cast<uint32_t>(from.sector)});
    }
    return {};
  }

  Status add_linedefs() {
    for (const wad::UdmfLinedef& from : map_.linedefs) {
      COMRAD_TRY(in_range(from.text_line, "linedef from vertex", from.v1, level_.vertices.size()));
      COMRAD_TRY(in_range(from.text_line, "linedef to vertex", from.v2, level_.vertices.size()));
      COMRAD_TRY(in_range(from.text_line, "linedef with sidefront", from.side_front, level_.sidedefs.size()));
      if (from.side_back != -1)
        COMRAD_TRY(in_range(from.text_line, "linedef with sideback", from.side_back, level_.sidedefs.size()));
      if (from.two_sided && from.side_back == -1)
        return wrong(from.text_line, "this linedef is marked twosided but has no sideback");
      const Vertex &start = level_.vertices[static_cast<std::size_t>(from.v1)],
                   &end = level_.vertices[static_cast<std::size_t>(from.v2)];
      const double length_x = to_double(end.x) - to_double(start.x),
                   length_y = to_double(end.y) - to_double(start.y);
      if (start.x == end.x && start.y == end.y)
        return wrong(from.text_line, "this linedef has no length: both ends lie at (" +
                                         std::to_string(to_double(start.x)) + ", " +
                                         std::to_string(to_double(start.y)) + ")");
      if (std::abs(length_x) > kLengthMax || std::abs(length_y) > kLengthMax)
        return wrong(from.text_line, "this linedef is longer than 32000 units");
      Linedef line;
      line.start = static_cast<uint32_t>(from.v1), line.end = static_cast<uint32_t>(from.v2);
      line.flags = (from.blocking ? kLineBlocking : 0u) | (from.block_monsters ? kLineBlockMonsters : 0u) |
                   (from.side_back != -1 ? kLineTwoSided : 0u) |
                   (from.dont_peg_top ? kLineUpperUnpegged : 0u) |
                   (from.dont_peg_bottom ? kLineLowerUnpegged : 0u) |
                   (from.block_everything ? kLineBlockEverything : 0u);
      line.special = from.special;
      line.args = from.args;
      line.id = from.id;
      line.front = static_cast<uint32_t>(from.side_front);
      if (from.side_back != -1) line.back = static_cast<uint32_t>(from.side_back);
      level_.linedefs.push_back(line);
    }
    return {};
  }

  Status add_things() {
    for (const wad::UdmfThing& from : map_.things) {
      COMRAD_TRY(in_bounds(from.text_line, "thing at x", from.x));
      COMRAD_TRY(in_bounds(from.text_line, "thing at y", from.y));
      COMRAD_TRY(in_bounds(from.text_line, "thing with height", from.height));
      MapThing thing;
      thing.id = from.id;
      thing.x = fixed_from(from.x), thing.y = fixed_from(from.y), thing.height = fixed_from(from.height);
      thing.angle_degrees = from.angle % 360;
      thing.editor_number = from.type;
      thing.special = from.special;
      thing.args = from.args;
      for (std::size_t skill = 0; skill < from.skill.size(); ++skill)
        if (from.skill[skill]) thing.flags |= kThingSkill1 << skill;
      thing.flags |= (from.single ? kThingSingle : 0u) | (from.coop ? kThingCoop : 0u) |
                     (from.dm ? kThingDeathmatch : 0u) | (from.ambush ? kThingAmbush : 0u) |
                     (from.dormant ? kThingDormant : 0u);
      level_.things.push_back(thing);
    }
    return {};
  }

  const wad::UdmfMap& map_;
  const std::string& label_;
  Level level_;
};

}  // namespace

void complete_level(Level& level) {
  level.sector_linedefs.assign(level.sectors.size(), {});
  for (uint32_t index = 0; index < level.linedefs.size(); ++index) {
    const Linedef& line = level.linedefs[index];
    const uint32_t front = level.sidedefs[line.front].sector_index;
    level.sector_linedefs[front].push_back(index);
    if (!line.back) continue;
    const uint32_t back = level.sidedefs[*line.back].sector_index;
    if (back != front) level.sector_linedefs[back].push_back(index);
  }
  level.index = LevelIndex::build(level);
}

Expected<std::shared_ptr<const Level>> make_level(const wad::UdmfMap& map, std::string name,
                                                  const std::string& label) {
  return Loader(map, std::move(name), label).load();
}

Expected<std::shared_ptr<const Level>> load_level(const wad::WadFile& wad, std::string_view name) {
  std::string map_name(name);
  if (map_name.empty()) {
    const std::vector<std::string> names = wad.map_names();
    if (names.empty()) return Error{ErrorCode::kNotFound, wad.path() + ": no map in this WAD"};
    map_name = names.front();
  }
  COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad.find_map(map_name));
  if (!lumps.textmap)
    return Error{ErrorCode::kUnsupported, wad.path() + ": map " + map_name +
                                              " is in a binary map format; this engine reads UDMF so far"};
  const std::string& shown_name = wad.lump(lumps.marker).name;
  const std::string label = wad.path() + ": TEXTMAP of " + shown_name;
  COMRAD_TRY_ASSIGN(const wad::UdmfMap map, wad::parse_udmf(wad.text(*lumps.textmap), label));
  return make_level(map, shown_name, label);
}

}  // namespace comrad::doom
