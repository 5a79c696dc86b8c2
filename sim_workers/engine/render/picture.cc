#include "sim_workers/engine/render/picture.h"

#ifdef __SSE2__
#include <emmintrin.h>
#endif

#include <algorithm>

#include "sim_workers/engine/render/art_atlas.h"

namespace comrad::doom {
namespace {

constexpr std::size_t kTablesKept = 512;

/// `destination` is the pixel in the red plane.
void blend_pixel(uint32_t color, const Blend& blend, std::size_t plane, uint8_t* destination) {
  for (std::size_t channel = 0; channel < 3; ++channel) {
    uint8_t& pixel = destination[channel * plane];
    const int source = static_cast<int>(color >> (8 * channel) & 255), below = pixel;
    int mixed = below;
    switch (blend.kind) {
      case Blend::Kind::kMix:
        mixed = (source * blend.front + below * (Blend::kWhole - blend.front)) / Blend::kWhole;
        break;
      case Blend::Kind::kAdd:
        mixed = std::min(255, below + source * blend.front / Blend::kWhole);
        break;
      case Blend::Kind::kSubtract:
        mixed = std::max(0, below - source * blend.front / Blend::kWhole);
        break;
      case Blend::Kind::kDarken:
        mixed = below * (Blend::kWhole - blend.front) / Blend::kWhole;
        break;
    }
    pixel = static_cast<uint8_t>(mixed);
  }
}

constexpr std::size_t kBlock = 16;

/// Sixteen colours 0xBBGGRR into sixteen bytes of each plane.
void split_block(const std::array<uint32_t, kBlock>& colors, uint8_t* red, uint8_t* green, uint8_t* blue) {
#ifdef __SSE2__
  const __m128i byte = _mm_set1_epi32(255);
  const auto bytes_of = [&](int shift) {
    const auto four = [&](std::size_t first) {
      const __m128i packed = _mm_load_si128(reinterpret_cast<const __m128i*>(&colors[first]));
      return _mm_and_si128(_mm_srli_epi32(packed, shift), byte);
    };
    return _mm_packus_epi16(_mm_packs_epi32(four(0), four(4)), _mm_packs_epi32(four(8), four(12)));
  };
  _mm_storeu_si128(reinterpret_cast<__m128i*>(red), bytes_of(0));
  _mm_storeu_si128(reinterpret_cast<__m128i*>(green), bytes_of(8));
  _mm_storeu_si128(reinterpret_cast<__m128i*>(blue), bytes_of(16));
#else
  for (std::size_t k = 0; k < kBlock; ++k) {
    red[k] = static_cast<uint8_t>(colors[k]), green[k] = static_cast<uint8_t>(colors[k] >> 8);
    blue[k] = static_cast<uint8_t>(colors[k] >> 16);
  }
#endif
}

/// Writes color_of(pixel), 0xBBGGRR, of all pixels as planar RGB.
template <typename Pixel, typename ColorOf>
void write_planes(std::span<const Pixel> pixels, const ColorOf& color_of, std::size_t plane,
                  uint8_t* destination) {
  uint8_t* red = destination;
  uint8_t* green = destination + plane;
  uint8_t* blue = destination + 2 * plane;
  alignas(16) std::array<uint32_t, kBlock> block;
  std::size_t i = 0;
  for (; i + kBlock <= pixels.size(); i += kBlock) {
    for (std::size_t k = 0; k < kBlock; ++k) block[k] = color_of(pixels[i + k]);
    split_block(block, red + i, green + i, blue + i);
  }
  for (; i < pixels.size(); ++i) {
    const uint32_t color = color_of(pixels[i]);
    red[i] = static_cast<uint8_t>(color), green[i] = static_cast<uint8_t>(color >> 8);
    blue[i] = static_cast<uint8_t>(color >> 16);
  }
}

}  // namespace

ColorTables::ColorTables(std::shared_ptr<const ArtArchive> archive) : archive_(std::move(archive)) {
  for (int palette = 0; palette < kPaletteCount; ++palette)
    for (std::size_t index = 0; index < 256; ++index) {
      const ArtArchive::Color& color = archive_->palette(palette)[index];
      palettes_[static_cast<std::size_t>(palette)][index] =
          color[0] | static_cast<uint32_t>(color[1]) << 8 | static_cast<uint32_t>(color[2]) << 16;
    }
}

const PaletteMixer& ColorTables::mixer() {
  if (!mixer_.is_made) mixer_.make(*archive_);
  return mixer_;
}

/// What every index becomes under a coloured light, [row, index]: as in ZDoom the nearest colour that the
/// palette has, the light falling off evenly instead of along COLORMAP.
const std::vector<uint8_t>& ColorTables::tinted_rows(uint32_t tint) {
  const auto found = tinted_rows_.find(tint);
  if (found != tinted_rows_.end()) return found->second;
  std::vector<uint8_t> made;
  made.reserve(kTableSize);
  for (uint32_t row = 0; row < kLightRowCount; ++row)
    for (std::size_t index = 0; index < 256; ++index) {
      const ArtArchive::Color& plain = archive_->palette(0)[index];
      ArtArchive::Color wanted{};
      for (std::size_t channel = 0; channel < 3; ++channel)
        wanted[channel] = static_cast<uint8_t>(plain[channel] * (tint >> (16 - 8 * channel) & 255) / 255 *
                                               (kLightRowCount - row) / kLightRowCount);
      made.push_back(archive_->nearest(wanted));
    }
  return tinted_rows_.emplace(tint, std::move(made)).first->second;
}

/// [row, index] of a tint; of one row where light makes no difference.
const uint8_t* ColorTables::rows_of(Sight sight, uint32_t tint) {
  if (sight == Sight::kInverse) return archive_->colormap(kInverseRow).data();
  return tint == 0xFFFFFFu ? archive_->colormap(0).data() : tinted_rows(tint).data();
}

LightRows ColorTables::light_rows(Sight sight, std::span<const uint32_t> tints) {
  if (tinted_rows_.size() > kTablesKept) tinted_rows_.clear();
  LightRows light;
  light.row_stride = sight == Sight::kPlain ? 256 : 0;
  for (std::size_t i = 0; i < tints.size(); ++i) light.rows[i] = rows_of(sight, tints[i]);
  return light;
}

const std::vector<uint32_t>& ColorTables::table(int palette, Sight sight, uint32_t tint) {
  const uint64_t key = tint | static_cast<uint64_t>(palette) << 24 | static_cast<uint64_t>(sight) << 32;
  const auto found = tables_.find(key);
  if (found != tables_.end()) return found->second;
  const bool tinted = tint != 0xFFFFFFu && sight != Sight::kInverse;
  const std::vector<uint8_t>* rows = tinted ? &tinted_rows(tint) : nullptr;
  std::vector<uint32_t> made;
  made.reserve(kTableSize);
  for (int row = 0; row < kLightRowCount; ++row) {
    const int shown = sight == Sight::kPlain ? row : sight == Sight::kLightAmp ? 0 : kInverseRow;
    for (std::size_t index = 0; index < 256; ++index) {
      const std::size_t lit = rows != nullptr ? (*rows)[static_cast<std::size_t>(shown) * 256 + index]
                                              : archive_->colormap(shown)[index];
      made.push_back(palettes_[static_cast<std::size_t>(palette)][lit]);
    }
  }
  return tables_.emplace(key, std::move(made)).first->second;
}

PictureColors ColorTables::select(int palette, Sight sight, std::span<const uint32_t> tints) {
  if (tables_.size() > kTablesKept) tables_.clear(), tinted_rows_.clear(), joined_keys_.clear();
  if (tints.size() <= 1) return {table(palette, sight, 0xFFFFFFu).data(), kLightRowCount - 1};
  const auto key = [&](uint32_t tint) {
    return tint | static_cast<uint64_t>(palette) << 24 | static_cast<uint64_t>(sight) << 32;
  };
  joined_.resize(std::size_t{kTintsMax} * kTableSize);
  joined_keys_.resize(kTintsMax, UINT64_MAX);
  for (std::size_t i = 0; i < tints.size(); ++i) {
    if (joined_keys_[i] == key(tints[i])) continue;
    joined_keys_[i] = key(tints[i]);
    const std::vector<uint32_t>& from = table(palette, sight, tints[i]);
    std::copy(from.begin(), from.end(), joined_.begin() + static_cast<std::ptrdiff_t>(i * kTableSize));
  }
  return {joined_.data(), kTintsMax * kLightRowCount - 1};
}

void convert(std::span<const uint32_t> words, const uint8_t* texels, const PictureColors& colors,
             std::size_t plane, uint8_t* destination) {
  const uint32_t* table = colors.colors;
  const uint32_t row_mask = colors.row_mask << 8;
  write_planes(
      words,
      [=](uint32_t word) {
        return table[(word >> (kAddressBits - 8) & row_mask) | texels[word & kAddressMask]];
      },
      plane, destination);
}

void show_indices(std::span<const uint8_t> indices, const uint32_t* colors, std::size_t plane,
                  uint8_t* destination) {
  write_planes(
      indices, [=](uint8_t index) { return colors[index]; }, plane, destination);
}

void blend_layer(std::span<const uint32_t> layer, const PixelBox& box, const uint8_t* texels,
                 const PictureColors& colors, std::span<const Blend> blends, int width, std::size_t plane,
                 uint8_t* destination) {
  std::size_t next = 0;
  for (int row = box.top; row < box.bottom; ++row)
    for (int column = box.left; column < box.right; ++column) {
      const uint32_t word = layer[next++];
      if (word == 0 || word >> kTintShift >= blends.size()) continue;
      const uint32_t color =
          colors.colors[(word >> kAddressBits & (kLightRowCount - 1)) * 256 + texels[word & kAddressMask]];
      blend_pixel(color, blends[word >> kTintShift], plane,
                  destination + static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                      static_cast<std::size_t>(column));
    }
}

}  // namespace comrad::doom
