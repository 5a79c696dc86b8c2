// Upright pieces of a picture between two edges, and how they are cut where edges cross, each other or the
// picture's border. All in pixels. Stage: render.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>

namespace comrad::doom {

/// What lies between an upper and a lower edge, from one x to another; each edge given by its rows at the ends.
struct PictureArea {
  float left = 0, right = 0;
  float top_left = 0, top_right = 0, bottom_left = 0, bottom_right = 0;
};

/// A number for each of the four corners of a quad, which are computed side by side.
using FourCorners = float __attribute__((vector_size(16)));

/// Rasterizers place corners on a grid of 1/256 pixel; on the same grid, "is this pixel's centre inside" has
/// the same answer here and there.
inline float snap(float pixels) { return std::floor(pixels * 256.0f + 0.5f) * (1.0f / 256.0f); }

/// First column whose centre is not left of x.
inline int first_column(float x) { return static_cast<int>(std::ceil(x - 0.5f)); }
/// x of a column's centre.
inline float centre_of(int column) { return static_cast<float>(column) + 0.5f; }

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

/// Calls piece(area) for the runs of columns of [left, right) in which the lower of two upper edges and the
/// higher of two lower ones are the same; edges are functions from x to a row.
template <typename Top, typename OwnTop, typename Bottom, typename OwnBottom, typename Piece>
void cut_by_edges(float left, float right, const Top& top, const OwnTop& own_top, const Bottom& bottom,
                  const OwnBottom& own_bottom, const Piece& piece) {
  struct Cut {
    bool top, bottom;
    bool operator==(const Cut&) const = default;
  };
  const auto cuts = [&](float column) {
    const float x = column + 0.5f;
    return Cut{top(x) > own_top(x), bottom(x) < own_bottom(x)};
  };
  for (float x = left; x < right;) {
    const Cut cut = cuts(std::floor(x));
    float end = std::floor(x) + 1.0f;
    while (end < right && cuts(end) == cut) end += 1.0f;
    end = std::min(end, right);
    const auto upper = [&](float at) { return cut.top ? top(at) : own_top(at); };
    const auto lower = [&](float at) { return cut.bottom ? bottom(at) : own_bottom(at); };
    piece(PictureArea{x, end, upper(x), upper(end), lower(x), lower(end)});
    x = end;
  }
}

}  // namespace comrad::doom
