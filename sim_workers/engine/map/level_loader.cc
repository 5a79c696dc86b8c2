#include "sim_workers/engine/map/level_loader.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <utility>

#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/doom_specials.h"
#include "doomgen/wad/special_names.h"
#include "rollout_buffer/core/log.h"
#include "rollout_buffer/core/text.h"
#include "sim_workers/engine/actors/actor_type.h"
#include "sim_workers/engine/map/level_index.h"

namespace comrad::doom {
namespace {

// Coordinates beyond this do not fit 16.16 with room for a body; map units.
constexpr double kCoordinateMax = 32000.0;
constexpr double kLengthMax = 32000.0;

Fixed fixed_from(double units) { return static_cast<Fixed>(std::lround(units * kFracUnit)); }
/// For numbers that only decorate: cut off instead of refused.
Fixed fixed_clamped(double units) { return fixed_from(std::clamp(units, -kCoordinateMax, kCoordinateMax)); }
float float_clamped(double value, double low, double high) {
  return static_cast<float>(std::clamp(value, low, high));
}
int32_t light_from(int32_t light) { return std::clamp(light, 0, 255); }

/// Checks one map and builds the Level beside it; every message names the line of the text, or the record.
class Loader {
 public:
  Loader(const wad::UdmfMap& map, std::string name, const std::string& label) : map_(map), label_(label) {
    level_.name = std::move(name);
  }

  Expected<Level> load() {
    // Namespaces differ in the numbers of line specials; ours are Hexen's, as in zdoom.
    if (!same_ignoring_case(map_.name_space, "zdoom"))
      return Error{ErrorCode::kUnsupported, label_ + ": namespace \"" + map_.name_space +
                                                "\"; this engine reads \"zdoom\" and \"ZDoomTranslated\""};
    if (map_.sectors.empty()) return Error{ErrorCode::kBadFormat, label_ + ": a map without sectors"};
    if (map_.linedefs.empty()) return Error{ErrorCode::kBadFormat, label_ + ": a map without linedefs"};
    level_.warnings = map_.warnings;
    COMRAD_TRY(add_vertices());
    COMRAD_TRY(add_sectors());
    COMRAD_TRY(add_sidedefs());
    COMRAD_TRY(add_linedefs());
    if (level_.linedefs.empty())
      return Error{ErrorCode::kBadFormat, label_ + ": no linedef of this map can be used"};
    COMRAD_TRY(add_things());
    split_shared_sides();
    warn_of_missing();
    complete_level(level_);
    return std::move(level_);
  }

 private:
  /// Where a block or record is: "label:12" in text, "label: linedef 12" in a binary lump.
  Error wrong(const char* kind, int place, const std::string& what) const {
    return Error{ErrorCode::kBadFormat, map_.is_binary
                                            ? fmt::format("{}: {} {}: {}", label_, kind, place, what)
                                            : fmt::format("{}:{}: {}", label_, place, what)};
  }
  /// Checks that `index` is below `count`.
  Status in_range(const char* kind, int place, const char* what, int32_t index, std::size_t count) const {
    if (index >= 0 && static_cast<std::size_t>(index) < count) return {};
    return wrong(kind, place, fmt::format("{} {}, but there are {}", what, index, count));
  }
  Status in_bounds(const char* kind, int place, const char* what, double value) const {
    if (std::abs(value) <= kCoordinateMax) return {};
    return wrong(kind, place, fmt::format("{} {} lies outside -32000..32000", what, value));
  }

  Status add_vertices() {
    bool has_slope = false;
    for (const wad::UdmfVertex& vertex : map_.vertices) {
      COMRAD_TRY(in_bounds("vertex", vertex.text_line, "vertex at x", vertex.x));
      COMRAD_TRY(in_bounds("vertex", vertex.text_line, "vertex at y", vertex.y));
      level_.vertices.push_back({fixed_from(vertex.x), fixed_from(vertex.y)});
      has_slope |= vertex.has_height;
    }
    for (const wad::UdmfSector& sector : map_.sectors) has_slope |= sector.is_sloped;
    if (has_slope) level_.warnings.push_back("slopes are not supported: floors and ceilings stay level");
    return {};
  }

  static FlatPlacement placement_from(const wad::UdmfSector::Plane& from) {
    FlatPlacement placement;
    placement.offset_x = fixed_clamped(from.panning_x), placement.offset_y = fixed_clamped(from.panning_y);
    placement.scale_x = from.scale_x == 0 ? 1.0f : float_clamped(from.scale_x, -1000, 1000);
    placement.scale_y = from.scale_y == 0 ? 1.0f : float_clamped(from.scale_y, -1000, 1000);
    placement.rotation_degrees = static_cast<float>(std::fmod(from.rotation, 360.0));
    placement.light = std::clamp(from.light, -255, 255), placement.light_absolute = from.light_absolute;
    return placement;
  }

  static DamageType damage_type_from(const std::string& name) {
    static constexpr std::pair<std::string_view, DamageType> kTypes[] = {
        {"FIRE", DamageType::kFire},         {"ICE", DamageType::kIce},
        {"SLIME", DamageType::kSlime},       {"DROWNING", DamageType::kDrowning},
        {"CRUSH", DamageType::kCrush},       {"FALLING", DamageType::kFalling},
        {"ELECTRIC", DamageType::kElectric}, {"POISON", DamageType::kPoison},
        {"MASSACRE", DamageType::kMassacre}, {"INSTANTDEATH", DamageType::kInstantDeath},
    };
    for (const auto& [type_name, type] : kTypes)
      if (name == type_name) return type;
    return DamageType::kNormal;
  }

  Status add_sectors() {
    for (const wad::UdmfSector& from : map_.sectors) {
      const int place = from.text_line;
      COMRAD_TRY(in_bounds("sector", place, "sector with heightfloor", from.height_floor));
      COMRAD_TRY(in_bounds("sector", place, "sector with heightceiling", from.height_ceiling));
      Sector sector;
      sector.floor_height = fixed_from(from.height_floor);
      sector.ceiling_height = fixed_from(from.height_ceiling);
      if (sector.ceiling_height < sector.floor_height) {
        // Doors of old maps begin so; they are shut all the same.
        sector.ceiling_height = sector.floor_height;
        ++low_ceilings_;
      }
      sector.floor_texture = from.texture_floor, sector.ceiling_texture = from.texture_ceiling;
      sector.light = light_from(from.light_level);
      sector.special = from.special;
      sector.tag = from.id;
      sector.damage_amount = from.damage_amount;
      sector.damage_interval = from.damage_interval > 0 ? from.damage_interval : kDamageIntervalTics;
      sector.damage_leak = std::clamp(from.leakiness, 0, 256);
      sector.damage_type = static_cast<uint8_t>(damage_type_from(from.damage_type));
      sector.secret = from.secret;
      sector.gravity = fixed_from(std::clamp(from.gravity, -100.0, 100.0));
      sector.silent = from.silent, sector.hidden = from.hidden;
      sector.no_falling_damage = from.no_falling_damage;
      sector.light_color = static_cast<uint32_t>(from.light_color) & 0xFFFFFFu;
      sector.fade_color = static_cast<uint32_t>(from.fade_color) & 0xFFFFFFu;
      sector.floor_placement = placement_from(from.floor);
      sector.ceiling_placement = placement_from(from.ceiling);
      if (!from.more_ids.empty()) ++more_ids_;
      level_.sectors.push_back(std::move(sector));
    }
    if (low_ceilings_ > 0)
      level_.warnings.push_back(
          fmt::format("{} sectors with a ceiling below their floor: they start shut", low_ceilings_));
    if (more_ids_ > 0)
      level_.warnings.push_back(fmt::format(
          "{} sectors with 'moreids', which is not supported: they answer to 'id' alone", more_ids_));
    return {};
  }

  Status add_sidedefs() {
    int lost = 0;
    for (const wad::UdmfSidedef& from : map_.sidedefs) {
      Sidedef side{from.texture_top, from.texture_bottom, from.texture_middle,
                   from.offset_x,    from.offset_y,       0};
      // An editor's leftovers, which no line uses.
      if (map_.is_binary && static_cast<std::size_t>(from.sector) >= level_.sectors.size()) {
        ++lost;
      } else {
        COMRAD_TRY(
            in_range("sidedef", from.text_line, "sidedef of sector", from.sector, level_.sectors.size()));
        side.sector_index = static_cast<uint32_t>(from.sector);
      }
      for (std::size_t i = 0; i < side.parts.size(); ++i) {
        const wad::UdmfSidedef::Part& part = from.parts[i];
        side.parts[i] = {fixed_clamped(part.offset_x), fixed_clamped(part.offset_y),
                         part.scale_x == 0 ? 1.0f : float_clamped(part.scale_x, -1000, 1000),
                         part.scale_y == 0 ? 1.0f : float_clamped(part.scale_y, -1000, 1000)};
      }
      side.light = std::clamp(from.light, -255, 255);
      side.flags = (from.light_absolute ? kSideLightAbsolute : 0u) |
                   (from.no_fake_contrast ? kSideNoFakeContrast : 0u) |
                   (from.smooth_lighting ? kSideSmoothLighting : 0u) |
                   (from.clip_midtex ? kSideClipMiddle : 0u) | (from.wrap_midtex ? kSideWrapMiddle : 0u);
      level_.sidedefs.push_back(std::move(side));
    }
    if (lost > 0)
      level_.warnings.push_back(fmt::format("{} sidedefs of sectors that do not exist: sector 0", lost));
    return {};
  }

  static uint32_t flags_of(const wad::UdmfLinedef& from) {
    const auto flag = [](bool on, LinedefFlag value) { return on ? uint32_t{value} : 0u; };
    return flag(from.blocking, kLineBlocking) | flag(from.block_monsters, kLineBlockMonsters) |
           flag(from.dont_peg_top, kLineUpperUnpegged) | flag(from.dont_peg_bottom, kLineLowerUnpegged) |
           flag(from.block_everything, kLineBlockEverything) | flag(from.block_sound, kLineSoundBlock) |
           flag(from.secret, kLineSecret) | flag(from.repeat_special, kLineRepeatable) |
           flag(from.player_cross, kLinePlayerCross) | flag(from.player_use, kLinePlayerUse) |
           flag(from.player_push, kLinePlayerPush) | flag(from.impact, kLineImpact) |
           flag(from.monster_cross, kLineMonsterCross) | flag(from.monster_use, kLineMonsterUse) |
           flag(from.monster_push, kLineMonsterPush) | flag(from.missile_cross, kLineMissileCross) |
           flag(from.any_cross, kLineAnyCross) | flag(from.player_use_back, kLinePlayerUseBack) |
           flag(from.pass_use, kLinePassUse) | flag(from.first_side_only, kLineFirstSideOnly) |
           flag(from.monster_activate, kLineMonsterActivate) | flag(from.jump_over, kLineRailing) |
           flag(from.block_players, kLineBlockPlayers) | flag(from.block_projectiles, kLineBlockProjectiles) |
           flag(from.block_hitscan, kLineBlockHitscan) | flag(from.block_use, kLineBlockUse) |
           flag(from.block_sight, kLineBlockSight) | flag(from.wrap_midtex, kLineWrapMidtex) |
           flag(from.clip_midtex, kLineClipMidtex) | flag(from.block_floaters, kLineBlockFloaters) |
           flag(from.check_switch_range, kLineCheckSwitchRange);
  }

  /// A line of a binary map that cannot be used is left out: true.
  bool leave_out(bool flaw, int place, int& count, int& first) const {
    if (flaw && count++ == 0) first = place;
    return flaw;
  }

  Status add_linedefs() {
    int no_length = 0, first_no_length = 0, no_front = 0, first_no_front = 0, no_back = 0, first_no_back = 0;
    bool has_3d_midtex = false;
    for (const wad::UdmfLinedef& from : map_.linedefs) {
      const int place = from.text_line;
      COMRAD_TRY(in_range("linedef", place, "linedef from vertex", from.v1, level_.vertices.size()));
      COMRAD_TRY(in_range("linedef", place, "linedef to vertex", from.v2, level_.vertices.size()));
      const Vertex &start = level_.vertices[static_cast<std::size_t>(from.v1)],
                   &end = level_.vertices[static_cast<std::size_t>(from.v2)];
      const double length_x = to_double(end.x) - to_double(start.x),
                   length_y = to_double(end.y) - to_double(start.y);
      if (map_.is_binary) {
        const auto unusable = [&](int32_t side) {
          return side < 0 || static_cast<std::size_t>(side) >= level_.sidedefs.size();
        };
        if (leave_out(start.x == end.x && start.y == end.y, place, no_length, first_no_length)) continue;
        if (leave_out(unusable(from.side_front), place, no_front, first_no_front)) continue;
      }
      COMRAD_TRY(
          in_range("linedef", place, "linedef with sidefront", from.side_front, level_.sidedefs.size()));
      if (from.side_back != -1)
        COMRAD_TRY(
            in_range("linedef", place, "linedef with sideback", from.side_back, level_.sidedefs.size()));
      leave_out(from.two_sided && from.side_back == -1, place, no_back, first_no_back);  // it is a wall
      if (start.x == end.x && start.y == end.y)
        return wrong("linedef", place,
                     fmt::format("this linedef has no length: both ends lie at ({}, {})", to_double(start.x),
                                 to_double(start.y)));
      if (std::abs(length_x) > kLengthMax || std::abs(length_y) > kLengthMax)
        return wrong("linedef", place, "this linedef is longer than 32000 units");
      Linedef line;
      line.start = static_cast<uint32_t>(from.v1), line.end = static_cast<uint32_t>(from.v2);
      line.flags = flags_of(from) | (from.side_back != -1 ? kLineTwoSided : 0u);
      line.special = from.special;
      line.args = from.args;
      line.id = from.id;
      line.front = static_cast<uint32_t>(from.side_front);
      if (from.side_back != -1) line.back = static_cast<uint32_t>(from.side_back);
      line.alpha = float_clamped(from.alpha, 0, 1);
      if (from.transparent) line.alpha = 0.25f;
      if (from.translucent) line.alpha = 0.75f;
      line.additive = from.render_style == "ADD";
      line.lock_number = from.lock_number;
      line.arg0_text = from.arg0_text;
      // Static_Init's kin: these only say what the line is.
      if (from.special == wad::Special::kLine_SetIdentification) line.special = 0;
      has_3d_midtex |= from.midtex_3d;
      level_.linedefs.push_back(std::move(line));
    }
    const auto tell = [&](int count, int first, const char* what) {
      if (count > 0)
        level_.warnings.push_back(fmt::format("{} linedefs {}, linedef {} the first", count, what, first));
    };
    tell(no_length, first_no_length, "of no length, left out");
    tell(no_front, first_no_front, "without a front side, left out");
    tell(no_back, first_no_back, "marked two-sided without a back side: taken as one-sided");
    if (has_3d_midtex) level_.warnings.push_back("middle textures are no floors here: 'midtex3d' is ignored");
    apply_translucency();
    return {};
  }

  /// TranslucentLine(id, amount, additive) on a line speaks of all lines with that id.
  void apply_translucency() {
    for (std::size_t i = 0; i < level_.linedefs.size(); ++i) {
      if (level_.linedefs[i].special != wad::Special::kTranslucentLine) continue;
      const std::array<int32_t, 5> args = level_.linedefs[i].args;
      const auto apply = [&](Linedef& line) {
        line.alpha = static_cast<float>(light_from(args[1])) / 255.0f;
        line.additive = args[2] != 0;
      };
      apply(level_.linedefs[i]);
      level_.linedefs[i].special = 0;
      if (args[0] == 0) continue;
      for (Linedef& line : level_.linedefs)
        if (line.id == args[0]) apply(line);
    }
  }

  Status add_things() {
    int far_off = 0;
    for (const wad::UdmfThing& from : map_.things) {
      if (map_.is_binary && (std::abs(from.x) > kCoordinateMax || std::abs(from.y) > kCoordinateMax)) {
        ++far_off;
        continue;
      }
      COMRAD_TRY(in_bounds("thing", from.text_line, "thing at x", from.x));
      COMRAD_TRY(in_bounds("thing", from.text_line, "thing at y", from.y));
      COMRAD_TRY(in_bounds("thing", from.text_line, "thing with height", from.height));
      MapThing thing;
      thing.id = from.id;
      thing.x = fixed_from(from.x), thing.y = fixed_from(from.y), thing.height = fixed_from(from.height);
      thing.angle_degrees = from.angle % 360;
      thing.editor_number = from.type;
      thing.special = from.special;
      thing.args = from.args;
      for (std::size_t skill = 0; skill < from.skill.size(); ++skill)
        if (from.skill[skill]) thing.flags |= thing_skill_flag(static_cast<int>(skill) + 1);
      const auto flag = [](bool on, ThingFlag value) { return on ? uint32_t{value} : 0u; };
      thing.flags |= flag(from.single, kThingSingle) | flag(from.coop, kThingCoop) |
                     flag(from.dm, kThingDeathmatch) | flag(from.ambush, kThingAmbush) |
                     flag(from.dormant, kThingDormant) | flag(from.standing, kThingStanding) |
                     flag(from.friendly, kThingFriend) | flag(from.invisible, kThingInvisible) |
                     flag(from.translucent, kThingShadow) | flag(from.count_secret, kThingCountSecret);
      thing.class_filter = from.class_filter & 0xFFFFu;
      thing.pitch_degrees = from.pitch % 360;
      thing.alpha = float_clamped(from.alpha, -1, 1);
      if (from.scale_x != 0) thing.scale_x = float_clamped(from.scale_x, -1000, 1000);
      if (from.scale_y != 0) thing.scale_y = float_clamped(from.scale_y, -1000, 1000);
      thing.health = std::clamp(from.health, -1'000'000, 1'000'000);
      thing.gravity = fixed_from(std::clamp(from.gravity, -100.0, 100.0));
      thing.score = from.score;
      thing.arg0_text = from.arg0_text;
      level_.things.push_back(thing);
    }
    if (far_off > 0)
      level_.warnings.push_back(fmt::format("{} things beyond 32000 units, left out", far_off));
    return {};
  }

  /// Some editors let lines share a sidedef to save space. In play each side changes for itself.
  void split_shared_sides() {
    std::vector<bool> used(level_.sidedefs.size(), false);
    const auto own = [&](uint32_t side) {
      if (!used[side]) {
        used[side] = true;
        return side;
      }
      level_.sidedefs.push_back(Sidedef(level_.sidedefs[side]));
      return static_cast<uint32_t>(level_.sidedefs.size() - 1);
    };
    for (Linedef& line : level_.linedefs) {
      line.front = own(line.front);
      if (line.back) line.back = own(*line.back);
    }
  }

  /// What the map requests and does not get: it is loaded without.
  void warn_of_missing() {
    for (const wad::SpecialName& missing : wad::special_names()) {
      if (missing.support != wad::SpecialSupport::kUnsupportedShape) continue;
      const auto count = std::count_if(level_.linedefs.begin(), level_.linedefs.end(),
                                       [&](const Linedef& line) { return line.special == missing.number; });
      if (count > 0)
        level_.warnings.push_back(fmt::format("{} ({}) on {} linedefs is not supported and has no effect",
                                              missing.name, missing.number, count));
    }
  }

  const wad::UdmfMap& map_;
  const std::string& label_;
  Level level_;
  int low_ceilings_ = 0, more_ids_ = 0;
};

/// Lines of polyobjects are drawn somewhere and stand elsewhere: no walls of the map. A polyobject is a ring
/// of lines that begins with Polyobj_StartLine, or all lines with the same Polyobj_ExplicitLine.
void mark_polyobject_lines(Level& level) {
  std::vector<std::vector<uint32_t>> leaving;  // [vertex] lines
  for (Linedef& line : level.linedefs) line.in_polyobject = false;
  for (uint32_t index = 0; index < level.linedefs.size(); ++index) {
    Linedef& line = level.linedefs[index];
    if (line.special == wad::Special::kPolyobj_ExplicitLine) line.in_polyobject = true;
    if (line.special != wad::Special::kPolyobj_StartLine) continue;
    if (leaving.empty()) {
      leaving.resize(level.vertices.size());
      for (uint32_t other = 0; other < level.linedefs.size(); ++other)
        leaving[level.linedefs[other].start].push_back(other);
    }
    // Round the ring, from end to start.
    uint32_t current = index;
    while (!level.linedefs[current].in_polyobject) {
      level.linedefs[current].in_polyobject = true;
      for (const uint32_t next : leaving[level.linedefs[current].end]) {
        if (level.linedefs[next].in_polyobject) continue;
        current = next;
        break;
      }
    }
  }
}

}  // namespace

void complete_level(Level& level) {
  mark_polyobject_lines(level);
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
  COMRAD_TRY_ASSIGN(Level level, Loader(map, std::move(name), label).load());
  return std::make_shared<const Level>(std::move(level));
}

Expected<std::shared_ptr<const Level>> load_level(const wad::WadFile& wad, std::string_view name) {
  std::string map_name(name);
  if (map_name.empty()) {
    const std::vector<std::string> names = wad.map_names();
    if (names.empty()) return Error{ErrorCode::kNotFound, wad.path() + ": no map in this WAD"};
    map_name = names.front();
  }
  COMRAD_TRY_ASSIGN(const wad::MapLumps lumps, wad.find_map(map_name));
  const std::string& shown_name = wad.lump(lumps.marker).name;
  const std::string label = wad.path() + (lumps.textmap ? ": TEXTMAP of " : ": map ") + shown_name;
  COMRAD_TRY_ASSIGN(wad::UdmfMap map, lumps.textmap ? wad::parse_udmf(wad.text(*lumps.textmap), label)
                                                    : wad::read_binary_map(wad, lumps, label));
  if (same_ignoring_case(map.name_space, "zdoomtranslated")) wad::translate_doom_map(map);
  COMRAD_TRY_ASSIGN(Level level, Loader(map, shown_name, label).load());
  level.format = lumps.textmap                 ? MapFormat::kUdmf
                 : wad::is_hexen_format(lumps) ? MapFormat::kHexen
                                               : MapFormat::kDoom;
  if (lumps.behavior) {
    const std::span<const uint8_t> bytes = wad.bytes(*lumps.behavior);
    level.behavior_lump.assign(bytes.begin(), bytes.end());
  }
  if (lumps.scripts) level.scripts_text = wad.text(*lumps.scripts);
  if (lumps.dialogue) level.dialogue_text = wad.text(*lumps.dialogue);
  for (const std::string& warning : level.warnings) spdlog::warn("{}: {}", label, warning);
  return std::make_shared<const Level>(std::move(level));
}

}  // namespace comrad::doom
