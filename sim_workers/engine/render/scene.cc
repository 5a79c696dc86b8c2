#include "sim_workers/engine/render/scene.h"

#include <spdlog/fmt/fmt.h>

#include <cmath>
#include <cstdio>

#include "rollout_buffer/core/log.h"

namespace comrad::doom {
namespace {

constexpr float kContrastRows = 4.0f;  // 16 light levels of 256, in rows of the light table

/// A wall part's texture. Errors: kNoSpace.
Status resolve(const std::string& name, ArtAtlas* atlas, ScenePart* part) {
  part->present = !name.empty() && name != "-";
  if (!part->present) return {};
  const Expected<AtlasRegion> found = atlas->wall(name);
  if (!found && found.error().code == ErrorCode::kNoSpace) return found.error();
  if (!found) spdlog::warn("{}; it is drawn as a checkerboard", found.error().message);
  part->region = found ? *found : atlas->checkerboard();
  return {};
}

/// Offsets and scale of a part; a scale of zero or below would divide by it.
void place(const Sidedef& sidedef, SideTexture which, ScenePart* part) {
  const SidePart& own = sidedef.parts[static_cast<std::size_t>(which)];
  const auto usable = [](float scale) { return scale > 1e-3f && scale < 1e3f ? scale : 1.0f; };
  part->offset_x = static_cast<float>(sidedef.offset_x) + to_float(own.offset_x);
  part->offset_y = static_cast<float>(sidedef.offset_y) + to_float(own.offset_y);
  part->scale_x = usable(own.scale_x), part->scale_y = usable(own.scale_y);
}

/// The angle between a wall and the x axis, 0 to pi/2; rounded from double, so that every C library gives the same.
float slope_of(double dx, double dy) { return static_cast<float>(std::atan2(std::abs(dy), std::abs(dx))); }

Expected<SceneSide> resolve_side(const Level& level, uint32_t index, float dx, float dy, ArtAtlas* atlas) {
  const Sidedef& sidedef = level.sidedefs[index];
  SceneSide side;
  side.sidedef = index, side.sector = sidedef.sector_index;
  place(sidedef, kSideTop, &side.top);
  place(sidedef, kSideMiddle, &side.middle);
  place(sidedef, kSideBottom, &side.bottom);
  COMRAD_TRY(resolve(sidedef.top, atlas, &side.top));
  COMRAD_TRY(resolve(sidedef.middle, atlas, &side.middle));
  COMRAD_TRY(resolve(sidedef.bottom, atlas, &side.bottom));
  side.light = sidedef.light, side.light_absolute = (sidedef.flags & kSideLightAbsolute) != 0;
  if ((sidedef.flags & kSideNoFakeContrast) != 0)
    side.contrast_rows = 0;
  else if ((sidedef.flags & kSideSmoothLighting) != 0 && (dx != 0 || dy != 0))
    side.contrast_rows = kContrastRows * (1.0f - 4.0f / 3.14159265f * slope_of(dx, dy));
  else
    side.contrast_rows = dy == 0 ? kContrastRows : dx == 0 ? -kContrastRows : 0;
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

SceneSide Scene::retextured(const SceneSide& side, const SideState& state, ArtAtlas* atlas) {
  SceneSide changed = side;
  (void)resolve(state.top, atlas, &changed.top);
  (void)resolve(state.middle, atlas, &changed.middle);
  (void)resolve(state.bottom, atlas, &changed.bottom);
  return changed;
}

std::vector<std::string> sky_textures(const std::string& map_name) {
  int episode = 0, map = 0;
  int sky = 1;
  if (std::sscanf(map_name.c_str(), "MAP%d", &map) == 1)
    sky = map >= 21 ? 3 : map >= 12 ? 2 : 1;
  else if (std::sscanf(map_name.c_str(), "E%dM%d", &episode, &map) == 2 && episode >= 1 && episode <= 4)
    sky = episode;
  std::vector<std::string> names;
  for (const char* prefix : {"RSKY", "SKY"}) names.push_back(fmt::format("{}{}", prefix, sky));
  if (sky != 1) names.insert(names.end(), {"RSKY1", "SKY1"});
  return names;
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
    LineShape shape;
    shape.start = linedef.start, shape.end = linedef.end;
    shape.two_sided = linedef.back.has_value();
    line.upper_unpegged = (linedef.flags & kLineUpperUnpegged) != 0;
    line.lower_unpegged = (linedef.flags & kLineLowerUnpegged) != 0;
    line.wraps_middle = (linedef.flags & kLineWrapMidtex) != 0 ||
                        (level->sidedefs[linedef.front].flags & kSideWrapMiddle) != 0;
    line.clips_middle = (linedef.flags & kLineClipMidtex) != 0 ||
                        (level->sidedefs[linedef.front].flags & kSideClipMiddle) != 0;
    line.in_polyobject = linedef.in_polyobject;
    line.alpha = linedef.alpha, line.additive = linedef.additive;
    const float dx = scene->vertex_x[shape.end] - scene->vertex_x[shape.start];
    const float dy = scene->vertex_y[shape.end] - scene->vertex_y[shape.start];
    shape.length = std::sqrt(dx * dx + dy * dy), shape.texel_length = std::round(shape.length);
    COMRAD_TRY_ASSIGN(line.front, resolve_side(*level, linedef.front, dx, dy, atlas));
    if (linedef.back) {
      COMRAD_TRY_ASSIGN(line.back, resolve_side(*level, *linedef.back, dx, dy, atlas));
    }
    shape.front_sector = line.front.sector, shape.back_sector = line.back.sector;
    scene->shapes.push_back(shape);
    scene->lines.push_back(std::move(line));
  }
  std::vector<std::vector<uint32_t>> touching(level->sectors.size());
  for (uint32_t index = 0; index < scene->lines.size(); ++index) {
    const LineShape& shape = scene->shapes[index];
    if (scene->lines[index].in_polyobject) continue;
    touching[shape.front_sector].push_back(index);
    if (shape.two_sided && shape.back_sector != shape.front_sector)
      touching[shape.back_sector].push_back(index);
  }
  scene->sector_line_begin.push_back(0);
  for (const std::vector<uint32_t>& lines : touching) {
    scene->sector_lines.insert(scene->sector_lines.end(), lines.begin(), lines.end());
    scene->sector_line_begin.push_back(static_cast<uint32_t>(scene->sector_lines.size()));
  }
  for (const Sector& sector : level->sectors) {
    scene->floors.push_back(plane(sector.floor_texture, atlas));
    scene->ceilings.push_back(plane(sector.ceiling_texture, atlas));
    scene->has_sky = scene->has_sky || scene->floors.back().sky || scene->ceilings.back().sky;
  }
  scene->sky = atlas->checkerboard();
  for (const std::string& name : sky_textures(level->name)) {
    const Expected<AtlasRegion> found = atlas->wall(name);
    if (!found) continue;
    scene->sky = *found;
    break;
  }
  return scene;
}

const SpriteSides* SpriteTable::load(uint32_t sprite, uint8_t frame, uint8_t translation) {
  if (sprite >= catalog_->sprite_count()) return nullptr;
  slots_.resize(catalog_->sprite_count() * kFramesMax, kUnknown);
  warned_.resize(catalog_->sprite_count());
  const std::size_t slot = std::size_t{sprite} * kFramesMax + frame;
  const uint64_t key = slot << 8 | translation;
  if (translation == 0) {
    if (slots_[slot] != kUnknown) return at(slots_[slot]);
  } else if (const auto found = translated_.find(key); found != translated_.end()) {
    return at(found->second);
  }
  const Expected<SpriteSides> sides = atlas_->sprite(
      catalog_->sprite_name(sprite), frame, translation == 0 ? nullptr : &catalog_->translation(translation));
  int32_t index = kNone;
  if (sides) {
    index = static_cast<int32_t>(sides_.size());
    sides_.push_back(*sides);
  } else if (sides.error().code == ErrorCode::kNoSpace) {
    atlas_full_ = true;
  } else if (!warned_[sprite]) {
    warned_[sprite] = true;
    spdlog::warn("{}; it is not drawn", sides.error().message);
  }
  if (translation == 0)
    slots_[slot] = index;
  else
    translated_.emplace(key, index);
  return at(index);
}

}  // namespace comrad::doom
