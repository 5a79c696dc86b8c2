#include "sim_workers/engine/render/visibility.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "sim_workers/engine/map/level_index.h"

namespace comrad::doom {
namespace {

constexpr float kNearDepth = 1.0f;  // bodies keep walls farther away than this

/// The place of a coordinate on the map, kept inside it.
template <typename Number>
Fixed on_map(Number at) {
  return static_cast<Fixed>(std::clamp(at, Number{-32767}, Number{32767}) * 65536);
}

/// Level where the ends lie in the same place.
ColumnLine line_through(float x0, float value0, float x1, float value1) {
  constexpr float kNarrowest = 1e-4f;
  const float slope = x1 - x0 > kNarrowest ? (value1 - value0) / (x1 - x0) : 0.0f;
  return {.at_zero = value0 - slope * x0, .slope = slope};
}

}  // namespace

Visibility::Visibility(ViewFrame* frame) : frame_(*frame) {
  for (int column = 0; column < frame->projection.width; ++column)
    rays_.push_back(frame->projection.ray_of(column));
}

const SceneSide& Visibility::near_side(const WallSpan& span) const {
  const SceneLine& line = frame_.scene->lines[span.line];
  return frame_.side_now(span.back_side ? line.back : line.front);
}

void Visibility::place_vertex(uint32_t vertex, float x, float y) {
  const float dx = x - frame_.eye_x, dy = y - frame_.eye_y;
  VertexView& seen = vertices_[vertex];
  seen.stamp = frame_.stamp;
  seen.depth = dx * frame_.cosine + dy * frame_.sine;
  seen.side = dx * frame_.sine - dy * frame_.cosine;
  const Projection& projection = frame_.projection;
  const float left_reach = projection.center_x,
              right_reach = static_cast<float>(projection.width) - left_reach;
  seen.beyond_left = seen.side * projection.focal_x < -left_reach * seen.depth;
  seen.beyond_right = seen.side * projection.focal_x > right_reach * seen.depth;
}

void Visibility::look() {
  const Scene& scene = *frame_.scene;
  const SceneView& view = *frame_.view;
  windows_.resize(std::max(windows_.size(), view.sectors.size()));
  line_views_.resize(std::max(line_views_.size(), scene.lines.size()));
  vertices_.resize(std::max(vertices_.size(), scene.vertex_x.size()));
  spans_.clear(), partial_spans_.clear(), queue_.clear();
  columns_.assign(static_cast<std::size_t>(frame_.projection.width), ViewColumn{});
  collect_polyobjects();
  if (scene.level().index != nullptr && !view.sectors.empty()) {
    eye_sector_ = scene.level().index->sectors.sector_at(on_map(view.eye_x), on_map(view.eye_y));
    reach(eye_sector_, 0, frame_.projection.width);
  }
  for (std::size_t next = 0; next < queue_.size(); ++next) {
    const uint32_t index = queue_[next];
    windows_[index].queued = false;
    const Window window = windows_[index];
    for (uint32_t at = scene.sector_line_begin[index]; at < scene.sector_line_begin[index + 1]; ++at) {
      const uint32_t line_index = scene.sector_lines[at];
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
      if (!seen.any_facing && seen.span.near_sector != index) continue;
      const LineShape& line = scene.shapes[line_index];
      reach(line.front_sector == index ? line.back_sector : line.front_sector, begin, end);
    }
  }
  std::erase_if(partial_spans_, [&](uint32_t index) { return is_hidden(spans_[index]); });
}

bool Visibility::is_hidden(const WallSpan& span) const {
  for (int at = span.column_begin; at < span.column_end; ++at)
    if (span.inverse.at(ray(at)) > column(at).inverse) return false;
  return true;
}

/// Widens the window of a sector; its lines are looked at (again) if it grew.
void Visibility::reach(uint32_t index, int begin, int end) {
  Window& window = windows_[index];
  if (window.stamp != frame_.stamp) {
    window = {.stamp = frame_.stamp, .begin = begin, .end = end, .queued = false};
  } else {
    if (begin >= window.begin && end <= window.end) return;
    window.begin = std::min(window.begin, begin), window.end = std::max(window.end, end);
  }
  if (window.queued) return;
  window.queued = true;
  queue_.push_back(index);
}

Visibility::LineView& Visibility::look_at(uint32_t index) {
  LineView& seen = line_views_[index];
  if (seen.stamp == frame_.stamp) return seen;
  seen.stamp = frame_.stamp;
  seen.kind = LineView::Kind::kUnseen;
  seen.added = seen.open = seen.any_facing = false;
  measure_line(index, &seen);
  return seen;
}

void Visibility::measure_line(uint32_t line_index, LineView* seen) {
  const Projection& projection = frame_.projection;
  const LineShape& line = frame_.scene->shapes[line_index];
  const auto near_side = [&]() -> const SceneSide& {
    const SceneLine& sides = frame_.scene->lines[line_index];
    return seen->span.back_side ? sides.back : sides.front;
  };
  const VertexView &start = transform(line.start), &end = transform(line.end);
  float side_a = start.side, depth_a = start.depth;
  float side_b = end.side, depth_b = end.depth;
  if (depth_a < kNearDepth && depth_b < kNearDepth) {
    if (!line.two_sided || (depth_a <= 0 && depth_b <= 0)) return;
    // It crosses the view closer than anything is drawn: nothing to show, but it must not stop the eye.
    seen->kind = LineView::Kind::kPlain, seen->open = seen->any_facing = true;
    seen->column_begin = 0, seen->column_end = projection.width;
    return;
  }
  // Seen from its front, a line runs from left to right.
  const bool from_back = side_a * depth_b >= side_b * depth_a;
  if (from_back && !line.two_sided) return;
  // Outside the picture's left or right border: both ends on the far side of the same border ray.
  if ((start.beyond_left && end.beyond_left) || (start.beyond_right && end.beyond_right)) return;
  seen->span.back_side = from_back;
  if (line.two_sided) frame_.will_ask(near_side());
  const float focal = projection.focal_x;
  float u_a = 0, u_b = line.texel_length;
  if (from_back) {
    std::swap(side_a, side_b), std::swap(depth_a, depth_b);
  }
  bool clipped = true;
  if (depth_a < kNearDepth) {
    const float t = (kNearDepth - depth_a) / (depth_b - depth_a);
    side_a += t * (side_b - side_a), u_a += t * line.texel_length, depth_a = kNearDepth;
  } else if (depth_b < kNearDepth) {
    const float t = (kNearDepth - depth_b) / (depth_a - depth_b);
    side_b += t * (side_a - side_b), u_b -= t * line.texel_length, depth_b = kNearDepth;
  } else {
    clipped = false;
  }
  WallSpan& span = seen->span;
  span.line = line_index;
  span.near_sector = from_back ? line.back_sector : line.front_sector;
  span.far_sector = !line.two_sided ? span.near_sector : from_back ? line.front_sector : line.back_sector;
  const float inverse_a = 1.0f / depth_a, inverse_b = 1.0f / depth_b;
  const float x_left = span.x_left = projection.center_x + focal * side_a * inverse_a;
  const float x_right = projection.center_x + focal * side_b * inverse_b;
  span.column_begin = std::max(0, projection.first_column(std::clamp(x_left, -1.0f, 65536.0f)));
  span.column_end = std::min(projection.width, projection.first_column(std::clamp(x_right, -1.0f, 65536.0f)));
  seen->column_begin = span.column_begin, seen->column_end = span.column_end;
  if (clipped && line.two_sided) {
    seen->column_begin = 0, seen->column_end = projection.width;
    seen->any_facing = true;
  }
  if (seen->column_begin >= seen->column_end) return;
  seen->kind = LineView::Kind::kPlain;
  span.solid = !line.two_sided;
  if (line.two_sided) {
    const SectorNow& now = frame_.sector(span.near_sector);
    const SectorNow& beyond = frame_.sector(span.far_sector);
    span.solid = std::max(now.floor, beyond.floor) >= std::min(now.ceiling, beyond.ceiling);
    seen->open = !span.solid && span.near_sector != span.far_sector;
  }
  if (span.column_begin >= span.column_end) return;
  if (line.two_sided && !span.solid) {
    const bool alike =
        span.near_sector == span.far_sector || frame_.same_look(span.near_sector, span.far_sector);
    if (alike && !frame_.side_now(near_side()).middle.present) return;
  }
  // The texture runs from the near side's own start, which is always the span's left end.
  span.inverse = line_through(x_left, inverse_a, x_right, inverse_b);
  span.u = line_through(x_left, u_a * inverse_a, x_right, u_b * inverse_b);
  const auto width = static_cast<float>(projection.width);
  const bool from_outside = x_left<0, to_outside = x_right> width;
  span.edge =
      line_through(static_cast<float>(span.column_begin), from_outside ? span.inverse.at(0.0f) : inverse_a,
                   static_cast<float>(span.column_end), to_outside ? span.inverse.at(width) : inverse_b);
  seen->kind = LineView::Kind::kShown;
}

void Visibility::add_span(const WallSpan& span) {
  const auto index = static_cast<uint32_t>(spans_.size());
  spans_.push_back(span);
  if (!span.solid) {
    partial_spans_.push_back(index);
    return;
  }
  for (int at = span.column_begin; at < span.column_end; ++at) {
    const float inverse = span.inverse.at(ray(at));
    ViewColumn& nearest = columns_[static_cast<std::size_t>(at)];
    if (inverse > nearest.inverse) nearest = {.inverse = inverse, .span = index};
  }
}

/// Lines that move as one: their ends lie where the world has them now, and each is in the sector that it
/// is in.
void Visibility::collect_polyobjects() {
  const Scene& scene = *frame_.scene;
  for (const Polyobject& polyobject : frame_.view->polyobjects) {
    for (std::size_t i = 0; i < polyobject.vertices.size() && i < polyobject.position.size(); ++i)
      if (polyobject.vertices[i] < scene.vertex_x.size())
        place_vertex(polyobject.vertices[i], to_float(polyobject.position[i][0]),
                     to_float(polyobject.position[i][1]));
    for (const uint32_t line_index : polyobject.lines) {
      if (line_index >= scene.lines.size() || scene.level().index == nullptr) continue;
      const LineShape& line = scene.shapes[line_index];
      LineView& seen = look_at(line_index);
      if (seen.kind != LineView::Kind::kShown || seen.added) continue;
      seen.added = true;
      // A step to the near side of its middle; (depth, side) back to the map.
      const VertexView &start = vertices_[line.start], &end = vertices_[line.end];
      const float middle_depth = 0.5f * (start.depth + end.depth),
                  middle_side = 0.5f * (start.side + end.side);
      const float along_depth = end.depth - start.depth, along_side = end.side - start.side;
      const float step = (seen.span.back_side ? -2.0f : 2.0f) / std::max(1e-3f, line.length);
      const float depth = middle_depth - along_side * step, side = middle_side + along_depth * step;
      WallSpan span = seen.span;
      span.near_sector = scene.level().index->sectors.sector_at(
          on_map(frame_.eye_x + frame_.cosine * depth + frame_.sine * side),
          on_map(frame_.eye_y + frame_.sine * depth - frame_.cosine * side));
      span.far_sector = span.near_sector;
      add_span(span);
    }
  }
}

}  // namespace comrad::doom
