// The built-in actor types and the numbers that name them in maps. Stage: tic and render.
#pragma once

#include <cstddef>
#include <cstdint>
#include <optional>

#include "sim_workers/engine/play/world.h"

namespace comrad::doom {

// Places in the Player type's list of frames.
constexpr uint16_t kPlayerIdleFrame = 0;
constexpr uint16_t kPlayerWalkFrame = 1;   ///< four of them, in a circle
constexpr uint16_t kPlayerDeathFrame = 5;  ///< seven of them, the last for ever

constexpr int kPlayersMax = 8;

/// The player, from 0, whose start a THINGS editor number is: 1-4 and 4001-4004. Nothing for other numbers.
constexpr std::optional<int> player_of_start(int32_t editor_number) {
  if (editor_number >= 1 && editor_number <= 4) return editor_number - 1;
  if (editor_number >= 4001 && editor_number <= 4004) return editor_number - 4001 + 4;
  return std::nullopt;
}

}  // namespace comrad::doom
