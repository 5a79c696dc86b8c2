#include "sim_workers/engine/render/art_atlas.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstring>

#include "rollout_buffer/core/check.h"

namespace comrad::doom {
namespace {

// One texel around each image repeats its other edge, so that a coordinate rounded up to the image's size
// shows what tiling would.
constexpr int kBorder = 1;

IndexedImage make_checkerboard() {
  IndexedImage image;
  image.width = image.height = 64;
  image.texels.resize(64 * 64);
  for (int y = 0; y < 64; ++y)
    for (int x = 0; x < 64; ++x)
      image.texels[static_cast<std::size_t>(y) * 64 + x] = ((x ^ y) & 16) ? 176 : 4;
  return image;
}

}  // namespace

ArtAtlas::ArtAtlas(std::shared_ptr<const ArtArchive> archive)
    : archive_(std::move(archive)),
      texels_(static_cast<uint8_t*>(std::calloc(std::size_t{1} << kAddressBits, 1))) {
  COMRAD_CHECK(texels_ != nullptr, "memory for the atlas of textures");
  clear();
}

void ArtAtlas::clear() {
  shelves_.clear(), columns_.clear(), walls_.clear(), flats_.clear(), sprite_of_lump_.clear(),
      sprites_.clear();
  next_top_ = 0;
  IndexedImage nothing;  // address 0 is what an undrawn pixel shows: index 0, Doom's black
  nothing.width = nothing.height = 1;
  nothing.texels = {0};
  (void)add(nothing);
  checkerboard_ = add(make_checkerboard()).value();
}

Expected<AtlasRegion> ArtAtlas::add(const IndexedImage& image) {
  const int width = image.width + kBorder, height = image.height + kBorder;
  if (width > kAtlasWidth)
    return Error{ErrorCode::kUnsupported,
                 fmt::format("a picture {} texels wide does not fit the atlas", image.width)};
  Shelf* best = nullptr;
  for (Shelf& shelf : shelves_) {
    if (shelf.height < height || shelf.used_width + width > kAtlasWidth ||
        shelf.height > height + height / 4 + 4)
      continue;
    if (best == nullptr || shelf.height < best->height) best = &shelf;
  }
  if (best == nullptr) {
    if (next_top_ + height > kAtlasHeightMax)
      return Error{ErrorCode::kNoSpace, fmt::format("the level's art does not fit the atlas of {}x{} texels",
                                                    kAtlasWidth, kAtlasHeightMax)};
    shelves_.push_back({.top = next_top_, .height = height, .used_width = 0});
    next_top_ += height;
    best = &shelves_.back();
  }
  const int left = best->used_width, top = best->top;
  best->used_width += width;
  for (int y = 0; y < height; ++y) {
    uint8_t* row = texels_.get() + static_cast<std::size_t>(top + y) * kAtlasWidth + left;
    const uint8_t* source = image.texels.data() + static_cast<std::size_t>(y % image.height) * image.width;
    std::memcpy(row, source, static_cast<std::size_t>(image.width));
    row[image.width] = source[0];
  }
  changed_ = {std::min(changed_.first, top), std::max(changed_.second, top + height)};
  AtlasRegion region;
  region.address = static_cast<uint32_t>(top) * kAtlasWidth + static_cast<uint32_t>(left);
  region.width = static_cast<uint16_t>(image.width), region.height = static_cast<uint16_t>(image.height);
  region.masked = image.masked;
  region.columns = static_cast<uint32_t>(columns_.size());
  for (int x = 0; x < image.width; ++x)
    for (int y = 0; y < image.height; ++y)
      columns_.push_back(image.texels[static_cast<std::size_t>(y) * image.width + x]);
  return region;
}

Expected<AtlasRegion> ArtAtlas::wall(std::string_view name) {
  const std::string key(name);
  if (const auto found = walls_.find(key); found != walls_.end()) return found->second;
  COMRAD_TRY_ASSIGN(const IndexedImage image, archive_->wall(name));
  COMRAD_TRY_ASSIGN(const AtlasRegion region, add(image));
  walls_.emplace(key, region);
  return region;
}

Expected<AtlasRegion> ArtAtlas::flat(std::string_view name) {
  const std::string key(name);
  if (const auto found = flats_.find(key); found != flats_.end()) return found->second;
  COMRAD_TRY_ASSIGN(const IndexedImage image, archive_->flat(name));
  COMRAD_TRY_ASSIGN(const AtlasRegion region, add(image));
  flats_.emplace(key, region);
  return region;
}

Expected<uint32_t> ArtAtlas::sprite_lump(uint32_t lump, const Translation* translation) {
  std::pair<uint32_t, std::string> key(lump, {});
  if (translation != nullptr) key.second.assign(translation->begin(), translation->end());
  if (const auto found = sprite_of_lump_.find(key); found != sprite_of_lump_.end()) return found->second;
  COMRAD_TRY_ASSIGN(IndexedImage image, archive_->sprite_image(lump));
  if (translation != nullptr) {
    for (uint8_t& texel : image.texels) {
      if (texel == kTransparentIndex) continue;
      const uint8_t other = (*translation)[texel];
      texel = other == kTransparentIndex ? archive_->nearest(archive_->palette(0)[kTransparentIndex]) : other;
    }
  }
  COMRAD_TRY_ASSIGN(const AtlasRegion region, add(image));
  const auto index = static_cast<uint32_t>(sprites_.size());
  sprites_.push_back({.region = region, .left_offset = image.left_offset, .top_offset = image.top_offset});
  sprite_of_lump_.emplace(std::move(key), index);
  return index;
}

Expected<SpriteSides> ArtAtlas::sprite(std::string_view name, int letter_index,
                                       const Translation* translation) {
  const SpriteFrame* frame = archive_->sprite(name, letter_index);
  if (frame == nullptr)
    return Error{ErrorCode::kNotFound, "no sprite " + std::string(name) + " frame " +
                                           std::string(1, static_cast<char>('A' + letter_index)) +
                                           " in the IWAD or the PWADs"};
  SpriteSides sides;
  sides.rotates = frame->rotates;
  for (std::size_t side = 0; side < 8; ++side) {
    if (!frame->views[side]) continue;
    COMRAD_TRY_ASSIGN(sides.art[side], sprite_lump(frame->views[side]->lump, translation));
    sides.mirrored[side] = frame->views[side]->mirrored;
  }
  return sides;
}

}  // namespace comrad::doom
