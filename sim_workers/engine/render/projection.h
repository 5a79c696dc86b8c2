// Doom's camera as numbers: where a direction and a height land in a picture of any size. Stage: render.
#pragma once

#include <cmath>
#include <cstdint>
#include <vector>

#include "sim_workers/engine/fixed.h"
#include "sim_workers/engine/render/renderer.h"

namespace comrad::doom {

/// The 3D view: `width` x `rows` pixels above the status bar. A point `depth` units ahead, `side` to
/// the right and `up` above the eye lands at (center_x + focal_x * side / depth, center_y - focal_y *
/// up / depth).
///
/// Where a pixel (column, row) looks, as ViZDoom does it (found with textures that tell their texels, at 160x120):
/// walls' texels at (column, row + 1), planes' at (column + 1, row + 1/2), and which wall it is at ray_of(column).
struct Projection {
  int width = 0;  ///< of the view and of the picture
  int rows = 0;   ///< of the view: those above the status bar
  float center_x = 0, center_y = 0, focal_x = 0, focal_y = 0;
  float hand_unit_x = 1, hand_unit_y = 1;  ///< pixels of a column of 320 and of a row of 200, for the weapon
  std::vector<Angle> sky_angles;  ///< [column] how far to the right of the view the sky's column lies

  /// Where a column looks for walls: ends of walls are rounded away from the picture's middle, an end that lies on a border
  /// exactly to the right one.
  float ray_of(int column) const {
    const auto left = static_cast<float>(column);
    return (left < center_x ? left + 1.0f : left) - 2 * kHair;
  }
  /// The first column whose ray is not left of x.
  int first_column(float x) const {
    const float at = x + kHair;
    const int cut = static_cast<int>(at), column = cut - (static_cast<float>(cut) > at ? 1 : 0);
    return at < center_x ? column : column + 1;
  }
  static constexpr float kHair = 1.0f / 512.0f;
};

/// How a sky's rows lie in the picture: v(row) = horizon + (row + 1 - center_y) * step, texels.
struct SkyRows {
  double horizon = 0, step = 0;
};

/// Skies are drawn for a screen of 200 rows and reach 200 rows above the horizon; those of 128 to 199 rows are stretched to 228.
inline SkyRows sky_rows(uint32_t height, float focal_y) {
  constexpr double kScreenRows = 200, kStretchedRows = 228;
  const double rows_per_pixel = kScreenRows * 0.8 / focal_y;
  if (height < 128 || height >= kScreenRows) return {kScreenRows - rows_per_pixel / 2, rows_per_pixel};
  const double texels_per_row = height / kStretchedRows;
  return {kScreenRows * texels_per_row, rows_per_pixel * texels_per_row};
}

/// Doom's pixels are 1.2 times as tall as wide and its screen is 4:3, so 90 degrees across make a vertical
/// focal length of 0.8 screen heights; a wider screen sees more to the sides.
inline Projection make_projection(const RenderOptions& options) {
  Projection projection;
  projection.width = options.width;
  projection.rows = options.status_bar ? options.height * 168 / 200 : options.height;
  const double half_fov = std::tan(options.fov_degrees * 3.14159265358979323846 / 360.0);
  const double focal_y = options.height * (4.0 / 3.0) / 2.0 * 1.2 / half_fov;
  projection.focal_y = static_cast<float>(focal_y);
  projection.focal_x =
      static_cast<float>(focal_y / 1.2 * options.width / (options.height * options.screen_aspect));
  projection.center_x = static_cast<float>(options.width / 2.0);
  projection.center_y = static_cast<float>(projection.rows / 2);
  projection.hand_unit_y = static_cast<float>(options.height / 200.0);
  projection.hand_unit_x = static_cast<float>(options.width / 320.0 * (4.0 / 3.0) / options.screen_aspect);
  // Fine angles, 8192 a turn, rounded down; the hair is for those that are whole but for rounding.
  for (int column = 0; column < options.width; ++column) {
    const double radians =
        std::atan((column - static_cast<double>(projection.center_x)) / projection.focal_x);
    const double fine_angles = std::floor(radians * (8192.0 / 6.283185307179586) + 1e-6);
    projection.sky_angles.push_back(static_cast<Angle>(static_cast<int64_t>(fine_angles) << 19));
  }
  return projection;
}

}  // namespace comrad::doom
