// Where a player's body can walk from its start: a flood fill over the map, used to accept or refuse
// a layout.
#pragma once

#include <cstdint>
#include <span>
#include <vector>

#include "doomgen/layout/map_data.h"

namespace comrad::doomgen {

/// The walker's body and what it can climb.
struct Body {
  int32_t radius = 16, height = 56, step = 24;
};

/// True where the line stops the body: one-sided, blocking, too low an opening or too high a step.
bool stops(const MapData& map, const LinedefData& line, const Body& body);

/// The places a body reaches from any of the starts, on a grid of 8 units. Lines stop it where they are
/// one-sided or blocking, where the opening is lower than its height, and where the floors differ by more
/// than its step.
class Reachability {
 public:
  Reachability(const MapData& map, std::span<const Point> starts, const Body& body = {});
  /// True where the body can come to within its radius of `p`.
  bool reaches(Point p) const;

 private:
  static constexpr int32_t kGrid = 8;
  Box bounds_;
  int32_t radius_ = 0, columns_ = 0, rows_ = 0;
  std::vector<uint8_t> state_;  ///< [row, column] 0 free, 1 blocked, 2 reached
};

}  // namespace comrad::doomgen
