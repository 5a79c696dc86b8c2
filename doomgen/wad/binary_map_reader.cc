#include "doomgen/wad/binary_map_reader.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstring>
#include <optional>
#include <span>
#include <utility>

#include "doomgen/wad/doom_specials.h"
#include "doomgen/wad/map_records.h"
#include "doomgen/wad/special_names.h"
#include "rollout_buffer/core/text.h"

namespace comrad::wad {
namespace {

// Flags of LINEDEFS.
enum : uint16_t {
  kBlocking = 0x01,
  kBlockMonsters = 0x02,
  kTwoSided = 0x04,
  kUpperUnpegged = 0x08,
  kLowerUnpegged = 0x10,
  kSecret = 0x20,
  kBlockSound = 0x40,
  // Doom format with Boom's addition.
  kPassUse = 0x200,
  kReservedLineFlag = 0x800,  // set by old editors that filled the higher bits with rubbish
  // Hexen format.
  kHexenRepeat = 0x200,
  kHexenMonsters = 0x2000,
  kHexenBlockPlayers = 0x4000,
  kHexenBlockEverything = 0x8000,
};
constexpr int kHexenActivationShift = 10;

// Flags of THINGS.
enum : uint16_t {
  kEasy = 0x01,
  kMedium = 0x02,
  kHard = 0x04,
  kAmbush = 0x08,
  // Doom format.
  kNotSingle = 0x10,
  kNotDeathmatch = 0x20,
  kNotCoop = 0x40,
  kFriend = 0x80,
  kReservedThingFlag = 0x100,
  // Hexen format.
  kHexenDormant = 0x10,
  kHexenSingle = 0x100,
  kHexenCoop = 0x200,
  kHexenDeathmatch = 0x400,
  kHexenShadow = 0x800,
  kHexenFriend = 0x2000,
  kHexenStanding = 0x4000,
};
constexpr int kHexenClassShift = 5;

std::string name_of(const NameBytes& bytes) {
  std::string name(bytes.begin(), std::find(bytes.begin(), bytes.end(), '\0'));
  for (char& c : name) {
    c = upper_case(c);
    if (c < ' ' || c > '~') c = '?';
  }
  return name.empty() ? "-" : name;
}

class Reader {
 public:
  Reader(const WadFile& wad, const MapLumps& lumps, const std::string& label)
      : wad_(wad), lumps_(lumps), label_(label) {}

  Expected<UdmfMap> read() {
    map_.name_space = "zdoom";  // the numbers are ZDoom's, from here on
    map_.is_binary = true;
    COMRAD_TRY((for_each<VertexRecord>("VERTEXES", lumps_.vertexes, [&](const VertexRecord& from, int index) {
      UdmfVertex vertex;
      vertex.x = from.x, vertex.y = from.y;
      vertex.text_line = index;
      map_.vertices.push_back(vertex);
    })));
    COMRAD_TRY((for_each<SectorRecord>("SECTORS", lumps_.sectors,
                                       [&](const SectorRecord& from, int index) { sector(from, index); })));
    COMRAD_TRY((for_each<SidedefRecord>(
        "SIDEDEFS", lumps_.sidedefs, [&](const SidedefRecord& from, int index) { sidedef(from, index); })));
    if (is_hexen_format(lumps_)) {
      COMRAD_TRY((for_each<HexenLinedefRecord>(
          "LINEDEFS", lumps_.linedefs,
          [&](const HexenLinedefRecord& from, int index) { hexen_linedef(from, index); })));
      COMRAD_TRY(
          (for_each<HexenThingRecord>("THINGS", lumps_.things, [&](const HexenThingRecord& from, int index) {
            hexen_thing(from, index);
          })));
    } else {
      COMRAD_TRY(
          (for_each<LinedefRecord>("LINEDEFS", lumps_.linedefs, [&](const LinedefRecord& from, int index) {
            doom_linedef(from, index);
          })));
      COMRAD_TRY((for_each<ThingRecord>(
          "THINGS", lumps_.things, [&](const ThingRecord& from, int index) { doom_thing(from, index); })));
    }
    if (unknown_lines_ > 0)
      map_.warnings.push_back(fmt::format(
          "{} linedefs of types that are not known, type {} of linedef {} the first; they do nothing",
          unknown_lines_, unknown_type_, unknown_line_));
    if (untagged_lines_ > 0)
      map_.warnings.push_back(fmt::format(
          "{} linedefs act on tagged sectors but have no tag, linedef {} the first; they do nothing",
          untagged_lines_, untagged_line_));
    return std::move(map_);
  }

 private:
  template <typename Record, typename Take>
  Status for_each(const char* lump_name, std::optional<std::size_t> lump, Take&& take) const {
    if (!lump) return Error{ErrorCode::kBadFormat, label_ + " has no " + lump_name + " lump"};
    const std::span<const uint8_t> bytes = wad_.bytes(*lump);
    if (bytes.size() % sizeof(Record) != 0)
      return Error{ErrorCode::kBadFormat,
                   fmt::format("{}: {} has {} bytes, which is no multiple of {}: truncated?", label_,
                               lump_name, bytes.size(), sizeof(Record))};
    for (std::size_t at = 0; at < bytes.size(); at += sizeof(Record)) {
      Record record;
      std::memcpy(&record, bytes.data() + at, sizeof(Record));
      take(record, static_cast<int>(at / sizeof(Record)));
    }
    return {};
  }

  void sector(const SectorRecord& from, int index) {
    UdmfSector sector;
    sector.height_floor = from.floor_height, sector.height_ceiling = from.ceiling_height;
    sector.texture_floor = name_of(from.floor_texture),
    sector.texture_ceiling = name_of(from.ceiling_texture);
    sector.light_level = from.light;
    sector.special = is_hexen_format(lumps_) ? from.special : translate_doom_sector(from.special);
    sector.id = from.tag;
    sector.text_line = index;
    map_.sectors.push_back(std::move(sector));
  }

  void sidedef(const SidedefRecord& from, int index) {
    UdmfSidedef side;
    side.offset_x = from.offset_x, side.offset_y = from.offset_y;
    side.texture_top = name_of(from.top), side.texture_bottom = name_of(from.bottom),
    side.texture_middle = name_of(from.middle);
    side.sector = from.sector;
    side.text_line = index;
    map_.sidedefs.push_back(std::move(side));
  }

  template <typename Record>
  UdmfLinedef common_linedef(const Record& from, int index) const {
    UdmfLinedef line;
    line.v1 = from.start, line.v2 = from.end;
    line.side_front = from.front == kNoSidedef ? -1 : from.front;
    line.side_back = from.back == kNoSidedef ? -1 : from.back;
    line.blocking = (from.flags & kBlocking) != 0;
    line.block_monsters = (from.flags & kBlockMonsters) != 0;
    line.two_sided = (from.flags & kTwoSided) != 0;
    line.dont_peg_top = (from.flags & kUpperUnpegged) != 0;
    line.dont_peg_bottom = (from.flags & kLowerUnpegged) != 0;
    line.secret = (from.flags & kSecret) != 0;
    line.block_sound = (from.flags & kBlockSound) != 0;
    line.text_line = index;
    return line;
  }

  void doom_linedef(const LinedefRecord& from, int index) {
    UdmfLinedef line = common_linedef(from, index);
    if ((from.flags & kReservedLineFlag) == 0) line.pass_use = (from.flags & kPassUse) != 0;
    line.id = from.tag;
    const std::optional<TranslatedLine> translated = translate_doom_line(from.special, from.tag, line);
    if (!translated) {
      if (unknown_lines_++ == 0) unknown_type_ = from.special, unknown_line_ = index;
    } else if (translated->uses_tag && from.tag == 0) {
      if (untagged_lines_++ == 0) untagged_line_ = index;
    } else {
      line.special = translated->special, line.args = translated->args;
    }
    map_.linedefs.push_back(std::move(line));
  }

  void hexen_linedef(const HexenLinedefRecord& from, int index) {
    UdmfLinedef line = common_linedef(from, index);
    line.special = from.special;
    std::copy(from.args.begin(), from.args.end(), line.args.begin());
    line.repeat_special = (from.flags & kHexenRepeat) != 0;
    line.monster_activate = (from.flags & kHexenMonsters) != 0;
    line.block_players = (from.flags & kHexenBlockPlayers) != 0;
    line.block_everything = (from.flags & kHexenBlockEverything) != 0;
    switch (from.flags >> kHexenActivationShift & 7) {
      case 0:
        line.player_cross = true;
        break;
      case 1:
        line.player_use = true;
        break;
      case 2:
        line.monster_cross = true;
        break;
      case 3:
        line.impact = true;
        break;
      case 4:
        line.player_push = true;
        break;
      case 5:
        line.missile_cross = true;
        break;
      case 6:
        line.player_use = line.pass_use = true;
        break;
      default:
        line.player_cross = line.missile_cross = true;
        break;
    }
    if (line.special == 0)
      line.player_cross = line.player_use = line.pass_use = line.monster_cross = line.impact = false;
    // These carry the line's own id among their arguments.
    switch (line.special) {
      case Special::kPolyobj_StartLine:
        line.id = line.args[3];
        break;
      case Special::kPolyobj_ExplicitLine:
        line.id = line.args[4];
        break;
      case Special::kLine_SetIdentification:  // which is nothing else
        line.id = line.args[0] + 256 * line.args[4];
        line.block_floaters = (line.args[1] & 2) != 0;
        line.special = 0;
        break;
      case Special::kTranslucentLine:
      case Special::kTeleport_Line:
      case Special::kScroll_Texture_Model:
        line.id = line.args[0];
        break;
      default:
        break;
    }
    map_.linedefs.push_back(std::move(line));
  }

  static void set_skills(UdmfThing& thing, uint16_t flags) {
    thing.skill = {(flags & kEasy) != 0,
                   (flags & kEasy) != 0,
                   (flags & kMedium) != 0,
                   (flags & kHard) != 0,
                   (flags & kHard) != 0,
                   false,
                   false,
                   false};
    thing.ambush = (flags & kAmbush) != 0;
  }

  void doom_thing(const ThingRecord& from, int index) {
    UdmfThing thing;
    thing.x = from.x, thing.y = from.y, thing.angle = from.angle, thing.type = from.type;
    set_skills(thing, from.flags);
    const bool extended = (from.flags & kReservedThingFlag) == 0;
    thing.single = (from.flags & kNotSingle) == 0;
    thing.coop = !extended || (from.flags & kNotCoop) == 0;
    thing.dm = !extended || (from.flags & kNotDeathmatch) == 0;
    thing.friendly = extended && (from.flags & kFriend) != 0;
    thing.text_line = index;
    map_.things.push_back(std::move(thing));
  }

  void hexen_thing(const HexenThingRecord& from, int index) {
    UdmfThing thing;
    thing.id = from.id;
    thing.x = from.x, thing.y = from.y, thing.height = from.height;
    thing.angle = from.angle, thing.type = from.type;
    thing.special = from.special;
    std::copy(from.args.begin(), from.args.end(), thing.args.begin());
    set_skills(thing, from.flags);
    thing.dormant = (from.flags & kHexenDormant) != 0;
    thing.single = (from.flags & kHexenSingle) != 0;
    thing.coop = (from.flags & kHexenCoop) != 0;
    thing.dm = (from.flags & kHexenDeathmatch) != 0;
    thing.translucent = (from.flags & kHexenShadow) != 0;
    thing.friendly = (from.flags & kHexenFriend) != 0;
    thing.standing = (from.flags & kHexenStanding) != 0;
    // Three classes; a map that names none means all, as one made for Doom's single class does.
    const uint32_t classes = from.flags >> kHexenClassShift & 7u;
    if (classes != 0) thing.class_filter = 0xFFF8u | classes;
    thing.text_line = index;
    map_.things.push_back(std::move(thing));
  }

  const WadFile& wad_;
  const MapLumps& lumps_;
  const std::string& label_;
  UdmfMap map_;
  int unknown_lines_ = 0, unknown_type_ = 0, unknown_line_ = 0;
  int untagged_lines_ = 0, untagged_line_ = 0;
};

}  // namespace

Expected<UdmfMap> read_binary_map(const WadFile& wad, const MapLumps& lumps, const std::string& label) {
  return Reader(wad, lumps, label).read();
}

}  // namespace comrad::wad
