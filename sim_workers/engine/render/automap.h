// Doom's automap as ViZDoom's automap buffer has it: the map from above with the player in its middle, drawn by the CPU.
// Stage: beside render.
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// What it shows beside the players: the walls that were seen, those of the whole map, things as well, and their boxes.
enum class AutomapMode : uint8_t { kNormal, kWhole, kObjects, kObjectsWithSize };

/// By ViZDoom's names ("OBJECTS_WITH_SIZE"), in any case.
std::optional<AutomapMode> find_automap_mode(std::string_view name);
inline constexpr const char* kAutomapModeNames = "NORMAL, WHOLE, OBJECTS, OBJECTS_WITH_SIZE";

struct AutomapOptions {
  int width = 320, height = 240;
  AutomapMode mode = AutomapMode::kNormal;
  bool rotates = false;  ///< what lies ahead of the player is up; else north is
};

/// Draws `player`'s map; the whole map would fill about 1.4 pictures.
///   seen     [linedef] 1 where the player has seen it (Renderer::mark_seen_lines()); shorter: not yet
///   picture  [height, width, 3] u8 RGB
/// Colours are ViZDoom's; its walls have textures on their floors and smooth edges, these have none.
void draw_automap(const World& world, int player, const AutomapOptions& options,
                  std::span<const uint8_t> seen, uint8_t* picture);

}  // namespace comrad::doom
