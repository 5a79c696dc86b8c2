#include "sim_workers/engine/render/view_frame.h"

#include <algorithm>
#include <cmath>
#include <string>

namespace comrad::doom {
namespace {

constexpr float kShadowAlpha = 0.3f;  // how much a spectre or a half invisible player takes of the light
constexpr float kLightRowsPerFlash = 4.0f;  // a weapon's flash adds 16 light levels of 256

bool same_plane(const ScenePlane& a, const ScenePlane& b) {
  return a.sky == b.sky && a.region.address == b.region.address;
}

/// A way to blend; nothing for what is opaque.
std::optional<Blend> blend_of(RenderStyle style, float alpha) {
  Blend blend;
  switch (style) {
    case RenderStyle::kNone:
    case RenderStyle::kNormal:
      return std::nullopt;
    case RenderStyle::kTranslucent:
      if (alpha >= 1) return std::nullopt;
      break;
    case RenderStyle::kAdd:
      blend.kind = Blend::Kind::kAdd;
      break;
    case RenderStyle::kSubtract:
      blend.kind = Blend::Kind::kSubtract;
      break;
    case RenderStyle::kFuzzy:
    case RenderStyle::kShadow:
      blend.kind = Blend::Kind::kDarken;
      alpha = kShadowAlpha;
      break;
    case RenderStyle::kStencil:
      blend.kind = Blend::Kind::kDarken;
      break;
  }
  // Both shares are cut off, as the reference engine does it; the hair is for those that are whole but for rounding.
  constexpr float kShares = Blend::kWhole, kHair = 1.0f / 1024.0f;
  blend.front = static_cast<uint8_t>(alpha * kShares + kHair);
  blend.behind = static_cast<uint8_t>((1.0f - alpha) * kShares + kHair);
  return blend;
}

}  // namespace

void ViewFrame::begin(const SceneView& next, DrawList* into) {
  view = &next, scene = next.scene, list = into;
  list->clear();
  ++stamp;
  sectors_.resize(std::max(sectors_.size(), next.sectors.size()));
  side_changes_.resize(std::max(side_changes_.size(), next.sides.size()));
  changed_planes_.clear(), changed_sides_.clear();
  // As in the reference engine from the table of fine angles, whose quadrants do not meet exactly: a view is turned by up to
  // 1/8192 of a turn.
  cosine = to_float(fine_cosine(next.angle)), sine = to_float(fine_sine(next.angle));
  eye_x = static_cast<float>(next.eye_x), eye_y = static_cast<float>(next.eye_y);
  eye_z = static_cast<float>(next.eye_z);
  // Looking up or down shifts the picture, as Doom's descendants do it; walls stay upright.
  center_y = projection.center_y;
  if (next.pitch != 0) {
    const double down = std::clamp(static_cast<int32_t>(next.pitch) * (kTwoPi / 4294967296.0), -1.3, 1.3);
    center_y -= static_cast<float>(std::round(projection.focal_y * std::tan(down)));
  }
  into->center_y = center_y, into->sky_angle = next.angle;
}

const SectorNow& ViewFrame::sector(uint32_t index) {
  SectorNow& now = sectors_[index];
  if (now.stamp == stamp) return now;
  const Sector& sector = view->sectors[index];
  now.stamp = stamp;
  now.floor = to_float(sector.floor_height), now.ceiling = to_float(sector.ceiling_height);
  const float flash = kLightRowsPerFlash * static_cast<float>(view->extra_light);
  const auto shade = [&](int light) { return light_shade(std::clamp(light, 0, 255)) - flash; };
  const auto plane_shade = [&](const FlatPlacement& placement) {
    return placement.light_absolute ? shade(placement.light)
           : placement.light != 0   ? shade(sector.light + placement.light)
                                    : now.shade;
  };
  now.shade = shade(sector.light);
  now.floor_shade = plane_shade(sector.floor_placement);
  now.ceiling_shade = plane_shade(sector.ceiling_placement);
  now.tint = tint(sector.light_color);
  const auto current = [&](const ScenePlane& loaded, const std::string& name) {
    if (loaded.name == name) return &loaded;
    changed_planes_.push_back(Scene::plane(name, atlas));
    return const_cast<const ScenePlane*>(&changed_planes_.back());
  };
  now.floor_plane = current(scene->floors[index], sector.floor_texture);
  now.ceiling_plane = current(scene->ceilings[index], sector.ceiling_texture);
  return now;
}

const SceneSide& ViewFrame::changed(const SceneSide& side) {
  auto& [changed_at, changed] = side_changes_[side.sidedef];
  if (changed_at != stamp) {
    changed_sides_.push_back(Scene::retextured(side, view->sides[side.sidedef], atlas));
    changed_at = stamp, changed = &changed_sides_.back();
  }
  return *changed;
}

/// The number of a light's colour in this picture; the nearest where there are too many.
uint8_t ViewFrame::tint(uint32_t color) {
  color &= 0xFFFFFFu;
  if (color == 0xFFFFFFu) return 0;
  uint32_t best = 0;
  int best_distance = INT32_MAX;
  for (uint32_t i = 0; i < list->tint_count; ++i) {
    int distance = 0;
    for (int shift = 0; shift < 24; shift += 8)
      distance +=
          std::abs(static_cast<int>(color >> shift & 255) - static_cast<int>(list->tints[i] >> shift & 255));
    if (distance < best_distance) best_distance = distance, best = i;
  }
  if (best_distance > 0 && list->tint_count < kTintsMax) {
    best = list->tint_count++;
    list->tints[best] = color;
  }
  return static_cast<uint8_t>(best);
}

std::optional<Paint> ViewFrame::paint(RenderStyle style, float alpha, uint8_t tint) {
  if (style == RenderStyle::kNone) return std::nullopt;
  const std::optional<Blend> wanted = blend_of(style, std::clamp(alpha, 0.0f, 1.0f));
  if (!wanted) return Paint{.tint = tint};
  if (wanted->front == 0) return std::nullopt;
  uint32_t best = 0;
  int best_distance = INT32_MAX;
  for (uint32_t i = 0; i < list->blend_count; ++i) {
    const Blend& known = list->blends[i];
    const int distance = std::abs(known.front - wanted->front) + std::abs(known.behind - wanted->behind) +
                         (known.kind == wanted->kind ? 0 : 1000);
    if (distance < best_distance) best_distance = distance, best = i;
  }
  if (best_distance > 0 && list->blend_count < kBlendsMax) {
    best = list->blend_count++;
    list->blends[best] = *wanted;
  }
  return Paint{.tint = tint, .blended = true, .blend = static_cast<uint8_t>(best)};
}

bool ViewFrame::same_plane_look(uint32_t one, uint32_t other, bool floor) {
  if (one == other) return true;
  const SectorNow &a = sector(one), &b = sector(other);
  if (a.tint != b.tint) return false;
  const Sector &here = view->sectors[one], &there = view->sectors[other];
  return floor ? a.floor == b.floor && a.floor_shade == b.floor_shade &&
                     same_plane(*a.floor_plane, *b.floor_plane) &&
                     same_placement(here.floor_placement, there.floor_placement)
               : a.ceiling == b.ceiling && a.ceiling_shade == b.ceiling_shade &&
                     same_plane(*a.ceiling_plane, *b.ceiling_plane) &&
                     same_placement(here.ceiling_placement, there.ceiling_placement);
}

bool ViewFrame::same_look(uint32_t one, uint32_t other) {
  return sector(one).shade == sector(other).shade && same_plane_look(one, other, /*floor=*/true) &&
         same_plane_look(one, other, /*floor=*/false);
}

float ViewFrame::wall_shade(const SectorNow& now, const SceneSide& side) const {
  if (side.light == 0 && !side.light_absolute) return now.shade + side.contrast_rows;
  const float flash = kLightRowsPerFlash * static_cast<float>(view->extra_light);
  if (side.light_absolute) return light_shade(std::clamp(side.light, 0, 255)) - flash + side.contrast_rows;
  return now.shade - static_cast<float>(side.light) * 0.25f + side.contrast_rows;
}

}  // namespace comrad::doom
