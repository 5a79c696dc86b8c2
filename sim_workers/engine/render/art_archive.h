// The pictures of the IWAD and of PWADs that override it: palette, light tables, wall textures, flats,
// sprites and status bar graphics, decoded on demand into indexed images. Every offset of a lump is checked:
// a broken picture is an error that names the lump, never a read out of bounds. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/expected.h"

namespace comrad::doom {

constexpr int kPaletteCount = 14;   ///< PLAYPAL: 0 plain, 1..8 red, 9..12 gold, 13 radiation suit
constexpr int kLightRowCount = 32;  ///< COLORMAP rows from bright to dark
constexpr int kInverseRow = 32;     ///< COLORMAP row of the invulnerable: bright and dark change places
/// Palette index that means "nothing here" in a masked image; opaque texels of this index take a twin colour.
constexpr uint8_t kTransparentIndex = 0;

/// A picture of palette indices, row by row from the top.
struct IndexedImage {
  int width = 0, height = 0;
  int left_offset = 0,
      top_offset = 0;           ///< Doom's: the point of the picture that stands at the thing's position
  bool masked = false;          ///< has transparent texels
  std::vector<uint8_t> texels;  ///< [height, width]

  uint8_t at(int x, int y) const { return texels[static_cast<std::size_t>(y) * width + x]; }
};

/// Which lump shows a sprite frame from one side, and whether it is drawn mirrored.
struct SpriteView {
  uint32_t lump = 0;
  bool mirrored = false;
};

/// One frame of a sprite: the same view all round, or eight.
struct SpriteFrame {
  std::array<std::optional<SpriteView>, 8> views;  ///< [0] from the front, counter-clockwise from there
  bool rotates = false;
};

/// Decodes a picture in Doom's column format. `name` goes into the message.
/// Errors: kBadFormat for sizes beyond 2048, columns or posts outside the lump.
Expected<IndexedImage> decode_picture(std::span<const uint8_t> lump, std::string_view name);

class ArtArchive {
 public:
  /// Opens the IWAD at `iwad_path` (empty: $COMRAD_IWAD, then wad::find_iwad's places) and then every PWAD,
  /// whose lumps override those before. Errors: kNotFound without an IWAD; kBadFormat for a broken one
  /// (PLAYPAL, COLORMAP, PNAMES, TEXTURE1).
  static Expected<std::shared_ptr<const ArtArchive>> open(const std::string& iwad_path = {},
                                                          const std::vector<std::string>& pwad_paths = {});
  /// The same from bytes in memory, for tests and fuzzing: each element is one WAD.
  static Expected<std::shared_ptr<const ArtArchive>> from_bytes(std::vector<std::vector<uint8_t>> wads);

  using Color = std::array<uint8_t, 3>;
  const std::array<Color, 256>& palette(int index) const { return palettes_[index]; }
  /// Row 0..31 of the light table, or kInverseRow.
  const std::array<uint8_t, 256>& colormap(int row) const { return colormaps_[row]; }
  /// The index of palette 0, up to `last`, that is nearest to a colour; never kTransparentIndex.
  uint8_t nearest(Color color, std::size_t last = 255) const;

  // Wall textures and flats share one name space where a map uses the one for the other (as ZDoom allows):
  // wall() looks among the textures first, flat() among the flats first.
  bool has_surface(std::string_view name) const;
  Expected<IndexedImage> wall(std::string_view name) const;
  Expected<IndexedImage> flat(std::string_view name) const;
  /// A graphic by name: the status bar's, faces, letters; else a sprite's lump, a patch, a texture or a flat.
  Expected<IndexedImage> graphic(std::string_view name) const;
  /// The bytes of a lump outside the namespaces (fonts); empty where there is none.
  std::span<const uint8_t> bytes(std::string_view name) const;

  /// Frame `letter_index` (0 = A) of the four-letter sprite; nothing where no lump has it.
  const SpriteFrame* sprite(std::string_view name, int letter_index) const;
  Expected<IndexedImage> sprite_image(uint32_t lump) const;
  uint32_t lump_count() const { return static_cast<uint32_t>(lumps_.size()); }

 private:
  struct Lump {
    std::string name;
    std::span<const uint8_t> bytes;
  };
  struct TexturePatch {
    int x = 0, y = 0;
    uint32_t patch = 0;  ///< into the patch names of its WAD
  };
  struct Texture {
    int width = 0, height = 0;
    std::vector<TexturePatch> patches;
    std::shared_ptr<const std::vector<std::string>> patch_names;
  };

  struct Storage;  // keeps the mapped files or bytes behind the spans
  static Expected<std::shared_ptr<const ArtArchive>> build(std::shared_ptr<const Storage> storage);
  Status index_wad(std::span<const Lump> wad);
  Status read_palette();
  Status read_textures(std::span<const uint8_t> lump, std::string_view lump_name,
                       const std::shared_ptr<const std::vector<std::string>>& patch_names);
  void add_sprite_lump(uint32_t lump);
  Expected<IndexedImage> compose(const Texture& texture, std::string_view name) const;
  Expected<IndexedImage> picture(const Lump& lump) const;
  template <typename Plot>
  Expected<IndexedImage> plot_picture(std::span<const uint8_t> lump, std::string_view name,
                                      Plot&& plot) const;
  void finish(IndexedImage* image, const std::vector<bool>& covered) const;
  const Lump* find(std::string_view name) const;

  std::shared_ptr<const Storage> storage_;
  std::vector<Lump> lumps_;
  std::unordered_map<std::string, uint32_t> by_name_;  // last of a name wins
  std::unordered_map<std::string, uint32_t> flats_;
  std::unordered_map<std::string, uint32_t> patches_;  // P_START..P_END, where a name exists twice
  std::unordered_map<std::string, uint32_t> sprite_lumps_;
  std::unordered_map<std::string, uint32_t> textures_tx_;  // TX_START..TX_END: pictures that are textures
  std::unordered_map<std::string, Texture> textures_;
  std::map<std::string, std::map<int, SpriteFrame>, std::less<>> sprites_;
  std::array<std::array<Color, 256>, kPaletteCount> palettes_{};
  std::array<std::array<uint8_t, 256>, kLightRowCount + 1> colormaps_{};
  uint8_t twin_of_transparent_ = kTransparentIndex;
};

}  // namespace comrad::doom
