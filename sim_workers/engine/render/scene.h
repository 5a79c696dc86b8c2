// A level as the renderer sees it: vertices and lines in floats, textures resolved to places in the atlas.
// Heights, lights and floor textures are not here: they are read from the world's sectors at every draw, so
// doors and lifts need no update. Stage: render.
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/map/level.h"
#include "sim_workers/engine/play/world.h"
#include "sim_workers/engine/render/art_atlas.h"

namespace comrad::doom {

/// One side of a line with its textures; a part without texture is nothing.
struct SceneSide {
  uint32_t sector = 0;
  float offset_x = 0, offset_y = 0;
  bool has_top = false, has_bottom = false, has_middle = false;
  AtlasRegion top, bottom, middle;
};

struct SceneLine {
  uint32_t start = 0, end = 0;
  bool two_sided = false, upper_unpegged = false, lower_unpegged = false;
  float length = 0;
  float contrast_rows = 0;  ///< walls along the axes are lit a little differently, as in Doom
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
  /// Resolves the textures of `level`, which the scene keeps alive. Unknown textures become a checkerboard
  /// and a warning. Errors: kBadFormat for broken pictures, kNoSpace for a full atlas.
  static Expected<std::unique_ptr<Scene>> create(std::shared_ptr<const Level> level, ArtAtlas* atlas);

  const Level& level() const { return *level_; }

  std::vector<float> vertex_x, vertex_y;
  std::vector<SceneLine> lines;
  std::vector<ScenePlane> floors, ceilings;  ///< [sector]
  AtlasRegion sky;
  bool has_sky = false;

  /// The plane for a texture name that a script has set since, from the atlas; a checkerboard where it is
  /// unknown.
  static ScenePlane plane(const std::string& name, ArtAtlas* atlas);

 private:
  std::shared_ptr<const Level> level_;
};

/// Sprites of a catalog, resolved: sides(type, frame) for Actor::type and Actor::frame_index.
class SpriteTable {
 public:
  /// Errors: kNotFound naming the actor and the sprite that no archive has. The table is usable even then
  /// (the sprites that are missing are left out).
  static Expected<std::unique_ptr<SpriteTable>> create(std::shared_ptr<const ActorCatalog> catalog,
                                                       ArtAtlas* atlas, bool skip_missing);
  const ActorCatalog& catalog() const { return *catalog_; }
  /// Null where the actor is invisible.
  const SpriteSides* sides(uint32_t type, uint32_t frame) const {
    if (type >= first_.size() || first_[type] < 0) return nullptr;
    const uint32_t count = count_[type];
    return &sides_[static_cast<std::size_t>(first_[type]) + (frame < count ? frame : 0)];
  }

 private:
  std::shared_ptr<const ActorCatalog> catalog_;
  std::vector<int32_t> first_;   // [type] into sides_, -1 invisible
  std::vector<uint32_t> count_;  // [type] frames
  std::vector<SpriteSides> sides_;
};

/// The name that means open sky.
constexpr const char* kSkyFlat = "F_SKY1";

}  // namespace comrad::doom
