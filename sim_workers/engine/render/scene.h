// A level as the renderer sees it: vertices and lines in floats, textures resolved to places in the atlas.
// Heights, lights and floor textures are not here: they are read from the world's sectors at every draw, so
// doors and lifts need no update. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <unordered_map>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/map/level.h"
#include "sim_workers/engine/render/art_atlas.h"
#include "sim_workers/engine/world/world.h"

namespace comrad::doom {

/// One part of a side: its texture and how it is laid on.
struct ScenePart {
  bool present = false;
  AtlasRegion region;
  float offset_x = 0, offset_y = 0;  ///< the side's and its own, map units
  float scale_x = 1, scale_y = 1;    ///< texels per map unit
};

/// One side of a line with its textures; a part without texture is nothing.
struct SceneSide {
  uint32_t sidedef = 0, sector = 0;
  ScenePart top, middle, bottom;
  float contrast_rows = 0;  ///< walls along the axes are lit a little differently, as in Doom
  int light = 0;            ///< added to the sector's, or instead of it
  bool light_absolute = false;
};

/// Where a line lies: asked of every line near the eye, so apart from its textures.
struct LineShape {
  uint32_t start = 0, end = 0;  ///< vertices
  uint32_t front_sector = 0, back_sector = 0;
  float length = 0, texel_length = 0;  ///< textures are laid along the length in whole units
  bool two_sided = false;
};

struct SceneLine {
  bool upper_unpegged = false, lower_unpegged = false;
  bool wraps_middle = false, clips_middle = false;
  bool in_polyobject = false;
  float alpha = 1;  ///< of see-through middle textures
  bool additive = false;
  SceneSide front, back;
};

/// A floor's or ceiling's texture by name, as the level has it.
struct ScenePlane {
  std::string name;
  AtlasRegion region;
  bool sky = false;
};

class Scene {
 public:
  /// Resolves the textures of `level`, which the scene keeps alive. Unknown and broken textures become a
  /// checkerboard and a warning. Errors: kNoSpace for a full atlas.
  static Expected<std::unique_ptr<Scene>> create(std::shared_ptr<const Level> level, ArtAtlas* atlas);

  const Level& level() const { return *level_; }

  std::vector<float> vertex_x, vertex_y;
  std::vector<LineShape> shapes;  ///< [line]
  std::vector<SceneLine> lines;
  std::vector<uint32_t> sector_line_begin;   ///< [sector + 1] into sector_lines
  std::vector<uint32_t> sector_lines;        ///< lines that touch each sector, those of polyobjects left out
  std::vector<ScenePlane> floors, ceilings;  ///< [sector]
  AtlasRegion sky;
  bool has_sky = false;

  /// The plane for a texture name that a script has set since, from the atlas; a checkerboard where it
  /// is unknown.
  static ScenePlane plane(const std::string& name, ArtAtlas* atlas);
  /// The side with the textures that play has given it since.
  static SceneSide retextured(const SceneSide& side, const SideState& state, ArtAtlas* atlas);

 private:
  std::shared_ptr<const Level> level_;
};

/// Sprites of a catalog, loaded when they are first seen.
class SpriteTable {
 public:
  SpriteTable(std::shared_ptr<const ActorCatalog> catalog, ArtAtlas* atlas)
      : catalog_(std::move(catalog)), atlas_(atlas) {}

  const ActorCatalog& catalog() const { return *catalog_; }
  /// The eight sides of a sprite's frame (as of Actor::sprite and Actor::frame); null where it shows nothing.
  /// A sprite that no archive has is one warning.
  const SpriteSides* sides(uint32_t sprite, uint8_t frame, uint8_t translation = 0) {
    if (sprite == 0 || frame >= kFramesMax) return nullptr;  // sprite 0 is TNT1
    if (translation == 0) {
      const std::size_t slot = std::size_t{sprite} * kFramesMax + frame;
      if (slot < slots_.size() && slots_[slot] != kUnknown) return at(slots_[slot]);
    }
    return load(sprite, frame, translation);
  }
  bool atlas_full() const { return atlas_full_; }  ///< a sprite did not fit: the renderer starts anew

 private:
  static constexpr std::size_t kFramesMax = 29;  // letters A to ]
  static constexpr int32_t kUnknown = -2, kNone = -1;
  const SpriteSides* at(int32_t index) const {
    return index < 0 ? nullptr : &sides_[static_cast<std::size_t>(index)];
  }
  const SpriteSides* load(uint32_t sprite, uint8_t frame, uint8_t translation);

  std::shared_ptr<const ActorCatalog> catalog_;
  ArtAtlas* atlas_;
  std::vector<int32_t> slots_;                        // [sprite, frame] into sides_
  std::unordered_map<uint64_t, int32_t> translated_;  // slot and translation
  std::vector<SpriteSides> sides_;
  std::vector<bool> warned_;  // [sprite]
  bool atlas_full_ = false;
};

/// The name that means open sky.
constexpr const char* kSkyFlat = "F_SKY1";
/// The sky textures of a map, the first that exists is used: by number of the map, as Doom has it.
std::vector<std::string> sky_textures(const std::string& map_name);

}  // namespace comrad::doom
