#include "sim_workers/engine/render/painter.h"

#include <algorithm>
#include <cmath>

namespace comrad::doom {
namespace {

constexpr uint32_t kNoStrip = UINT32_MAX;

/// std::floor() without a call, which compilers make of it on plain x86-64.
int64_t rounded_down(double value) {
  const auto cut = static_cast<int64_t>(value);
  return cut - (static_cast<double>(cut) > value ? 1 : 0);
}

/// 16.16, rounded down.
int64_t texel_fixed(double texels) { return rounded_down(texels * 65536.0); }

/// A wall's step as the reference engine has it: the nearest 16.16.
int64_t nearest_fixed(double texels) { return rounded_down(texels * 65536.0 + 0.5); }

/// Walks over a texture that repeats, one axis: 16.16 with the size a power of two, or not.
struct MaskedWalk {
  uint32_t at, step, mask;
  uint32_t texel() const { return at >> 16 & mask; }
  void advance() { at += step; }
};
struct WrappedWalk {
  uint32_t at, step, end;  // the step is below the end too
  uint32_t texel() const { return at >> 16; }
  void advance() {
    at += step;
    if (at >= end) at -= end;
  }
};

/// Calls walk(walker) with the one that suits the size; `at` and `step` are 16.16 and may be any.
template <typename Walk>
void walk_along(int64_t at, int64_t step, uint32_t size, Walk&& walk) {
  if ((size & (size - 1)) == 0)
    return walk(MaskedWalk{static_cast<uint32_t>(at), static_cast<uint32_t>(step), size - 1});
  const int64_t end = int64_t{size} << 16;
  const auto wrapped = [end](int64_t value) {
    const int64_t rest = value % end;
    return static_cast<uint32_t>(rest < 0 ? rest + end : rest);
  };
  walk(WrappedWalk{wrapped(at), wrapped(step), static_cast<uint32_t>(end)});
}

/// row_below() of an edge, within the picture.
int clamped_row(float edge, int rows) {
  if (!(edge > 0)) return 0;
  return edge < static_cast<float>(rows) ? static_cast<int>(edge) : rows;
}

// What is left at a pixel. of() takes how a surface is drawn, 1/depth and 1/depth for its light, and calls use(brush), where
// brush(pixel, texel) paints.
struct ColourBrushes {
  const LightRows& light;
  PaintedPicture& picture;
  bool layered;

  template <typename Use>
  void of(const Paint& paint, bool masked, float shade, int32_t, float, float light_inverse,
          Use&& use) const {
    const uint8_t* const row =
        light.rows[paint.tint] + static_cast<std::size_t>(light_row(shade, light_inverse)) * light.row_stride;
    uint8_t* const indices = picture.indices.data();
    if (!masked || !layered) return use([=](std::size_t at, uint8_t texel) { indices[at] = row[texel]; });
    uint8_t* const blends = picture.layer_blends.data();
    if (!paint.blended)
      return use([=](std::size_t at, uint8_t texel) { indices[at] = row[texel], blends[at] = 0; });
    uint8_t* const layer = picture.layer_indices.data();
    const auto blend = static_cast<uint8_t>(paint.blend + 1);
    use([=](std::size_t at, uint8_t texel) { layer[at] = row[texel], blends[at] = blend; });
  }
};

struct DepthBrushes {
  float* depth;
  template <typename Use>
  void of(const Paint&, bool, float, int32_t, float inverse, float, Use&& use) const {
    const float value = inverse > 0 ? 1.0f / inverse : 0.0f;
    use([=, this](std::size_t at, uint8_t) { depth[at] = value; });
  }
};

struct SubjectBrushes {
  uint32_t* subjects;
  template <typename Use>
  void of(const Paint&, bool, float, int32_t subject, float, float, Use&& use) const {
    use([=, this](std::size_t at, uint8_t) { subjects[at] = static_cast<uint32_t>(subject); });
  }
};

}  // namespace

Painter::Painter(const Projection& projection, const ArtAtlas* atlas)
    : projection_(projection), atlas_(*atlas) {
  row_begins_.resize(static_cast<std::size_t>(projection.rows));
}

void Painter::paint(const DrawList& list, const LightRows& light, PaintedPicture* picture) {
  const std::size_t pixels = at(projection_.rows, 0);
  picture->indices.assign(pixels, 0);
  if (list.has_blended) {
    picture->layer_indices.resize(pixels);
    picture->layer_blends.assign(pixels, 0);
  }
  paint_all(list, ColourBrushes{light, *picture, list.has_blended});
}

void Painter::paint_depth(const DrawList& list, float* depth) {
  std::fill_n(depth, at(projection_.rows, 0), 0.0f);
  paint_all(list, DepthBrushes{depth});
}

void Painter::paint_subjects(const DrawList& list, uint32_t nothing, uint32_t* subjects) {
  std::fill_n(subjects, at(projection_.rows, 0), nothing);
  paint_all(list, SubjectBrushes{subjects});
}

template <typename Brushes>
void Painter::paint_all(const DrawList& list, const Brushes& brushes) {
  for (const Strip& strip : std::span(list.strips).first(list.opaque_end))
    if (strip.kind == Strip::Kind::kSky) paint_sky(list, strip, brushes);
  paint_planes(list, brushes);
  for (const Strip& strip : list.strips)
    if (strip.kind == Strip::Kind::kWall || strip.kind == Strip::Kind::kPicture)
      paint_columns(list, strip, brushes);
}

// ---------------------------------------------------------------- walls and sprites: column by column

template <typename Brushes>
void Painter::paint_columns(const DrawList& list, const Strip& strip, const Brushes& brushes) {
  const auto stride = static_cast<std::size_t>(projection_.width);
  const uint32_t width = strip.region.width, height = strip.region.height;
  const uint8_t* const image = atlas_.columns() + strip.region.columns;
  const bool is_wall = strip.kind == Strip::Kind::kWall;
  const auto center = static_cast<int>(list.center_y);
  const int64_t v_horizon = nearest_fixed(strip.v_horizon);
  int32_t picture_u = strip.u_begin;
  for (int column = strip.column_begin; column < strip.column_end; ++column, picture_u += strip.u_step) {
    const auto x = static_cast<float>(column);
    const int begin = clamped_row(strip.top.at(x), projection_.rows),
              end = clamped_row(strip.bottom.at(x), projection_.rows);
    if (begin >= end) continue;
    const float texel_x = is_wall ? std::max(x, strip.x_left) : x;
    const float inverse = strip.inverse.at(texel_x);
    const double depth = 1.0 / inverse;
    const int64_t v_step = nearest_fixed(strip.v_step * depth);
    const int64_t v = v_horizon + (begin + 1 - center) * v_step;
    uint32_t u = 0;
    if (is_wall)
      walk_along(texel_fixed(strip.u_offset + strip.u_over_depth.at(texel_x) * depth), 0, width,
                 [&](auto walk) { u = walk.texel(); });
    else
      u = std::min(static_cast<uint32_t>(std::max(picture_u, 0)) >> 16, width - 1);
    const uint8_t* const texels = image + std::size_t{u} * height;
    std::size_t pixel = at(begin, column);
    const std::size_t last = at(end, column);
    brushes.of(strip.paint, strip.masked, strip.shade, strip.subject, inverse, strip.light.at(x),
               [&](const auto& brush) {
                 if (!is_wall) {  // the picture ends where its texels do
                   const int64_t texels_end = int64_t{height} << 16;
                   int64_t at_texel = v;
                   for (; pixel != last; pixel += stride, at_texel += v_step) {
                     const uint8_t texel = texels[std::clamp<int64_t>(at_texel, 0, texels_end - 1) >> 16];
                     if (texel != kTransparentIndex) brush(pixel, texel);
                   }
                   return;
                 }
                 walk_along(v, v_step, height, [&](auto walk) {
                   if (strip.masked) {
                     for (; pixel != last; pixel += stride, walk.advance())
                       if (const uint8_t texel = texels[walk.texel()]; texel != kTransparentIndex)
                         brush(pixel, texel);
                   } else {
                     for (; pixel != last; pixel += stride, walk.advance())
                       brush(pixel, texels[walk.texel()]);
                   }
                 });
               });
  }
}

template <typename Brushes>
void Painter::paint_sky(const DrawList& list, const Strip& strip, const Brushes& brushes) {
  const auto stride = static_cast<std::size_t>(projection_.width);
  const uint32_t width = strip.region.width, height = strip.region.height;
  const SkyRows rows = sky_rows(height, projection_.focal_y);
  for (int column = strip.column_begin; column < strip.column_end; ++column) {
    const auto x = static_cast<float>(column);
    const int begin = clamped_row(strip.top.at(x), projection_.rows),
              end = clamped_row(strip.bottom.at(x), projection_.rows);
    if (begin >= end) continue;
    // 1024 columns of a sky a turn.
    const uint32_t u = (list.sky_angle - projection_.sky_angles[static_cast<std::size_t>(column)]) >> 22;
    const uint8_t* const texels = atlas_.columns() + strip.region.columns + std::size_t{u % width} * height;
    const double v = rows.horizon + (begin + 1 - static_cast<double>(list.center_y)) * rows.step;
    std::size_t pixel = at(begin, column);
    const std::size_t last = at(end, column);
    brushes.of(strip.paint, false, 0, strip.subject, 0, 0, [&](const auto& brush) {
      walk_along(texel_fixed(v), texel_fixed(rows.step), height, [&](auto walk) {
        for (; pixel != last; pixel += stride, walk.advance()) brush(pixel, texels[walk.texel()]);
      });
    });
  }
}

// ---------------------------------------------------------------- floors and ceilings: row by row

/// Strips of the same plane are joined where they lie side by side, so that a row is walked along in one go.
template <typename Brushes>
void Painter::paint_planes(const DrawList& list, const Brushes& brushes) {
  plane_strips_.assign(list.planes.size(), {kNoStrip, kNoStrip});
  next_strips_.resize(list.strips.size());
  for (uint32_t i = 0; i < list.opaque_end; ++i) {
    if (list.strips[i].kind != Strip::Kind::kPlane) continue;
    PlaneStrips& strips = plane_strips_[list.strips[i].plane];
    (strips.first == kNoStrip ? strips.first : next_strips_[strips.last]) = i;
    strips.last = i;
    next_strips_[i] = kNoStrip;
  }
  for (std::size_t index = 0; index < list.planes.size(); ++index) {
    const Plane& plane = list.planes[index];
    const uint32_t width = plane.region.width, height = plane.region.height;
    const uint8_t* const image = atlas_.columns() + plane.region.columns;
    const double factor = std::abs(plane.row_factor);
    const auto paint_row = [&](int row, int begin, int end) {
      const double depth = factor / std::abs(row + 0.5 - list.center_y);
      const double right = begin + 1 - static_cast<double>(projection_.center_x);
      const double u_step = depth * plane.u_right, v_step = depth * plane.v_right;
      const double u = plane.u_eye + depth * plane.u_ahead + u_step * right;
      const double v = plane.v_eye + depth * plane.v_ahead + v_step * right;
      std::size_t pixel = at(row, begin);
      const std::size_t last = at(row, end);
      const double light = std::abs(row - list.center_y) / factor;
      brushes.of({.tint = plane.tint}, false, plane.shade, kPlaneSubject, static_cast<float>(1.0 / depth),
                 static_cast<float>(light), [&](const auto& brush) {
                   walk_along(texel_fixed(u), texel_fixed(u_step), width, [&](auto across) {
                     walk_along(texel_fixed(v), texel_fixed(v_step), height, [&](auto down) {
                       for (; pixel != last; ++pixel, across.advance(), down.advance())
                         brush(pixel, image[across.texel() * height + down.texel()]);
                     });
                   });
                 });
    };
    // Rows [top, bottom) of the column before are open, each since row_begins_.
    int top = 0, bottom = 0, column_end = 0;
    const auto turn_to = [&](int column, int next_top, int next_bottom) {
      const auto close = [&](int from, int to) {
        for (int row = from; row < to; ++row)
          paint_row(row, row_begins_[static_cast<std::size_t>(row)], column);
      };
      const auto open = [&](int from, int to) {
        for (int row = from; row < to; ++row) row_begins_[static_cast<std::size_t>(row)] = column;
      };
      close(top, std::min(bottom, next_top)), close(std::max(top, next_bottom), bottom);
      open(next_top, std::min(next_bottom, top)), open(std::max(next_top, bottom), next_bottom);
      top = next_top, bottom = next_bottom;
    };
    for (uint32_t i = plane_strips_[index].first; i != kNoStrip; i = next_strips_[i]) {
      const Strip& strip = list.strips[i];
      if (strip.column_begin != column_end) turn_to(column_end, 0, 0);
      for (int column = strip.column_begin; column < strip.column_end; ++column) {
        const auto x = static_cast<float>(column);
        const int next_top = clamped_row(strip.top.at(x), projection_.rows),
                  next_bottom = clamped_row(strip.bottom.at(x), projection_.rows);
        if (next_top < next_bottom)
          turn_to(column, next_top, next_bottom);
        else
          turn_to(column, 0, 0);
      }
      column_end = strip.column_end;
    }
    turn_to(column_end, 0, 0);
  }
}

}  // namespace comrad::doom
