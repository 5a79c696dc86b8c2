// What is seen through, in a palette: the reference engine mixes two entries with five bits a channel and takes the nearest entry
// (found with glass of known colours before walls of known colours). Stage: render.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>

#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/draw_list.h"

namespace comrad::doom {

struct PaletteMixer {
  bool is_made = false;
  std::array<std::array<uint8_t, 3>, 256> colors{};  ///< of palette 0
  std::array<uint8_t, 32 * 32 * 32> nearest{};       ///< [red, green, blue] of five bits: a palette index

  void make(const ArtArchive& archive) {
    colors = archive.palette(0);
    const auto widened = [](std::size_t five) { return static_cast<uint8_t>(five << 3 | five >> 2); };
    for (std::size_t at = 0; at < nearest.size(); ++at)
      nearest[at] = archive.nearest({widened(at >> 10), widened(at >> 5 & 31), widened(at & 31)});
    is_made = true;
  }

  /// The index of `front` over `behind`.
  uint8_t mix(uint8_t front, uint8_t behind, const Blend& blend) const {
    std::size_t place = 0;
    for (std::size_t channel = 0; channel < 3; ++channel) {
      // Each part keeps ten bits, their sum five.
      const int source = colors[front][channel] * blend.front >> 4, below = colors[behind][channel];
      const int below_share = below * blend.behind >> 4, below_whole = below * Blend::kWhole >> 4;
      const int sum = blend.kind == Blend::Kind::kMix        ? source + below_share
                      : blend.kind == Blend::Kind::kAdd      ? below_whole + source
                      : blend.kind == Blend::Kind::kSubtract ? below_whole - source
                                                             : below_share;
      place = place << 5 | static_cast<std::size_t>(std::clamp(sum >> 5, 0, 31));
    }
    return nearest[place];
  }
};

}  // namespace comrad::doom
