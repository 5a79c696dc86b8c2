// All texels that a renderer draws from, in one sheet of palette indices: walls, flats and sprites side by
// side, so that everything draws with one texture bound. Filled when a level is registered, read by the
// rasterizer (as a texture) and by the pass that turns texel addresses into colours. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/play/world.h"
#include "sim_workers/engine/render/art_archive.h"

namespace comrad::doom {

constexpr int kAtlasWidthBits = 11;
constexpr int kAtlasWidth = 1 << kAtlasWidthBits;
constexpr int kAtlasHeightMax = 2048;
/// A texel's address is y << kAtlasWidthBits | x, 22 bits; the light row lies above it.
constexpr int kAddressBits = 22;
constexpr uint32_t kAddressMask = (1u << kAddressBits) - 1;
static_assert(kAtlasWidth * kAtlasHeightMax == 1 << kAddressBits);

/// Where an image lies in the atlas.
struct AtlasRegion {
  uint32_t address = 0;  ///< of its top left texel
  uint16_t width = 1, height = 1;
  bool masked = false;
};

/// A sprite picture with Doom's offsets.
struct SpriteArt {
  AtlasRegion region;
  int left_offset = 0, top_offset = 0;
};

/// The eight sides of one sprite frame; art[i] indexes into ArtAtlas::sprites(), -1 where the archive has
/// none.
struct SpriteSides {
  std::array<int32_t, 8> art{-1, -1, -1, -1, -1, -1, -1, -1};
  std::array<bool, 8> mirrored{};
};

class ArtAtlas {
 public:
  explicit ArtAtlas(std::shared_ptr<const ArtArchive> archive);

  /// Errors: kNotFound, kBadFormat from the archive; kNoSpace when the atlas is full.
  Expected<AtlasRegion> wall(std::string_view name);
  Expected<AtlasRegion> flat(std::string_view name);
  Expected<SpriteSides> sprite(std::string_view name, int letter_index);
  /// What stands in for an unknown texture.
  const AtlasRegion& checkerboard() const { return checkerboard_; }

  const std::vector<SpriteArt>& sprites() const { return sprites_; }
  const ArtArchive& archive() const { return *archive_; }
  const uint8_t* texels() const { return texels_.data(); }
  int height() const { return next_top_; }
  /// Grows by one whenever the texels change, so that the texture can be brought up to date.
  uint32_t version() const { return version_; }

 private:
  struct Shelf {
    int top = 0, height = 0, used_width = 0;
  };
  Expected<AtlasRegion> add(const IndexedImage& image);
  Expected<int32_t> sprite_lump(uint32_t lump);

  std::shared_ptr<const ArtArchive> archive_;
  std::vector<uint8_t> texels_;  // always the full size: any 22-bit address is inside
  std::vector<Shelf> shelves_;
  int next_top_ = 0;
  uint32_t version_ = 0;
  AtlasRegion checkerboard_;
  std::unordered_map<std::string, AtlasRegion> walls_, flats_;
  std::unordered_map<uint32_t, int32_t> sprite_of_lump_;
  std::vector<SpriteArt> sprites_;
};

}  // namespace comrad::doom
