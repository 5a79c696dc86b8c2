// A finished map as plain records in whole units: what the builder makes and the writers print. The engine
// has its own Level (sim_workers/engine/map/level.h); between the two lie only the bytes of the WAD.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "doomgen/layout/geometry.h"

namespace comrad::doomgen {

/// One side of a linedef; empty texture names mean none.
struct SidedefData {
  uint32_t sector = 0;
  std::string top = {}, middle = {}, bottom = {};
};

/// A wall or an opening; its front side lies to the right of start -> end.
struct LinedefData {
  uint32_t start = 0, end = 0;  ///< vertex indices
  uint32_t front = 0;           ///< sidedef index
  std::optional<uint32_t> back = {};
  bool blocking = false;
  int32_t id = 0, special = 0;
  std::array<int32_t, 5> args{};
};

struct SectorData {
  int32_t floor_height = 0, ceiling_height = 128;
  std::string floor_texture = "FLOOR4_8", ceiling_texture = "CEIL3_5";
  int32_t light = 160;
  int32_t special = 0, tag = 0;
};

/// A thing the map wants; present on every skill and in every game mode.
struct ThingData {
  Point position = {};
  int32_t height = 0;  ///< above the floor
  int32_t angle_degrees = 0;
  int32_t editor_number = 0;
  int32_t id = 0, special = 0;
  std::array<int32_t, 5> args{};
};

struct MapData {
  std::vector<Point> vertices;
  std::vector<LinedefData> linedefs;
  std::vector<SidedefData> sidedefs;
  std::vector<SectorData> sectors;
  std::vector<ThingData> things;
};

}  // namespace comrad::doomgen
