// Small levels for tests, made by hand: rooms with straight walls, pillars, raised floors, players' starts.
#pragma once

#include <memory>
#include <utility>
#include <vector>

#include "sim_workers/engine/map/level_loader.h"

namespace comrad::doom::test {

class LevelBuilder {
 public:
  using Points = std::vector<std::pair<int, int>>;

  uint32_t sector(int floor_height, int ceiling_height, int tag = 0) {
    Sector sector;
    sector.floor_height = to_fixed(floor_height), sector.ceiling_height = to_fixed(ceiling_height);
    sector.floor_texture = "FLOOR4_8", sector.ceiling_texture = "CEIL3_5";
    sector.tag = tag;
    level_.sectors.push_back(sector);
    return static_cast<uint32_t>(level_.sectors.size() - 1);
  }
  Sector& sector_at(uint32_t index) { return level_.sectors[index]; }

  /// Walls round `sector`; corners clockwise, so that the inside lies to the right.
  LevelBuilder& room(uint32_t sector, const Points& clockwise) {
    ring(clockwise, sector, std::nullopt, 0);
    return *this;
  }
  LevelBuilder& room(uint32_t sector, int left, int bottom, int right, int top) {
    return room(sector, {{left, bottom}, {left, top}, {right, top}, {right, bottom}});
  }
  /// A solid block inside `sector`.
  LevelBuilder& pillar(uint32_t sector, int left, int bottom, int right, int top) {
    ring({{left, bottom}, {right, bottom}, {right, top}, {left, top}}, sector, std::nullopt, 0);
    return *this;
  }
  /// An area of sector `inner` inside sector `outer`, with two-sided lines between them.
  LevelBuilder& island(uint32_t inner, uint32_t outer, int left, int bottom, int right, int top,
                       uint32_t line_flags = 0) {
    ring({{left, bottom}, {left, top}, {right, top}, {right, bottom}}, inner, outer, line_flags);
    return *this;
  }
  /// The same with any outline; the front sector lies to the right of its lines.
  LevelBuilder& island(const Points& points, uint32_t front_sector, uint32_t back_sector) {
    ring(points, front_sector, back_sector, 0);
    return *this;
  }
  /// Areas side by side from west to east inside sector `outer`; the line between two has its front to
  /// the west.
  LevelBuilder& row(uint32_t outer, const std::vector<uint32_t>& sectors, int left, int bottom, int width,
                    int height) {
    const auto first = static_cast<uint32_t>(level_.vertices.size());  // pairs, bottom and top
    const auto count = static_cast<uint32_t>(sectors.size());
    for (uint32_t i = 0; i <= count; ++i) {
      const int x = left + static_cast<int>(i) * width;
      level_.vertices.push_back({to_fixed(x), to_fixed(bottom)});
      level_.vertices.push_back({to_fixed(x), to_fixed(bottom + height)});
    }
    for (uint32_t i = 0; i < count; ++i) {
      two_sided(first + 2 * i + 1, first + 2 * i + 3, sectors[i], outer);
      two_sided(first + 2 * i + 2, first + 2 * i, sectors[i], outer);
    }
    two_sided(first, first + 1, sectors[0], outer);
    for (uint32_t i = 1; i < count; ++i)
      two_sided(first + 2 * i + 1, first + 2 * i, sectors[i - 1], sectors[i]);
    two_sided(first + 2 * count + 1, first + 2 * count, sectors[count - 1], outer);
    return *this;
  }
  /// Linedefs count in the order in which they were made, four to a box.
  Linedef& line(uint32_t index) { return level_.linedefs[index]; }
  LevelBuilder& thing(int editor_number, int x, int y, int angle_degrees = 0, int id = 0,
                      MapThing thing = {}) {
    thing.editor_number = editor_number;
    thing.x = to_fixed(x), thing.y = to_fixed(y);
    thing.angle_degrees = angle_degrees;
    thing.id = id;
    thing.flags |= kThingSkill1 * 31 | kThingSingle | kThingCoop | kThingDeathmatch;
    level_.things.push_back(thing);
    return *this;
  }
  std::shared_ptr<const Level> build() {
    complete_level(level_);
    return std::make_shared<const Level>(level_);
  }

 private:
  void ring(const Points& points, uint32_t front_sector, std::optional<uint32_t> back_sector,
            uint32_t flags) {
    const auto first = static_cast<uint32_t>(level_.vertices.size());
    const auto count = static_cast<uint32_t>(points.size());
    for (const auto& [x, y] : points) level_.vertices.push_back({to_fixed(x), to_fixed(y)});
    for (uint32_t i = 0; i < count; ++i) {
      Linedef line;
      line.start = first + i, line.end = first + (i + 1) % count;
      line.flags = flags | (back_sector ? kLineTwoSided : kLineBlocking);
      line.front = side(front_sector);
      if (back_sector) line.back = side(*back_sector);
      level_.linedefs.push_back(line);
    }
  }
  void two_sided(uint32_t start, uint32_t end, uint32_t front_sector, uint32_t back_sector) {
    Linedef line;
    line.start = start, line.end = end;
    line.flags = kLineTwoSided;
    line.front = side(front_sector), line.back = side(back_sector);
    level_.linedefs.push_back(line);
  }
  uint32_t side(uint32_t sector) {
    level_.sidedefs.push_back({"-", "-", "BRICK6", 0, 0, sector});
    return static_cast<uint32_t>(level_.sidedefs.size() - 1);
  }

  Level level_;
};

/// One square room of 1024 units with two players' starts near its middle.
inline std::shared_ptr<const Level> one_room() {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 256, 900);
  builder.room(room, -512, -512, 512, 512).thing(1, -128, 0).thing(2, 128, 0, 180);
  return builder.build();
}

}  // namespace comrad::doom::test
