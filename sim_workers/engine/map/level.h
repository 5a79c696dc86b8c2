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

/// How one part of a side (top, middle, bottom) is laid on: offsets on top of the side's own, and a scale.
struct SidePart {
  Fixed offset_x = 0, offset_y = 0;
  float scale_x = 1.0f, scale_y = 1.0f;
};

enum SidedefFlag : uint32_t {
  kSideLightAbsolute = 1u << 0,  ///< `light` is no difference from its sector's
  kSideNoFakeContrast = 1u << 1,
  kSideSmoothLighting = 1u << 2,
  kSideClipMiddle = 1u << 3,  ///< the middle texture ends at floor and ceiling
  kSideWrapMiddle = 1u << 4,  ///< the middle texture repeats upwards
};

/// One side of a linedef: three textures by name (upper case, "-" for none) and their offsets in map units.
struct Sidedef {
  std::string top, bottom, middle;
  int32_t offset_x = 0, offset_y = 0;
  uint32_t sector_index = 0;
  std::array<SidePart, 3> parts{};  ///< [SideTexture]
  int32_t light = 0;                ///< added to the sector's
  uint32_t flags = 0;               ///< SidedefFlag bits
};

/// Parts of a side as scripts count them.
enum SideTexture : int32_t { kSideTop = 0, kSideMiddle = 1, kSideBottom = 2 };

/// What a line stops, how it looks, and how its special is activated.
enum LinedefFlag : uint32_t {
  kLineBlocking = 1u << 0,
  kLineBlockMonsters = 1u << 1,
  kLineTwoSided = 1u << 2,
  kLineUpperUnpegged = 1u << 3,
  kLineLowerUnpegged = 1u << 4,
  kLineBlockEverything = 1u << 5,
  kLineSoundBlock = 1u << 6,
  kLineSecret = 1u << 7,      ///< monsters do not open it
  kLineRepeatable = 1u << 8,  ///< its special works more than once
  // Who activates it, and how. See Activation in specials/line_specials.h.
  kLinePlayerCross = 1u << 9,
  kLinePlayerUse = 1u << 10,
  kLinePlayerPush = 1u << 11,  ///< a player runs into it
  kLineImpact = 1u << 12,      ///< a missile or a shot hits it
  kLineMonsterCross = 1u << 13,
  kLineMonsterUse = 1u << 14,
  kLineMonsterPush = 1u << 15,
  kLineMissileCross = 1u << 16,
  kLineAnyCross = 1u << 17,         ///< whatever crosses
  kLinePlayerUseBack = 1u << 18,    ///< a player uses it from behind
  kLinePassUse = 1u << 19,          ///< a use continues to what lies behind it
  kLineFirstSideOnly = 1u << 20,    ///< only from the front
  kLineMonsterActivate = 1u << 21,  ///< monsters too, wherever players may
  kLineRailing = 1u << 22,          ///< a wall 32 units high that can be jumped over
  kLineBlockPlayers = 1u << 23,
  kLineBlockProjectiles = 1u << 24,
  kLineBlockHitscan = 1u << 25,
  kLineBlockUse = 1u << 26,
  kLineBlockSight = 1u << 27,
  kLineWrapMidtex = 1u << 28,
  kLineClipMidtex = 1u << 29,
  kLineBlockFloaters = 1u << 30,
  kLineCheckSwitchRange = 1u << 31,
};

/// Every way to activate a line.
constexpr uint32_t kLineActivations = kLinePlayerCross | kLinePlayerUse | kLinePlayerPush | kLineImpact |
                                      kLineMonsterCross | kLineMonsterUse | kLineMonsterPush |
                                      kLineMissileCross | kLineAnyCross | kLinePlayerUseBack;

/// A wall from start to end; the front side lies to its right.
struct Linedef {
  uint32_t start = 0, end = 0;  ///< vertex indices
  uint32_t flags = 0;           ///< LinedefFlag bits
  int32_t special = 0;          ///< Hexen numbering; 0 none
  std::array<int32_t, 5> args{};
  int32_t id = 0;
  uint32_t front = 0;            ///< sidedef index
  std::optional<uint32_t> back;  ///< sidedef index; nothing where one-sided
  float alpha = 1.0f;            ///< of its middle textures
  bool additive = false;
  int32_t lock_number = 0;  ///< key it requires, as in Door_LockedRaise; 0 none
  std::string arg0_text;    ///< name of a script, instead of args[0]
  bool in_polyobject =
      false;  ///< moves with a polyobject: no wall where it was drawn; set by complete_level()
};

/// How a flat is laid on a floor or a ceiling.
struct FlatPlacement {
  Fixed offset_x = 0, offset_y = 0;
  float scale_x = 1.0f, scale_y = 1.0f;
  float rotation_degrees = 0.0f;
  int32_t light = 0;  ///< added to the sector's, or instead of it
  bool light_absolute = false;
};

constexpr Fixed kSectorFriction = 0xE800;  ///< of plain ground: factor per tic, 0.90625
constexpr int32_t kSectorMoveFactor = 2048;
constexpr Fixed kAirControl = 256;           ///< of that, what players have in the air
constexpr int32_t kDamageIntervalTics = 32;  ///< where a map's sector hurts and does not say how often

struct Sector {
  Fixed floor_height = 0, ceiling_height = 0;
  std::string floor_texture, ceiling_texture;
  int32_t light = 160;  ///< 0..255
  int32_t special = 0;  ///< ZDoom's numbering; its secret bit is in `secret`
  int32_t tag = 0;
  int32_t damage_amount = 0;    ///< damage to a player on its floor; set by map or script (SetSectorDamage)
  int32_t damage_interval = 0;  ///< tics between hits; 0: by the amount; see world.h for the clock rule
  int32_t damage_leak = 0;      ///< of 256: chance that a radiation suit does not help
  uint8_t damage_type = 0;      ///< a DamageType
  bool secret = false;          ///< finding it counts
  Fixed gravity = kFracUnit;    ///< times the world's
  Fixed friction = kSectorFriction;         ///< of bodies on its floor, where `special_friction`
  int32_t move_factor = kSectorMoveFactor;  ///< of what pushes bodies on its floor, where `special_friction`
  bool special_friction = false;            ///< ice or mud
  bool silent = false, hidden = false, no_falling_damage = false;
  uint32_t light_color = 0xFFFFFF, fade_color = 0;  ///< 0xRRGGBB
  FlatPlacement floor_placement, ceiling_placement;
};

enum ThingFlag : uint32_t {
  kThingSkill1 = 1u << 0,  ///< skill n: kThingSkill1 << (n - 1), n = 1..5; see thing_skill_flag()
  kThingSingle = 1u << 5,
  kThingCoop = 1u << 6,
  kThingDeathmatch = 1u << 7,
  kThingAmbush = 1u << 8,
  kThingDormant = 1u << 9,
  kThingSkill6 = 1u << 10,  ///< to skill 8, which is 1 << 12
  kThingStanding = 1u << 13,
  kThingFriend = 1u << 14,
  kThingInvisible = 1u << 15,
  kThingShadow = 1u << 16,
  kThingCountSecret = 1u << 17,
};

/// Flag of the things that a skill (1..8) shows.
constexpr uint32_t thing_skill_flag(int skill) {
  return skill <= 5 ? kThingSkill1 << (skill < 1 ? 0 : skill - 1)
                    : kThingSkill6 << ((skill > 8 ? 8 : skill) - 6);
}

/// A THINGS entry: where the map requires something, before it lives.
struct MapThing {
  int32_t id = 0;
  Fixed x = 0, y = 0, height = 0;  ///< height above the floor
  int32_t angle_degrees = 0;
  int32_t editor_number = 0;
  int32_t special = 0;
  std::array<int32_t, 5> args{};
  uint32_t flags = 0;              ///< ThingFlag bits
  uint32_t class_filter = 0xFFFF;  ///< bit n: it is there for player class n + 1
  int32_t pitch_degrees = 0;
  float alpha = -1.0f;                   ///< below 0: its type's own
  float scale_x = 1.0f, scale_y = 1.0f;  ///< times its type's
  int32_t health = 1;                    ///< times its type's; below 0: minus so many points
  Fixed gravity = kFracUnit;             ///< times its type's; below 0: minus that much
  int32_t score = 0;                     ///< of APROP_Score
  std::string arg0_text;                 ///< name of a script, instead of args[0]
};

enum class MapFormat : uint8_t { kUdmf, kHexen, kDoom };

struct LevelIndex;

/// MAPINFO's properties of a map.
struct LevelRules {
  bool no_jump = false, no_crouch = false;
  Fixed gravity = kFracUnit;  ///< units/tic^2
  bool operator==(const LevelRules&) const = default;
};

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
  MapFormat format = MapFormat::kUdmf;
  LevelRules rules;
  std::vector<uint8_t> behavior_lump;  ///< compiled scripts, the last BEHAVIOR of the map; empty without one
  std::string scripts_text;            ///< SCRIPTS: their source, if it came along
  std::string dialogue_text;           ///< DIALOGUE, unread
  std::vector<std::string> warnings;   ///< what the loader put right, left out or does not support
};

}  // namespace comrad::doom
