#include "sim_workers/engine/render/picture.h"

#include <algorithm>
#include <cstring>

#include "sim_workers/engine/render/art_atlas.h"

namespace comrad::doom {
namespace {

constexpr std::size_t kTablesKept = 512;

/// `destination` is the pixel in the red plane.
void blend_pixel(uint32_t word, const uint8_t* texels, const PictureColors& colors,
                 std::span<const Blend> blends, std::size_t plane, uint8_t* destination) {
  const std::size_t kind = word >> kTintShift;
  if (kind >= blends.size()) return;
  const Blend& blend = blends[kind];
  const uint32_t color =
      colors.colors[(word >> kAddressBits & (kLightRowCount - 1)) * 256 + texels[word & kAddressMask]];
  const int alpha = blend.alpha;
  for (std::size_t channel = 0; channel < 3; ++channel) {
    uint8_t& pixel = destination[channel * plane];
    const int source = static_cast<int>(color >> (8 * channel) & 255), below = pixel;
    int mixed = below;
    switch (blend.kind) {
      case Blend::Kind::kMix:
        mixed = (source * alpha + below * (255 - alpha) + 127) / 255;
        break;
      case Blend::Kind::kAdd:
        mixed = std::min(255, below + source * alpha / 255);
        break;
      case Blend::Kind::kSubtract:
        mixed = std::max(0, below - source * alpha / 255);
        break;
      case Blend::Kind::kDarken:
        mixed = below * (255 - alpha) / 255;
        break;
    }
    pixel = static_cast<uint8_t>(mixed);
  }
}

}  // namespace

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
      const ArtArchive::Color& color = archive_->palette(palette)[lit];
      made.push_back(color[0] | static_cast<uint32_t>(color[1]) << 8 | static_cast<uint32_t>(color[2]) << 16);
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
  uint8_t* red = destination;
  uint8_t* green = destination + plane;
  uint8_t* blue = destination + 2 * plane;
  const uint32_t* table = colors.colors;
  const uint32_t row_mask = colors.row_mask;
  const auto color_of = [=](uint32_t word) {
    return table[(word >> kAddressBits & row_mask) * 256 + texels[word & kAddressMask]];
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

void blend_layer(std::span<const uint32_t> layer, const PixelBox& box, const uint8_t* texels,
                 const PictureColors& colors, std::span<const Blend> blends, int width, std::size_t plane,
                 uint8_t* destination) {
  std::size_t next = 0;
  for (int row = box.top; row < box.bottom; ++row)
    for (int column = box.left; column < box.right; ++column) {
      const uint32_t word = layer[next++];
      if (word != 0)
        blend_pixel(word, texels, colors, blends, plane,
                    destination + static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
                        static_cast<std::size_t>(column));
    }
}

}  // namespace comrad::doom
