// PNG lumps of PWADs: decoded to RGBA, with the offsets that ZDoom's tools keep in a grAb chunk. libpng has
// its home here. Stage: render.
#pragma once

#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::doom {

constexpr int kPngSideMax = 2048;  ///< more fits no atlas

struct RgbaImage {
  int width = 0, height = 0;
  int left_offset = 0, top_offset = 0;  ///< of the grAb chunk; 0 without one
  std::vector<uint8_t> rgba;            ///< [height, width, 4], alpha not multiplied in
};

/// True where the bytes begin as a PNG does.
bool is_png(std::span<const uint8_t> lump);

/// Decodes any PNG to 8 bits a channel. `name` goes into the message.
/// Errors: kBadFormat for what libpng refuses and for sides beyond kPngSideMax.
Expected<RgbaImage> decode_png(std::span<const uint8_t> lump, std::string_view name);

/// Writes a picture as PNG. `planes` [3, height, width] u8, planar RGB. Errors: kSystem.
Status write_png(const std::string& path, std::span<const uint8_t> planes, int width, int height);

}  // namespace comrad::doom
