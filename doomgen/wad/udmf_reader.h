// Reads a TEXTMAP lump, the Universal Doom Map Format, into plain records: what the text says, unchecked
// against itself. The engine's loader (engine/map/level_loader.h) checks indices and makes a Level.
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::wad {

struct UdmfVertex {
  double x = 0, y = 0;
  int text_line = 0;  ///< of TEXTMAP where its block begins, for messages; the same below
};

struct UdmfLinedef {
  int32_t id = 0, v1 = -1, v2 = -1, side_front = -1, side_back = -1;
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  bool blocking = false, block_monsters = false, two_sided = false, dont_peg_top = false,
       dont_peg_bottom = false;
  bool block_everything = false;
  int text_line = 0;
};

struct UdmfSidedef {
  int32_t offset_x = 0, offset_y = 0, sector = -1;
  std::string texture_top = "-", texture_bottom = "-", texture_middle = "-";
  int text_line = 0;
};

struct UdmfSector {
  double height_floor = 0, height_ceiling = 0;
  std::string texture_floor, texture_ceiling;
  int32_t light_level = 160, special = 0, id = 0;
  int32_t damage_amount = 0, damage_interval = 0;
  int text_line = 0;
};

struct UdmfThing {
  double x = 0, y = 0, height = 0;
  int32_t id = 0, angle = 0, type = 0, special = 0;
  std::array<int32_t, 5> args{};
  std::array<bool, 5> skill{};  ///< [skill - 1]
  bool single = false, coop = false, dm = false, ambush = false, dormant = false;
  int text_line = 0;
};

struct UdmfMap {
  std::string name_space;  ///< "zdoom", "doom", ...
  std::vector<UdmfVertex> vertices;
  std::vector<UdmfLinedef> linedefs;
  std::vector<UdmfSidedef> sidedefs;
  std::vector<UdmfSector> sectors;
  std::vector<UdmfThing> things;
};

/// Parses `text`. `label` names the lump in messages ("arena.wad: TEXTMAP of MAP01"). Unknown keys and blocks
/// are skipped, as the format asks; keys are read in any case; texture names come out in upper case. Errors:
/// kBadFormat as "label:line:column: what".
Expected<UdmfMap> parse_udmf(std::string_view text, const std::string& label);

}  // namespace comrad::wad
