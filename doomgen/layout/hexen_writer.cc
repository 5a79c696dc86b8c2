#include "doomgen/layout/hexen_writer.h"

#include <spdlog/fmt/fmt.h>

#include <bit>
#include <cstring>

#include "doomgen/wad/map_records.h"

namespace comrad::doomgen {
namespace {

static_assert(std::endian::native == std::endian::little, "records are written as they lie in memory");

constexpr int32_t kLineSetIdentification = 121;
// Flags of a line.
constexpr uint16_t kBlocking = 0x1, kBlockMonsters = 0x2, kTwoSided = 0x4, kUpperUnpegged = 0x8,
                   kLowerUnpegged = 0x10, kSecret = 0x20, kBlockSound = 0x40, kHidden = 0x80, kMapped = 0x100,
                   kRepeatable = 0x200, kBlockEverything = 0x8000;
constexpr int kActivationShift = 10;  // 0 crossed, 1 used, 3 shot, 4 pushed
// Flags of a thing: skills 1-2, 3, 4-5, ambush, dormant, the three classes, game modes.
constexpr uint16_t kEasy = 0x1, kNormal = 0x2, kHard = 0x4, kAmbush = 0x8, kDormant = 0x10, kClasses = 0xE0,
                   kSingle = 0x100, kCoop = 0x200, kDeathmatch = 0x400;

template <typename Record>
void put(std::string& out, const Record& record) {
  out.append(reinterpret_cast<const char*>(&record), sizeof(record));
}

wad::NameBytes name_bytes(const std::string& name) {
  wad::NameBytes bytes{};
  const std::string text = name.empty() ? "-" : name;
  std::memcpy(bytes.data(), text.data(), std::min(text.size(), bytes.size()));
  return bytes;
}

bool fits(int64_t value, int64_t low, int64_t high) { return value >= low && value <= high; }
bool fits_args(const std::array<int32_t, 5>& args) {
  for (const int32_t value : args)
    if (!fits(value, 0, 255)) return false;
  return true;
}
std::array<uint8_t, 5> args_of(const std::array<int32_t, 5>& args) {
  std::array<uint8_t, 5> bytes{};
  for (std::size_t i = 0; i < args.size(); ++i) bytes[i] = static_cast<uint8_t>(args[i]);
  return bytes;
}

Error unsupported(const std::string& what) {
  return Error{ErrorCode::kUnsupported, "Hexen format: " + what + "; write this map as UDMF"};
}

uint16_t flags_of(const LinedefData& line) {
  uint16_t flags = 0;
  const auto set = [&](bool value, uint16_t flag) { flags |= value ? flag : 0; };
  set(line.blocking, kBlocking), set(line.block_monsters, kBlockMonsters),
      set(line.back.has_value(), kTwoSided);
  set(line.upper_unpegged, kUpperUnpegged), set(line.lower_unpegged, kLowerUnpegged),
      set(line.secret, kSecret);
  set(line.block_sound, kBlockSound), set(line.hidden, kHidden), set(line.mapped, kMapped);
  set(line.repeatable, kRepeatable), set(line.block_everything, kBlockEverything);
  const int activation = line.player_use ? 1 : line.impact ? 3 : line.player_push ? 4 : 0;
  return static_cast<uint16_t>(flags | activation << kActivationShift);
}

}  // namespace

Expected<HexenLumps> write_hexen(const MapData& map) {
  HexenLumps lumps;
  constexpr std::size_t kMax = 65535;
  if (map.vertices.size() > kMax || map.linedefs.size() > kMax || map.sidedefs.size() >= kMax ||
      map.sectors.size() > kMax || map.things.size() > kMax)
    return unsupported("there are more than 65535 records of a kind");
  std::size_t extra_count = 0;
  for (const ThingData& thing : map.things) {
    const std::string name = fmt::format("the thing {} at {}", thing.editor_number, at(thing.position));
    if (!fits(thing.id, INT16_MIN, INT16_MAX) || !fits(thing.height, INT16_MIN, INT16_MAX) ||
        !fits(thing.angle_degrees, INT16_MIN, INT16_MAX) || !fits(thing.editor_number, 0, INT16_MAX) ||
        !fits(thing.special, 0, 255) || !fits_args(thing.args))
      return unsupported(name + " has a number that does not fit");
    uint16_t flags = kClasses;
    flags |= (thing.skills & 0b11) != 0 ? kEasy : 0;
    flags |= (thing.skills & 0b100) != 0 ? kNormal : 0;
    flags |= (thing.skills & 0b11000) != 0 ? kHard : 0;
    flags |= (thing.ambush ? kAmbush : 0) | (thing.dormant ? kDormant : 0);
    flags |= (thing.single ? kSingle : 0) | (thing.coop ? kCoop : 0) | (thing.deathmatch ? kDeathmatch : 0);
    extra_count += thing.extra.size();
    put(lumps.things,
        wad::HexenThingRecord{static_cast<int16_t>(thing.id), static_cast<int16_t>(thing.position.x),
                              static_cast<int16_t>(thing.position.y), static_cast<int16_t>(thing.height),
                              static_cast<int16_t>(thing.angle_degrees),
                              static_cast<int16_t>(thing.editor_number), flags,
                              static_cast<uint8_t>(thing.special), args_of(thing.args)});
  }
  for (const LinedefData& line : map.linedefs) {
    const std::string name = "the line " + at(map.vertices[line.start]) + "-" + at(map.vertices[line.end]);
    int32_t special = line.special;
    std::array<int32_t, 5> args = line.args;
    if (line.id != 0) {
      if (special != 0) return unsupported(name + " has both a special and an id");
      special = kLineSetIdentification;
      args = {line.id & 0xFF, 0, 0, 0, line.id >> 8};
    }
    if (!fits(special, 0, 255) || !fits_args(args))
      return unsupported(name + " has a number that does not fit");
    extra_count += line.extra.size();
    put(lumps.linedefs,
        wad::HexenLinedefRecord{static_cast<uint16_t>(line.start), static_cast<uint16_t>(line.end),
                                flags_of(line), static_cast<uint8_t>(special), args_of(args),
                                static_cast<uint16_t>(line.front),
                                line.back ? static_cast<uint16_t>(*line.back) : wad::kNoSidedef});
  }
  for (const SidedefData& side : map.sidedefs)
    put(lumps.sidedefs,
        wad::SidedefRecord{static_cast<int16_t>(side.offset_x), static_cast<int16_t>(side.offset_y),
                           name_bytes(side.top), name_bytes(side.bottom), name_bytes(side.middle),
                           static_cast<uint16_t>(side.sector)});
  for (const Point& vertex : map.vertices)
    put(lumps.vertexes, wad::VertexRecord{static_cast<int16_t>(vertex.x), static_cast<int16_t>(vertex.y)});
  for (uint32_t i = 0; i < map.sectors.size(); ++i) {
    const SectorData& sector = map.sectors[i];
    if (!fits(sector.floor_height, INT16_MIN, INT16_MAX) ||
        !fits(sector.ceiling_height, INT16_MIN, INT16_MAX) || !fits(sector.light, INT16_MIN, INT16_MAX) ||
        !fits(sector.special, 0, UINT16_MAX) || !fits(sector.tag, 0, UINT16_MAX))
      return unsupported(name_of(map, i) + " has a number that does not fit");
    extra_count += sector.extra.size();
    put(lumps.sectors,
        wad::SectorRecord{static_cast<int16_t>(sector.floor_height),
                          static_cast<int16_t>(sector.ceiling_height), name_bytes(sector.floor_texture),
                          name_bytes(sector.ceiling_texture), static_cast<int16_t>(sector.light),
                          static_cast<uint16_t>(sector.special), static_cast<uint16_t>(sector.tag)});
  }
  if (extra_count > 0)
    lumps.warnings.push_back(fmt::format(
        "Hexen format: {} further UDMF fields have no place in it and were left out", extra_count));
  return lumps;
}

}  // namespace comrad::doomgen
