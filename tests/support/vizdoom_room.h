// ViZDoom games made by hand: a square room with starts, in a WAD that a .cfg can name.
#pragma once

#include <string>
#include <vector>

#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/udmf_writer.h"
#include "doomgen/layout/wad_writer.h"

namespace comrad::test {

/// Bytes of a WAD with one room on each of `maps`: players 1 to `starts` have a start, and a box of shells lies in front of
/// the first. Empty where the room cannot be built, which no test survives.
inline std::string room_wad(const std::vector<std::string>& maps, int starts) {
  doomgen::WadWriter wad;
  for (const std::string& name : maps) {
    doomgen::MapPlan plan;
    plan.add_area({.name = "room"}, doomgen::Box::around({0, 0}, 512, 512));
    for (int player = 1; player <= starts; ++player) plan.add_start(player, {64 * player - 160, -96}, 90);
    doomgen::ThingData shells;
    shells.editor_number = 2049, shells.position = {-96, 96};
    plan.add_thing(shells);
    const auto map = plan.build();
    if (!map || !wad.add_udmf_map(name, doomgen::write_udmf(*map))) return {};
  }
  const auto bytes = wad.bytes();
  return bytes ? *bytes : std::string();
}

}  // namespace comrad::test
