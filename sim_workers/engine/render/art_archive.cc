#include "sim_workers/engine/render/art_archive.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cctype>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <utility>

#include "doomgen/wad/iwad_search.h"
#include "doomgen/wad/wad_reader.h"
#include "sim_workers/engine/render/png_image.h"

namespace comrad::doom {
namespace {

constexpr int kMaxPictureSize = 2048;  // an atlas holds no wider ones

/// Little-endian reads that stay inside the lump.
class LumpCursor {
 public:
  explicit LumpCursor(std::span<const uint8_t> bytes) : bytes_(bytes) {}
  bool holds(std::size_t offset, std::size_t count) const {
    return offset <= bytes_.size() && count <= bytes_.size() - offset;
  }
  int16_t i16(std::size_t offset) const {
    return static_cast<int16_t>(static_cast<uint16_t>(bytes_[offset] | (bytes_[offset + 1] << 8)));
  }
  uint16_t u16(std::size_t offset) const { return static_cast<uint16_t>(i16(offset)); }
  uint32_t u32(std::size_t offset) const {
    return static_cast<uint32_t>(u16(offset)) | static_cast<uint32_t>(u16(offset + 2)) << 16;
  }
  uint8_t u8(std::size_t offset) const { return bytes_[offset]; }
  std::string name(std::size_t offset) const {
    std::string text;
    for (std::size_t i = 0; i < 8 && bytes_[offset + i] != 0; ++i)
      text.push_back(static_cast<char>(std::toupper(bytes_[offset + i])));
    return text;
  }

 private:
  std::span<const uint8_t> bytes_;
};

std::string upper(std::string_view text) {
  std::string result(text);
  for (char& letter : result) letter = static_cast<char>(std::toupper(static_cast<unsigned char>(letter)));
  return result;
}

Error broken(std::string_view lump, const std::string& what) {
  return Error{ErrorCode::kBadFormat, "lump " + std::string(lump) + ": " + what};
}

/// Reads the columns of a picture lump and hands every opaque texel to plot(x, y, index).
template <typename Plot>
Expected<IndexedImage> read_picture(std::span<const uint8_t> lump, std::string_view name, Plot&& plot) {
  const LumpCursor cursor(lump);
  if (!cursor.holds(0, 8)) return broken(name, "shorter than a picture header");
  IndexedImage image;
  image.width = cursor.u16(0), image.height = cursor.u16(2);
  image.left_offset = cursor.i16(4), image.top_offset = cursor.i16(6);
  if (image.width < 1 || image.height < 1 || image.width > kMaxPictureSize || image.height > kMaxPictureSize)
    return broken(name, fmt::format("a picture of {}x{} texels is not supported", image.width, image.height));
  if (!cursor.holds(8, 4 * static_cast<std::size_t>(image.width)))
    return broken(name, "the column table reaches past the end");
  // Posts may overlap, but a lump that draws everything over and over is no picture.
  int64_t budget = int64_t{4} * image.width * image.height + 1024;
  for (int x = 0; x < image.width; ++x) {
    std::size_t offset = cursor.u32(8 + 4 * static_cast<std::size_t>(x));
    int top = -1;
    while (true) {
      if (!cursor.holds(offset, 1)) return broken(name, fmt::format("column {} has no end", x));
      const int delta = cursor.u8(offset);
      if (delta == 0xFF) break;
      if (!cursor.holds(offset, 4)) return broken(name, fmt::format("column {} is cut short", x));
      const int length = cursor.u8(offset + 1);
      if (!cursor.holds(offset + 3, static_cast<std::size_t>(length) + 1))
        return broken(name, fmt::format("a post of column {} reaches past the end", x));
      budget -= length + 1;
      if (budget < 0) return broken(name, "its posts overlap too often");
      top =
          delta <= top ? top + delta : delta;  // tall pictures: a smaller start is relative to the last post
      for (int i = 0; i < length; ++i)
        if (top + i < image.height) plot(x, top + i, cursor.u8(offset + 3 + static_cast<std::size_t>(i)));
      offset += static_cast<std::size_t>(length) + 4;
    }
  }
  return image;
}

}  // namespace

Expected<IndexedImage> decode_picture(std::span<const uint8_t> lump, std::string_view name) {
  struct Texel {
    int x, y;
    uint8_t index;
  };
  std::vector<Texel> plotted;
  COMRAD_TRY_ASSIGN(IndexedImage image, read_picture(lump, name, [&](int x, int y, uint8_t index) {
                      plotted.push_back({x, y, index});
                    }));
  image.masked = true;
  image.texels.assign(static_cast<std::size_t>(image.width) * image.height, kTransparentIndex);
  for (const Texel& texel : plotted)
    image.texels[static_cast<std::size_t>(texel.y) * image.width + texel.x] = texel.index;
  return image;
}

/// The same for whatever a lump holds: Doom's columns, or a PNG whose colours go to the nearest of
/// the palette.
template <typename Plot>
Expected<IndexedImage> ArtArchive::plot_picture(std::span<const uint8_t> lump, std::string_view name,
                                                Plot&& plot) const {
  if (!is_png(lump)) return read_picture(lump, name, plot);
  COMRAD_TRY_ASSIGN(const RgbaImage source, decode_png(lump, name));
  IndexedImage image;
  image.width = source.width, image.height = source.height;
  image.left_offset = source.left_offset, image.top_offset = source.top_offset;
  std::unordered_map<uint32_t, uint8_t> known;  // pictures have few colours
  const uint8_t* texel = source.rgba.data();
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x, texel += 4) {
      if (texel[3] < 128) continue;
      const uint32_t key = uint32_t{texel[0]} << 16 | uint32_t{texel[1]} << 8 | texel[2];
      auto found = known.find(key);
      if (found == known.end()) found = known.emplace(key, nearest({texel[0], texel[1], texel[2]})).first;
      plot(x, y, found->second);
    }
  }
  return image;
}

struct ArtArchive::Storage {
  std::vector<wad::WadFile> wads;
};

Expected<std::shared_ptr<const ArtArchive>> ArtArchive::open(const std::string& iwad_path,
                                                             const std::vector<std::string>& pwad_paths) {
  COMRAD_TRY_ASSIGN(const std::string path, wad::find_iwad(iwad_path));
  auto storage = std::make_shared<Storage>();
  COMRAD_TRY_ASSIGN(wad::WadFile iwad, wad::WadFile::open(path));
  storage->wads.push_back(std::move(iwad));
  for (const std::string& pwad_path : pwad_paths) {
    COMRAD_TRY_ASSIGN(wad::WadFile pwad, wad::WadFile::open(pwad_path));
    storage->wads.push_back(std::move(pwad));
  }
  return build(std::move(storage));
}

Expected<std::shared_ptr<const ArtArchive>> ArtArchive::from_bytes(std::vector<std::vector<uint8_t>> wads) {
  auto storage = std::make_shared<Storage>();
  for (std::vector<uint8_t>& bytes : wads) {
    COMRAD_TRY_ASSIGN(wad::WadFile wad, wad::WadFile::from_bytes(std::move(bytes), "memory"));
    storage->wads.push_back(std::move(wad));
  }
  return build(std::move(storage));
}

Expected<std::shared_ptr<const ArtArchive>> ArtArchive::build(std::shared_ptr<const Storage> storage) {
  auto archive = std::make_shared<ArtArchive>();
  archive->storage_ = std::move(storage);
  for (const wad::WadFile& wad : archive->storage_->wads) {
    std::vector<Lump> lumps;
    lumps.reserve(wad.lump_count());
    for (std::size_t i = 0; i < wad.lump_count(); ++i) lumps.push_back({wad.lump(i).name, wad.bytes(i)});
    COMRAD_TRY(archive->index_wad(lumps));
  }
  COMRAD_TRY(archive->read_palette());
  return std::shared_ptr<const ArtArchive>(std::move(archive));
}

Status ArtArchive::index_wad(std::span<const Lump> wad) {
  enum class Space { kNone, kFlats, kSprites, kPatches, kTextures };
  Space space = Space::kNone;
  std::unordered_map<std::string, std::span<const uint8_t>> tables;
  for (const Lump& lump : wad) {
    const auto index = static_cast<uint32_t>(lumps_.size());
    lumps_.push_back(lump);
    // F_START and FF_START open the same namespace (PWADs double the letter); inner markers such as F1_START
    // stay in.
    const std::string& name = lump.name;
    const auto is = [&](const char* single, const char* twice) { return name == single || name == twice; };
    if (is("F_START", "FF_START"))
      space = Space::kFlats;
    else if (is("S_START", "SS_START"))
      space = Space::kSprites;
    else if (is("P_START", "PP_START"))
      space = Space::kPatches;
    else if (name == "TX_START")
      space = Space::kTextures;
    else if (is("F_END", "FF_END") || is("S_END", "SS_END") || is("P_END", "PP_END") || name == "TX_END")
      space = Space::kNone;
    else if (space == Space::kFlats)
      flats_[name] = index;
    else if (space == Space::kSprites)
      add_sprite_lump(index), sprite_lumps_[name] = index;
    else if (space == Space::kPatches)
      patches_[name] = index;
    else if (space == Space::kTextures)
      textures_tx_[name] = index;
    else
      by_name_[name] = index;
    if (name == "PNAMES" || name == "TEXTURE1" || name == "TEXTURE2") tables[name] = lump.bytes;
  }
  if (tables.contains("TEXTURE1") || tables.contains("TEXTURE2")) {
    auto names = std::make_shared<std::vector<std::string>>();
    const Lump* inherited = find("PNAMES");
    if (inherited == nullptr) return broken("PNAMES", "missing beside TEXTURE1");
    const LumpCursor cursor(inherited->bytes);
    if (!cursor.holds(0, 4)) return broken("PNAMES", "shorter than its count");
    const uint32_t count = cursor.u32(0);
    if (count > 1u << 20 || !cursor.holds(4, std::size_t{8} * count))
      return broken("PNAMES", fmt::format("its count of {} names reaches past the end", count));
    for (uint32_t i = 0; i < count; ++i) names->push_back(cursor.name(4 + std::size_t{8} * i));
    for (const char* table : {"TEXTURE1", "TEXTURE2"})
      if (tables.contains(table)) COMRAD_TRY(read_textures(tables[table], table, names));
  }
  return {};
}

Status ArtArchive::read_palette() {
  const Lump* palette = find("PLAYPAL");
  const Lump* colormap = find("COLORMAP");
  if (palette == nullptr || palette->bytes.size() < kPaletteCount * 768)
    return broken("PLAYPAL", palette == nullptr ? "missing: this is no IWAD" : "shorter than 14 palettes");
  if (colormap == nullptr || colormap->bytes.size() < kLightRowCount * 256)
    return broken("COLORMAP", colormap == nullptr ? "missing: this is no IWAD" : "shorter than 32 rows");
  for (int index = 0; index < kPaletteCount; ++index)
    std::memcpy(palettes_[index].data(), palette->bytes.data() + index * 768, 768);
  for (int row = 0; row < kLightRowCount; ++row)
    std::memcpy(colormaps_[row].data(), colormap->bytes.data() + row * 256, 256);
  colormaps_[kInverseRow] = colormaps_[0];
  if (colormap->bytes.size() >= (kInverseRow + 1) * 256)
    std::memcpy(colormaps_[kInverseRow].data(), colormap->bytes.data() + kInverseRow * 256, 256);
  twin_of_transparent_ = nearest(palettes_[0][kTransparentIndex]);
  return {};
}

uint8_t ArtArchive::nearest(Color color, std::size_t last) const {
  uint8_t best = 1;
  int best_distance = INT32_MAX;
  for (std::size_t index = 1; index <= last; ++index) {
    int distance = 0;
    for (std::size_t channel = 0; channel < 3; ++channel) {
      const int difference = int{palettes_[0][index][channel]} - int{color[channel]};
      distance += difference * difference;
    }
    if (distance < best_distance) best_distance = distance, best = static_cast<uint8_t>(index);
  }
  return best;
}

Status ArtArchive::read_textures(std::span<const uint8_t> lump, std::string_view lump_name,
                                 const std::shared_ptr<const std::vector<std::string>>& patch_names) {
  const LumpCursor cursor(lump);
  if (!cursor.holds(0, 4)) return broken(lump_name, "shorter than its count");
  const uint32_t count = cursor.u32(0);
  if (count > 1u << 20 || !cursor.holds(4, std::size_t{4} * count))
    return broken(lump_name, fmt::format("its count of {} textures reaches past the end", count));
  for (uint32_t i = 0; i < count; ++i) {
    const std::size_t offset = cursor.u32(4 + std::size_t{4} * i);
    if (!cursor.holds(offset, 22)) return broken(lump_name, fmt::format("texture {} lies past the end", i));
    Texture texture;
    const std::string name = cursor.name(offset);
    texture.width = cursor.u16(offset + 12), texture.height = cursor.u16(offset + 14);
    if (texture.width < 1 || texture.height < 1 || texture.width > kMaxPictureSize ||
        texture.height > kMaxPictureSize)
      return broken(lump_name, "texture " + name + " has no usable size");
    const std::size_t patch_count = cursor.u16(offset + 20);
    if (!cursor.holds(offset + 22, patch_count * 10))
      return broken(lump_name, "the patches of texture " + name + " lie past the end");
    for (std::size_t p = 0; p < patch_count; ++p) {
      const std::size_t at = offset + 22 + p * 10;
      const uint32_t patch = cursor.u16(at + 4);
      if (patch >= patch_names->size())
        return broken(lump_name,
                      fmt::format("texture {} names patch {} of {}", name, patch, patch_names->size()));
      texture.patches.push_back({.x = cursor.i16(at), .y = cursor.i16(at + 2), .patch = patch});
    }
    texture.patch_names = patch_names;
    textures_[name] = std::move(texture);  // a PWAD's texture replaces the IWAD's
  }
  return {};
}

void ArtArchive::add_sprite_lump(uint32_t lump) {
  // TROOA2A8: sprite TROO, frame A seen from side 2, and mirrored the same lump as frame A from side 8.
  const std::string& name = lumps_[lump].name;
  if (name.size() != 6 && name.size() != 8) return;
  for (std::size_t at = 4; at + 1 < name.size(); at += 2) {
    const int letter = name[at] - 'A', side = name[at + 1] - '0';
    if (letter < 0 || letter > 28 || side < 0 || side > 8) return;
    SpriteFrame& frame = sprites_[name.substr(0, 4)][letter];
    const SpriteView view{.lump = lump, .mirrored = at > 4};
    if (side == 0) {
      frame.rotates = false;
      frame.views.fill(view);
    } else {
      frame.rotates = true;
      frame.views[static_cast<std::size_t>(side - 1)] = view;
    }
  }
}

const ArtArchive::Lump* ArtArchive::find(std::string_view name) const {
  const auto found = by_name_.find(upper(name));
  return found == by_name_.end() ? nullptr : &lumps_[found->second];
}

/// Opaque texels must not carry the index that means transparent.
void ArtArchive::finish(IndexedImage* image, const std::vector<bool>& covered) const {
  image->masked = false;
  for (std::size_t i = 0; i < image->texels.size(); ++i) {
    if (!covered[i]) {
      image->texels[i] = kTransparentIndex;
      image->masked = true;
    } else if (image->texels[i] == kTransparentIndex) {
      image->texels[i] = twin_of_transparent_;
    }
  }
}

Expected<IndexedImage> ArtArchive::sprite_image(uint32_t lump) const {
  if (lump >= lumps_.size()) return Error{ErrorCode::kNotFound, fmt::format("no lump number {}", lump)};
  return picture(lumps_[lump]);
}

Expected<IndexedImage> ArtArchive::picture(const Lump& lump) const {
  std::vector<std::array<int, 3>> plotted;
  COMRAD_TRY_ASSIGN(IndexedImage image, plot_picture(lump.bytes, lump.name, [&](int x, int y, uint8_t index) {
                      plotted.push_back({x, y, index});
                    }));
  image.texels.assign(static_cast<std::size_t>(image.width) * image.height, kTransparentIndex);
  std::vector<bool> covered(image.texels.size(), false);
  for (const auto& [x, y, index] : plotted) {
    const std::size_t at = static_cast<std::size_t>(y) * image.width + x;
    image.texels[at] = static_cast<uint8_t>(index);
    covered[at] = true;
  }
  finish(&image, covered);
  return image;
}

Expected<IndexedImage> ArtArchive::compose(const Texture& texture, std::string_view name) const {
  IndexedImage image;
  image.width = texture.width, image.height = texture.height;
  image.texels.assign(static_cast<std::size_t>(image.width) * image.height, kTransparentIndex);
  std::vector<bool> covered(image.texels.size(), false);
  for (const TexturePatch& part : texture.patches) {
    const std::string& patch_name = (*texture.patch_names)[part.patch];
    const auto among_patches = patches_.find(patch_name);
    const Lump* lump = among_patches != patches_.end() ? &lumps_[among_patches->second] : find(patch_name);
    if (lump == nullptr) continue;  // as Doom's descendants do: the texture keeps a hole
    const auto drawn = plot_picture(lump->bytes, patch_name, [&](int x, int y, uint8_t index) {
      const int to_x = x + part.x, to_y = y + part.y;
      if (to_x < 0 || to_y < 0 || to_x >= image.width || to_y >= image.height) return;
      const std::size_t at = static_cast<std::size_t>(to_y) * image.width + to_x;
      image.texels[at] = index;
      covered[at] = true;
    });
    if (!drawn)
      return Error{drawn.error().code, "texture " + std::string(name) + ": " + drawn.error().message};
  }
  finish(&image, covered);
  return image;
}

bool ArtArchive::has_surface(std::string_view name) const {
  const std::string key = upper(name);
  return textures_.contains(key) || flats_.contains(key) || textures_tx_.contains(key);
}

Expected<IndexedImage> ArtArchive::wall(std::string_view name) const {
  const std::string key = upper(name);
  if (const auto found = textures_tx_.find(key); found != textures_tx_.end())
    return sprite_image(found->second);
  if (const auto found = textures_.find(key); found != textures_.end()) return compose(found->second, key);
  if (flats_.contains(key)) return flat(key);
  return Error{ErrorCode::kNotFound, "no texture named " + key + " in the IWAD or the PWADs"};
}

Expected<IndexedImage> ArtArchive::flat(std::string_view name) const {
  const std::string key = upper(name);
  const auto found = flats_.find(key);
  if (found == flats_.end()) {
    if (textures_.contains(key) || textures_tx_.contains(key)) return wall(key);
    return Error{ErrorCode::kNotFound, "no flat named " + key + " in the IWAD or the PWADs"};
  }
  const std::span<const uint8_t> bytes = lumps_[found->second].bytes;
  if (is_png(bytes)) return picture(lumps_[found->second]);
  int side = 64;  // larger squares are ZDoom's high-resolution flats
  for (int larger : {128, 256, 512})
    if (bytes.size() == static_cast<std::size_t>(larger) * larger) side = larger;
  if (bytes.size() < static_cast<std::size_t>(side) * side) return broken(key, "shorter than a 64x64 flat");
  IndexedImage image;
  image.width = image.height = side;
  image.texels.assign(bytes.begin(), bytes.begin() + static_cast<std::ptrdiff_t>(side) * side);
  return image;
}

Expected<IndexedImage> ArtArchive::graphic(std::string_view name) const {
  const std::string key = upper(name);
  if (const auto found = by_name_.find(key); found != by_name_.end()) return picture(lumps_[found->second]);
  if (const auto found = sprite_lumps_.find(key); found != sprite_lumps_.end())
    return picture(lumps_[found->second]);
  if (const auto found = patches_.find(key); found != patches_.end()) return picture(lumps_[found->second]);
  if (has_surface(key)) return wall(key);
  return Error{ErrorCode::kNotFound, "no graphic named " + key + " in the IWAD or the PWADs"};
}

std::span<const uint8_t> ArtArchive::bytes(std::string_view name) const {
  const Lump* lump = find(name);
  return lump == nullptr ? std::span<const uint8_t>{} : lump->bytes;
}

const SpriteFrame* ArtArchive::sprite(std::string_view name, int letter_index) const {
  const auto found = sprites_.find(upper(name));
  if (found == sprites_.end()) return nullptr;
  const auto frame = found->second.find(letter_index);
  return frame == found->second.end() ? nullptr : &frame->second;
}

}  // namespace comrad::doom
