// Makes the bytes of a WAD in memory, good or bent, for tests of readers.
#pragma once

#include <cstdint>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "doomgen/wad/map_records.h"

namespace comrad::wad::test {

struct WadBytes {
  std::string magic = "PWAD";
  std::vector<std::pair<std::string, std::string>> lumps;

  WadBytes& add(std::string name, std::string bytes = {}) {
    lumps.emplace_back(std::move(name), std::move(bytes));
    return *this;
  }
  std::vector<uint8_t> build() const {
    std::vector<uint8_t> file(sizeof(WadHeaderRecord));
    std::vector<DirectoryRecord> directory;
    for (const auto& [name, bytes] : lumps) {
      DirectoryRecord record{};
      record.offset_bytes = static_cast<int32_t>(file.size());
      record.size_bytes = static_cast<int32_t>(bytes.size());
      std::memcpy(record.name.data(), name.data(), std::min(name.size(), record.name.size()));
      directory.push_back(record);
      file.insert(file.end(), bytes.begin(), bytes.end());
    }
    WadHeaderRecord header{};
    std::memcpy(header.magic.data(), magic.data(), 4);
    header.lump_count = static_cast<int32_t>(lumps.size());
    header.directory_offset_bytes = static_cast<int32_t>(file.size());
    std::memcpy(file.data(), &header, sizeof(header));
    for (const DirectoryRecord& record : directory) {
      const auto* bytes = reinterpret_cast<const uint8_t*>(&record);
      file.insert(file.end(), bytes, bytes + sizeof(record));
    }
    return file;
  }
};

/// A square room as TEXTMAP, one start and one Stimpack in it.
inline std::string square_room_text() {
  return R"(namespace = "zdoom";
thing { x = 0.0; y = 0.0; angle = 90; type = 1; skill3 = true; coop = true; single = true; }
thing { x = 64.5; y = -32.25; type = 2011; id = 7; skill3 = true; coop = true; single = true; }
vertex { x = -256.0; y = -256.0; }
vertex { x = -256.0; y = 256.0; }
vertex { x = 256.0; y = 256.0; }
vertex { x = 256.0; y = -256.0; }
linedef { v1 = 0; v2 = 1; sidefront = 0; blocking = true; }
linedef { v1 = 1; v2 = 2; sidefront = 1; blocking = true; }
linedef { v1 = 2; v2 = 3; sidefront = 2; blocking = true; }
linedef { v1 = 3; v2 = 0; sidefront = 3; blocking = true; }
sidedef { sector = 0; texturemiddle = "brick6"; }
sidedef { sector = 0; texturemiddle = "brick6"; }
sidedef { sector = 0; texturemiddle = "brick6"; offsetx = 16; }
sidedef { sector = 0; texturemiddle = "brick6"; }
sector { texturefloor = "flat1"; textureceiling = "CEIL1_2"; heightceiling = 128; lightlevel = 200; id = 900; }
)";
}

}  // namespace comrad::wad::test
