// Doom's camera as numbers: where a direction and a height land in a picture of any size. Stage: render.
#pragma once

#include <cmath>

#include "sim_workers/engine/render/renderer.h"

namespace comrad::doom {

/// The 3D view: `width` x `rows` pixels above the status bar. A point `depth` units ahead, `side` to
/// the right and `up` above the eye lands at (center_x + focal_x * side / depth, center_y - focal_y *
/// up / depth).
struct Projection {
  int width = 0;  ///< of the view and of the picture
  int rows = 0;   ///< of the view: those above the status bar
  float center_x = 0, center_y = 0, focal_x = 0, focal_y = 0;
  /// Where inside a pixel the reference engine looks a texture up, relative to the pixel's centre
  /// (measured on its frames of 160x120, half a pixel there): planes at the right border, walls at the
  /// lower left corner.
  float plane_shift_x = 0, wall_shift_x = 0, wall_shift_y = 0;
  float hand_unit_x = 1, hand_unit_y = 1;  ///< pixels of a column of 320 and of a row of 200, for the weapon
};

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
  projection.plane_shift_x = 0.5f * static_cast<float>(options.width) / 160.0f;
  projection.wall_shift_x = -projection.plane_shift_x;
  projection.wall_shift_y = 0.5f * static_cast<float>(options.height) / 120.0f;
  projection.hand_unit_y = static_cast<float>(options.height / 200.0);
  projection.hand_unit_x = static_cast<float>(options.width / 320.0 * (4.0 / 3.0) / options.screen_aspect);
  return projection;
}

}  // namespace comrad::doom
