// The lumps of a small map in the binary formats of Doom and Hexen, good until a test bends them: a square
// room of 512 units with a smaller square of sector 1 in its middle.
#pragma once

#include <cstring>
#include <string>
#include <string_view>
#include <vector>

#include "doomgen/wad/map_records.h"
#include "tests/support/wad_bytes.h"

namespace comrad::wad::test {

inline NameBytes name_bytes(std::string_view name) {
  NameBytes bytes{};
  std::memcpy(bytes.data(), name.data(), std::min(name.size(), bytes.size()));
  return bytes;
}

template <typename Record>
std::string bytes_of(const std::vector<Record>& records) {
  std::string bytes(records.size() * sizeof(Record), '\0');
  if (!records.empty()) std::memcpy(bytes.data(), records.data(), bytes.size());
  return bytes;
}

struct BinaryMapBytes {
  std::vector<VertexRecord> vertices = {{-256, -256}, {-256, 256}, {256, 256}, {256, -256},
                                        {-64, -64},   {-64, 64},   {64, 64},   {64, -64}};
  std::vector<SectorRecord> sectors = {{0, 128, name_bytes("floor4_8"), name_bytes("CEIL3_5"), 160, 0, 0},
                                       {16, 128, name_bytes("NUKAGE1"), name_bytes("F_SKY1"), 255, 9, 7}};
  std::vector<SidedefRecord> sidedefs;
  std::vector<LinedefRecord> linedefs;
  std::vector<HexenLinedefRecord> hexen_linedefs;
  std::vector<ThingRecord> things = {{-128, 0, 90, 1, 7}, {128, 0, 180, 3001, 6 | 8 | 16}};
  std::vector<HexenThingRecord> hexen_things = {{0, -128, 0, 0, 90, 1, 0x7E7, 0, {}},
                                                {12, 128, 0, 24, 0, 3001, 0x704 | 16, 80, {3, 0, 1, 2, 3}}};

  BinaryMapBytes() {
    // The outer four one-sided; the inner four show their front to the inner sector.
    for (uint16_t i = 0; i < 8; ++i) {
      const bool inner = i >= 4;
      const auto end = static_cast<uint16_t>((i + 1) % 4 + (inner ? 4 : 0));
      const uint16_t front = side(inner ? 1 : 0);
      const uint16_t back = inner ? side(0) : kNoSidedef;
      const uint16_t flags = inner ? 4 : 1;
      linedefs.push_back({i, end, flags, 0, 0, front, back});
      hexen_linedefs.push_back({i, end, flags, 0, {}, front, back});
    }
  }
  uint16_t side(uint16_t sector) {
    sidedefs.push_back({0, 0, name_bytes("-"), name_bytes("STEP1"), name_bytes("sw1brn1"), sector});
    return static_cast<uint16_t>(sidedefs.size() - 1);
  }
  WadBytes doom() const {
    return add_rest(
        WadBytes().add("MAP01").add("THINGS", bytes_of(things)).add("LINEDEFS", bytes_of(linedefs)));
  }
  WadBytes hexen() const {
    return add_rest(WadBytes()
                        .add("MAP01")
                        .add("THINGS", bytes_of(hexen_things))
                        .add("LINEDEFS", bytes_of(hexen_linedefs)))
        .add("BEHAVIOR", "ACS first")
        .add("SCRIPTS", "script 1 OPEN {}")
        .add("BEHAVIOR", "ACS last");
  }

 private:
  WadBytes add_rest(WadBytes bytes) const {
    return bytes.add("SIDEDEFS", bytes_of(sidedefs))
        .add("VERTEXES", bytes_of(vertices))
        .add("SECTORS", bytes_of(sectors));
  }
};

}  // namespace comrad::wad::test
