#include "sim_workers/engine/render/view_builder.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "sim_workers/engine/map/level_index.h"

namespace comrad::doom {
namespace {

constexpr float kNearDepth = 1.0f;        // bodies keep walls farther away than this
constexpr float kSpriteNearDepth = 4.0f;  // as in Doom: nearer things are not drawn
constexpr float kFarInverse = 1.0f / 60000.0f;
constexpr int kCrossingsMax = 32;  // floor or ceiling changes seen in one column; farther ones are left out
constexpr int kSkyStripColumns = 16;
constexpr float kSkyColumnsPerTurn = 1024.0f;
constexpr int kTallSkyRows = 200;
constexpr float kSkyHorizonRow = 108.5f;
// Coordinates that are whole texels in exact arithmetic (walls and eyes on round numbers are common) must not
// fall to either side by rounding.
constexpr float kTexelEpsilon = 1.0f / 256.0f;
constexpr float kTwoPi = 6.28318530717958647692f;
constexpr float kShadowAlpha = 0.3f;   // how much a spectre or a half invisible player takes of the light
constexpr float kTuck = 1.0f / 16.0f;  // rows that a surface goes on below a nearer one
constexpr std::size_t kPiecesLookedAt = 8;
constexpr float kLightRowsPerFlash = 4.0f;  // a weapon's flash adds 16 light levels of 256

/// Rasterizers place corners on a grid of 1/256 pixel; on the same grid, "is this pixel's centre inside" has
/// the same answer here and there.
float snap(float pixels) { return std::floor(pixels * 256.0f + 0.5f) * (1.0f / 256.0f); }

/// First column whose centre is not left of x.
int first_column(float x) { return static_cast<int>(std::ceil(x - 0.5f)); }

/// Calls piece(x0, x1) for the parts of [left, right] between the places where one of two edges (given by
/// their rows at the ends) leaves or enters the picture of `rows` rows; inside a part each edge is wholly
/// above, in or below.
template <typename Piece>
void split_at_borders(float left, float right, float top_left, float top_right, float bottom_left,
                      float bottom_right, float rows, Piece&& piece) {
  const auto [low, high] = std::minmax({top_left, top_right, bottom_left, bottom_right});
  if (low >= 0 && high <= rows) {
    piece(left, right);
    return;
  }
  std::array<float, 6> cuts{left};
  int count = 1;
  const auto cut = [&](float at_left, float at_right, float level) {
    if ((at_left - level) * (at_right - level) >= 0) return;
    cuts[static_cast<std::size_t>(count++)] =
        std::clamp(left + (level - at_left) / (at_right - at_left) * (right - left), left, right);
  };
  cut(top_left, top_right, 0), cut(top_left, top_right, rows);
  cut(bottom_left, bottom_right, 0), cut(bottom_left, bottom_right, rows);
  std::sort(cuts.begin() + 1, cuts.begin() + count);
  cuts[static_cast<std::size_t>(count++)] = right;
  for (int i = 0; i + 1 < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    if (cuts[at + 1] > cuts[at]) piece(cuts[at], cuts[at + 1]);
  }
}

/// Calls corner(x, row) for the corners, clockwise from the upper left one, of the quads that make up what
/// lies between two edges and in the picture. Edges that cross end the quad there.
template <typename Corner>
void cut_to_picture(float left, float right, float top_left, float top_right, float bottom_left,
                    float bottom_right, float rows, Corner&& corner) {
  if (std::max(bottom_left, bottom_right) <= 0 || std::min(top_left, top_right) >= rows) return;
  const float height_left = bottom_left - top_left, height_right = bottom_right - top_right;
  if (height_left <= 0 && height_right <= 0) return;
  if (height_left < 0 || height_right < 0) {
    const float t = height_left / (height_left - height_right), x = left + t * (right - left);
    const float row = top_left + t * (top_right - top_left);
    if (height_left < 0)
      left = x, top_left = bottom_left = row;
    else
      right = x, top_right = bottom_right = row;
    if (right <= left) return;
  }
  const auto along = [&](float at_left, float at_right, float x) {
    return std::clamp(at_left + (at_right - at_left) * ((x - left) / (right - left)), 0.0f, rows);
  };
  split_at_borders(left, right, top_left, top_right, bottom_left, bottom_right, rows, [&](float a, float b) {
    const float top_a = along(top_left, top_right, a), top_b = along(top_left, top_right, b);
    const float bottom_a = along(bottom_left, bottom_right, a),
                bottom_b = along(bottom_left, bottom_right, b);
    if (bottom_a <= top_a && bottom_b <= top_b) return;
    corner(a, top_a), corner(b, top_b), corner(b, bottom_b), corner(a, bottom_a);
  });
}

/// Calls piece(a, b, upper, lower) for the runs of columns of [left, right] in which the lower of two upper
/// edges and the higher of two lower ones are the same; edges are functions from x to a row.
template <typename Top, typename OwnTop, typename Bottom, typename OwnBottom, typename Piece>
void cut_by_edges(float left, float right, const Top& top, const OwnTop& own_top, const Bottom& bottom,
                  const OwnBottom& own_bottom, const Piece& piece) {
  const auto cuts = [&](float column) {
    const float x = column + 0.5f;
    return std::pair(top(x) > own_top(x), bottom(x) < own_bottom(x));
  };
  for (float x = left; x < right;) {
    const auto cut = cuts(std::floor(x));
    float end = std::floor(x) + 1.0f;
    while (end < right && cuts(end) == cut) end += 1.0f;
    end = std::min(end, right);
    piece(
        x, end, [&](float at) { return cut.first ? top(at) : own_top(at); },
        [&](float at) { return cut.second ? bottom(at) : own_bottom(at); });
    x = end;
  }
}

/// A place in a sprite's picture from 0 to 1, kept a hair inside so that rounding never wraps it to the other
/// edge.
float inside(float value) { return std::clamp(value, 1e-4f, 1.0f - 1e-4f); }

bool same_plane(const ScenePlane& a, const ScenePlane& b) {
  return a.sky == b.sky && a.region.address == b.region.address;
}

bool same_placement(const FlatPlacement& a, const FlatPlacement& b) {
  return a.offset_x == b.offset_x && a.offset_y == b.offset_y && a.scale_x == b.scale_x &&
         a.scale_y == b.scale_y && a.rotation_degrees == b.rotation_degrees;
}

}  // namespace

ViewBuilder::ViewBuilder(const Projection& projection, ArtAtlas* atlas)
    : projection_(projection), atlas_(atlas) {
  const auto columns = static_cast<std::size_t>(projection.width);
  column_inverse_.resize(columns);
  column_span_.resize(columns);
  crossings_.resize(columns * kCrossingsMax);
  crossing_count_.resize(columns);
}

void ViewBuilder::build(const SceneView& view, DrawList* list) {
  view_ = &view, scene_ = view.scene, list_ = list;
  list->clear();
  ++stamp_;
  sectors_.resize(std::max(sectors_.size(), view.sectors.size()));
  windows_.resize(std::max(windows_.size(), view.sectors.size()));
  side_changes_.resize(std::max(side_changes_.size(), view.sides.size()));
  line_views_.resize(std::max(line_views_.size(), scene_->lines.size()));
  const std::size_t vertex_count = std::max(side_.size(), scene_->vertex_x.size());
  side_.resize(vertex_count), depth_.resize(vertex_count), vertex_stamps_.resize(vertex_count);
  changed_planes_.clear(), changed_sides_.clear();
  const double radians = angle_to_radians(view.angle);
  cosine_ = static_cast<float>(std::cos(radians)), sine_ = static_cast<float>(std::sin(radians));
  eye_x_ = static_cast<float>(view.eye_x), eye_y_ = static_cast<float>(view.eye_y);
  eye_z_ = static_cast<float>(view.eye_z);
  // Looking up or down shifts the picture, as Doom's descendants do it; walls stay upright.
  center_y_ = projection_.center_y;
  if (view.pitch != 0) {
    const double down = std::clamp(static_cast<int32_t>(view.pitch) * (kTwoPi / 4294967296.0), -1.3, 1.3);
    center_y_ -= static_cast<float>(std::round(projection_.focal_y * std::tan(down)));
  }
  sky_seen_ = false;
  collect_spans();
  if (partial_spans_.empty()) {
    emit_painted_planes();
    emit_all_walls();
  } else {
    collect_crossings();
    collect_pieces();
    if (sky_seen_) emit_sky();
    for (const Piece& piece : pieces_) emit_piece(piece);
  }
  list->opaque_end = quad_count();
  collect_sprites();
  emit_masked();
  emit_hand();
  if (!list->masked_runs.empty()) list->masked_runs.back().end = quad_count();
  list->masked_end = quad_count();
}

const ViewBuilder::SectorNow& ViewBuilder::sector(uint32_t index) {
  SectorNow& now = sectors_[index];
  if (now.stamp == stamp_) return now;
  const Sector& sector = view_->sectors[index];
  now.stamp = stamp_;
  now.floor = to_float(sector.floor_height), now.ceiling = to_float(sector.ceiling_height);
  const float flash = kLightRowsPerFlash * static_cast<float>(view_->extra_light);
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
    changed_planes_.push_back(Scene::plane(name, atlas_));
    return const_cast<const ScenePlane*>(&changed_planes_.back());
  };
  now.floor_plane = current(scene_->floors[index], sector.floor_texture);
  now.ceiling_plane = current(scene_->ceilings[index], sector.ceiling_texture);
  return now;
}

/// The number of a light's colour in this picture, at its place above an address; the nearest where there are
/// too many.
int32_t ViewBuilder::tint(uint32_t color) {
  color &= 0xFFFFFFu;
  if (color == 0xFFFFFFu) return 0;
  uint32_t best = 0;
  int best_distance = INT32_MAX;
  for (uint32_t i = 0; i < list_->tint_count; ++i) {
    int distance = 0;
    for (int shift = 0; shift < 24; shift += 8)
      distance +=
          std::abs(static_cast<int>(color >> shift & 255) - static_cast<int>(list_->tints[i] >> shift & 255));
    if (distance < best_distance) best_distance = distance, best = i;
  }
  if (best_distance > 0 && list_->tint_count < kTintsMax) {
    best = list_->tint_count++;
    list_->tints[best] = color;
  }
  return static_cast<int32_t>(best << kTintShift);
}

/// The number of a way to blend in this picture; -1: opaque, -2: not to be drawn.
int32_t ViewBuilder::blend(RenderStyle style, float alpha) {
  Blend wanted;
  alpha = std::clamp(alpha, 0.0f, 1.0f);
  switch (style) {
    case RenderStyle::kNone:
      return -2;
    case RenderStyle::kNormal:
      return -1;
    case RenderStyle::kTranslucent:
      if (alpha >= 1) return -1;
      break;
    case RenderStyle::kAdd:
      wanted.kind = Blend::Kind::kAdd;
      break;
    case RenderStyle::kSubtract:
      wanted.kind = Blend::Kind::kSubtract;
      break;
    case RenderStyle::kFuzzy:
    case RenderStyle::kShadow:
      wanted.kind = Blend::Kind::kDarken;
      alpha = kShadowAlpha;
      break;
    case RenderStyle::kStencil:
      wanted.kind = Blend::Kind::kDarken;
      break;
  }
  wanted.alpha = static_cast<uint8_t>(alpha * 255.0f + 0.5f);
  if (wanted.alpha == 0) return -2;
  uint32_t best = 0;
  int best_distance = INT32_MAX;
  for (uint32_t i = 0; i < list_->blend_count; ++i) {
    const Blend& known = list_->blends[i];
    const int distance = std::abs(known.alpha - wanted.alpha) + (known.kind == wanted.kind ? 0 : 1000);
    if (distance < best_distance) best_distance = distance, best = i;
  }
  if (best_distance > 0 && list_->blend_count < kBlendsMax) {
    best = list_->blend_count++;
    list_->blends[best] = wanted;
  }
  return static_cast<int32_t>(best);
}

const SceneSide& ViewBuilder::side_now(const SceneSide& side) {
  if (side.sidedef >= view_->sides.size() || !view_->sides[side.sidedef].retextured) return side;
  auto& [stamp, changed] = side_changes_[side.sidedef];
  if (stamp != stamp_) {
    changed_sides_.push_back(Scene::retextured(side, view_->sides[side.sidedef], atlas_));
    stamp = stamp_, changed = &changed_sides_.back();
  }
  return *changed;
}

const SceneSide& ViewBuilder::near_side(const Span& span) {
  return side_now(span.back_side ? scene_->lines[span.line].back : scene_->lines[span.line].front);
}

float ViewBuilder::wall_shade(const SectorNow& now, const SceneSide& side) const {
  if (side.light == 0 && !side.light_absolute) return now.shade + side.contrast_rows;
  const float flash = kLightRowsPerFlash * static_cast<float>(view_->extra_light);
  if (side.light_absolute) return light_shade(std::clamp(side.light, 0, 255)) - flash + side.contrast_rows;
  return now.shade - static_cast<float>(side.light) * 0.25f + side.contrast_rows;
}

void ViewBuilder::place_vertex(uint32_t vertex, float x, float y) {
  const float dx = x - eye_x_, dy = y - eye_y_;
  depth_[vertex] = dx * cosine_ + dy * sine_;
  side_[vertex] = dx * sine_ - dy * cosine_;
  vertex_stamps_[vertex] = stamp_;
}

void ViewBuilder::transform(uint32_t vertex) {
  if (vertex_stamps_[vertex] != stamp_)
    place_vertex(vertex, scene_->vertex_x[vertex], scene_->vertex_y[vertex]);
}

/// From the eye's sector through every opening that shows another one, with the columns it shows it in.
void ViewBuilder::collect_spans() {
  spans_.clear();
  partial_spans_.clear();
  queue_.clear();
  std::fill(column_inverse_.begin(), column_inverse_.end(), 0.0f);
  std::fill(column_span_.begin(), column_span_.end(), -1);
  collect_polyobjects();
  if (scene_->level().index != nullptr && !view_->sectors.empty()) {
    const auto fixed = [](double at) {
      return static_cast<Fixed>(std::clamp(at, -32767.0, 32767.0) * 65536);
    };
    eye_sector_ = scene_->level().index->sectors.sector_at(fixed(view_->eye_x), fixed(view_->eye_y));
    reach(eye_sector_, 0, projection_.width);
  }
  for (std::size_t next = 0; next < queue_.size(); ++next) {
    const uint32_t index = queue_[next];
    windows_[index].queued = false;
    const Window window = windows_[index];
    for (uint32_t at = scene_->sector_line_begin[index]; at < scene_->sector_line_begin[index + 1]; ++at) {
      const uint32_t line_index = scene_->sector_lines[at];
      LineView& seen = look_at(line_index);
      if (seen.kind == LineView::Kind::kUnseen) continue;
      const int begin = std::max(window.begin, seen.column_begin);
      const int end = std::min(window.end, seen.column_end);
      if (begin >= end) continue;
      if (seen.kind == LineView::Kind::kShown && !seen.added) {
        seen.added = true;
        add_span(seen.span);
      }
      if (!seen.open) continue;
      const SceneLine& line = scene_->lines[line_index];
      if (!seen.any_facing && seen.span.near_sector != index) continue;
      reach(line.front.sector == index ? line.back.sector : line.front.sector, begin, end);
    }
  }
  const auto hidden = [&](int32_t index) {
    const Span& span = spans_[static_cast<std::size_t>(index)];
    for (int column = span.column_begin; column < span.column_end; ++column)
      if (span.inverse_at(static_cast<float>(column) + 0.5f) >
          column_inverse_[static_cast<std::size_t>(column)])
        return false;
    return true;
  };
  partial_spans_.erase(std::remove_if(partial_spans_.begin(), partial_spans_.end(), hidden),
                       partial_spans_.end());
}

/// Widens the window of a sector; its lines are looked at (again) if it grew.
void ViewBuilder::reach(uint32_t index, int begin, int end) {
  Window& window = windows_[index];
  if (window.stamp != stamp_) {
    window = {.stamp = stamp_, .begin = begin, .end = end, .queued = false};
  } else {
    if (begin >= window.begin && end <= window.end) return;
    window.begin = std::min(window.begin, begin), window.end = std::max(window.end, end);
  }
  if (window.queued) return;
  window.queued = true;
  queue_.push_back(index);
}

ViewBuilder::LineView& ViewBuilder::look_at(uint32_t index) {
  LineView& seen = line_views_[index];
  if (seen.stamp == stamp_) return seen;
  seen.stamp = stamp_;
  seen.kind = LineView::Kind::kUnseen;
  seen.added = seen.open = seen.any_facing = false;
  measure_line(index, &seen);
  return seen;
}

void ViewBuilder::measure_line(uint32_t line_index, LineView* seen) {
  const SceneLine& line = scene_->lines[line_index];
  transform(line.start), transform(line.end);
  float side_a = side_[line.start], depth_a = depth_[line.start];
  float side_b = side_[line.end], depth_b = depth_[line.end];
  if (depth_a < kNearDepth && depth_b < kNearDepth) {
    if (!line.two_sided || (depth_a <= 0 && depth_b <= 0)) return;
    // It crosses the view closer than anything is drawn: nothing to show, but it must not stop the eye.
    seen->kind = LineView::Kind::kPlain, seen->open = seen->any_facing = true;
    seen->column_begin = 0, seen->column_end = projection_.width;
    return;
  }
  // Seen from its front, a line runs from left to right.
  const bool from_back = side_a * depth_b >= side_b * depth_a;
  if (from_back && !line.two_sided) return;
  // Outside the picture's left or right border: both ends on the far side of the same border ray.
  const float left_reach = projection_.center_x,
              right_reach = static_cast<float>(projection_.width) - left_reach;
  const float focal = projection_.focal_x;
  if (side_a * focal < -left_reach * depth_a && side_b * focal < -left_reach * depth_b) return;
  if (side_a * focal > right_reach * depth_a && side_b * focal > right_reach * depth_b) return;
  float u_a = 0, u_b = line.length;
  if (from_back) {
    std::swap(side_a, side_b), std::swap(depth_a, depth_b);
  }
  const float length = line.length;
  bool clipped = true;
  if (depth_a < kNearDepth) {
    const float t = (kNearDepth - depth_a) / (depth_b - depth_a);
    side_a += t * (side_b - side_a), u_a += t * length, depth_a = kNearDepth;
  } else if (depth_b < kNearDepth) {
    const float t = (kNearDepth - depth_b) / (depth_a - depth_b);
    side_b += t * (side_a - side_b), u_b -= t * length, depth_b = kNearDepth;
  } else {
    clipped = false;
  }
  Span& span = seen->span;
  span.line = line_index, span.back_side = from_back;
  span.near_sector = from_back ? line.back.sector : line.front.sector;
  span.far_sector = !line.two_sided ? span.near_sector : from_back ? line.front.sector : line.back.sector;
  const float inverse_a = 1.0f / depth_a, inverse_b = 1.0f / depth_b;
  span.x_left = snap(projection_.center_x + focal * side_a * inverse_a);
  span.x_right = snap(projection_.center_x + focal * side_b * inverse_b);
  span.column_begin = std::max(0, first_column(std::max(span.x_left, -1.0f)));
  span.column_end = std::min(projection_.width, first_column(std::min(span.x_right, 65536.0f)));
  seen->column_begin = span.column_begin, seen->column_end = span.column_end;
  if (clipped && line.two_sided) {
    seen->column_begin = 0, seen->column_end = projection_.width;
    seen->any_facing = true;
  }
  if (seen->column_begin >= seen->column_end) return;
  seen->kind = LineView::Kind::kPlain;
  span.solid = !line.two_sided;
  if (line.two_sided) {
    const SectorNow now = sector(span.near_sector);
    const SectorNow& beyond = sector(span.far_sector);
    span.solid = std::max(now.floor, beyond.floor) >= std::min(now.ceiling, beyond.ceiling);
    seen->open = !span.solid && span.near_sector != span.far_sector;
  }
  if (span.column_begin >= span.column_end) return;
  if (line.two_sided && !span.solid) {
    const bool alike =
        span.near_sector == span.far_sector ||
        same_look(sector(span.near_sector), sector(span.far_sector), span.near_sector, span.far_sector);
    if (alike && !side_now(from_back ? line.back : line.front).middle.present) return;
  }
  // The texture runs from the near side's own start, which is always the span's left end.
  const float width = span.x_right - span.x_left;
  span.inverse_left = inverse_a, span.inverse_slope = (inverse_b - inverse_a) / width;
  span.u_left = u_a * inverse_a, span.u_slope = (u_b * inverse_b - span.u_left) / width;
  seen->kind = LineView::Kind::kShown;
}

/// Sectors between which no border shows.
bool ViewBuilder::same_look(const SectorNow& a, const SectorNow& b, uint32_t a_index,
                            uint32_t b_index) const {
  return a.shade == b.shade && same_plane_look(a, b, a_index, b_index, /*floor=*/true) &&
         same_plane_look(a, b, a_index, b_index, /*floor=*/false);
}

void ViewBuilder::add_span(const Span& span) {
  const auto index = static_cast<int32_t>(spans_.size());
  spans_.push_back(span);
  if (span.solid)
    fill_columns(index);
  else
    partial_spans_.push_back(index);
}

/// Lines that move as one: their ends lie where the world has them now, and each stands in the sector that it
/// is in.
void ViewBuilder::collect_polyobjects() {
  for (const Polyobject& polyobject : view_->polyobjects) {
    for (std::size_t i = 0; i < polyobject.vertices.size() && i < polyobject.position.size(); ++i)
      if (polyobject.vertices[i] < scene_->vertex_x.size())
        place_vertex(polyobject.vertices[i], to_float(polyobject.position[i][0]),
                     to_float(polyobject.position[i][1]));
    for (const uint32_t line_index : polyobject.lines) {
      if (line_index >= scene_->lines.size() || scene_->level().index == nullptr) continue;
      const SceneLine& line = scene_->lines[line_index];
      LineView& seen = look_at(line_index);
      if (seen.kind != LineView::Kind::kShown || seen.added) continue;
      seen.added = true;
      // A step to the near side of its middle; (depth, side) back to the map.
      const float middle_depth = 0.5f * (depth_[line.start] + depth_[line.end]);
      const float middle_side = 0.5f * (side_[line.start] + side_[line.end]);
      const float along_depth = depth_[line.end] - depth_[line.start],
                  along_side = side_[line.end] - side_[line.start];
      const float step = (seen.span.back_side ? -2.0f : 2.0f) / std::max(1e-3f, line.length);
      const float depth = middle_depth - along_side * step, side = middle_side + along_depth * step;
      const auto fixed = [](float at) {
        return static_cast<Fixed>(std::clamp(at, -32767.0f, 32767.0f) * 65536.0f);
      };
      Span span = seen.span;
      span.near_sector = scene_->level().index->sectors.sector_at(
          fixed(eye_x_ + cosine_ * depth + sine_ * side), fixed(eye_y_ + sine_ * depth - cosine_ * side));
      span.far_sector = span.near_sector;
      add_span(span);
    }
  }
}

void ViewBuilder::fill_columns(int32_t span_index) {
  const Span& span = spans_[static_cast<std::size_t>(span_index)];
  for (int column = span.column_begin; column < span.column_end; ++column) {
    const float inverse = span.inverse_at(static_cast<float>(column) + 0.5f);
    const auto at = static_cast<std::size_t>(column);
    if (inverse <= column_inverse_[at]) continue;
    column_inverse_[at] = inverse;
    column_span_[at] = span_index;
  }
}

void ViewBuilder::push(float x, float row, float inverse, float u, float v, const AtlasRegion& region,
                       float shade, int32_t tint) {
  const float w = 1.0f / inverse;
  list_->vertices.push_back({.x = (x * 2.0f / static_cast<float>(projection_.width) - 1.0f) * w,
                             .y = (row * 2.0f / static_cast<float>(projection_.rows) - 1.0f) * w,
                             .z = 0,
                             .w = w,
                             .u = u,
                             .v = v,
                             .width = static_cast<float>(region.width),
                             .height = static_cast<float>(region.height),
                             .shade = shade,
                             .address = static_cast<int32_t>(region.address) | tint});
}

float ViewBuilder::sky_u(float x) const {
  // 1.5 times the walls' shift: the reference engine looks skies up a little more to the left still.
  const float offset = (x + 1.5f * projection_.wall_shift_x - projection_.center_x) / projection_.focal_x;
  return (static_cast<float>(angle_to_radians(view_->angle)) - std::atan(offset)) * kSkyColumnsPerTurn /
         kTwoPi / static_cast<float>(scene_->sky.width);
}

float ViewBuilder::sky_v(float row) const {
  // Skies of 128 rows are stretched to twice their height and stand on the horizon's row 108.5; taller ones
  // were drawn for a screen of 200 rows.
  const bool stretched = scene_->sky.height < kTallSkyRows;
  const float texels_per_row = (stretched ? 100.0f : 200.0f) / (projection_.focal_y / 0.8f);
  return ((stretched ? kSkyHorizonRow : 100.0f) + (row - center_y_) * texels_per_row) /
         static_cast<float>(scene_->sky.height);
}

void ViewBuilder::emit_sky() {
  const AtlasRegion& region = scene_->sky;
  const auto rows = static_cast<float>(projection_.rows);
  for (int begin = 0; begin < projection_.width; begin += kSkyStripColumns) {
    const auto left = static_cast<float>(begin),
               right = static_cast<float>(std::min(begin + kSkyStripColumns, projection_.width));
    push(left, 0, 1, sky_u(left), sky_v(0), region, 0, 0);
    push(right, 0, 1, sky_u(right), sky_v(0), region, 0, 0);
    push(right, rows, 1, sky_u(right), sky_v(rows), region, 0, 0);
    push(left, rows, 1, sky_u(left), sky_v(rows), region, 0, 0);
  }
}

/// Where only solid walls are seen, each stretch of columns that ends at the same kind of floor gets one
/// rectangle down from the farthest wall's foot; nearer walls are painted over it.
void ViewBuilder::emit_painted_planes() {
  for (int column = 0; column < projection_.width && !sky_seen_; ++column) {
    const int32_t index = column_span_[static_cast<std::size_t>(column)];
    if (index < 0 || (column > 0 && column_span_[static_cast<std::size_t>(column - 1)] == index)) continue;
    const SectorNow& now = sector(spans_[static_cast<std::size_t>(index)].near_sector);
    sky_seen_ = now.ceiling_plane->sky || now.floor_plane->sky;
  }
  if (sky_seen_) emit_sky();
  int begin = 0;
  while (begin < projection_.width) {
    const int32_t first = column_span_[static_cast<std::size_t>(begin)];
    if (first < 0) {
      ++begin;
      continue;
    }
    const uint32_t here = spans_[static_cast<std::size_t>(first)].near_sector;
    const SectorNow now = sector(here);
    float inverse_min = column_inverse_[static_cast<std::size_t>(begin)];
    int32_t last = first;
    int end = begin + 1;
    for (; end < projection_.width; ++end) {
      const int32_t index = column_span_[static_cast<std::size_t>(end)];
      if (index < 0) break;
      if (index != last) {
        const uint32_t there = spans_[static_cast<std::size_t>(index)].near_sector;
        if (there != here && !same_look(now, sector(there), here, there)) break;
        last = index;
      }
      inverse_min = std::min(inverse_min, column_inverse_[static_cast<std::size_t>(end)]);
    }
    emit_painted_run(begin, end, here, inverse_min);
    begin = end;
  }
}

void ViewBuilder::emit_painted_run(int column_begin, int column_end, uint32_t sector_index,
                                   float inverse_min) {
  const SectorNow now = sector(sector_index);
  const Sector& source = view_->sectors[sector_index];
  const auto left = static_cast<float>(column_begin), right = static_cast<float>(column_end);
  const auto rows = static_cast<float>(projection_.rows);
  inverse_min = std::max(inverse_min, kFarInverse);
  if (now.floor < eye_z_ && !now.floor_plane->sky) {
    const float foot = center_y_ + projection_.focal_y * (eye_z_ - now.floor) * inverse_min;
    if (foot < rows)
      emit_plane(left, right, foot, foot, rows, rows, now.floor, now.floor_plane->region,
                 source.floor_placement, now.floor_shade, now.tint);
  }
  if (now.ceiling > eye_z_ && !now.ceiling_plane->sky) {
    const float head = center_y_ + projection_.focal_y * (eye_z_ - now.ceiling) * inverse_min;
    if (head > 0)
      emit_plane(left, right, 0, 0, head, head, now.ceiling, now.ceiling_plane->region,
                 source.ceiling_placement, now.ceiling_shade, now.tint);
  }
}

/// The nearest solid walls of all columns.
void ViewBuilder::emit_all_walls() {
  int begin = 0;
  while (begin < projection_.width) {
    const int32_t span = column_span_[static_cast<std::size_t>(begin)];
    int end = begin + 1;
    while (end < projection_.width && column_span_[static_cast<std::size_t>(end)] == span) ++end;
    if (span >= 0) emit_walls(spans_[static_cast<std::size_t>(span)], begin, end);
    begin = end;
  }
}

/// One wall of the nearest, from its ceiling to its floor.
void ViewBuilder::emit_walls(const Span& span, int column_begin, int column_end) {
  const SectorNow& now = sector(span.near_sector);
  const SectorNow& beyond = sector(span.far_sector);
  const float left = std::max(span.x_left, static_cast<float>(column_begin));
  const float right = std::min(span.x_right, static_cast<float>(column_end));
  if (right <= left) return;
  const auto part = [&](Piece::Kind kind, float top, float bottom) {
    emit_wall_part(span, kind, left, right, row_at(span, left, top), row_at(span, right, top),
                   row_at(span, left, bottom), row_at(span, right, bottom));
  };
  if (!scene_->lines[span.line].two_sided) {
    part(Piece::Kind::kMiddle, now.ceiling, now.floor);
    return;
  }
  if (beyond.ceiling < now.ceiling)
    part(Piece::Kind::kUpper, now.ceiling, std::max(beyond.ceiling, now.floor));
  if (beyond.floor > now.floor) part(Piece::Kind::kLower, std::min(beyond.floor, now.ceiling), now.floor);
}

bool ViewBuilder::same_plane_look(const SectorNow& a, const SectorNow& b, uint32_t a_index, uint32_t b_index,
                                  bool floor) const {
  if (a_index == b_index) return true;
  if (a.tint != b.tint) return false;
  const Sector &one = view_->sectors[a_index], &other = view_->sectors[b_index];
  return floor ? a.floor == b.floor && a.floor_shade == b.floor_shade &&
                     same_plane(*a.floor_plane, *b.floor_plane) &&
                     same_placement(one.floor_placement, other.floor_placement)
               : a.ceiling == b.ceiling && a.ceiling_shade == b.ceiling_shade &&
                     same_plane(*a.ceiling_plane, *b.ceiling_plane) &&
                     same_placement(one.ceiling_placement, other.ceiling_placement);
}

void ViewBuilder::measure_border(int32_t span_index) {
  const Span& span = spans_[static_cast<std::size_t>(span_index)];
  const SceneLine& line = scene_->lines[span.line];
  const SceneSide& side = near_side(span);
  Border& border = borders_[static_cast<std::size_t>(span_index)];
  border = {};
  const SectorNow& now = *(border.now = &sector(span.near_sector));
  const SectorNow& beyond = *(border.beyond = &sector(span.far_sector));
  const auto factor = [&](float height) { return projection_.focal_y * (eye_z_ - height); };
  border.factor = {factor(now.floor), factor(now.ceiling), factor(std::min(beyond.floor, now.ceiling)),
                   factor(std::max(beyond.ceiling, now.floor))};
  border.draws_floor = now.floor < eye_z_ && !now.floor_plane->sky;
  border.draws_ceiling = now.ceiling > eye_z_ && !now.ceiling_plane->sky;
  // From below a floor hides nothing (an eye may be there while a lift rises past it).
  border.floor_ends = now.floor < eye_z_;
  border.ceiling_ends = now.ceiling > eye_z_;
  if (!line.two_sided) {
    border.middle = side.middle.present;
    return;
  }
  const bool both_sky = now.ceiling_plane->sky && beyond.ceiling_plane->sky;
  const bool ceiling_drops = beyond.ceiling<now.ceiling, floor_rises = beyond.floor> now.floor;
  border.upper = ceiling_drops && !both_sky && side.top.present;
  border.lower = floor_rises && side.bottom.present;
  if (span.solid) return;
  border.floor_ends &= !same_plane_look(now, beyond, span.near_sector, span.far_sector, true);
  border.ceiling_ends &= !same_plane_look(now, beyond, span.near_sector, span.far_sector, false);
  border.sky_goes_on = both_sky && !ceiling_drops;
  // Where a texture is missing the floor or ceiling behind it runs on in its place, as in Doom.
  border.closes_top = border.upper || (both_sky && ceiling_drops);
  border.closes_bottom = border.lower;
  if (border.closes_top)
    border.sprite_top = edge(span_index, kFarCeiling);
  else if (!ceiling_drops && !border.sky_goes_on && (beyond.ceiling > now.ceiling || now.ceiling_plane->sky))
    border.sprite_top = edge(span_index, kNearCeiling);
  if (border.closes_bottom)
    border.sprite_bottom = edge(span_index, kFarFloor);
  else if (beyond.floor < now.floor)
    border.sprite_bottom = edge(span_index, kNearFloor);
}

float ViewBuilder::row_at(const Span& span, float x, float height) const {
  return center_y_ - projection_.focal_y * (height - eye_z_) * span.inverse_at(x);
}

float ViewBuilder::row_of(Edge at, float x) const {
  if (at < 0) return at == kPictureTop ? 0.0f : static_cast<float>(projection_.rows);
  const auto span = static_cast<std::size_t>(at / 4);
  return center_y_ + borders_[span].factor[static_cast<std::size_t>(at % 4)] * spans_[span].inverse_at(x);
}

/// The partial spans of every column, near to far.
void ViewBuilder::collect_crossings() {
  std::fill(crossing_count_.begin(), crossing_count_.end(), 0);
  for (const int32_t index : partial_spans_) {
    const Span& span = spans_[static_cast<std::size_t>(index)];
    if (span.near_sector == span.far_sector) continue;
    for (int column = span.column_begin; column < span.column_end; ++column) {
      const float inverse = span.inverse_at(static_cast<float>(column) + 0.5f);
      const auto at = static_cast<std::size_t>(column);
      if (inverse <= column_inverse_[at]) continue;
      Crossing* list = &crossings_[at * kCrossingsMax];
      int32_t& count = crossing_count_[at];
      if (count == kCrossingsMax && list[count - 1].inverse >= inverse) continue;
      int place = std::min(count, kCrossingsMax - 1);
      while (place > 0 && list[place - 1].inverse < inverse) list[place] = list[place - 1], --place;
      list[place] = {.inverse = inverse, .span = index};
      count = std::min(count + 1, kCrossingsMax);
    }
  }
}

/// The same surface between the same edges, in the next column.
bool ViewBuilder::goes_on(const Piece& before, const Piece& now) const {
  if (before.kind != now.kind || before.top != now.top || before.bottom != now.bottom) return false;
  if (before.span == now.span) return true;
  if (now.kind != Piece::Kind::kFloor && now.kind != Piece::Kind::kCeiling) return false;
  const uint32_t a = spans_[static_cast<std::size_t>(before.span)].near_sector,
                 b = spans_[static_cast<std::size_t>(now.span)].near_sector;
  return same_plane_look(*borders_[static_cast<std::size_t>(before.span)].now,
                         *borders_[static_cast<std::size_t>(now.span)].now, a, b,
                         now.kind == Piece::Kind::kFloor);
}

/// Adds a piece of one column, as the continuation of one of the column before it where it is that, or else
/// if it `holds_pixel`. Pieces of a column are in the same order as those of the one before; the search goes
/// on behind the last that was found, and not far: a piece that is missed is drawn in two.
void ViewBuilder::add_piece(const Piece& piece, bool holds_pixel, std::size_t* older) {
  const std::size_t end = std::min(column_pieces_.size(), *older + kPiecesLookedAt);
  for (std::size_t i = *older; i < end; ++i) {
    Piece& before = column_pieces_[i];
    if (!goes_on(before, piece)) continue;
    next_column_pieces_.push_back(before);
    next_column_pieces_.back().column_end = piece.column_end;
    before.column_end = 0;  // it is not over
    *older = i + 1;
    return;
  }
  if (holds_pixel) next_column_pieces_.push_back(piece);
}

/// Every column is looked through from near to far: what lies between the lowest upper and the highest lower
/// edge so far still shows. Each pixel belongs to one piece; nothing is painted twice but a sliver below
/// edges.
void ViewBuilder::collect_pieces() {
  borders_.resize(std::max(borders_.size(), spans_.size()));
  for (std::size_t i = 0; i < spans_.size(); ++i) measure_border(static_cast<int32_t>(i));
  pieces_.clear(), column_pieces_.clear();
  const auto end_pieces = [&] {
    for (const Piece& piece : column_pieces_)
      if (piece.column_end > 0) pieces_.push_back(piece);
  };
  for (int column = 0; column < projection_.width; ++column) {
    const auto at = static_cast<std::size_t>(column);
    const Crossing* crossings = &crossings_[at * kCrossingsMax];
    next_column_pieces_.clear();
    std::size_t older = 0;
    struct End {
      Edge edge;
      float row;
    };
    const auto add = [&](Piece::Kind kind, int32_t span, End from, End to) {
      const Span& of = spans_[static_cast<std::size_t>(span)];
      const bool holds_pixel = std::ceil(from.row - kTuck - 0.5f) < to.row + kTuck - 0.5f;
      add_piece({.kind = kind,
                 .span = span,
                 .top = from.edge,
                 .bottom = to.edge,
                 .column_begin = column,
                 .column_end = column + 1,
                 .inverse = of.inverse_at(0.5f * static_cast<float>(of.column_begin + of.column_end))},
                holds_pixel, &older);
    };
    End top{kPictureTop, 0}, bottom{kPictureBottom, static_cast<float>(projection_.rows)};
    for (int i = 0; i <= crossing_count_[at]; ++i) {
      const bool last = i == crossing_count_[at];
      const int32_t index = last ? column_span_[at] : crossings[i].span;
      if (index < 0) {  // the map is open here: nothing ends this floor
        sky_seen_ = scene_->has_sky;
        break;
      }
      const float inverse = last ? column_inverse_[at] : crossings[i].inverse;
      const Border& border = borders_[static_cast<std::size_t>(index)];
      const auto row = [&](EdgeHeight which) { return center_y_ + border.factor[which] * inverse; };
      sky_seen_ |= border.now->ceiling_plane->sky || border.now->floor_plane->sky;
      if (const End floor{edge(index, kNearFloor), row(kNearFloor)};
          border.floor_ends && floor.row < bottom.row) {
        if (border.draws_floor) add(Piece::Kind::kFloor, index, floor.row >= top.row ? floor : top, bottom);
        bottom = floor;
        if (bottom.row <= top.row) break;
      }
      if (const End ceiling{edge(index, kNearCeiling), row(kNearCeiling)};
          border.ceiling_ends && !border.sky_goes_on && ceiling.row > top.row) {
        if (border.draws_ceiling)
          add(Piece::Kind::kCeiling, index, top, ceiling.row <= bottom.row ? ceiling : bottom);
        top = ceiling;
        if (bottom.row <= top.row) break;
      }
      if (border.middle) add(Piece::Kind::kMiddle, index, top, bottom);
      const End opening_top{edge(index, kFarCeiling), row(kFarCeiling)};
      const End opening_bottom{edge(index, kFarFloor), row(kFarFloor)};
      if (border.upper && opening_top.row > top.row)
        add(Piece::Kind::kUpper, index, top, opening_top.row <= bottom.row ? opening_top : bottom);
      if (border.lower && opening_bottom.row < bottom.row)
        add(Piece::Kind::kLower, index, opening_bottom.row >= top.row ? opening_bottom : top, bottom);
      if (border.closes_top && opening_top.row > top.row) top = opening_top;
      if (border.closes_bottom && opening_bottom.row < bottom.row) bottom = opening_bottom;
      if (bottom.row <= top.row) break;
    }
    end_pieces();
    std::swap(column_pieces_, next_column_pieces_);
  }
  end_pieces();
  // Far to near, and at the same border its wall before the floor in front of it.
  const auto farther = [](const Piece& a, const Piece& b) {
    return a.inverse != b.inverse ? a.inverse < b.inverse : a.kind > b.kind;
  };
  std::stable_sort(pieces_.begin(), pieces_.end(), farther);
}

void ViewBuilder::emit_piece(const Piece& piece) {
  const Span& span = spans_[static_cast<std::size_t>(piece.span)];
  auto left = static_cast<float>(piece.column_begin), right = static_cast<float>(piece.column_end);
  const bool wall = piece.kind != Piece::Kind::kFloor && piece.kind != Piece::Kind::kCeiling;
  if (wall) left = std::max(left, span.x_left), right = std::min(right, span.x_right);
  if (right <= left) return;
  // Under what is nearer, and so painted later, it goes on a little: edges that are cut in different places
  // are not rounded alike.
  const Edge own_top = piece.kind == Piece::Kind::kFloor   ? edge(piece.span, kNearFloor)
                       : piece.kind == Piece::Kind::kLower ? edge(piece.span, kFarFloor)
                                                           : kPictureTop;
  const Edge own_bottom = piece.kind == Piece::Kind::kCeiling ? edge(piece.span, kNearCeiling)
                          : piece.kind == Piece::Kind::kUpper ? edge(piece.span, kFarCeiling)
                                                              : kPictureBottom;
  const float above = piece.top == own_top ? 0.0f : kTuck, below = piece.bottom == own_bottom ? 0.0f : kTuck;
  const float top_left = row_of(piece.top, left) - above, top_right = row_of(piece.top, right) - above;
  const float bottom_left = row_of(piece.bottom, left) + below,
              bottom_right = row_of(piece.bottom, right) + below;
  if (wall) {
    emit_wall_part(span, piece.kind, left, right, top_left, top_right, bottom_left, bottom_right);
    return;
  }
  const SectorNow& now = *borders_[static_cast<std::size_t>(piece.span)].now;
  const Sector& source = view_->sectors[span.near_sector];
  const bool floor = piece.kind == Piece::Kind::kFloor;
  const float height = floor ? now.floor : now.ceiling;
  const float horizon = center_y_ + projection_.focal_y * (eye_z_ - height) * kFarInverse;
  if (floor)
    emit_plane(left, right, std::max(top_left, horizon), std::max(top_right, horizon), bottom_left,
               bottom_right, height, now.floor_plane->region, source.floor_placement, now.floor_shade,
               now.tint);
  else
    emit_plane(left, right, top_left, top_right, std::min(bottom_left, horizon),
               std::min(bottom_right, horizon), height, now.ceiling_plane->region, source.ceiling_placement,
               now.ceiling_shade, now.tint);
}

/// The texture of a part of a wall between four corners.
void ViewBuilder::emit_wall_part(const Span& span, Piece::Kind kind, float x_left, float x_right,
                                 float top_left, float top_right, float bottom_left, float bottom_right) {
  const SceneLine& line = scene_->lines[span.line];
  const SceneSide& near = near_side(span);
  const ScenePart& part = kind == Piece::Kind::kMiddle  ? near.middle
                          : kind == Piece::Kind::kUpper ? near.top
                                                        : near.bottom;
  if (!part.present) return;
  const SectorNow& now = sector(span.near_sector);
  const SectorNow& beyond = sector(span.far_sector);
  const float part_height = static_cast<float>(part.region.height) / part.scale_y;
  float texture_top = now.ceiling;
  if (kind == Piece::Kind::kMiddle) {
    if (line.lower_unpegged) texture_top = now.floor + part_height;
  } else if (kind == Piece::Kind::kUpper) {
    if (!line.upper_unpegged) texture_top = beyond.ceiling + part_height;
  } else {
    // Unpegged, the texture lines up with the ceiling, or with the upper edge of the opening under open sky.
    const bool both_sky = now.ceiling_plane->sky && beyond.ceiling_plane->sky;
    texture_top = !line.lower_unpegged ? beyond.floor
                  : both_sky           ? std::min(now.ceiling, beyond.ceiling)
                                       : now.ceiling;
  }
  emit_textured(span, x_left, x_right, top_left, top_right, bottom_left, bottom_right, texture_top, part,
                near, wall_shade(now, near), now.tint);
}

void ViewBuilder::emit_textured(const Span& span, float x_left, float x_right, float top_left,
                                float top_right, float bottom_left, float bottom_right, float texture_top,
                                const ScenePart& part, const SceneSide& side, float shade, int32_t tint) {
  const auto rows = static_cast<float>(projection_.rows);
  const auto texture_width = static_cast<float>(part.region.width),
             texture_height = static_cast<float>(part.region.height);
  float offset_x = part.offset_x, offset_y = part.offset_y;
  if (side.sidedef < view_->sides.size()) {
    offset_x += to_float(view_->sides[side.sidedef].scroll_x);
    offset_y += to_float(view_->sides[side.sidedef].scroll_y);
  }
  const auto corner = [&](float x, float row) {
    const float sample_x = x + projection_.wall_shift_x, sample_row = row + projection_.wall_shift_y;
    const float inverse = std::max(span.inverse_at(sample_x), kFarInverse);
    const float height = eye_z_ + (center_y_ - sample_row) / (projection_.focal_y * inverse);
    push(x, row, inverse,
         (span.u_at(sample_x) / inverse * part.scale_x + offset_x + kTexelEpsilon) / texture_width,
         ((texture_top - height) * part.scale_y + offset_y + kTexelEpsilon) / texture_height, part.region,
         shade, tint);
  };
  cut_to_picture(x_left, x_right, top_left, top_right, bottom_left, bottom_right, rows, corner);
}

void ViewBuilder::emit_plane(float x_left, float x_right, float top_left, float top_right, float bottom_left,
                             float bottom_right, float height, const AtlasRegion& region,
                             const FlatPlacement& placement, float shade, int32_t tint) {
  const auto rows = static_cast<float>(projection_.rows);
  const float inverse_per_row = 1.0f / (projection_.focal_y * (eye_z_ - height));
  // Texels per unit of the map along both axes, and where they begin.
  float along_x = 1, across = 0, scale_x = 1, scale_y = 1, offset_x = 0, offset_y = 0;
  static const FlatPlacement plain;
  if (!same_placement(placement, plain)) {
    const float radians = placement.rotation_degrees * (kTwoPi / 360.0f);
    along_x = std::cos(radians), across = std::sin(radians);
    const auto usable = [](float scale) { return scale > 1e-3f && scale < 1e3f ? scale : 1.0f; };
    scale_x = usable(placement.scale_x), scale_y = usable(placement.scale_y);
    offset_x = to_float(placement.offset_x), offset_y = to_float(placement.offset_y);
  }
  const auto corner = [&](float x, float row) {
    const float inverse = std::max((row - center_y_) * inverse_per_row, kFarInverse);
    const float depth = 1.0f / inverse,
                side = (x + projection_.plane_shift_x - projection_.center_x) / projection_.focal_x * depth;
    const float map_x = eye_x_ + cosine_ * depth + sine_ * side,
                map_y = eye_y_ + sine_ * depth - cosine_ * side;
    const float texel_x = (map_x * along_x - map_y * across) * scale_x + offset_x;
    const float texel_y = -(map_x * across + map_y * along_x) * scale_y + offset_y;
    push(x, row, inverse, (texel_x - kTexelEpsilon) / static_cast<float>(region.width),
         (texel_y - kTexelEpsilon) / static_cast<float>(region.height), region, shade, tint);
  };
  cut_to_picture(x_left, x_right, top_left, top_right, bottom_left, bottom_right, rows, corner);
}

void ViewBuilder::collect_sprites() {
  sprites_.clear();
  const auto rows = static_cast<float>(projection_.rows);
  const ActorCatalog& catalog = view_->sprites->catalog();
  const std::size_t count = view_->actors == nullptr ? 0 : view_->actors->size();
  for (std::size_t slot = 0; slot < count; ++slot) {
    const Actor& actor = (*view_->actors)[slot];
    if (actor.removed || actor.sprite == 0 || actor.id == view_->hidden_actor_id) continue;
    // As in Doom, a sprite shows where its sector does.
    if (actor.sector_index >= view_->sectors.size() || windows_[actor.sector_index].stamp != stamp_) continue;
    const float dx = to_float(actor.x) - eye_x_, dy = to_float(actor.y) - eye_y_;
    const float depth = dx * cosine_ + dy * sine_;
    if (depth < kSpriteNearDepth) continue;
    const float side = dx * sine_ - dy * cosine_;
    if (std::abs(side) > depth * 4.0f + 512.0f) continue;
    if (actor.has(ActorFlag::kInvisible) || actor.render_style == RenderStyle::kNone) continue;
    const SpriteSides* sides = view_->sprites->sides(actor.sprite, actor.frame, actor.translation);
    if (sides == nullptr) continue;
    std::size_t rotation = 0;
    if (sides->rotates)
      rotation = static_cast<std::size_t>(sprite_side(
          static_cast<Angle>(static_cast<int64_t>(std::atan2(dy, dx) * (4294967296.0 / 6.283185307179586))),
          actor.angle));
    if (sides->art[rotation] < 0) continue;
    const SpriteArt& art = atlas_->sprites()[static_cast<std::size_t>(sides->art[rotation])];
    VisibleSprite sprite;
    sprite.region = art.region, sprite.mirrored = sides->mirrored[rotation];
    sprite.inverse = 1.0f / depth;
    const float unit_x = projection_.focal_x * sprite.inverse * actor.scale_x,
                unit_y = projection_.focal_y * sprite.inverse * actor.scale_y;
    if (!(unit_x > 0) || !(unit_y > 0)) continue;
    const auto width = static_cast<float>(art.region.width);
    // A mirrored picture hangs on the other side of its point.
    const auto left_offset =
        sprite.mirrored ? width - static_cast<float>(art.left_offset) : static_cast<float>(art.left_offset);
    sprite.x_left =
        snap(projection_.center_x + side * projection_.focal_x * sprite.inverse - left_offset * unit_x);
    sprite.x_right = snap(sprite.x_left + width * unit_x);
    sprite.column_begin = std::max(0, first_column(std::clamp(sprite.x_left, -1.0f, 65536.0f)));
    sprite.column_end =
        std::min(projection_.width, first_column(std::clamp(sprite.x_right, -1.0f, 65536.0f)));
    if (sprite.column_begin >= sprite.column_end) continue;
    sprite.y_top = center_y_ - (to_float(actor.z) - eye_z_) * projection_.focal_y * sprite.inverse -
                   static_cast<float>(art.top_offset) * unit_y;
    sprite.y_bottom = sprite.y_top + static_cast<float>(art.region.height) * unit_y;
    if (sprite.y_bottom <= 0 || sprite.y_top >= rows) continue;
    bool seen = false;
    for (int column = sprite.column_begin; column < sprite.column_end && !seen; ++column)
      seen = sprite.inverse > column_inverse_[static_cast<std::size_t>(column)];
    if (!seen) continue;
    sprite.blend = blend(actor.render_style, actor.alpha);
    if (sprite.blend == -2) continue;
    const bool bright = actor.has(ActorFlag::kBright) ||
                        (actor.state < catalog.state_count() && catalog.state(actor.state).bright);
    const SectorNow& now = sector(actor.sector_index);
    sprite.shade = bright ? 0 : now.shade;
    sprite.tint = now.tint;
    sprites_.push_back(sprite);
  }
  collect_gratings();
  std::stable_sort(sprites_.begin(), sprites_.end(),
                   [](const VisibleSprite& a, const VisibleSprite& b) { return a.inverse < b.inverse; });
}

void ViewBuilder::collect_gratings() {
  for (const int32_t index : partial_spans_) {
    const Span& span = spans_[static_cast<std::size_t>(index)];
    const SceneLine& line = scene_->lines[span.line];
    if (!line.two_sided || !near_side(span).middle.present) continue;
    VisibleSprite grating;
    grating.grating = index;
    grating.inverse = span.inverse_at(0.5f * static_cast<float>(span.column_begin + span.column_end));
    const float set = span.line < view_->lines.size() ? view_->lines[span.line].alpha : -1.0f;
    grating.blend =
        blend(line.additive ? RenderStyle::kAdd : RenderStyle::kTranslucent, set >= 0 ? set : line.alpha);
    if (grating.blend != -2) sprites_.push_back(grating);
  }
}

/// Quads from here on are opaque or blended.
void ViewBuilder::begin_masked(bool blended) {
  std::vector<DrawList::Run>& runs = list_->masked_runs;
  if (!runs.empty() && runs.back().blended == blended) return;
  if (!runs.empty()) runs.back().end = quad_count();
  runs.push_back({.end = quad_count(), .blended = blended});
  list_->has_blended |= blended;
}

/// Blended quads lie in this part of the picture, given in pixels.
void ViewBuilder::cover_blended(float left, float top, float right, float bottom) {
  const auto rows = static_cast<float>(projection_.rows), columns = static_cast<float>(projection_.width);
  const PixelBox box{static_cast<int>(std::floor(std::clamp(left, 0.0f, columns))),
                     static_cast<int>(std::floor(std::clamp(top, 0.0f, rows))),
                     static_cast<int>(std::ceil(std::clamp(right, 0.0f, columns))),
                     static_cast<int>(std::ceil(std::clamp(bottom, 0.0f, rows)))};
  PixelBox& all = list_->blended_box;
  if (all.right <= all.left || all.bottom <= all.top)
    all = box;
  else
    all = {std::min(all.left, box.left), std::min(all.top, box.top), std::max(all.right, box.right),
           std::max(all.bottom, box.bottom)};
}

/// What is left between the edges that are nearer than 1 / inverse and hide sprites.
ViewBuilder::Clip ViewBuilder::clip_at(int column, float inverse, int32_t own_span) const {
  Clip clip;
  if (partial_spans_.empty()) return clip;
  const auto at = static_cast<std::size_t>(column);
  float top_row = 0, bottom_row = static_cast<float>(projection_.rows);
  for (int i = 0; i < crossing_count_[at]; ++i) {
    const Crossing& crossing = crossings_[at * kCrossingsMax + static_cast<std::size_t>(i)];
    if (crossing.inverse <= inverse || crossing.span == own_span) break;
    const Border& border = borders_[static_cast<std::size_t>(crossing.span)];
    const auto row = [&](Edge edge_at) {
      return center_y_ + border.factor[static_cast<std::size_t>(edge_at % 4)] * crossing.inverse;
    };
    if (border.sprite_top >= 0 && row(border.sprite_top) > top_row)
      top_row = row(border.sprite_top), clip.top = border.sprite_top;
    if (border.sprite_bottom >= 0 && row(border.sprite_bottom) < bottom_row)
      bottom_row = row(border.sprite_bottom), clip.bottom = border.sprite_bottom;
  }
  return clip;
}

void ViewBuilder::emit_masked() {
  const auto rows = static_cast<float>(projection_.rows);
  for (const VisibleSprite& sprite : sprites_) {
    const Span* span = sprite.grating < 0 ? nullptr : &spans_[static_cast<std::size_t>(sprite.grating)];
    const auto inverse_at = [&](int column) {
      return span == nullptr ? sprite.inverse : span->inverse_at(static_cast<float>(column) + 0.5f);
    };
    const auto visible = [&](int column) {
      return inverse_at(column) > column_inverse_[static_cast<std::size_t>(column)];
    };
    begin_masked(sprite.blend >= 0);
    const int32_t mark = sprite.blend >= 0
                             ? static_cast<int32_t>(static_cast<uint32_t>(sprite.blend) << kTintShift)
                             : sprite.tint;
    const int first = span == nullptr ? sprite.column_begin : span->column_begin;
    const int last = span == nullptr ? sprite.column_end : span->column_end;
    for (int column = first; column < last;) {
      if (!visible(column)) {
        ++column;
        continue;
      }
      const Clip clip = clip_at(column, inverse_at(column), sprite.grating);
      int end = column + 1;
      while (end < last && visible(end) && clip_at(end, inverse_at(end), sprite.grating) == clip) ++end;
      const auto run_left = static_cast<float>(column), run_right = static_cast<float>(end);
      column = end;
      if (span == nullptr) {
        emit_sprite(sprite, mark, run_left, run_right, clip);
      } else {
        if (sprite.blend >= 0) cover_blended(run_left, 0, run_right, rows);
        emit_grating(*span, sprite.blend >= 0 ? mark : sector(span->near_sector).tint, run_left, run_right,
                     clip);
      }
    }
  }
}

void ViewBuilder::emit_sprite(const VisibleSprite& sprite, int32_t mark, float run_left, float run_right,
                              const Clip& clip) {
  const auto rows = static_cast<float>(projection_.rows);
  const float left = std::max(sprite.x_left, run_left), right = std::min(sprite.x_right, run_right);
  if (right <= left) return;
  if (sprite.blend >= 0) cover_blended(left, sprite.y_top, right, sprite.y_bottom);
  const auto corner = [&](float x, float row) {
    const float u = inside((x - sprite.x_left) / (sprite.x_right - sprite.x_left));
    const float v = inside((row - sprite.y_top) / (sprite.y_bottom - sprite.y_top));
    push(x, row, sprite.inverse, sprite.mirrored ? 1.0f - u : u, v, sprite.region, sprite.shade, mark);
  };
  cut_by_edges(
      left, right, [&](float x) { return row_of(clip.top, x); }, [&](float) { return sprite.y_top; },
      [&](float x) { return row_of(clip.bottom, x); }, [&](float) { return sprite.y_bottom; },
      [&](float a, float b, const auto& upper, const auto& lower) {
        cut_to_picture(a, b, upper(a), upper(b), lower(a), lower(b), rows, corner);
      });
}

void ViewBuilder::emit_grating(const Span& span, int32_t tint_or_blend, float run_left, float run_right,
                               const Clip& clip) {
  const SceneLine& line = scene_->lines[span.line];
  const SceneSide& near = near_side(span);
  const SectorNow& now = sector(span.near_sector);
  const SectorNow& beyond = sector(span.far_sector);
  const float opening_top = std::min(now.ceiling, beyond.ceiling);
  const float opening_bottom = std::max(now.floor, beyond.floor);
  const float height = static_cast<float>(near.middle.region.height) / near.middle.scale_y;
  // The offset moves the picture itself, not what it shows.
  ScenePart part = near.middle;
  float texture_top =
      (line.lower_unpegged ? opening_bottom + height : opening_top) + part.offset_y / part.scale_y;
  part.offset_y = 0;
  if (near.sidedef < view_->sides.size() && !line.wraps_middle)
    texture_top += to_float(view_->sides[near.sidedef].scroll_y) / part.scale_y;
  const float left = std::max(span.x_left, run_left), right = std::min(span.x_right, run_right);
  if (right <= left) return;
  const float top = line.wraps_middle ? opening_top : std::min(opening_top, texture_top);
  const float bottom = line.wraps_middle ? opening_bottom : std::max(opening_bottom, texture_top - height);
  cut_by_edges(
      left, right, [&](float x) { return row_of(clip.top, x); },
      [&](float x) { return row_at(span, x, top); }, [&](float x) { return row_of(clip.bottom, x); },
      [&](float x) { return row_at(span, x, bottom); },
      [&](float a, float b, const auto& upper, const auto& lower) {
        emit_textured(span, a, b, upper(a), upper(b), lower(a), lower(b), texture_top, part, near,
                      wall_shade(now, near), tint_or_blend);
      });
}

void ViewBuilder::emit_hand() {
  const auto rows = static_cast<float>(projection_.rows);
  const int32_t hand_blend = blend(view_->hand_style, view_->hand_alpha);
  if (hand_blend == -2) return;
  // 320 columns and 200 rows of a 4:3 screen; x = 160 lies in the middle of the view, and as much of the
  // picture is hidden below the view as on a screen with a status bar.
  const float unit_x = projection_.hand_unit_x, unit_y = projection_.hand_unit_y;
  for (const HandSprite& held : view_->hand) {
    const SpriteSides* sides = view_->sprites->sides(held.sprite, held.frame);
    if (sides == nullptr || sides->art[0] < 0) continue;
    const SpriteArt& art = atlas_->sprites()[static_cast<std::size_t>(sides->art[0])];
    const float left =
        snap(projection_.center_x + (held.x - 160.0f - static_cast<float>(art.left_offset)) * unit_x);
    const float right = snap(left + static_cast<float>(art.region.width) * unit_x);
    const float top = projection_.center_y + (held.y - 100.0f - static_cast<float>(art.top_offset)) * unit_y;
    const float bottom = top + static_cast<float>(art.region.height) * unit_y;
    const float x0 = std::max(left, 0.0f), x1 = std::min(right, static_cast<float>(projection_.width));
    const float y0 = std::max(top, 0.0f), y1 = std::min(bottom, rows);
    if (x0 >= x1 || y0 >= y1) continue;
    begin_masked(hand_blend >= 0);
    if (hand_blend >= 0) cover_blended(x0, y0, x1, y1);
    const SectorNow& now = sector(eye_sector_);
    const float shade = held.bright ? 0 : now.shade;
    const int32_t mark =
        hand_blend >= 0 ? static_cast<int32_t>(static_cast<uint32_t>(hand_blend) << kTintShift) : now.tint;
    const bool mirrored = sides->mirrored[0];
    const auto u_at = [&](float x) {
      const float u = inside((x - left) / (right - left));
      return mirrored ? 1.0f - u : u;
    };
    const auto v_at = [&](float row) { return inside((row - top) / (bottom - top)); };
    push(x0, y0, 1, u_at(x0), v_at(y0), art.region, shade, mark);
    push(x1, y0, 1, u_at(x1), v_at(y0), art.region, shade, mark);
    push(x1, y1, 1, u_at(x1), v_at(y1), art.region, shade, mark);
    push(x0, y1, 1, u_at(x0), v_at(y1), art.region, shade, mark);
  }
}

}  // namespace comrad::doom
