#include "sim_workers/engine/render/view_builder.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace comrad::doom {
namespace {

constexpr float kNearDepth = 1.0f;        // bodies keep walls farther away than this
constexpr float kSpriteNearDepth = 4.0f;  // as in Doom: nearer things are not drawn
constexpr float kFarInverse = 1.0f / 60000.0f;
constexpr int kCrossingsMax = 32;  // floor or ceiling changes seen in one column; farther ones are left out
constexpr int kSkyStripColumns = 16;
constexpr float kSkyColumnsPerTurn = 1024.0f;
// Coordinates that are whole texels in exact arithmetic (walls and eyes on round numbers are common) must not
// fall to either side by rounding.
constexpr float kTexelEpsilon = 1.0f / 256.0f;
constexpr float kTwoPi = 6.28318530717958647692f;

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

bool same_plane(const ScenePlane& a, const ScenePlane& b) {
  return a.sky == b.sky && a.region.address == b.region.address;
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
  changed_planes_.clear();
  const double radians = angle_to_radians(view.angle);
  cosine_ = static_cast<float>(std::cos(radians)), sine_ = static_cast<float>(std::sin(radians));
  eye_x_ = static_cast<float>(view.eye_x), eye_y_ = static_cast<float>(view.eye_y);
  eye_z_ = static_cast<float>(view.eye_z);
  sky_seen_ = false;
  transform_vertices();
  collect_spans();
  list->needs_depth = !partial_spans_.empty();

  if (!list->needs_depth) {
    emit_painted_planes();
    int begin = 0;
    while (begin < projection_.width) {
      const int32_t span = column_span_[static_cast<std::size_t>(begin)];
      int end = begin + 1;
      while (end < projection_.width && column_span_[static_cast<std::size_t>(end)] == span) ++end;
      if (span >= 0) emit_walls(spans_[static_cast<std::size_t>(span)], begin, end);
      begin = end;
    }
    list->painted_end = list->solid_end = list->plane_end = quad_count();
  } else {
    if (scene_->has_sky) emit_sky();
    list->painted_end = quad_count();
    int begin = 0;
    while (begin < projection_.width) {
      const int32_t span = column_span_[static_cast<std::size_t>(begin)];
      int end = begin + 1;
      while (end < projection_.width && column_span_[static_cast<std::size_t>(end)] == span) ++end;
      if (span >= 0) emit_walls(spans_[static_cast<std::size_t>(span)], begin, end);
      begin = end;
    }
    for (const int32_t index : partial_spans_) {
      const Span& span = spans_[static_cast<std::size_t>(index)];
      for (int column = span.column_begin; column < span.column_end;) {
        const auto hidden = [&](int at) {
          return span.inverse_at(static_cast<float>(at) + 0.5f) <=
                 column_inverse_[static_cast<std::size_t>(at)];
        };
        if (hidden(column)) {
          ++column;
          continue;
        }
        int end = column + 1;
        while (end < span.column_end && !hidden(end)) ++end;
        emit_walls(span, column, end);
        column = end;
      }
    }
    list->solid_end = quad_count();
    emit_crossed_planes();
    list->plane_end = quad_count();
  }
  collect_sprites();
  emit_masked();
  list->masked_end = quad_count();
}

const ViewBuilder::SectorNow& ViewBuilder::sector(uint32_t index) {
  SectorNow& now = sectors_[index];
  if (now.stamp == stamp_) return now;
  const Sector& sector = view_->sectors[index];
  now.stamp = stamp_;
  now.floor = to_float(sector.floor_height), now.ceiling = to_float(sector.ceiling_height);
  now.shade = light_shade(std::clamp(sector.light, 0, 255));
  const auto current = [&](const ScenePlane& loaded, const std::string& name) {
    if (loaded.name == name) return &loaded;
    changed_planes_.push_back(Scene::plane(name, atlas_));
    return const_cast<const ScenePlane*>(&changed_planes_.back());
  };
  now.floor_plane = current(scene_->floors[index], sector.floor_texture);
  now.ceiling_plane = current(scene_->ceilings[index], sector.ceiling_texture);
  return now;
}

const SceneSide& ViewBuilder::near_side(const Span& span) const {
  return span.back_side ? scene_->lines[span.line].back : scene_->lines[span.line].front;
}

const SceneSide& ViewBuilder::far_side(const Span& span) const {
  return span.back_side ? scene_->lines[span.line].front : scene_->lines[span.line].back;
}

void ViewBuilder::transform_vertices() {
  const std::size_t count = scene_->vertex_x.size();
  side_.resize(count), depth_.resize(count);
  const float* x = scene_->vertex_x.data();
  const float* y = scene_->vertex_y.data();
  for (std::size_t i = 0; i < count; ++i) {
    const float dx = x[i] - eye_x_, dy = y[i] - eye_y_;
    depth_[i] = dx * cosine_ + dy * sine_;
    side_[i] = dx * sine_ - dy * cosine_;
  }
}

void ViewBuilder::collect_spans() {
  spans_.clear();
  partial_spans_.clear();
  std::fill(column_inverse_.begin(), column_inverse_.end(), 0.0f);
  std::fill(column_span_.begin(), column_span_.end(), -1);
  for (uint32_t line = 0; line < scene_->lines.size(); ++line) {
    if (!add_span(line)) continue;
    const auto index = static_cast<int32_t>(spans_.size()) - 1;
    if (spans_.back().solid)
      fill_columns(index);
    else
      partial_spans_.push_back(index);
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

bool ViewBuilder::add_span(uint32_t line_index) {
  const SceneLine& line = scene_->lines[line_index];
  float side_a = side_[line.start], depth_a = depth_[line.start];
  float side_b = side_[line.end], depth_b = depth_[line.end];
  if (depth_a < kNearDepth && depth_b < kNearDepth) return false;
  // Seen from its front, a line runs from left to right.
  const bool from_back = side_a * depth_b >= side_b * depth_a;
  if (from_back && !line.two_sided) return false;
  // Outside the picture's left or right border: both ends on the far side of the same border ray.
  const float left_reach = projection_.center_x,
              right_reach = static_cast<float>(projection_.width) - left_reach;
  const float focal = projection_.focal_x;
  if (side_a * focal < -left_reach * depth_a && side_b * focal < -left_reach * depth_b) return false;
  if (side_a * focal > right_reach * depth_a && side_b * focal > right_reach * depth_b) return false;
  float u_a = 0, u_b = line.length;
  if (from_back) {
    std::swap(side_a, side_b), std::swap(depth_a, depth_b);
  }
  const float length = line.length;
  if (depth_a < kNearDepth) {
    const float t = (kNearDepth - depth_a) / (depth_b - depth_a);
    side_a += t * (side_b - side_a), u_a += t * length, depth_a = kNearDepth;
  } else if (depth_b < kNearDepth) {
    const float t = (kNearDepth - depth_b) / (depth_a - depth_b);
    side_b += t * (side_a - side_b), u_b -= t * length, depth_b = kNearDepth;
  }
  Span span;
  span.line = line_index, span.back_side = from_back;
  const float inverse_a = 1.0f / depth_a, inverse_b = 1.0f / depth_b;
  span.x_left = snap(projection_.center_x + focal * side_a * inverse_a);
  span.x_right = snap(projection_.center_x + focal * side_b * inverse_b);
  span.column_begin = std::max(0, first_column(std::max(span.x_left, -1.0f)));
  span.column_end = std::min(projection_.width, first_column(std::min(span.x_right, 65536.0f)));
  if (span.column_begin >= span.column_end) return false;
  const SceneSide& near = near_side(span);
  if (line.two_sided) {
    const SceneSide& far = far_side(span);
    if (near.sector == far.sector && !near.has_middle) return false;
    const SectorNow now = sector(near.sector);
    const SectorNow& beyond = sector(far.sector);
    span.solid = std::max(now.floor, beyond.floor) >= std::min(now.ceiling, beyond.ceiling);
    if (!span.solid && !near.has_middle && now.floor == beyond.floor && now.ceiling == beyond.ceiling &&
        now.shade == beyond.shade && same_plane(*now.floor_plane, *beyond.floor_plane) &&
        same_plane(*now.ceiling_plane, *beyond.ceiling_plane))
      return false;
  } else {
    span.solid = true;
  }
  // The texture runs from the near side's own start, which is always the span's left end.
  const float width = span.x_right - span.x_left;
  span.inverse_left = inverse_a, span.inverse_slope = (inverse_b - inverse_a) / width;
  span.u_left = (u_a + near.offset_x) * inverse_a;
  span.u_slope = ((u_b + near.offset_x) * inverse_b - span.u_left) / width;
  spans_.push_back(span);
  return true;
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
                       float shade) {
  const float w = 1.0f / inverse;
  list_->vertices.push_back({.x = (x * 2.0f / static_cast<float>(projection_.width) - 1.0f) * w,
                             .y = (row * 2.0f / static_cast<float>(projection_.rows) - 1.0f) * w,
                             .z = w - 2.0f * kNearDepth,
                             .w = w,
                             .u = u,
                             .v = v,
                             .width = static_cast<float>(region.width),
                             .height = static_cast<float>(region.height),
                             .shade = shade,
                             .address = static_cast<int32_t>(region.address)});
}

void ViewBuilder::emit_sky() {
  const AtlasRegion& region = scene_->sky;
  const float radians = static_cast<float>(angle_to_radians(view_->angle));
  const float repeats_per_radian = kSkyColumnsPerTurn / kTwoPi / static_cast<float>(region.width);
  const float texels_per_row = 200.0f / (projection_.focal_y / 0.8f);  // the texture was drawn for 200 rows
  const auto u_at = [&](int column) {
    const float offset = (static_cast<float>(column) - projection_.center_x) / projection_.focal_x;
    return (radians - std::atan(offset)) * repeats_per_radian;
  };
  const auto v_at = [&](float row) {
    return (100.0f + (row - projection_.center_y) * texels_per_row) / static_cast<float>(region.height);
  };
  const auto rows = static_cast<float>(projection_.rows);
  for (int begin = 0; begin < projection_.width; begin += kSkyStripColumns) {
    const int end = std::min(begin + kSkyStripColumns, projection_.width);
    const auto left = static_cast<float>(begin), right = static_cast<float>(end);
    push(left, 0, 1, u_at(begin), v_at(0), region, 0);
    push(right, 0, 1, u_at(end), v_at(0), region, 0);
    push(right, rows, 1, u_at(end), v_at(rows), region, 0);
    push(left, rows, 1, u_at(begin), v_at(rows), region, 0);
  }
}

/// Where only solid walls are seen, each stretch of columns that ends at the same kind of floor gets one
/// rectangle down from the farthest wall's foot; nearer walls are painted over it.
void ViewBuilder::emit_painted_planes() {
  for (int column = 0; column < projection_.width && !sky_seen_; ++column) {
    const int32_t index = column_span_[static_cast<std::size_t>(column)];
    if (index < 0 || (column > 0 && column_span_[static_cast<std::size_t>(column - 1)] == index)) continue;
    const SectorNow& now = sector(near_side(spans_[static_cast<std::size_t>(index)]).sector);
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
    const SectorNow now = sector(near_side(spans_[static_cast<std::size_t>(first)]).sector);
    float inverse_min = column_inverse_[static_cast<std::size_t>(begin)];
    int32_t last = first;
    int end = begin + 1;
    for (; end < projection_.width; ++end) {
      const int32_t index = column_span_[static_cast<std::size_t>(end)];
      if (index < 0) break;
      if (index != last) {
        const SectorNow& other = sector(near_side(spans_[static_cast<std::size_t>(index)]).sector);
        if (other.floor != now.floor || other.ceiling != now.ceiling || other.shade != now.shade ||
            !same_plane(*other.floor_plane, *now.floor_plane) ||
            !same_plane(*other.ceiling_plane, *now.ceiling_plane))
          break;
        last = index;
      }
      inverse_min = std::min(inverse_min, column_inverse_[static_cast<std::size_t>(end)]);
    }
    emit_painted_run(begin, end, now, inverse_min);
    begin = end;
  }
}

void ViewBuilder::emit_painted_run(int column_begin, int column_end, const SectorNow& now,
                                   float inverse_min) {
  const auto left = static_cast<float>(column_begin), right = static_cast<float>(column_end);
  const auto rows = static_cast<float>(projection_.rows);
  inverse_min = std::max(inverse_min, kFarInverse);
  if (now.floor < eye_z_ && !now.floor_plane->sky) {
    const float foot = projection_.center_y + projection_.focal_y * (eye_z_ - now.floor) * inverse_min;
    if (foot < rows)
      emit_plane(left, right, foot, foot, rows, rows, now.floor, now.floor_plane->region, now.shade);
  }
  if (now.ceiling > eye_z_ && !now.ceiling_plane->sky) {
    const float head = projection_.center_y + projection_.focal_y * (eye_z_ - now.ceiling) * inverse_min;
    if (head > 0)
      emit_plane(left, right, 0, 0, head, head, now.ceiling, now.ceiling_plane->region, now.shade);
  }
}

void ViewBuilder::emit_walls(const Span& span, int column_begin, int column_end) {
  const SceneLine& line = scene_->lines[span.line];
  const SceneSide& near = near_side(span);
  const SectorNow now = sector(near.sector);
  const float left = std::max(span.x_left, static_cast<float>(column_begin));
  const float right = std::min(span.x_right, static_cast<float>(column_end));
  if (right <= left) return;
  const float shade = now.shade + line.contrast_rows;
  if (!line.two_sided) {
    if (!near.has_middle) return;
    const float texture_top =
        line.lower_unpegged ? now.floor + static_cast<float>(near.middle.height) : now.ceiling;
    emit_wall_part(span, left, right, now.ceiling, now.floor, texture_top, near.offset_y, near.middle, shade);
    return;
  }
  const SectorNow beyond = sector(far_side(span).sector);
  const bool both_sky = now.ceiling_plane->sky && beyond.ceiling_plane->sky;
  if (beyond.ceiling < now.ceiling && !both_sky && near.has_top) {
    const float bottom = std::max(beyond.ceiling, now.floor);
    const float texture_top =
        line.upper_unpegged ? now.ceiling : beyond.ceiling + static_cast<float>(near.top.height);
    emit_wall_part(span, left, right, now.ceiling, bottom, texture_top, near.offset_y, near.top, shade);
  }
  if (beyond.floor > now.floor && near.has_bottom) {
    const float top = std::min(beyond.floor, now.ceiling);
    const float texture_top = line.lower_unpegged ? now.ceiling : beyond.floor;
    emit_wall_part(span, left, right, top, now.floor, texture_top, near.offset_y, near.bottom, shade);
  }
  // A floor that drops away hides what lies below its edge, a ceiling that rises what lies above. Planes
  // write no depth (sprites may reach a little below their floor), so a curtain behind the edge does; the
  // nearer plane covers it in the picture.
  if (beyond.floor < now.floor)
    emit_wall_part(span, left, right, now.floor, beyond.floor, now.floor, 0, now.floor_plane->region,
                   now.shade);
  if (beyond.ceiling > now.ceiling && !now.ceiling_plane->sky)
    emit_wall_part(span, left, right, beyond.ceiling, now.ceiling, now.ceiling, 0, now.ceiling_plane->region,
                   now.shade);
}

void ViewBuilder::emit_wall_part(const Span& span, float x_left, float x_right, float top, float bottom,
                                 float texture_top, float offset_y, const AtlasRegion& region, float shade) {
  if (top <= bottom) return;
  const auto rows = static_cast<float>(projection_.rows);
  const auto row_at = [&](float x, float height) {
    return projection_.center_y - projection_.focal_y * (height - eye_z_) * span.inverse_at(x);
  };
  const float top_left = row_at(x_left, top), top_right = row_at(x_right, top);
  const float bottom_left = row_at(x_left, bottom), bottom_right = row_at(x_right, bottom);
  if (std::max(bottom_left, bottom_right) <= 0 || std::min(top_left, top_right) >= rows) return;
  const auto texture_width = static_cast<float>(region.width),
             texture_height = static_cast<float>(region.height);
  const auto corner = [&](float x, float row) {
    const float sample_x = x + projection_.wall_shift_x, sample_row = row + projection_.wall_shift_y;
    const float inverse = std::max(span.inverse_at(sample_x), kFarInverse);
    const float height = eye_z_ + (projection_.center_y - sample_row) / (projection_.focal_y * inverse);
    push(x, row, inverse, (span.u_at(sample_x) / inverse + kTexelEpsilon) / texture_width,
         (texture_top - height + offset_y + kTexelEpsilon) / texture_height, region, shade);
  };
  split_at_borders(x_left, x_right, top_left, top_right, bottom_left, bottom_right, rows,
                   [&](float a, float b) {
                     const float top_a = std::clamp(row_at(a, top), 0.0f, rows),
                                 top_b = std::clamp(row_at(b, top), 0.0f, rows);
                     const float bottom_a = std::clamp(row_at(a, bottom), 0.0f, rows);
                     const float bottom_b = std::clamp(row_at(b, bottom), 0.0f, rows);
                     if (bottom_a <= top_a && bottom_b <= top_b) return;
                     corner(a, top_a), corner(b, top_b), corner(b, bottom_b), corner(a, bottom_a);
                   });
}

/// Columns that look through the same openings to the same wall share the strips of floor and ceiling between
/// them.
void ViewBuilder::emit_crossed_planes() {
  std::fill(crossing_count_.begin(), crossing_count_.end(), 0);
  for (const int32_t index : partial_spans_) {
    const Span& span = spans_[static_cast<std::size_t>(index)];
    if (near_side(span).sector == far_side(span).sector) continue;
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
  const auto same_column = [&](int a, int b) {
    const auto one = static_cast<std::size_t>(a), other = static_cast<std::size_t>(b);
    if (column_span_[one] != column_span_[other] || crossing_count_[one] != crossing_count_[other])
      return false;
    for (int i = 0; i < crossing_count_[one]; ++i)
      if (crossings_[one * kCrossingsMax + static_cast<std::size_t>(i)].span !=
          crossings_[other * kCrossingsMax + static_cast<std::size_t>(i)].span)
        return false;
    return true;
  };
  int begin = 0;
  while (begin < projection_.width) {
    int end = begin + 1;
    while (end < projection_.width && same_column(begin, end)) ++end;
    const auto at = static_cast<std::size_t>(begin);
    emit_plane_run(begin, end, &crossings_[at * kCrossingsMax], crossing_count_[at], column_span_[at]);
    begin = end;
  }
}

void ViewBuilder::emit_plane_run(int column_begin, int column_end, const Crossing* crossings, int count,
                                 int32_t solid_span) {
  const auto left = static_cast<float>(column_begin), right = static_cast<float>(column_end);
  const auto rows = static_cast<float>(projection_.rows);
  const auto inverse_of = [&](const Span& span, float x) {
    return std::clamp(span.inverse_at(x), kFarInverse, 1.0f / kNearDepth);
  };
  const Span* near_edge = nullptr;
  for (int i = 0; i <= count; ++i) {
    const int32_t far_index = i < count ? crossings[i].span : solid_span;
    if (far_index < 0) return;  // the map is open here: nothing ends this floor
    const Span& far_edge = spans_[static_cast<std::size_t>(far_index)];
    const SectorNow now = sector(near_side(far_edge).sector);
    const bool has_beyond = !far_edge.solid;
    const SectorNow beyond = has_beyond ? sector(far_side(far_edge).sector) : now;
    const float far_left = inverse_of(far_edge, left), far_right = inverse_of(far_edge, right);
    const float near_left = near_edge ? inverse_of(*near_edge, left) : 0;
    const float near_right = near_edge ? inverse_of(*near_edge, right) : 0;
    // Under a wall that rises from the far edge the strip goes on for a pixel: the wall hides it, no gap can
    // show.
    const auto scale = [&](float height) { return projection_.focal_y * (eye_z_ - height); };
    if (now.floor < eye_z_ && !now.floor_plane->sky) {
      const float tuck = !has_beyond || beyond.floor > now.floor ? 1.0f : 0.0f;
      const float unit = scale(now.floor), horizon = projection_.center_y + unit * kFarInverse;
      emit_plane(left, right, std::max(horizon, projection_.center_y + unit * far_left - tuck),
                 std::max(horizon, projection_.center_y + unit * far_right - tuck),
                 near_edge ? projection_.center_y + unit * near_left : rows,
                 near_edge ? projection_.center_y + unit * near_right : rows, now.floor,
                 now.floor_plane->region, now.shade);
    }
    if (now.ceiling > eye_z_ && !now.ceiling_plane->sky) {
      const float tuck = !has_beyond || beyond.ceiling < now.ceiling ? 1.0f : 0.0f;
      const float unit = scale(now.ceiling), horizon = projection_.center_y + unit * kFarInverse;
      emit_plane(left, right, near_edge ? projection_.center_y + unit * near_left : 0,
                 near_edge ? projection_.center_y + unit * near_right : 0,
                 std::min(horizon, projection_.center_y + unit * far_left + tuck),
                 std::min(horizon, projection_.center_y + unit * far_right + tuck), now.ceiling,
                 now.ceiling_plane->region, now.shade);
    }
    near_edge = &far_edge;
  }
}

void ViewBuilder::emit_plane(float x_left, float x_right, float top_left, float top_right, float bottom_left,
                             float bottom_right, float height, const AtlasRegion& region, float shade) {
  const auto rows = static_cast<float>(projection_.rows);
  if (std::max(bottom_left, bottom_right) <= 0 || std::min(top_left, top_right) >= rows) return;
  const float inverse_per_row = 1.0f / (projection_.focal_y * (eye_z_ - height));
  const auto corner = [&](float x, float row) {
    const float inverse = std::max((row - projection_.center_y) * inverse_per_row, kFarInverse);
    const float depth = 1.0f / inverse,
                side = (x + projection_.plane_shift_x - projection_.center_x) / projection_.focal_x * depth;
    const float map_x = eye_x_ + cosine_ * depth + sine_ * side,
                map_y = eye_y_ + sine_ * depth - cosine_ * side;
    push(x, row, inverse, (map_x - kTexelEpsilon) / static_cast<float>(region.width),
         (-map_y - kTexelEpsilon) / static_cast<float>(region.height), region, shade);
  };
  split_at_borders(
      x_left, x_right, top_left, top_right, bottom_left, bottom_right, rows, [&](float a, float b) {
        const auto along = [&](float at_left, float at_right, float x) {
          return std::clamp(at_left + (at_right - at_left) * ((x - x_left) / (x_right - x_left)), 0.0f, rows);
        };
        const float top_a = along(top_left, top_right, a), top_b = along(top_left, top_right, b);
        const float bottom_a = along(bottom_left, bottom_right, a),
                    bottom_b = along(bottom_left, bottom_right, b);
        if (bottom_a <= top_a && bottom_b <= top_b) return;
        corner(a, top_a), corner(b, top_b), corner(b, bottom_b), corner(a, bottom_a);
      });
}

void ViewBuilder::collect_sprites() {
  sprites_.clear();
  const auto rows = static_cast<float>(projection_.rows);
  for (const Actor& actor : view_->actors) {
    if (actor.removed || actor.id == view_->hidden_actor_id) continue;
    const SpriteSides* sides = view_->sprites->sides(actor.type, actor.frame_index);
    if (sides == nullptr) continue;
    const float dx = to_float(actor.x) - eye_x_, dy = to_float(actor.y) - eye_y_;
    const float depth = dx * cosine_ + dy * sine_;
    if (depth < kSpriteNearDepth) continue;
    const float side = dx * sine_ - dy * cosine_;
    if (std::abs(side) > depth * 4.0f + 512.0f) continue;
    std::size_t rotation = 0;
    if (sides->art[0] != sides->art[4] || sides->mirrored[0] != sides->mirrored[4] ||
        sides->art[0] != sides->art[2])
      rotation = static_cast<std::size_t>(sprite_side(
          static_cast<Angle>(static_cast<int64_t>(std::atan2(dy, dx) * (4294967296.0 / 6.283185307179586))),
          actor.angle));
    if (sides->art[rotation] < 0) continue;
    const SpriteArt& art = atlas_->sprites()[static_cast<std::size_t>(sides->art[rotation])];
    VisibleSprite sprite;
    sprite.art = &art, sprite.mirrored = sides->mirrored[rotation];
    sprite.inverse = 1.0f / depth;
    const ActorType& type = view_->sprites->catalog()[actor.type];
    const float scale_x = projection_.focal_x * sprite.inverse,
                scale_y = projection_.focal_y * sprite.inverse;
    const auto left_offset = static_cast<float>(art.left_offset),
               width = static_cast<float>(art.region.width);
    sprite.x_left = snap(projection_.center_x + (side - left_offset * type.scale) * scale_x);
    sprite.x_right = snap(sprite.x_left + width * type.scale * scale_x);
    sprite.column_begin = std::max(0, first_column(std::max(sprite.x_left, -1.0f)));
    sprite.column_end = std::min(projection_.width, first_column(std::min(sprite.x_right, 65536.0f)));
    if (sprite.column_begin >= sprite.column_end) continue;
    const float top = to_float(actor.z) + static_cast<float>(art.top_offset) * type.scale - eye_z_;
    sprite.y_top = projection_.center_y - top * scale_y;
    sprite.y_bottom = sprite.y_top + static_cast<float>(art.region.height) * type.scale * scale_y;
    if (sprite.y_bottom <= 0 || sprite.y_top >= rows) continue;
    bool seen = false;
    for (int column = sprite.column_begin; column < sprite.column_end && !seen; ++column)
      seen = sprite.inverse > column_inverse_[static_cast<std::size_t>(column)];
    if (!seen) continue;
    const bool bright =
        type.bright || (actor.frame_index < type.frames.size() && type.frames[actor.frame_index].bright);
    sprite.shade =
        bright || actor.sector_index >= view_->sectors.size() ? 0 : sector(actor.sector_index).shade;
    sprites_.push_back(sprite);
  }
  for (const int32_t index : partial_spans_) {
    const Span& span = spans_[static_cast<std::size_t>(index)];
    if (!near_side(span).has_middle || !scene_->lines[span.line].two_sided) continue;
    VisibleSprite grating;
    grating.grating = index;
    grating.inverse = span.inverse_at(0.5f * static_cast<float>(span.column_begin + span.column_end));
    sprites_.push_back(grating);
  }
  std::stable_sort(sprites_.begin(), sprites_.end(),
                   [](const VisibleSprite& a, const VisibleSprite& b) { return a.inverse < b.inverse; });
}

void ViewBuilder::emit_masked() {
  const auto rows = static_cast<float>(projection_.rows);
  for (const VisibleSprite& sprite : sprites_) {
    const Span* span = sprite.grating < 0 ? nullptr : &spans_[static_cast<std::size_t>(sprite.grating)];
    const auto visible = [&](int column) {
      const float inverse =
          span == nullptr ? sprite.inverse : span->inverse_at(static_cast<float>(column) + 0.5f);
      return inverse > column_inverse_[static_cast<std::size_t>(column)];
    };
    const int first = span == nullptr ? sprite.column_begin : span->column_begin;
    const int last = span == nullptr ? sprite.column_end : span->column_end;
    for (int column = first; column < last;) {
      if (!visible(column)) {
        ++column;
        continue;
      }
      int end = column + 1;
      while (end < last && visible(end)) ++end;
      const auto run_left = static_cast<float>(column), run_right = static_cast<float>(end);
      column = end;
      if (span != nullptr) {
        const SceneLine& line = scene_->lines[span->line];
        const SceneSide& near = near_side(*span);
        const SectorNow now = sector(near.sector);
        const SectorNow beyond = sector(far_side(*span).sector);
        const float opening_top = std::min(now.ceiling, beyond.ceiling);
        const float opening_bottom = std::max(now.floor, beyond.floor);
        const auto height = static_cast<float>(near.middle.height);
        // A see-through texture hangs once in the opening, it is not repeated downwards.
        const float texture_top =
            (line.lower_unpegged ? opening_bottom + height : opening_top) + near.offset_y;
        emit_wall_part(*span, std::max(span->x_left, run_left), std::min(span->x_right, run_right),
                       std::min(opening_top, texture_top), std::max(opening_bottom, texture_top - height),
                       texture_top, 0, near.middle, now.shade + line.contrast_rows);
        continue;
      }
      const AtlasRegion& region = sprite.art->region;
      const float left = std::max(sprite.x_left, run_left), right = std::min(sprite.x_right, run_right);
      const float top = std::max(sprite.y_top, 0.0f), bottom = std::min(sprite.y_bottom, rows);
      if (right <= left || bottom <= top) continue;
      // A hair inside the picture, so that rounding never wraps to the other edge.
      const auto inside = [](float value) { return std::clamp(value, 1e-4f, 1.0f - 1e-4f); };
      const auto u_at = [&](float x) {
        const float u = inside((x - sprite.x_left) / (sprite.x_right - sprite.x_left));
        return sprite.mirrored ? 1.0f - u : u;
      };
      const auto v_at = [&](float row) {
        return inside((row - sprite.y_top) / (sprite.y_bottom - sprite.y_top));
      };
      push(left, top, sprite.inverse, u_at(left), v_at(top), region, sprite.shade);
      push(right, top, sprite.inverse, u_at(right), v_at(top), region, sprite.shade);
      push(right, bottom, sprite.inverse, u_at(right), v_at(bottom), region, sprite.shade);
      push(left, bottom, sprite.inverse, u_at(left), v_at(bottom), region, sprite.shade);
    }
  }
}

}  // namespace comrad::doom
