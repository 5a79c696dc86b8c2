// Draws the map of Stealth Labyrinth: a start room, a hub, and one to three branches of rooms in a row, all
// dark, with turret spots at the far ends.
#pragma once

#include <vector>

#include "doomgen/layout/geometry.h"
#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios::stealth_labyrinth {

constexpr int32_t kFirstSpotId = 5000;
constexpr int32_t kStartTag = 100, kHubTag = 101, kFirstRoomTag = 102;
constexpr int32_t kStartCorridorTag = 200, kFirstCorridorTag = 201;

/// A room and the corridor that leads to it.
struct Room {
  int branch = 0, index = 0;  ///< of the branch; of the room in it
  doomgen::Box box, corridor;
  doomgen::Point centre;
  std::vector<doomgen::Point> turrets, lamps;
  int32_t turret_health = 0;
};

/// Where everything lies: what the recipe draws and what a scripted team may know.
struct Plan {
  doomgen::Box start, hub, start_corridor;
  std::vector<Room> rooms;
};
Plan plan(const LayoutDraw& draw);

/// The recipe: maps differ by their parameters, and by where the lamps stand.
LayoutRecipe recipe();

}  // namespace comrad::scenarios::stealth_labyrinth
