// Every map of Freedoom 2, if it is installed: it loads, and the sector tree agrees with the nodes that the
// map's own builder made.
#include <gtest/gtest.h>

#include <array>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <string>
#include <vector>

#include "doomgen/wad/binary_map_reader.h"
#include "doomgen/wad/map_records.h"
#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/map/level_index.h"
#include "sim_workers/engine/map/level_loader.h"

namespace comrad::doom {
namespace freedoom_maps_test {

std::string iwad_path() {
  const char* given = std::getenv("COMRAD_IWAD");
  return given != nullptr ? given : "/usr/share/games/doom/freedoom2.wad";
}

template <typename Record>
std::vector<Record> records_of(const wad::WadFile& wad, const wad::MapLumps& lumps, std::string_view name) {
  for (std::size_t index = lumps.marker; index < lumps.end; ++index) {
    if (wad.lump(index).name != name) continue;
    const auto bytes = wad.bytes(index);
    std::vector<Record> records(bytes.size() / sizeof(Record));
    std::memcpy(records.data(), bytes.data(), records.size() * sizeof(Record));
    return records;
  }
  return {};
}

struct [[gnu::packed]] NodeRecord {
  int16_t x, y, dx, dy;
  std::array<int16_t, 8> boxes;
  std::array<uint16_t, 2> children;
};
struct [[gnu::packed]] SubsectorRecord {
  uint16_t seg_count, first_seg;
};
struct [[gnu::packed]] SegRecord {
  uint16_t start, end, angle, linedef, side, offset;
};

/// The sector at a point, by the map's nodes.
class Nodes {
 public:
  Nodes(const wad::WadFile& wad, const wad::MapLumps& lumps)
      : nodes_(records_of<NodeRecord>(wad, lumps, "NODES")),
        subsectors_(records_of<SubsectorRecord>(wad, lumps, "SSECTORS")),
        segs_(records_of<SegRecord>(wad, lumps, "SEGS")),
        linedefs_(records_of<wad::LinedefRecord>(wad, lumps, "LINEDEFS")),
        sidedefs_(records_of<wad::SidedefRecord>(wad, lumps, "SIDEDEFS")) {}

  bool usable() const { return !nodes_.empty() && !subsectors_.empty() && !segs_.empty(); }
  uint32_t sector_at(int x, int y) const {
    auto child = static_cast<uint16_t>(nodes_.size() - 1);
    while ((child & 0x8000) == 0) {
      const NodeRecord& node = nodes_[child];
      const int64_t cross = int64_t{node.dy} * (x - node.x) - int64_t{node.dx} * (y - node.y);
      child = node.children[cross > 0 ? 0 : 1];
    }
    const SegRecord& seg = segs_[subsectors_[child & 0x7FFF].first_seg];
    const wad::LinedefRecord& line = linedefs_[seg.linedef];
    return sidedefs_[seg.side == 0 ? line.front : line.back].sector;
  }

 private:
  std::vector<NodeRecord> nodes_;
  std::vector<SubsectorRecord> subsectors_;
  std::vector<SegRecord> segs_;
  std::vector<wad::LinedefRecord> linedefs_;
  std::vector<wad::SidedefRecord> sidedefs_;
};

bool near_a_line(const Level& level, Fixed x, Fixed y) {
  bool near = false;
  const Box box = Box::around(x, y, to_fixed(2));
  level.index->blockmap.for_each_line(box, [&](const BlockLine& line) {
    near = near || line.crosses(box);
    return !near;
  });
  return near;
}

TEST(FreedoomMaps, All32LoadAndTheirSectorsAreFound) {
  const std::string path = iwad_path();
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not installed (Debian: freedoom)";
  const wad::WadFile wad = wad::WadFile::open(path).value();
  Rng rng(uint64_t{32});
  int points = 0, wrong = 0, compared_maps = 0;
  for (int number = 1; number <= 32; ++number) {
    const std::string name = (number < 10 ? "MAP0" : "MAP") + std::to_string(number);
    SCOPED_TRACE(name);
    const auto loaded = load_level(wad, name);
    ASSERT_TRUE(loaded) << loaded.error().message;
    const Level& level = **loaded;
    EXPECT_EQ(level.format, MapFormat::kDoom);
    EXPECT_GT(level.things.size(), 10u);
    for (const std::string& warning : level.warnings) std::printf("%s: %s\n", name.c_str(), warning.c_str());
    const Nodes nodes(wad, wad.find_map(name).value());
    if (!nodes.usable()) continue;
    ++compared_maps;
    int here = 0, wrong_here = 0;
    for (int i = 0; i < 4000; ++i) {
      const Vertex& near = level.vertices[rng.below(static_cast<uint32_t>(level.vertices.size()))];
      const int x = (near.x >> kFracBits) + rng.between(-256, 256);
      const int y = (near.y >> kFracBits) + rng.between(-256, 256);
      const Fixed fixed_x = to_fixed(x), fixed_y = to_fixed(y);
      if (!level.index->outline.contains(fixed_x, fixed_y) || near_a_line(level, fixed_x, fixed_y)) continue;
      ++here;
      wrong_here += level.index->sectors.sector_at(fixed_x, fixed_y) != nodes.sector_at(x, y);
    }
    // Unclosed sectors and tricks with self-referencing lines leave room for opinion.
    EXPECT_LE(wrong_here, here / 50) << wrong_here << " of " << here << " points";
    points += here, wrong += wrong_here;
  }
  std::printf("%d points in %d maps, %d in another sector than by the map's nodes\n", points, compared_maps,
              wrong);
  EXPECT_GT(points, 20000);
  EXPECT_LE(wrong, points / 500);
}

}  // namespace freedoom_maps_test
}  // namespace comrad::doom
