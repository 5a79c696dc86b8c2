// ZDoom's flags of a game: the bits of its console variables dmflags (the low half here) and dmflags2 (the high half), each of
// which has its own name, too. The values are what ZDoom's scripts read of both (GetCVar). Stage: loading.
#pragma once

#include <cstdint>
#include <string_view>

namespace comrad::wad {

// X(bit, console variable, name). What is not here changes nothing in this engine: cameras, chats, teams, suicide, what is kept
// between two levels.
#define COMRAD_GAME_FLAGS(X)                      \
  X(0, sv_nohealth, kNoHealth)                    \
  X(2, sv_weaponstay, kWeaponsStay)               \
  X(3, sv_oldfalldamage, kOldFallDamage)          \
  X(4, sv_falldamage, kFallDamage)                \
  X(7, sv_spawnfarthest, kSpawnFarthest)          \
  X(8, sv_forcerespawn, kForceRespawn)            \
  X(9, sv_noarmor, kNoArmor)                      \
  X(10, sv_noexit, kNoExit)                       \
  X(11, sv_infiniteammo, kInfiniteAmmo)           \
  X(12, sv_nomonsters, kNoMonsters)               \
  X(13, sv_monsterrespawn, kMonstersReturn)       \
  X(14, sv_itemrespawn, kItemsReturn)             \
  X(15, sv_fastmonsters, kFastMonsters)           \
  X(16, sv_nojump, kNoJump)                       \
  X(17, sv_allowjump, kAllowJump)                 \
  X(18, sv_nofreelook, kNoFreeLook)               \
  X(21, sv_noweaponspawn, kNoCooperativeWeapons)  \
  X(22, sv_nocrouch, kNoCrouch)                   \
  X(23, sv_allowcrouch, kAllowCrouch)             \
  X(24, sv_cooploseinventory, kLoseInventory)     \
  X(25, sv_cooplosekeys, kLoseKeys)               \
  X(26, sv_cooploseweapons, kLoseWeapons)         \
  X(27, sv_cooplosearmor, kLoseArmor)             \
  X(28, sv_cooplosepowerups, kLosePowers)         \
  X(29, sv_cooploseammo, kLoseAmmo)               \
  X(30, sv_coophalveammo, kHalveAmmo)             \
  X(33, sv_weapondrop, kDropWeapons)              \
  X(38, sv_doubleammo, kDoubleAmmo)               \
  X(39, sv_degeneration, kDegeneration)           \
  X(41, sv_barrelrespawn, kBarrelsReturn)         \
  X(42, sv_respawnprotect, kRespawnProtection)    \
  X(44, sv_samespawnspot, kRespawnWhereDied)      \
  X(46, sv_norespawn, kNoRespawn)                 \
  X(48, sv_infiniteinventory, kInfiniteInventory) \
  X(49, sv_killallmonsters, kExitAfterMonsters)   \
  X(55, sv_noautoaim, kNoAutoaim)                 \
  X(59, sv_respawnsuper, kPowersReturn)

enum class GameFlag : uint64_t {
#define COMRAD_GAME_FLAG(bit, variable, name) name = uint64_t{1} << bit,
  COMRAD_GAME_FLAGS(COMRAD_GAME_FLAG)
#undef COMRAD_GAME_FLAG
};

struct GameFlagName {
  std::string_view variable;  ///< sv_...
  GameFlag flag;
};
inline constexpr GameFlagName kGameFlagNames[] = {
#define COMRAD_GAME_FLAG(bit, variable, name) {#variable, GameFlag::name},
    COMRAD_GAME_FLAGS(COMRAD_GAME_FLAG)
#undef COMRAD_GAME_FLAG
};

struct GameFlags {
  uint64_t bits = 0;  ///< dmflags | dmflags2 << 32

  bool has(GameFlag flag) const { return (bits & static_cast<uint64_t>(flag)) != 0; }
  void set(GameFlag flag, bool value = true) {
    bits = value ? bits | static_cast<uint64_t>(flag) : bits & ~static_cast<uint64_t>(flag);
  }
};

}  // namespace comrad::wad
