// The smallest IWAD that holds everything the renderer requests, made in memory: a palette of known colours,
// one texture per need, one sprite with eight sides. Tests built on it need no game files.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "sim_workers/engine/render/art_archive.h"
#include "tests/support/wad_bytes.h"

namespace comrad::doom::test {

/// Bytes of a picture lump; index 255 in `texels` (row by row) is a hole.
inline std::string picture_lump(int width, int height, int left, int top,
                                const std::vector<uint8_t>& texels) {
  std::string lump;
  const auto u16 = [&](int value) {
    lump.push_back(static_cast<char>(value & 255)), lump.push_back(static_cast<char>(value >> 8 & 255));
  };
  u16(width), u16(height), u16(left), u16(top);
  std::string columns;
  std::vector<std::size_t> offsets;
  for (int x = 0; x < width; ++x) {
    offsets.push_back(columns.size());
    for (int y = 0; y < height;) {
      const auto at = [&](int row) { return texels[static_cast<std::size_t>(row) * width + x]; };
      if (at(y) == 255) {
        ++y;
        continue;
      }
      int end = y;
      while (end < height && at(end) != 255 && end - y < 128) ++end;
      columns.push_back(static_cast<char>(y)), columns.push_back(static_cast<char>(end - y)),
          columns.push_back(0);
      for (; y < end; ++y) columns.push_back(static_cast<char>(at(y)));
      columns.push_back(0);
    }
    columns.push_back(static_cast<char>(0xFF));
  }
  for (const std::size_t offset : offsets) {
    const std::size_t at = 8 + 4 * static_cast<std::size_t>(width) + offset;
    u16(static_cast<int>(at & 0xFFFF)), u16(static_cast<int>(at >> 16));
  }
  return lump + columns;
}

inline std::string filled_picture(int width, int height, uint8_t index, int left = 0, int top = 0) {
  return picture_lump(width, height, left, top,
                      std::vector<uint8_t>(static_cast<std::size_t>(width) * height, index));
}

/// A TEXTURE1 lump with one single-patch texture per name; patch i belongs to name i. All 64x64.
inline std::string texture_lump(const std::vector<std::string>& names) {
  std::string lump;
  const auto number = [&](uint32_t value, int bytes) {
    for (int i = 0; i < bytes; ++i) lump.push_back(static_cast<char>(value >> (8 * i) & 255));
  };
  const auto name_field = [&](std::string name) {
    name.resize(8, '\0');
    lump += name;
  };
  number(static_cast<uint32_t>(names.size()), 4);
  for (std::size_t i = 0; i < names.size(); ++i)
    number(static_cast<uint32_t>(4 + 4 * names.size() + 32 * i), 4);
  for (std::size_t i = 0; i < names.size(); ++i) {
    name_field(names[i]);
    number(0, 4), number(64, 2), number(64, 2), number(0, 4), number(1, 2);
    number(0, 2), number(0, 2), number(static_cast<uint32_t>(i), 2), number(0, 4);
  }
  return lump;
}

/// Palette index i is the colour (i, 255 - i, i / 2); COLORMAP row r maps i to i (light shows only in
/// the row).
inline wad::test::WadBytes tiny_iwad() {
  wad::test::WadBytes wad;
  wad.magic = "IWAD";
  std::string palette, colormap;
  for (int copy = 0; copy < kPaletteCount; ++copy)
    for (int i = 0; i < 256; ++i) {
      palette.push_back(static_cast<char>(i)), palette.push_back(static_cast<char>(255 - i));
      palette.push_back(static_cast<char>(i / 2));
    }
  for (int row = 0; row < 34; ++row)
    for (int i = 0; i < 256; ++i) colormap.push_back(static_cast<char>(i));
  wad.add("PLAYPAL", palette).add("COLORMAP", colormap);
  const std::vector<std::string> textures = {"BRICK6", "ASHWALL6", "RSKY1"};
  std::string patch_names("\3\0\0\0", 4);
  for (const char* name : {"PATCH1", "PATCH2", "PATCH3"}) patch_names += name + std::string(2, '\0');
  wad.add("TEXTURE1", texture_lump(textures)).add("PNAMES", patch_names);
  wad.add("PATCH1", filled_picture(64, 64, 10)).add("PATCH2", filled_picture(64, 64, 20));
  wad.add("PATCH3", filled_picture(64, 64, 30));
  wad.add("S_START");
  wad.add("STIMA0", filled_picture(8, 8, 40, 4, 8));
  wad.add("ORB1A1", filled_picture(8, 8, 41, 4, 4)).add("ORB1A5", filled_picture(8, 8, 45, 4, 4));
  for (const char* name : {"ORB1A2A8", "ORB1A3A7", "ORB1A4A6"}) wad.add(name, filled_picture(8, 8, 42, 4, 4));
  wad.add("S_END");
  wad.add("F_START");
  wad.add("FLOOR4_8", std::string(4096, 50)).add("CEIL3_5", std::string(4096, 60));
  wad.add("FLAT1", std::string(4096, 70));
  wad.add("F_END");
  return wad;
}

inline std::shared_ptr<const ArtArchive> tiny_archive() {
  return ArtArchive::from_bytes({tiny_iwad().build()}).value();
}

}  // namespace comrad::doom::test
