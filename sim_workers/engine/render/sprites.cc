#include "sim_workers/engine/render/sprites.h"

#include <algorithm>
#include <cmath>

namespace comrad::doom {
namespace {

constexpr float kSpriteNearDepth = 4.0f;  // as in Doom: nearer things are not drawn

Fixed fixed_of(double at) { return static_cast<Fixed>(std::clamp(at, -32767.0, 32767.0) * kFracUnit); }

/// Calls run(begin, end, top, bottom) for the runs of columns of [begin, end) in which the lower of two upper edges and the
/// higher of two lower ones are the same.
template <typename Run>
void cut_by_edges(int begin, int end, const ColumnLine (&tops)[2], const ColumnLine (&bottoms)[2],
                  const Run& run) {
  struct Cut {
    bool top, bottom;
    bool operator==(const Cut&) const = default;
  };
  const auto cut_at = [&](int column) {
    const auto at = static_cast<float>(column);
    return Cut{tops[1].at(at) > tops[0].at(at), bottoms[1].at(at) < bottoms[0].at(at)};
  };
  while (begin < end) {
    const Cut cut = cut_at(begin);
    int next = begin + 1;
    while (next < end && cut_at(next) == cut) ++next;
    run(begin, next, tops[cut.top ? 1 : 0], bottoms[cut.bottom ? 1 : 0]);
    begin = next;
  }
}

/// A picture in the columns from x_left to x_right, in rows from y_top on: as ViZDoom does it, whole columns, each of as many
/// texels in 16.16.
Strip picture_strip(const AtlasRegion& region, bool mirrored, float x_left, float x_right, float y_top,
                    float y_bottom, int width) {
  Strip strip;
  strip.kind = Strip::Kind::kPicture;
  strip.masked = true;
  strip.region = region;
  const int begin = static_cast<int>(std::floor(std::clamp(x_left, -65536.0f, 65536.0f)));
  const int end = static_cast<int>(std::floor(std::clamp(x_right, -65536.0f, 65536.0f)));
  strip.column_begin = std::max(0, begin), strip.column_end = std::min(width, end);
  if (begin >= end) return strip;
  strip.u_step = (static_cast<int32_t>(region.width) << 16) / (end - begin);
  strip.u_begin = strip.u_step * (strip.column_begin - begin);
  if (mirrored)
    strip.u_begin = (static_cast<int32_t>(region.width) << 16) - 1 - strip.u_begin,
    strip.u_step = -strip.u_step;
  strip.top.at_zero = y_top, strip.bottom.at_zero = y_bottom;
  return strip;
}

}  // namespace

void Sprites::emit() {
  masked_.clear();
  collect_sprites();
  collect_gratings();
  order_.clear();
  for (uint32_t i = 0; i < masked_.size(); ++i) order_.emplace_back(masked_[i].inverse, i);
  std::ranges::sort(order_);
  emit_masked();
  emit_hand();
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
      masked_.back().strip.subject = kFirstActor + static_cast<int32_t>(slot);
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
        angle_to(fixed_of(frame_.view->eye_x), fixed_of(frame_.view->eye_y), actor.x, actor.y), actor.angle));
  if (!sides->art[rotation]) return std::nullopt;
  const SpriteArt& art = frame_.atlas->sprites()[*sides->art[rotation]];
  Masked sprite;
  sprite.inverse = 1.0f / depth;
  const float unit_x = projection.focal_x * sprite.inverse * actor.scale_x,
              unit_y = projection.focal_y * sprite.inverse * actor.scale_y;
  if (!(unit_x > 0) || !(unit_y > 0)) return std::nullopt;
  const bool mirrored = sides->mirrored[rotation];
  const auto width = static_cast<float>(art.region.width);
  // A mirrored picture hangs on the other side of its point.
  const auto left_offset =
      mirrored ? width - static_cast<float>(art.left_offset) : static_cast<float>(art.left_offset);
  const float x_left =
      projection.center_x + side * projection.focal_x * sprite.inverse - left_offset * unit_x;
  const float y_top = frame_.center_y -
                      (to_float(actor.z) - frame_.eye_z) * projection.focal_y * sprite.inverse -
                      static_cast<float>(art.top_offset) * unit_y;
  const float y_bottom = y_top + static_cast<float>(art.region.height) * unit_y;
  if (y_bottom <= 0 || y_top >= frame_.rows()) return std::nullopt;
  Strip& strip = sprite.strip =
      picture_strip(art.region, mirrored, x_left, x_left + width * unit_x, y_top, y_bottom, projection.width);
  if (strip.column_begin >= strip.column_end) return std::nullopt;
  strip.inverse.at_zero = strip.light.at_zero = sprite.inverse;
  strip.v_horizon = (to_float(actor.z) - frame_.eye_z) / actor.scale_y + static_cast<float>(art.top_offset);
  strip.v_step = 1.0f / (projection.focal_y * actor.scale_y);
  bool seen = false;
  for (int column = strip.column_begin; column < strip.column_end && !seen; ++column)
    seen = sprite.inverse > visibility_.column(column).inverse;
  if (!seen) return std::nullopt;
  const SectorNow& now = frame_.sector(actor.sector_index);
  const std::optional<Paint> paint = frame_.paint(actor.render_style, actor.alpha, now.tint);
  if (!paint) return std::nullopt;
  const ActorCatalog& catalog = frame_.view->sprites->catalog();
  const bool bright = actor.has(ActorFlag::kBright) ||
                      (actor.state < catalog.state_count() && catalog.state(actor.state).bright);
  strip.shade = bright ? 0 : now.shade;
  strip.paint = *paint;
  return sprite;
}

void Sprites::collect_gratings() {
  for (const uint32_t index : visibility_.partial_spans()) {
    const WallSpan& span = visibility_.spans()[index];
    const SceneLine& line = frame_.scene->lines[span.line];
    if (!frame_.scene->shapes[span.line].two_sided || !visibility_.near_side(span).middle.present) continue;
    const float set = span.line < frame_.view->lines.size() ? frame_.view->lines[span.line].alpha : -1.0f;
    const SectorNow& now = frame_.sector(span.near_sector);
    const SectorNow& beyond = frame_.sector(span.far_sector);
    const std::optional<Paint> paint = frame_.paint(
        line.additive ? RenderStyle::kAdd : RenderStyle::kTranslucent, set >= 0 ? set : line.alpha, now.tint);
    if (!paint) continue;
    const SceneSide& near = visibility_.near_side(span);
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
    Masked grating;
    grating.grating = &span, grating.own_span = index;
    grating.inverse = span.inverse.at(0.5f * static_cast<float>(span.column_begin + span.column_end));
    grating.strip = surfaces_.textured(span, texture_top, part, near);
    grating.strip.masked = true;
    grating.strip.paint = *paint;
    grating.strip.column_begin = span.column_begin, grating.strip.column_end = span.column_end;
    grating.strip.top =
        surfaces_.line_at(span, line.wraps_middle ? opening_top : std::min(opening_top, texture_top));
    grating.strip.bottom = surfaces_.line_at(
        span, line.wraps_middle ? opening_bottom : std::max(opening_bottom, texture_top - height));
    masked_.push_back(grating);
  }
}

/// A part of a strip between edges.
void Sprites::add(const Strip& strip, int begin, int end, const ColumnLine& top, const ColumnLine& bottom) {
  Strip part = strip;
  part.u_begin += part.u_step * (begin - part.column_begin);
  part.column_begin = begin, part.column_end = end;
  part.top = top, part.bottom = bottom;
  if (part.paint.blended) frame_.list->has_blended = true;
  frame_.list->strips.push_back(part);
}

void Sprites::emit_masked() {
  for (const auto& [inverse, index] : order_) {
    const Masked& masked = masked_[index];
    const Strip& strip = masked.strip;
    const auto visible = [&](int column) {
      return masked.inverse_at(visibility_.ray(column)) > visibility_.column(column).inverse;
    };
    const auto clip_at = [&](int column) {
      return surfaces_.clip_at(column, masked.inverse_at(visibility_.ray(column)), masked.own_span);
    };
    for (int column = strip.column_begin; column < strip.column_end;) {
      if (!visible(column)) {
        ++column;
        continue;
      }
      const Surfaces::Clip clip = clip_at(column);
      int end = column + 1;
      while (end < strip.column_end && visible(end) && clip_at(end) == clip) ++end;
      cut_by_edges(column, end, {strip.top, surfaces_.line_of(clip.top)},
                   {strip.bottom, surfaces_.line_of(clip.bottom)},
                   [&](int from, int to, const ColumnLine& top, const ColumnLine& bottom) {
                     add(strip, from, to, top, bottom);
                   });
      column = end;
    }
  }
}

void Sprites::emit_hand() {
  const SceneView& view = *frame_.view;
  const Projection& projection = frame_.projection;
  const SectorNow& now = frame_.sector(visibility_.eye_sector());
  const std::optional<Paint> paint = frame_.paint(view.hand_style, view.hand_alpha, now.tint);
  if (!paint) return;
  // 320 columns and 200 rows of a 4:3 screen; x = 160 lies in the middle of the view, and as much of the
  // picture is hidden below the view as on a screen with a status bar.
  const float unit_x = projection.hand_unit_x, unit_y = projection.hand_unit_y;
  for (const HandSprite& held : view.hand) {
    const SpriteSides* sides = view.sprites->sides(held.sprite, held.frame);
    if (sides == nullptr || !sides->art[0]) continue;
    const SpriteArt& art = frame_.atlas->sprites()[*sides->art[0]];
    const float left = projection.center_x + (held.x - 160.0f - static_cast<float>(art.left_offset)) * unit_x;
    const float right = left + static_cast<float>(art.region.width) * unit_x;
    const float top = projection.center_y + (held.y - 100.0f - static_cast<float>(art.top_offset)) * unit_y;
    const float bottom = top + static_cast<float>(art.region.height) * unit_y;
    Strip strip = picture_strip(art.region, sides->mirrored[0], left, right, top, bottom, projection.width);
    if (strip.column_begin >= strip.column_end) continue;
    strip.inverse.at_zero = strip.light.at_zero = 1;
    strip.v_horizon = 100.0f - held.y + static_cast<float>(art.top_offset);
    strip.v_step = 1.0f / unit_y;
    strip.shade = held.bright ? 0 : now.shade;
    strip.paint = *paint;
    strip.subject = kWeaponSubject;
    add(strip, strip.column_begin, strip.column_end, strip.top, strip.bottom);
  }
}

}  // namespace comrad::doom
