// A finished map as plain records in whole units: what the builders make and the writers print. The engine
// has its own Level (sim_workers/engine/map/level.h); between the two lie only the bytes of the WAD.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "doomgen/layout/geometry.h"

namespace comrad::doomgen {

/// Further UDMF fields of a record, as name and literal: {"lightcolor", "0xFF0000"}, {"midtex3d", "true"},
/// {"comment", "\"text\""}. The Hexen format has no place for them (its writer warns).
using ExtraFields = std::vector<std::pair<std::string, std::string>>;

/// What a line does and bars.
struct LineSpec {
  int32_t special = 0, id = 0;
  std::array<int32_t, 5> args{};
  bool blocking = false;        ///< players and monsters
  bool block_monsters = false;  ///< monsters alone
  bool block_everything = false;
  bool upper_unpegged = false, lower_unpegged = false;
  bool secret = false, block_sound = false, hidden = false, mapped = false;
  bool repeatable = false;  ///< the special may be set off again
  /// What activates the special; all false: only scripts do.
  bool player_use = false, player_cross = false, player_push = false, impact = false;
  ExtraFields extra = {};

  friend bool operator==(const LineSpec&, const LineSpec&) = default;
};

/// One side of a linedef; empty texture names mean none.
struct SidedefData {
  uint32_t sector = 0;
  std::string top = {}, middle = {}, bottom = {};
  int32_t offset_x = 0, offset_y = 0;
};

/// A wall or an opening; its front side lies to the right of start -> end.
struct LinedefData : LineSpec {
  uint32_t start = 0, end = 0;  ///< vertex indices
  uint32_t front = 0;           ///< sidedef index
  std::optional<uint32_t> back = {};
};

struct SectorData {
  int32_t floor_height = 0, ceiling_height = 128;
  std::string floor_texture = "FLOOR4_8", ceiling_texture = "CEIL3_5";
  int32_t light = 160;
  int32_t special = 0, tag = 0;
  std::string name = {};  ///< for messages; not written
  ExtraFields extra = {};
};

/// A thing the map requires; present on every skill and in every game mode unless its flags differ.
struct ThingData {
  Point position = {};
  int32_t height = 0;  ///< above the floor
  int32_t angle_degrees = 0;
  int32_t editor_number = 0;
  int32_t id = 0, special = 0;
  std::array<int32_t, 5> args{};
  uint8_t skills = 0b11111;  ///< bit n: skill n + 1
  bool single = true, coop = true, deathmatch = true;
  bool ambush = false, dormant = false;
  ExtraFields extra = {};
};

struct MapData {
  std::vector<Point> vertices;
  std::vector<LinedefData> linedefs;
  std::vector<SidedefData> sidedefs;
  std::vector<SectorData> sectors;
  std::vector<ThingData> things;
};

/// "(x, y)", for messages.
inline std::string at(Point p) { return "(" + std::to_string(p.x) + ", " + std::to_string(p.y) + ")"; }

/// "area 'hall'", or "sector 3" where it has no name.
inline std::string name_of(const MapData& map, uint32_t sector) {
  const std::string& name = map.sectors[sector].name;
  return name.empty() ? "sector " + std::to_string(sector) : "area '" + name + "'";
}

}  // namespace comrad::doomgen
