// The pass that ends a picture: from palette indices, or from texel addresses and light rows, to colours. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <unordered_map>
#include <vector>

#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/draw_list.h"
#include "sim_workers/engine/render/painter.h"
#include "sim_workers/engine/render/palette_mixer.h"

namespace comrad::doom {

/// How a player sees light.
enum class Sight : uint8_t {
  kPlain,
  kLightAmp,  ///< everything is fully lit
  kInverse    ///< invulnerable: grey, bright and dark change places
};

/// The colours of one picture: [tint, row, index], and which of a word's upper bits count.
struct PictureColors {
  const uint32_t* colors = nullptr;
  uint32_t row_mask = 0;
};

/// For each palette and sight the colour of every texel index under every light row and tint, packed
/// 0xBBGGRR. Tables are made on first use.
class ColorTables {
 public:
  explicit ColorTables(std::shared_ptr<const ArtArchive> archive);
  /// The 256 unshaded colours of a palette.
  const uint32_t* lit(int palette) { return palettes_[static_cast<std::size_t>(palette)].data(); }
  /// The colours of a picture with these tints (0xRRGGBB; the first is white). Good until the next call.
  PictureColors select(int palette, Sight sight, std::span<const uint32_t> tints);
  /// The same in two steps, first what light makes of every index. Good until the next call.
  LightRows light_rows(Sight sight, std::span<const uint32_t> tints);
  /// What palette entries make when they are mixed; made on first use.
  const PaletteMixer& mixer();

 private:
  static constexpr std::size_t kTableSize = std::size_t{kLightRowCount} * 256;
  const std::vector<uint32_t>& table(int palette, Sight sight, uint32_t tint);
  const uint8_t* rows_of(Sight sight, uint32_t tint);
  const std::vector<uint8_t>& tinted_rows(uint32_t tint);

  std::shared_ptr<const ArtArchive> archive_;
  std::array<std::array<uint32_t, 256>, kPaletteCount> palettes_{};
  PaletteMixer mixer_;
  std::unordered_map<uint64_t, std::vector<uint32_t>> tables_;  // one [row, index] each
  std::unordered_map<uint32_t, std::vector<uint8_t>> tinted_rows_;
  std::vector<uint32_t> joined_;  // several tints side by side
  std::vector<uint64_t> joined_keys_;
};

/// Writes planar RGB: `destination` [3, plane], of which the first words.size() pixels of each plane are set.
///   words    one per pixel: tint << kTintShift | light row << kAddressBits | address
///   texels   the atlas
///   colors   of ColorTables::select()
void convert(std::span<const uint32_t> words, const uint8_t* texels, const PictureColors& colors,
             std::size_t plane, uint8_t* destination);

/// Writes planar RGB: `destination` [3, plane], of which the first indices.size() pixels of each plane are set.
///   colors  [256], of ColorTables::lit()
void show_indices(std::span<const uint8_t> indices, const uint32_t* colors, std::size_t plane,
                  uint8_t* destination);

/// Blends the see-through layer over a picture `width` pixels wide; see TexelWord.
///   layer  [box.bottom - box.top, box.right - box.left]: blend << kTintShift | light row << kAddressBits |
///          address, 0 where nothing see-through is
void blend_layer(std::span<const uint32_t> layer, const PixelBox& box, const uint8_t* texels,
                 const PictureColors& colors, std::span<const Blend> blends, int width, std::size_t plane,
                 uint8_t* destination);

}  // namespace comrad::doom
