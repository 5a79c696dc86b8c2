// Reads a TEXTMAP lump, the Universal Doom Map Format, into plain records: what the text contains, unchecked
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
  bool has_height = false;  ///< zfloor or zceiling: a slope
  int text_line = 0;        ///< of TEXTMAP where its block begins, for messages; the same below
};

struct UdmfLinedef {
  int32_t id = 0, v1 = -1, v2 = -1, side_front = -1, side_back = -1;
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  bool blocking = false, block_monsters = false, two_sided = false, dont_peg_top = false,
       dont_peg_bottom = false;
  bool block_everything = false, block_floaters = false, block_players = false, block_projectiles = false,
       block_hitscan = false, block_use = false, block_sight = false, block_sound = false, jump_over = false;
  bool secret = false, repeat_special = false, first_side_only = false, pass_use = false,
       check_switch_range = false;
  // What activates its special.
  bool player_cross = false, player_use = false, player_push = false, player_use_back = false,
       monster_cross = false, monster_use = false, monster_push = false, monster_activate = false,
       impact = false, missile_cross = false, any_cross = false;
  bool translucent = false, transparent = false, wrap_midtex = false, clip_midtex = false, midtex_3d = false;
  double alpha = 1;
  std::string render_style, arg0_text;
  int32_t lock_number = 0;
  int text_line = 0;
};

struct UdmfSidedef {
  int32_t offset_x = 0, offset_y = 0, sector = -1;
  std::string texture_top = "-", texture_bottom = "-", texture_middle = "-";
  struct Part {
    double offset_x = 0, offset_y = 0, scale_x = 1, scale_y = 1;
  };
  std::array<Part, 3> parts{};  ///< top, middle, bottom
  int32_t light = 0;
  bool light_absolute = false, no_fake_contrast = false, smooth_lighting = false, wrap_midtex = false,
       clip_midtex = false;
  int text_line = 0;
};

struct UdmfSector {
  double height_floor = 0, height_ceiling = 0;
  std::string texture_floor, texture_ceiling;
  int32_t light_level = 160, special = 0, id = 0;
  int32_t damage_amount = 0, damage_interval = 0, leakiness = 0;
  std::string damage_type;
  struct Plane {
    double panning_x = 0, panning_y = 0, scale_x = 1, scale_y = 1, rotation = 0;
    int32_t light = 0;
    bool light_absolute = false;
  };
  Plane floor, ceiling;
  double gravity = 1;
  int32_t light_color = 0xFFFFFF, fade_color = 0;
  bool silent = false, hidden = false, no_falling_damage = false, secret = false;
  bool is_sloped = false;  ///< has a plane equation
  std::string more_ids;
  int text_line = 0;
};

struct UdmfThing {
  double x = 0, y = 0, height = 0;
  int32_t id = 0, angle = 0, type = 0, special = 0;
  std::array<int32_t, 5> args{};
  std::array<bool, 8> skill{};     ///< [skill - 1]
  uint32_t class_filter = 0xFFFF;  ///< bit n: player class n + 1
  bool single = false, coop = false, dm = false, ambush = false, dormant = false;
  bool standing = false, friendly = false, invisible = false, translucent = false, count_secret = false;
  int32_t pitch = 0, score = 0;
  std::string arg0_text;
  double alpha = -1, scale_x = 1, scale_y = 1, gravity = 1;
  int32_t health = 1;  ///< times the type's; below 0: minus that many points; 0: it is dead
  int text_line = 0;
};

/// A map in UDMF's terms, with ZDoom's numbers of specials where the namespace is "zdoom"; binary maps take
/// this form too (binary_map_reader.h).
struct UdmfMap {
  std::string name_space;  ///< "zdoom", "doom", ...
  bool is_binary = false;  ///< from binary lumps: text_line is the record's index in its lump, and flaws of
                           ///< the map that other engines live with are put right instead of refused
  std::vector<std::string> warnings;
  std::vector<UdmfVertex> vertices;
  std::vector<UdmfLinedef> linedefs;
  std::vector<UdmfSidedef> sidedefs;
  std::vector<UdmfSector> sectors;
  std::vector<UdmfThing> things;
};

/// Parses `text`. `label` names the lump in messages ("arena.wad: TEXTMAP of MAP01"). Unknown keys and blocks
/// are skipped, as the format requires; keys are read in any case; texture names come out in upper case. Errors:
/// kBadFormat as "label:line:column: what".
Expected<UdmfMap> parse_udmf(std::string_view text, const std::string& label);

}  // namespace comrad::wad
