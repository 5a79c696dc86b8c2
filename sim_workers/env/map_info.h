// MAPINFO and KEYCONF: what public WADs change of the game by them. Stage: loading.
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "sim_workers/engine/map/level.h"

namespace comrad::sim {

struct MapInfo {
  doom::LevelRules rules;
  std::string player_class;  ///< the first that is named; empty: DoomPlayer
};

/// Reads a MAPINFO or ZMAPINFO lump, in the form with braces or in Hexen's: `gameinfo { playerclasses = "X" }`, and of the
/// blocks `defaultmap`, `adddefaultmap` and `map <map>`: nojump, allowjump, nocrouch, allowcrouch and gravity (800 is the
/// usual one). What else changes play is one warning of its name; stories, music, skies and menus have no effect.
void read_map_info(std::string_view text, const std::string& label, std::string_view map, MapInfo* info,
                   std::vector<std::string>* warnings);

/// Reads a KEYCONF lump: clearplayerclasses and addplayerclass; slots of weapons are one warning, keys have no effect.
void read_key_conf(std::string_view text, const std::string& label, MapInfo* info,
                   std::vector<std::string>* warnings);

}  // namespace comrad::sim
