// From texel addresses and light rows to colours: the pass that ends a picture. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "sim_workers/engine/render/art_archive.h"

namespace comrad::doom {

/// For each palette the colour of every texel index under every light row, packed 0xBBGGRR.
class ColorTables {
 public:
  explicit ColorTables(const ArtArchive& archive);
  /// The 256 unshaded colours of a palette.
  const uint32_t* lit(int palette) const { return table(palette); }

  /// Writes planar RGB: `destination` [3, plane], of which the first words.size() pixels of each plane are
  /// set.
  ///   words    one per pixel: light row << kAddressBits | address
  ///   texels   the atlas
  void convert(std::span<const uint32_t> words, const uint8_t* texels, int palette, std::size_t plane,
               uint8_t* destination) const;

 private:
  static constexpr std::size_t kTableSize = std::size_t{kLightRowCount} * 256;
  const uint32_t* table(int palette) const {
    return tables_.data() + static_cast<std::size_t>(palette) * kTableSize;
  }
  std::vector<uint32_t> tables_;  // [palette, row, index]
};

}  // namespace comrad::doom
