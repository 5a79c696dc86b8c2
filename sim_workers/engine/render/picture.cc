#include "sim_workers/engine/render/picture.h"

#include <cstring>

#include "sim_workers/engine/render/art_atlas.h"

namespace comrad::doom {

ColorTables::ColorTables(const ArtArchive& archive) {
  tables_.resize(kPaletteCount * kTableSize);
  for (int palette = 0; palette < kPaletteCount; ++palette) {
    uint32_t* out = tables_.data() + static_cast<std::size_t>(palette) * kTableSize;
    for (int row = 0; row < kLightRowCount; ++row) {
      for (std::size_t index = 0; index < 256; ++index) {
        const auto& [red, green, blue] = archive.palette(palette)[archive.colormap(row)[index]];
        *out++ = static_cast<uint32_t>(red) | static_cast<uint32_t>(green) << 8 |
                 static_cast<uint32_t>(blue) << 16;
      }
    }
  }
}

void ColorTables::convert(std::span<const uint32_t> words, const uint8_t* texels, int palette,
                          std::size_t plane, uint8_t* destination) const {
  const uint32_t* colors = table(palette);
  uint8_t* red = destination;
  uint8_t* green = destination + plane;
  uint8_t* blue = destination + 2 * plane;
  const auto color_of = [&](uint32_t word) {
    return colors[(word >> kAddressBits & (kLightRowCount - 1)) * 256 + texels[word & kAddressMask]];
  };
  std::size_t i = 0;
  for (; i + 4 <= words.size(); i += 4) {
    const uint32_t a = color_of(words[i]), b = color_of(words[i + 1]);
    const uint32_t c = color_of(words[i + 2]), d = color_of(words[i + 3]);
    // Transposes four pixels into four bytes of each plane.
    const uint32_t ab = (a & 0x00FF00FFu) | (b & 0x00FF00FFu) << 8, cd = (c & 0x00FF00FFu) | (d & 0x00FF00FFu)
                                                                                                 << 8;
    const uint32_t reds = (ab & 0xFFFFu) | cd << 16, blues = ab >> 16 | (cd & 0xFFFF0000u);
    const uint32_t greens = (a >> 8 & 0xFFu) | (b & 0xFF00u) | (c & 0xFF00u) << 8 | (d & 0xFF00u) << 16;
    std::memcpy(red + i, &reds, 4);
    std::memcpy(green + i, &greens, 4);
    std::memcpy(blue + i, &blues, 4);
  }
  for (; i < words.size(); ++i) {
    const uint32_t color = color_of(words[i]);
    red[i] = static_cast<uint8_t>(color), green[i] = static_cast<uint8_t>(color >> 8);
    blue[i] = static_cast<uint8_t>(color >> 16);
  }
}

}  // namespace comrad::doom
