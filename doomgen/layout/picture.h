// Pictures made by code: PNG for textures between TX_START and TX_END, Doom's column format for patches, indexed
// PNG for files that people look at.
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::doomgen {

struct Colour {
  uint8_t red = 0, green = 0, blue = 0, alpha = 255;
  friend bool operator==(const Colour&, const Colour&) = default;
};

/// A picture of RGBA pixels, row by row from the top.
struct Picture {
  int width = 0, height = 0;
  std::vector<Colour> pixels;  ///< [height, width]

  Picture() = default;
  Picture(int w, int h, Colour fill) : width(w), height(h), pixels(static_cast<std::size_t>(w) * h, fill) {}
  Colour& at(int x, int y) { return pixels[static_cast<std::size_t>(y) * width + x]; }
  const Colour& at(int x, int y) const { return pixels[static_cast<std::size_t>(y) * width + x]; }
};

/// The picture as a PNG file, 8 bits RGBA. The data is stored, not compressed, so that the bytes of a WAD depend on
/// nothing but the picture.
std::string encode_png(const Picture& picture);

/// The picture as a PNG file of palette indices, compressed; alpha is dropped. Errors: kBadInput for more than 256
/// colours.
Expected<std::string> encode_indexed_png(const Picture& picture);

/// The picture in Doom's column format, colours by the nearest of `palette` (PLAYPAL: 256 times red,
/// green, blue); pixels of alpha below 128 are holes. Errors: kBadInput for sides beyond 1024 x 254 or a
/// short palette.
Expected<std::string> encode_patch(const Picture& picture, std::string_view palette);

}  // namespace comrad::doomgen
