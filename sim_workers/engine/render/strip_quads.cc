#include "sim_workers/engine/render/strip_quads.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

namespace comrad::doom {
namespace {

constexpr float kFarInverse = 1.0f / 60000.0f;  // 1/depth of the farthest that is drawn
// Opaque strips overlap by this many rows: OpenGL rounds edges that are cut in different places differently.
constexpr float kOverlap = 1.0f / 128.0f;
constexpr float kTexelHair = 1.0f / 256.0f;  // texels in 16.16 must not fall below a whole one
constexpr int kSkyStripColumns = 16;

/// What lies between an upper and a lower edge, from one x to another; each edge given by its rows at the ends.
struct PictureArea {
  float left = 0, right = 0;
  float top_left = 0, top_right = 0, bottom_left = 0, bottom_right = 0;
};

/// A number for each of the four corners of a quad, which are computed side by side.
using FourCorners = float __attribute__((vector_size(16)));

/// Calls piece(x0, x1) for the parts of an area between the places where one of its edges leaves or enters the
/// picture of `rows` rows; inside a part each edge is wholly above, in or below.
template <typename Piece>
void split_at_borders(const PictureArea& area, float rows, Piece&& piece) {
  const auto [low, high] = std::minmax({area.top_left, area.top_right, area.bottom_left, area.bottom_right});
  if (low >= 0 && high <= rows) {
    piece(area.left, area.right);
    return;
  }
  std::array<float, 6> cuts{area.left};
  std::size_t count = 1;
  const auto cut = [&](float at_left, float at_right, float level) {
    if ((at_left - level) * (at_right - level) >= 0) return;
    const float x =
        std::clamp(area.left + (level - at_left) / (at_right - at_left) * (area.right - area.left), area.left,
                   area.right);
    std::size_t place = count++;
    for (; place > 1 && cuts[place - 1] > x; --place) cuts[place] = cuts[place - 1];
    cuts[place] = x;
  };
  cut(area.top_left, area.top_right, 0), cut(area.top_left, area.top_right, rows);
  cut(area.bottom_left, area.bottom_right, 0), cut(area.bottom_left, area.bottom_right, rows);
  cuts[count] = area.right;
  for (std::size_t i = 0; i < count; ++i)
    if (cuts[i + 1] > cuts[i]) piece(cuts[i], cuts[i + 1]);
}

/// Calls corner(x, row) for the corners, clockwise from the upper left one, of the quads that make up the part
/// of an area that lies in the picture. Edges that cross end the quad there.
template <typename Corner>
void cut_to_picture(PictureArea area, float rows, Corner&& corner) {
  if (std::max(area.bottom_left, area.bottom_right) <= 0 || std::min(area.top_left, area.top_right) >= rows)
    return;
  const float height_left = area.bottom_left - area.top_left,
              height_right = area.bottom_right - area.top_right;
  if (height_left <= 0 && height_right <= 0) return;
  if (height_left < 0 || height_right < 0) {
    const float t = height_left / (height_left - height_right), x = area.left + t * (area.right - area.left);
    const float row = area.top_left + t * (area.top_right - area.top_left);
    if (height_left < 0)
      area.left = x, area.top_left = area.bottom_left = row;
    else
      area.right = x, area.top_right = area.bottom_right = row;
    if (area.right <= area.left) return;
  }
  const auto along = [&](float at_left, float at_right, float x) {
    return std::clamp(at_left + (at_right - at_left) * ((x - area.left) / (area.right - area.left)), 0.0f,
                      rows);
  };
  split_at_borders(area, rows, [&](float a, float b) {
    const float top_a = along(area.top_left, area.top_right, a),
                top_b = along(area.top_left, area.top_right, b);
    const float bottom_a = along(area.bottom_left, area.bottom_right, a),
                bottom_b = along(area.bottom_left, area.bottom_right, b);
    if (bottom_a <= top_a && bottom_b <= top_b) return;
    corner(a, top_a), corner(b, top_b), corner(b, bottom_b), corner(a, bottom_a);
  });
}

/// The same, with quad(x, row) for each quad.
template <typename Quad>
void quads_in_picture(const PictureArea& area, float rows, Quad&& quad) {
  FourCorners x{}, row{};
  std::size_t count = 0;
  cut_to_picture(area, rows, [&](float corner_x, float corner_row) {
    x[count] = corner_x, row[count] = corner_row;
    if (++count < 4) return;
    quad(x, row);
    count = 0;
  });
}

/// A place in a picture from 0 to 1, kept a hair inside so that rounding never wraps it to the other edge.
FourCorners inside(FourCorners value) {
  for (int i = 0; i < 4; ++i) value[i] = std::clamp(value[i], 1e-4f, 1.0f - 1e-4f);
  return value;
}

/// Makes the quads of one list.
class QuadMaker {
 public:
  QuadMaker(const DrawList& list, const Projection& projection, QuadList* quads)
      : list_(list), projection_(projection), quads_(*quads), rows_(static_cast<float>(projection.rows)) {}

  void make(const Strip& strip, float overlap) {
    if (strip.kind == Strip::Kind::kSky) {
      for (int begin = strip.column_begin; begin < strip.column_end; begin += kSkyStripColumns)
        make_part(strip, begin, std::min(begin + kSkyStripColumns, strip.column_end), 0);
    } else {
      make_part(strip, strip.column_begin, strip.column_end, overlap);
    }
  }

 private:
  void make_part(const Strip& strip, int begin, int end, float overlap) {
    const auto left = static_cast<float>(begin), right = static_cast<float>(end);
    const auto edge = [](const ColumnLine& line, float x) { return line.at(x - 0.5f) - 0.5f; };
    const PictureArea area{left,
                           right,
                           edge(strip.top, left) - overlap,
                           edge(strip.top, right) - overlap,
                           edge(strip.bottom, left) + overlap,
                           edge(strip.bottom, right) + overlap};
    quads_in_picture(area, rows_, [&](const FourCorners& x, const FourCorners& row) {
      switch (strip.kind) {
        case Strip::Kind::kSky:
          return add_sky(strip, x, row);
        case Strip::Kind::kPlane:
          return add_plane(strip, x, row);
        case Strip::Kind::kWall:
          return add_wall(strip, x, row);
        case Strip::Kind::kPicture:
          return add_picture(strip, x, row);
      }
    });
  }

  void add_wall(const Strip& strip, const FourCorners& x, const FourCorners& row) {
    const FourCorners column = x - 0.5f;
    const FourCorners inverse = not_beyond(strip.inverse.at(column));
    const FourCorners u = strip.u_offset + strip.u_over_depth.at(column) / inverse;
    const FourCorners v = strip.v_horizon + (row + 0.5f - list_.center_y) * strip.v_step / inverse;
    add(strip, x, row, inverse, u / static_cast<float>(strip.region.width),
        v / static_cast<float>(strip.region.height), strip.region, strip.shade);
  }

  void add_picture(const Strip& strip, const FourCorners& x, const FourCorners& row) {
    const FourCorners inverse = FourCorners{} + strip.inverse.at_zero;
    const FourCorners columns = x - 0.5f - static_cast<float>(strip.column_begin);
    const FourCorners u =
        (static_cast<float>(strip.u_begin) + columns * static_cast<float>(strip.u_step)) / 65536.0f +
        kTexelHair;
    const FourCorners v = strip.v_horizon + (row + 0.5f - list_.center_y) * strip.v_step / inverse;
    add(strip, x, row, inverse, inside(u / static_cast<float>(strip.region.width)),
        inside(v / static_cast<float>(strip.region.height)), strip.region, strip.shade);
  }

  void add_plane(const Strip& strip, const FourCorners& x, const FourCorners& row) {
    const Plane& plane = list_.planes[strip.plane];
    const float width = plane.region.width, height = plane.region.height;
    const FourCorners inverse = not_beyond((row - list_.center_y) * (1.0f / plane.row_factor));
    const FourCorners right = x + 0.5f - projection_.center_x;
    const auto texel = [&](double eye, double ahead, double per_column, float size) {
      const auto begin = static_cast<float>(eye - std::floor(eye / size) * size);
      return begin + (static_cast<float>(ahead) + static_cast<float>(per_column) * right) / inverse;
    };
    Strip painted = strip;
    painted.paint.tint = plane.tint;
    add(painted, x, row, inverse, texel(plane.u_eye, plane.u_ahead, plane.u_right, width) / width,
        texel(plane.v_eye, plane.v_ahead, plane.v_right, height) / height, plane.region, plane.shade);
  }

  void add_sky(const Strip& strip, const FourCorners& x, const FourCorners& row) {
    const SkyRows rows = sky_rows(strip.region.height, projection_.focal_y);
    FourCorners u{};
    for (int i = 0; i < 4; ++i) u[i] = sky_column(x[i]) / static_cast<float>(strip.region.width);
    const FourCorners v =
        (static_cast<float>(rows.horizon) + (row + 0.5f - list_.center_y) * static_cast<float>(rows.step)) /
        static_cast<float>(strip.region.height);
    add(strip, x, row, FourCorners{} + 1.0f, u, v, strip.region,
        0);  // an inverse nearer than anything else can have
  }

  /// Column of the sky at x, 1024 a turn.
  float sky_column(float x) const {
    const auto last = static_cast<int>(projection_.sky_angles.size()) - 1;
    const int before = std::clamp(static_cast<int>(std::floor(x - 0.5f)), 0, std::max(0, last - 1));
    const auto angle = [&](int column) {
      return static_cast<double>(
          static_cast<int32_t>(projection_.sky_angles[static_cast<std::size_t>(column)]));
    };
    const double slope = angle(std::min(before + 1, last)) - angle(before);
    const double right = angle(before) + slope * (x - 0.5 - before);
    return static_cast<float>((list_.sky_angle - right) / 4194304.0);
  }

  static FourCorners not_beyond(const FourCorners& inverse) {
    return inverse < kFarInverse ? FourCorners{} + kFarInverse : inverse;
  }

  void add(const Strip& strip, const FourCorners& x, const FourCorners& row, const FourCorners& inverse,
           const FourCorners& u, const FourCorners& v, const AtlasRegion& region, float shade) {
    const FourCorners w = 1.0f / inverse;
    const FourCorners clip_x = (x * 2.0f / static_cast<float>(projection_.width) - 1.0f) * w;
    const FourCorners clip_y = (row * 2.0f / rows_ - 1.0f) * w;
    const uint32_t mark = static_cast<uint32_t>(strip.paint.blended ? strip.paint.blend : strip.paint.tint)
                          << kTintShift;
    for (int i = 0; i < 4; ++i)
      quads_.vertices.push_back({.x = clip_x[i],
                                 .y = clip_y[i],
                                 .z = 0,
                                 .w = w[i],
                                 .u = u[i],
                                 .v = v[i],
                                 .width = static_cast<float>(region.width),
                                 .height = static_cast<float>(region.height),
                                 .shade = shade,
                                 .address = static_cast<int32_t>(region.address | mark),
                                 .picture = strip.subject});
  }

  const DrawList& list_;
  const Projection& projection_;
  QuadList& quads_;
  const float rows_;
};

/// Of the picture's pixels those that a strip may cover, and `all`.
PixelBox joined_box(const Strip& strip, int rows, const PixelBox& all) {
  const auto first = static_cast<float>(strip.column_begin), last = static_cast<float>(strip.column_end - 1);
  const auto clamped = [&](float row) {
    return std::clamp(row_below(std::clamp(row, -8.0f, rows + 8.0f)), 0, rows);
  };
  const PixelBox box{strip.column_begin, clamped(std::min(strip.top.at(first), strip.top.at(last))),
                     strip.column_end, clamped(std::max(strip.bottom.at(first), strip.bottom.at(last)))};
  if (box.right <= box.left || box.bottom <= box.top) return all;
  if (all.right <= all.left || all.bottom <= all.top) return box;
  return {std::min(all.left, box.left), std::min(all.top, box.top), std::max(all.right, box.right),
          std::max(all.bottom, box.bottom)};
}

}  // namespace

void make_quads(const DrawList& list, const Projection& projection, QuadList* quads) {
  quads->clear();
  quads->has_blended = list.has_blended;
  QuadMaker maker(list, projection, quads);
  const std::span strips(list.strips);
  for (const Strip& strip : strips.first(list.opaque_end)) maker.make(strip, kOverlap);
  quads->opaque_end = quads->quad_count();
  for (const Strip& strip : strips.subspan(list.opaque_end)) {
    if (quads->masked_runs.empty() || quads->masked_runs.back().blended != strip.paint.blended)
      quads->masked_runs.push_back({.end = 0, .blended = strip.paint.blended});
    if (strip.paint.blended) quads->blended_box = joined_box(strip, projection.rows, quads->blended_box);
    maker.make(strip, 0);
    quads->masked_runs.back().end = quads->quad_count();
  }
}

}  // namespace comrad::doom
