// All texels that a renderer draws from, as palette indices: walls, flats and sprites. Once column by column, which the painter
// steps along, and once in one sheet, which OpenGL has as a texture and the pass that turns texel addresses into colours reads.
// Filled when a level is registered and when a sprite is first seen. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <cstdlib>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <unordered_map>
#include <utility>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// 33 cache lines: at a power of two the rows of a texture would compete for the same few places of a cache.
constexpr int kAtlasWidth = 2112;
constexpr int kAtlasHeightMax = 7943;
/// A texel's address is y * kAtlasWidth + x, 24 bits. Above it lie 5 bits of light row and 3 of tint
/// (or, in the blended layer, of blend).
constexpr int kAddressBits = 24;
constexpr uint32_t kAddressMask = (1u << kAddressBits) - 1;
constexpr int kTintShift = 29;
static_assert(kAtlasWidth * kAtlasHeightMax <= 1 << kAddressBits &&
              kAtlasWidth * (kAtlasHeightMax + 1) > 1 << kAddressBits);

/// Where an image lies in the atlas.
struct AtlasRegion {
  uint32_t address = 0;  ///< of its top left texel in the sheet
  uint32_t columns = 0;  ///< of its first column in ArtAtlas::columns()
  uint16_t width = 1, height = 1;
  bool masked = false;
};

/// A sprite picture with Doom's offsets.
struct SpriteArt {
  AtlasRegion region;
  int left_offset = 0, top_offset = 0;
};

/// The eight sides of one sprite frame; art[i] indexes into ArtAtlas::sprites(), where the archive has it.
struct SpriteSides {
  std::array<std::optional<uint32_t>, 8> art;
  std::array<bool, 8> mirrored{};
  bool rotates = false;
};

using Translation = std::array<uint8_t, 256>;  ///< of palette indices

class ArtAtlas {
 public:
  explicit ArtAtlas(std::shared_ptr<const ArtArchive> archive);

  /// Errors: kNotFound, kBadFormat from the archive; kNoSpace when the atlas is full.
  Expected<AtlasRegion> wall(std::string_view name);
  Expected<AtlasRegion> flat(std::string_view name);
  /// A sprite's frame, in other colours where `translation` is not null.
  Expected<SpriteSides> sprite(std::string_view name, int letter_index,
                               const Translation* translation = nullptr);
  /// What replaces an unknown texture.
  const AtlasRegion& checkerboard() const { return checkerboard_; }
  /// Forgets everything: what was handed out before shows something else from now on.
  void clear();

  const std::vector<SpriteArt>& sprites() const { return sprites_; }
  const ArtArchive& archive() const { return *archive_; }
  const uint8_t* texels() const { return texels_.get(); }
  /// The same images column by column, each from top to bottom and all of an image together.
  const uint8_t* columns() const { return columns_.data(); }
  int height() const { return next_top_; }
  /// Rows that changed since the last call, [first, second); first >= second for none.
  std::pair<int, int> take_changes() { return std::exchange(changed_, {kAtlasHeightMax, 0}); }

 private:
  struct Shelf {
    int top = 0, height = 0, used_width = 0;
  };
  struct Free {
    void operator()(uint8_t* bytes) const { std::free(bytes); }
  };
  Expected<AtlasRegion> add(const IndexedImage& image);
  Expected<uint32_t> sprite_lump(uint32_t lump, const Translation* translation);

  std::shared_ptr<const ArtArchive> archive_;
  std::unique_ptr<uint8_t, Free>
      texels_;  // the full size, so any address is inside; unused pages cost nothing
  std::vector<uint8_t> columns_;
  std::vector<Shelf> shelves_;
  int next_top_ = 0;
  std::pair<int, int> changed_{kAtlasHeightMax, 0};
  AtlasRegion checkerboard_;
  std::unordered_map<std::string, AtlasRegion> walls_, flats_;
  std::map<std::pair<uint32_t, std::string>, uint32_t> sprite_of_lump_;  // lump, translation
  std::vector<SpriteArt> sprites_;
};

}  // namespace comrad::doom
