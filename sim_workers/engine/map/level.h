// A map in play: checked indices, Fixed units, optional sides. One loader (level_loader.h) makes it from the
// bytes of a lump; the world (play/) moves its heights, the renderer (render/) draws it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "sim_workers/engine/fixed.h"

namespace comrad::doom {

struct Vertex {
  Fixed x = 0, y = 0;
};

/// One side of a linedef: three textures by name (upper case, "-" for none) and their offsets in map units.
struct Sidedef {
  std::string top, bottom, middle;
  int32_t offset_x = 0, offset_y = 0;
  uint32_t sector_index = 0;
};

enum LinedefFlag : uint32_t {
  kLineBlocking = 1u << 0,
  kLineBlockMonsters = 1u << 1,
  kLineTwoSided = 1u << 2,
  kLineUpperUnpegged = 1u << 3,
  kLineLowerUnpegged = 1u << 4,
  kLineBlockEverything = 1u << 5,
};

/// A wall from start to end; the front side lies to its right.
struct Linedef {
  uint32_t start = 0, end = 0;  ///< vertex indices
  uint32_t flags = 0;           ///< LinedefFlag bits
  int32_t special = 0;          ///< Hexen numbering; 0 none
  std::array<int32_t, 5> args{};
  int32_t id = 0;
  uint32_t front = 0;            ///< sidedef index
  std::optional<uint32_t> back;  ///< sidedef index; nothing where one-sided
};

struct Sector {
  Fixed floor_height = 0, ceiling_height = 0;
  std::string floor_texture, ceiling_texture;
  int32_t light = 160;  ///< 0..255
  int32_t special = 0;
  int32_t tag = 0;
  int32_t damage_amount = 0;    ///< damage to a player on its floor; set by map or script (SetSectorDamage)
  int32_t damage_interval = 0;  ///< tics between hits; see world.h for the clock rule
};

enum ThingFlag : uint32_t {
  kThingSkill1 = 1u << 0,  ///< skill n: kThingSkill1 << (n - 1), n = 1..5
  kThingSingle = 1u << 5,
  kThingCoop = 1u << 6,
  kThingDeathmatch = 1u << 7,
  kThingAmbush = 1u << 8,
  kThingDormant = 1u << 9,
};

/// A THINGS entry: where the map wants something, before it lives.
struct MapThing {
  int32_t id = 0;
  Fixed x = 0, y = 0, height = 0;  ///< height above the floor
  int32_t angle_degrees = 0;
  int32_t editor_number = 0;
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  uint32_t flags = 0;  ///< ThingFlag bits
};

struct LevelIndex;

/// A loaded map. Immutable apart from the sectors, which each World copies.
struct Level {
  std::string name;
  std::vector<Vertex> vertices;
  std::vector<Linedef> linedefs;
  std::vector<Sidedef> sidedefs;
  std::vector<Sector> sectors;
  std::vector<MapThing> things;
  std::vector<std::vector<uint32_t>> sector_linedefs;  ///< [sector] linedefs that touch it
  std::shared_ptr<const LevelIndex> index;             ///< collision grid and sector tree, made by the loader
};

}  // namespace comrad::doom
