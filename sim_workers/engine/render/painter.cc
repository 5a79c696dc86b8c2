#include "sim_workers/engine/render/painter.h"

#include <algorithm>
#include <cmath>
#include <type_traits>

namespace comrad::doom {
namespace {

constexpr uint32_t kNoStrip = UINT32_MAX;
// 1/depth of what no map is large enough for; a column may look a hair beyond a wall's end, where the line continues to nothing.
constexpr float kFarthestInverse = 1.0f / 131072.0f;

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

// A brush leaves something at a pixel: turn(inverse, light_inverse) gives it 1/depth of the surface and of its light, brush(pixel,
// texel) paints. Brushes pick the one for a surface and call use(brush).

struct ColourBrush {
  uint8_t* indices;
  const uint8_t* rows;  // of the light table
  std::size_t row_stride;
  float shade;
  const uint8_t* row = nullptr;
  void turn(float, float light_inverse) {
    row = rows + static_cast<std::size_t>(light_row(shade, light_inverse)) * row_stride;
  }
  void operator()(std::size_t at, uint8_t texel) const { indices[at] = row[texel]; }
};

/// Of see-through surfaces.
struct MixingBrush : ColourBrush {
  const PaletteMixer* mixer;
  Blend blend;
  void operator()(std::size_t at, uint8_t texel) const {
    indices[at] = mixer->mix(row[texel], indices[at], blend);
  }
};

struct ColourBrushes {
  const DrawList& list;
  const LightRows& light;
  const PaletteMixer* mixer;
  uint8_t* indices;

  template <typename Use>
  void pick(const Paint& paint, float shade, int32_t, Use&& use) const {
    const ColourBrush plain{indices, light.rows[paint.tint], light.row_stride, shade};
    if (!paint.blended) return use(plain);
    use(MixingBrush{plain, mixer, list.blends[paint.blend]});
  }
};

template <typename Value>
struct ValueBrush {
  Value* values;
  Value value;
  void turn(float inverse, float) {
    if constexpr (std::is_same_v<Value, float>) value = inverse > 0 ? 1.0f / inverse : 0.0f;
  }
  void operator()(std::size_t at, uint8_t) const { values[at] = value; }
};

struct DepthBrushes {
  float* depth;
  template <typename Use>
  void pick(const Paint&, float, int32_t, Use&& use) const {
    use(ValueBrush<float>{depth, 0});
  }
};

struct SubjectBrushes {
  uint32_t* subjects;
  template <typename Use>
  void pick(const Paint&, float, int32_t subject, Use&& use) const {
    use(ValueBrush<uint32_t>{subjects, static_cast<uint32_t>(subject)});
  }
};

}  // namespace

Painter::Painter(const Projection& projection, const ArtAtlas* atlas)
    : projection_(projection), atlas_(*atlas) {
  row_begins_.resize(static_cast<std::size_t>(projection.rows));
}

void Painter::paint(const DrawList& list, const LightRows& light, const PaletteMixer* mixer,
                    uint8_t* indices) {
  std::fill_n(indices, at(projection_.rows, 0), uint8_t{0});
  paint_all(list, ColourBrushes{list, light, mixer, indices});
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
  brushes.pick(strip.paint, strip.shade, strip.subject, [&](auto brush) {
    if (strip.kind == Strip::Kind::kPicture)
      paint_picture(list, strip, brush);
    else
      paint_wall(list, strip, brush);
  });
}

template <typename Brush>
void Painter::paint_wall(const DrawList& list, const Strip& strip, Brush brush) {
  const auto stride = static_cast<std::size_t>(projection_.width);
  const uint32_t width = strip.region.width, height = strip.region.height;
  const uint8_t* const image = atlas_.columns() + strip.region.columns;
  const auto center = static_cast<int>(list.center_y);
  const int64_t v_horizon = nearest_fixed(strip.v_horizon);
  for (int column = strip.column_begin; column < strip.column_end; ++column) {
    const auto x = static_cast<float>(column);
    const int begin = clamped_row(strip.top.at(x), projection_.rows),
              end = clamped_row(strip.bottom.at(x), projection_.rows);
    if (begin >= end) continue;
    const float texel_x = std::max(x, strip.x_left);
    const float inverse = std::max(strip.inverse.at(texel_x), kFarthestInverse);
    const double depth = 1.0 / inverse;
    const int64_t v_step = nearest_fixed(strip.v_step * depth);
    const int64_t v = v_horizon + (begin + 1 - center) * v_step;
    uint32_t u = 0;
    walk_along(texel_fixed(strip.u_offset + strip.u_over_depth.at(texel_x) * depth), 0, width,
               [&](auto walk) { u = walk.texel(); });
    const uint8_t* const texels = image + std::size_t{u} * height;
    std::size_t pixel = at(begin, column);
    const std::size_t last = at(end, column);
    brush.turn(inverse, strip.light.at(x));
    walk_along(v, v_step, height, [&](auto walk) {
      if (strip.masked) {
        for (; pixel != last; pixel += stride, walk.advance())
          if (const uint8_t texel = texels[walk.texel()]; texel != kTransparentIndex) brush(pixel, texel);
      } else {
        for (; pixel != last; pixel += stride, walk.advance()) brush(pixel, texels[walk.texel()]);
      }
    });
  }
}

/// It ends where its texels do.
template <typename Brush>
void Painter::paint_picture(const DrawList& list, const Strip& strip, Brush brush) {
  const auto stride = static_cast<std::size_t>(projection_.width);
  const uint32_t width = strip.region.width, height = strip.region.height;
  const int64_t v_last = (int64_t{height} << 16) - 1;
  const float inverse = strip.inverse.at_zero;
  const int64_t v_step = nearest_fixed(strip.v_step * (1.0 / inverse));
  const int64_t v_row_0 = nearest_fixed(strip.v_horizon) + (1 - static_cast<int64_t>(list.center_y)) * v_step;
  brush.turn(inverse, strip.light.at_zero);
  int32_t u = strip.u_begin;
  for (int column = strip.column_begin; column < strip.column_end; ++column, u += strip.u_step) {
    const auto x = static_cast<float>(column);
    const int begin = clamped_row(strip.top.at(x), projection_.rows),
              end = clamped_row(strip.bottom.at(x), projection_.rows);
    const uint8_t* const texels =
        atlas_.columns() + strip.region.columns +
        std::size_t{std::min(static_cast<uint32_t>(std::max(u, 0)) >> 16, width - 1)} * height;
    int64_t v = v_row_0 + begin * v_step;
    std::size_t pixel = at(begin, column);
    for (int row = begin; row < end; ++row, pixel += stride, v += v_step) {
      const uint8_t texel = texels[std::clamp<int64_t>(v, 0, v_last) >> 16];
      if (texel != kTransparentIndex) brush(pixel, texel);
    }
  }
}

template <typename Brushes>
void Painter::paint_sky(const DrawList& list, const Strip& strip, const Brushes& brushes) {
  const auto stride = static_cast<std::size_t>(projection_.width);
  const uint32_t width = strip.region.width, height = strip.region.height;
  const SkyRows rows = sky_rows(height, projection_.focal_y);
  brushes.pick(strip.paint, 0, strip.subject, [&](auto brush) {
    brush.turn(0, 0);
    for (int column = strip.column_begin; column < strip.column_end; ++column) {
      const auto x = static_cast<float>(column);
      const int begin = clamped_row(strip.top.at(x), projection_.rows),
                end = clamped_row(strip.bottom.at(x), projection_.rows);
      // 1024 columns of a sky a turn.
      const uint32_t u = (list.sky_angle - projection_.sky_angles[static_cast<std::size_t>(column)]) >> 22;
      const uint8_t* const texels = atlas_.columns() + strip.region.columns + std::size_t{u % width} * height;
      const double v = rows.horizon + (begin + 1 - static_cast<double>(list.center_y)) * rows.step;
      std::size_t pixel = at(begin, column);
      walk_along(texel_fixed(v), texel_fixed(rows.step), height, [&](auto walk) {
        for (int row = begin; row < end; ++row, pixel += stride, walk.advance())
          brush(pixel, texels[walk.texel()]);
      });
    }
  });
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
    brushes.pick({.tint = plane.tint}, plane.shade, kPlaneSubject,
                 [&](auto brush) { paint_plane(list, plane, plane_strips_[index].first, brush); });
  }
}

template <typename Brush>
void Painter::paint_plane(const DrawList& list, const Plane& plane, uint32_t first_strip, Brush brush) {
  // Rows [top, bottom) of the column before are open, each since row_begins_.
  int top = 0, bottom = 0, column_end = 0;
  const auto turn_to = [&](int column, int next_top, int next_bottom) {
    const auto close = [&](int from, int to) {
      for (int row = from; row < to; ++row)
        paint_row(list, plane, row, row_begins_[static_cast<std::size_t>(row)], column, &brush);
    };
    const auto open = [&](int from, int to) {
      for (int row = from; row < to; ++row) row_begins_[static_cast<std::size_t>(row)] = column;
    };
    close(top, std::min(bottom, next_top)), close(std::max(top, next_bottom), bottom);
    open(next_top, std::min(next_bottom, top)), open(std::max(next_top, bottom), next_bottom);
    top = next_top, bottom = next_bottom;
  };
  for (uint32_t i = first_strip; i != kNoStrip; i = next_strips_[i]) {
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

/// Pixels [begin, end) of a row.
template <typename Brush>
void Painter::paint_row(const DrawList& list, const Plane& plane, int row, int begin, int end, Brush* brush) {
  const uint32_t width = plane.region.width, height = plane.region.height;
  const uint8_t* const image = atlas_.columns() + plane.region.columns;
  const double factor = std::abs(plane.row_factor);
  const double depth = factor / std::abs(row + 0.5 - list.center_y);
  const double right = begin + 1 - static_cast<double>(projection_.center_x);
  const double across = depth * plane.u_right, down = depth * plane.v_right;
  const int64_t u = texel_fixed(plane.u_eye + depth * plane.u_ahead + across * right),
                v = texel_fixed(plane.v_eye + depth * plane.v_ahead + down * right);
  brush->turn(static_cast<float>(1.0 / depth), static_cast<float>(std::abs(row - list.center_y) / factor));
  std::size_t pixel = at(row, begin);
  const std::size_t last = at(row, end);
  walk_along(u, texel_fixed(across), width, [&](auto column) {
    walk_along(v, texel_fixed(down), height, [&](auto texel) {
      for (; pixel != last; ++pixel, column.advance(), texel.advance())
        (*brush)(pixel, image[column.texel() * height + texel.texel()]);
    });
  });
}

}  // namespace comrad::doom
