#include "sim_workers/engine/render/scene.h"

#include <cmath>

#include "rollout_buffer/core/log.h"

namespace comrad::doom {
namespace {

constexpr float kContrastRows = 4.0f;  // 16 light levels of 256, in rows of the light table

/// A wall part's texture; false where there is none.
Expected<bool> resolve(const std::string& name, ArtAtlas* atlas, AtlasRegion* region) {
  if (name.empty() || name == "-") return false;
  const Expected<AtlasRegion> found = atlas->wall(name);
  if (found) {
    *region = *found;
    return true;
  }
  if (found.error().code != ErrorCode::kNotFound) return found.error();
  spdlog::warn("{}; it is drawn as a checkerboard", found.error().message);
  *region = atlas->checkerboard();
  return true;
}

Expected<SceneSide> resolve_side(const Sidedef& sidedef, ArtAtlas* atlas) {
  SceneSide side;
  side.sector = sidedef.sector_index;
  side.offset_x = static_cast<float>(sidedef.offset_x), side.offset_y = static_cast<float>(sidedef.offset_y);
  COMRAD_TRY_ASSIGN(side.has_top, resolve(sidedef.top, atlas, &side.top));
  COMRAD_TRY_ASSIGN(side.has_bottom, resolve(sidedef.bottom, atlas, &side.bottom));
  COMRAD_TRY_ASSIGN(side.has_middle, resolve(sidedef.middle, atlas, &side.middle));
  return side;
}

}  // namespace

ScenePlane Scene::plane(const std::string& name, ArtAtlas* atlas) {
  ScenePlane plane;
  plane.name = name;
  plane.sky = name == kSkyFlat;
  if (plane.sky) return plane;
  const Expected<AtlasRegion> found = atlas->flat(name);
  plane.region = found ? *found : atlas->checkerboard();
  if (!found) spdlog::warn("{}; it is drawn as a checkerboard", found.error().message);
  return plane;
}

Expected<std::unique_ptr<Scene>> Scene::create(std::shared_ptr<const Level> level, ArtAtlas* atlas) {
  auto scene = std::make_unique<Scene>();
  scene->level_ = level;
  for (const Vertex& vertex : level->vertices) {
    scene->vertex_x.push_back(to_float(vertex.x));
    scene->vertex_y.push_back(to_float(vertex.y));
  }
  for (const Linedef& linedef : level->linedefs) {
    SceneLine line;
    line.start = linedef.start, line.end = linedef.end;
    line.two_sided = linedef.back.has_value();
    line.upper_unpegged = (linedef.flags & kLineUpperUnpegged) != 0;
    line.lower_unpegged = (linedef.flags & kLineLowerUnpegged) != 0;
    const float dx = scene->vertex_x[line.end] - scene->vertex_x[line.start];
    const float dy = scene->vertex_y[line.end] - scene->vertex_y[line.start];
    line.length = std::sqrt(dx * dx + dy * dy);
    line.contrast_rows = dy == 0 ? kContrastRows : dx == 0 ? -kContrastRows : 0;
    COMRAD_TRY_ASSIGN(line.front, resolve_side(level->sidedefs[linedef.front], atlas));
    if (linedef.back) {
      COMRAD_TRY_ASSIGN(line.back, resolve_side(level->sidedefs[*linedef.back], atlas));
    }
    scene->lines.push_back(std::move(line));
  }
  for (const Sector& sector : level->sectors) {
    scene->floors.push_back(plane(sector.floor_texture, atlas));
    scene->ceilings.push_back(plane(sector.ceiling_texture, atlas));
    scene->has_sky = scene->has_sky || scene->floors.back().sky || scene->ceilings.back().sky;
  }
  for (const char* name : {"RSKY1", "SKY1"}) {
    const Expected<AtlasRegion> found = atlas->wall(name);
    scene->sky = found ? *found : atlas->checkerboard();
    if (found) break;
  }
  return scene;
}

Expected<std::unique_ptr<SpriteTable>> SpriteTable::create(std::shared_ptr<const ActorCatalog> catalog,
                                                           ArtAtlas* atlas, bool skip_missing) {
  auto table = std::make_unique<SpriteTable>();
  table->catalog_ = catalog;
  for (uint32_t index = 0; index < catalog->size(); ++index) {
    const ActorType& type = (*catalog)[index];
    table->first_.push_back(type.sprite.empty() ? -1 : static_cast<int32_t>(table->sides_.size()));
    table->count_.push_back(
        type.sprite.empty() ? 0 : static_cast<uint32_t>(std::max<std::size_t>(1, type.frames.size())));
    if (type.sprite.empty()) continue;
    for (uint32_t frame = 0; frame < table->count_.back(); ++frame) {
      const int letter = type.frames.empty() ? 0 : type.frames[frame].frame;
      const Expected<SpriteSides> sides = atlas->sprite(type.sprite, letter);
      if (!sides && !(skip_missing && sides.error().code == ErrorCode::kNotFound))
        return Error{sides.error().code, "actor " + type.name + ": " + sides.error().message +
                                             "; name a sprite that exists or add a PWAD with it"};
      table->sides_.push_back(sides ? *sides : SpriteSides{});
    }
  }
  return table;
}

}  // namespace comrad::doom
