#include "sim_workers/engine/render/sprites.h"

#include <algorithm>
#include <cmath>

namespace comrad::doom {
namespace {

constexpr float kSpriteNearDepth = 4.0f;  // as in Doom: nearer things are not drawn

/// A place in a sprite's picture from 0 to 1, kept a hair inside so that rounding never wraps it to the
/// other edge.
float inside(float value) { return std::clamp(value, 1e-4f, 1.0f - 1e-4f); }

}  // namespace

void Sprites::emit() {
  masked_.clear();
  collect_sprites();
  collect_gratings();
  std::stable_sort(masked_.begin(), masked_.end(),
                   [](const Masked& a, const Masked& b) { return a.inverse < b.inverse; });
  emit_masked();
  emit_hand();
  DrawList& list = *frame_.list;
  if (!list.masked_runs.empty()) list.masked_runs.back().end = list.quad_count();
  list.masked_end = list.quad_count();
}

void Sprites::collect_sprites() {
  const SceneView& view = *frame_.view;
  const std::size_t count = view.actors == nullptr ? 0 : view.actors->size();
  for (std::size_t slot = 0; slot < count; ++slot) {
    const Actor& actor = (*view.actors)[slot];
    if (actor.removed || actor.sprite == 0 || actor.id == view.hidden_actor_id) continue;
    // As in Doom, a sprite shows where its sector does.
    if (actor.sector_index >= view.sectors.size() || !visibility_.reaches(actor.sector_index)) continue;
    if (const std::optional<Masked> sprite = place_sprite(actor)) {
      masked_.push_back(*sprite);
      masked_.back().subject = kFirstActor + static_cast<int32_t>(slot);
    }
  }
}

/// Where an actor's sprite stands; nothing where it does not show.
std::optional<Sprites::Masked> Sprites::place_sprite(const Actor& actor) {
  const Projection& projection = frame_.projection;
  const float dx = to_float(actor.x) - frame_.eye_x, dy = to_float(actor.y) - frame_.eye_y;
  const float depth = dx * frame_.cosine + dy * frame_.sine;
  if (depth < kSpriteNearDepth) return std::nullopt;
  const float side = dx * frame_.sine - dy * frame_.cosine;
  if (std::abs(side) > depth * 4.0f + 512.0f) return std::nullopt;
  if (actor.has(ActorFlag::kInvisible) || actor.render_style == RenderStyle::kNone) return std::nullopt;
  const SpriteSides* sides = frame_.view->sprites->sides(actor.sprite, actor.frame, actor.translation);
  if (sides == nullptr) return std::nullopt;
  std::size_t rotation = 0;
  if (sides->rotates)
    rotation = static_cast<std::size_t>(sprite_side(
        static_cast<Angle>(static_cast<int64_t>(std::atan2(dy, dx) * (4294967296.0 / 6.283185307179586))),
        actor.angle));
  if (!sides->art[rotation]) return std::nullopt;
  const SpriteArt& art = frame_.atlas->sprites()[*sides->art[rotation]];
  Masked sprite;
  sprite.region = art.region, sprite.mirrored = sides->mirrored[rotation];
  sprite.inverse = 1.0f / depth;
  const float unit_x = projection.focal_x * sprite.inverse * actor.scale_x,
              unit_y = projection.focal_y * sprite.inverse * actor.scale_y;
  if (!(unit_x > 0) || !(unit_y > 0)) return std::nullopt;
  const auto width = static_cast<float>(art.region.width);
  // A mirrored picture hangs on the other side of its point.
  const auto left_offset =
      sprite.mirrored ? width - static_cast<float>(art.left_offset) : static_cast<float>(art.left_offset);
  sprite.x_left =
      snap(projection.center_x + side * projection.focal_x * sprite.inverse - left_offset * unit_x);
  sprite.x_right = snap(sprite.x_left + width * unit_x);
  sprite.column_begin = std::max(0, first_column(std::clamp(sprite.x_left, -1.0f, 65536.0f)));
  sprite.column_end = std::min(projection.width, first_column(std::clamp(sprite.x_right, -1.0f, 65536.0f)));
  if (sprite.column_begin >= sprite.column_end) return std::nullopt;
  sprite.y_top = frame_.center_y - (to_float(actor.z) - frame_.eye_z) * projection.focal_y * sprite.inverse -
                 static_cast<float>(art.top_offset) * unit_y;
  sprite.y_bottom = sprite.y_top + static_cast<float>(art.region.height) * unit_y;
  if (sprite.y_bottom <= 0 || sprite.y_top >= frame_.rows()) return std::nullopt;
  bool seen = false;
  for (int column = sprite.column_begin; column < sprite.column_end && !seen; ++column)
    seen = sprite.inverse > visibility_.column(column).inverse;
  if (!seen) return std::nullopt;
  const std::optional<Paint> paint = frame_.paint(actor.render_style, actor.alpha);
  if (!paint) return std::nullopt;
  const ActorCatalog& catalog = frame_.view->sprites->catalog();
  const bool bright = actor.has(ActorFlag::kBright) ||
                      (actor.state < catalog.state_count() && catalog.state(actor.state).bright);
  const SectorNow& now = frame_.sector(actor.sector_index);
  sprite.shade = bright ? 0 : now.shade;
  sprite.paint = *paint, sprite.mark = paint->mark(now.tint);
  return sprite;
}

void Sprites::collect_gratings() {
  for (const uint32_t index : visibility_.partial_spans()) {
    const WallSpan& span = visibility_.spans()[index];
    const SceneLine& line = frame_.scene->lines[span.line];
    if (!line.two_sided || !visibility_.near_side(span).middle.present) continue;
    const float set = span.line < frame_.view->lines.size() ? frame_.view->lines[span.line].alpha : -1.0f;
    const std::optional<Paint> paint = frame_.paint(
        line.additive ? RenderStyle::kAdd : RenderStyle::kTranslucent, set >= 0 ? set : line.alpha);
    if (!paint) continue;
    Masked grating;
    grating.grating = &span, grating.own_span = index, grating.paint = *paint;
    grating.inverse = span.inverse_at(0.5f * static_cast<float>(span.column_begin + span.column_end));
    grating.column_begin = span.column_begin, grating.column_end = span.column_end;
    masked_.push_back(grating);
  }
}

/// Quads from here on are opaque or blended.
void Sprites::begin_masked(bool blended) {
  std::vector<DrawList::Run>& runs = frame_.list->masked_runs;
  if (!runs.empty() && runs.back().blended == blended) return;
  if (!runs.empty()) runs.back().end = frame_.list->quad_count();
  runs.push_back({.end = frame_.list->quad_count(), .blended = blended});
  frame_.list->has_blended |= blended;
}

/// Blended quads lie in this part of the picture, given in pixels.
void Sprites::cover_blended(float left, float top, float right, float bottom) {
  const float rows = frame_.rows();
  const auto columns = static_cast<float>(frame_.projection.width);
  const PixelBox box{static_cast<int>(std::floor(std::clamp(left, 0.0f, columns))),
                     static_cast<int>(std::floor(std::clamp(top, 0.0f, rows))),
                     static_cast<int>(std::ceil(std::clamp(right, 0.0f, columns))),
                     static_cast<int>(std::ceil(std::clamp(bottom, 0.0f, rows)))};
  PixelBox& all = frame_.list->blended_box;
  if (all.right <= all.left || all.bottom <= all.top)
    all = box;
  else
    all = {std::min(all.left, box.left), std::min(all.top, box.top), std::max(all.right, box.right),
           std::max(all.bottom, box.bottom)};
}

void Sprites::emit_masked() {
  for (const Masked& masked : masked_) {
    const auto visible = [&](int column) {
      return masked.inverse_at(column) > visibility_.column(column).inverse;
    };
    const auto clip_at = [&](int column) {
      return surfaces_.clip_at(column, masked.inverse_at(column), masked.own_span);
    };
    begin_masked(masked.paint.blend.has_value());
    for (int column = masked.column_begin; column < masked.column_end;) {
      if (!visible(column)) {
        ++column;
        continue;
      }
      const Surfaces::Clip clip = clip_at(column);
      int end = column + 1;
      while (end < masked.column_end && visible(end) && clip_at(end) == clip) ++end;
      const auto run_left = static_cast<float>(column), run_right = static_cast<float>(end);
      column = end;
      if (masked.grating == nullptr)
        emit_sprite(masked, run_left, run_right, clip);
      else
        emit_grating(masked, run_left, run_right, clip);
    }
  }
}

void Sprites::emit_sprite(const Masked& sprite, float run_left, float run_right, const Surfaces::Clip& clip) {
  const float left = std::max(sprite.x_left, run_left), right = std::min(sprite.x_right, run_right);
  if (right <= left) return;
  if (sprite.paint.blend) cover_blended(left, sprite.y_top, right, sprite.y_bottom);
  frame_.list->subject = sprite.subject;
  const auto corner = [&](float x, float row) {
    const float u = inside((x - sprite.x_left) / (sprite.x_right - sprite.x_left));
    const float v = inside((row - sprite.y_top) / (sprite.y_bottom - sprite.y_top));
    frame_.push(x, row, sprite.inverse, sprite.mirrored ? 1.0f - u : u, v, sprite.region, sprite.shade,
                sprite.mark);
  };
  cut_by_edges(
      left, right, [&](float x) { return surfaces_.row_of(clip.top, x); },
      [&](float) { return sprite.y_top; }, [&](float x) { return surfaces_.row_of(clip.bottom, x); },
      [&](float) { return sprite.y_bottom; },
      [&](const PictureArea& area) { cut_to_picture(area, frame_.rows(), corner); });
}

void Sprites::emit_grating(const Masked& grating, float run_left, float run_right,
                           const Surfaces::Clip& clip) {
  const WallSpan& span = *grating.grating;
  if (grating.paint.blend) cover_blended(run_left, 0, run_right, frame_.rows());
  const SceneLine& line = frame_.scene->lines[span.line];
  const SceneSide& near = visibility_.near_side(span);
  const SectorNow& now = frame_.sector(span.near_sector);
  const SectorNow& beyond = frame_.sector(span.far_sector);
  const float opening_top = std::min(now.ceiling, beyond.ceiling);
  const float opening_bottom = std::max(now.floor, beyond.floor);
  const float height = static_cast<float>(near.middle.region.height) / near.middle.scale_y;
  // The offset moves the picture itself, not what it shows.
  ScenePart part = near.middle;
  float texture_top =
      (line.lower_unpegged ? opening_bottom + height : opening_top) + part.offset_y / part.scale_y;
  part.offset_y = 0;
  const std::span<const SideState> sides = frame_.view->sides;
  if (near.sidedef < sides.size() && !line.wraps_middle)
    texture_top += to_float(sides[near.sidedef].scroll_y) / part.scale_y;
  const float left = std::max(span.x_left, run_left), right = std::min(span.x_right, run_right);
  if (right <= left) return;
  const float top = line.wraps_middle ? opening_top : std::min(opening_top, texture_top);
  const float bottom = line.wraps_middle ? opening_bottom : std::max(opening_bottom, texture_top - height);
  cut_by_edges(
      left, right, [&](float x) { return surfaces_.row_of(clip.top, x); },
      [&](float x) { return surfaces_.row_at(span, x, top); },
      [&](float x) { return surfaces_.row_of(clip.bottom, x); },
      [&](float x) { return surfaces_.row_at(span, x, bottom); },
      [&](const PictureArea& area) {
        surfaces_.emit_textured(span, area, texture_top, part, near, frame_.wall_shade(now, near),
                                grating.paint.mark(now.tint));
      });
}

void Sprites::emit_hand() {
  const SceneView& view = *frame_.view;
  const Projection& projection = frame_.projection;
  const std::optional<Paint> paint = frame_.paint(view.hand_style, view.hand_alpha);
  if (!paint) return;
  // 320 columns and 200 rows of a 4:3 screen; x = 160 lies in the middle of the view, and as much of the
  // picture is hidden below the view as on a screen with a status bar.
  const float unit_x = projection.hand_unit_x, unit_y = projection.hand_unit_y;
  frame_.list->subject = kWeaponSubject;
  for (const HandSprite& held : view.hand) {
    const SpriteSides* sides = view.sprites->sides(held.sprite, held.frame);
    if (sides == nullptr || !sides->art[0]) continue;
    const SpriteArt& art = frame_.atlas->sprites()[*sides->art[0]];
    const float left =
        snap(projection.center_x + (held.x - 160.0f - static_cast<float>(art.left_offset)) * unit_x);
    const float right = snap(left + static_cast<float>(art.region.width) * unit_x);
    const float top = projection.center_y + (held.y - 100.0f - static_cast<float>(art.top_offset)) * unit_y;
    const float bottom = top + static_cast<float>(art.region.height) * unit_y;
    const float x0 = std::max(left, 0.0f), x1 = std::min(right, static_cast<float>(projection.width));
    const float y0 = std::max(top, 0.0f), y1 = std::min(bottom, frame_.rows());
    if (x0 >= x1 || y0 >= y1) continue;
    begin_masked(paint->blend.has_value());
    if (paint->blend) cover_blended(x0, y0, x1, y1);
    const SectorNow& now = frame_.sector(visibility_.eye_sector());
    const auto corner = [&](float x, float row) {
      const float u = inside((x - left) / (right - left)), v = inside((row - top) / (bottom - top));
      frame_.push(x, row, 1, sides->mirrored[0] ? 1.0f - u : u, v, art.region, held.bright ? 0 : now.shade,
                  paint->mark(now.tint));
    };
    corner(x0, y0), corner(x1, y0), corner(x1, y1), corner(x0, y1);
  }
}

}  // namespace comrad::doom
