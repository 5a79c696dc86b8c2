// What a view comes to: strips of one surface each, between two edges that run straight across the picture. Each pixel of
// the opaque strips belongs to one of them. Stage: render.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "sim_workers/engine/render/art_atlas.h"

namespace comrad::doom {

/// A number that changes evenly from column to column of the picture.
struct ColumnLine {
  float at_zero = 0, slope = 0;
  template <typename Number>
  Number at(Number column) const {
    return at_zero + slope * column;
  }
  bool operator==(const ColumnLine&) const = default;
};

/// The first row of what lies below an edge: as in ViZDoom a pixel shows what its lower border meets.
inline int row_below(float edge) { return static_cast<int>(std::floor(edge)); }

/// Pixels [left, right) x [top, bottom).
struct PixelBox {
  int left = 0, top = 0, right = 0, bottom = 0;
};

constexpr int kTintsMax = 8, kBlendsMax = 8;

/// What a strip is of: these, and from kFirstActor on the actors by their place in the world's list.
enum Subject : int32_t { kWallSubject, kPlaneSubject, kWeaponSubject, kFirstActor };

/// How the texels of a see-through surface join the picture behind it.
struct Blend {
  enum class Kind : uint8_t { kMix, kAdd, kSubtract, kDarken } kind = Kind::kMix;
  static constexpr int kWhole = 64;
  uint8_t front = kWhole, behind = 0;  ///< shares of both, in 64ths
  bool operator==(const Blend&) const = default;
};

/// How something is coloured besides its texels: opaque in a tint, or as one of the picture's blends.
struct Paint {
  uint8_t tint = 0;  ///< into DrawList::tints
  bool blended = false;
  uint8_t blend = 0;  ///< into DrawList::blends
};

/// A floor or a ceiling: depth is the same along a row, and texels are linear in depth and column.
///   depth(row) = |row_factor / (row + 1/2 - center_y)|, of light |row_factor / (row - center_y)|
///   u(column, row) = u_eye + depth * (u_ahead + u_right * (column + 1 - center_x)); v alike. Texels.
struct Plane {
  AtlasRegion region;
  float row_factor = 0;  ///< rows below the horizon, times depth
  float shade = 0;
  uint8_t tint = 0;
  double u_eye = 0, v_eye = 0, u_ahead = 0, v_ahead = 0, u_right = 0, v_right = 0;
};

/// Columns [column_begin, column_end) of a surface, in each the rows [row_below(top), row_below(bottom)) that lie in the
/// picture.
struct Strip {
  enum class Kind : uint8_t {
    kSky,
    kPlane,   ///< plane
    kWall,    ///< texels from a wall in perspective
    kPicture  ///< upright at one depth: sprites and the weapon
  };
  Kind kind = Kind::kWall;
  bool masked = false;  ///< palette index 0 is a hole
  Paint paint;
  int column_begin = 0, column_end = 0;
  ColumnLine top, bottom;
  AtlasRegion region;
  float shade = 0;  ///< light row at infinite distance; see light_shade()
  int32_t subject = kWallSubject;
  uint32_t plane = 0;  ///< kPlane: into DrawList::planes
  float x_left = 0;    ///< kWall: columns left of this place have the texels of it
  // kWall and kPicture. v(column, row) = v_horizon + (row + 1 - center_y) * v_step / inverse(column), texels.
  ColumnLine inverse;  ///< 1/depth, of texels
  ColumnLine light;    ///< 1/depth, of light
  float v_horizon = 0, v_step = 0;
  // kWall: u(column) = u_offset + u_over_depth(column) / inverse(column), texels.
  float u_offset = 0;
  ColumnLine u_over_depth;
  // kPicture: u in 16.16 at column_begin, and its change per column.
  int32_t u_begin = 0, u_step = 0;
};

/// Strips in drawing order.
struct DrawList {
  std::vector<Strip> strips;
  std::vector<Plane> planes;
  uint32_t opaque_end = 0;  ///< [0, opaque_end): sky, then walls, floors and ceilings
  // From opaque_end on: sprites and gratings from far to near, then the weapon.
  bool has_blended = false;
  float center_y = 0;                               ///< row of the horizon
  Angle sky_angle = 0;                              ///< of the view
  std::array<uint32_t, kTintsMax> tints{0xFFFFFF};  ///< 0xRRGGBB by number; 0 is white
  uint32_t tint_count = 1;
  std::array<Blend, kBlendsMax> blends{};
  uint32_t blend_count = 0;

  uint32_t strip_count() const { return static_cast<uint32_t>(strips.size()); }
  void clear() {
    strips.clear(), planes.clear();
    opaque_end = 0;
    has_blended = false;
    tint_count = 1, blend_count = 0;
  }
};

/// Light row at infinite distance for a sector light of 0..255; a surface `depth` units away shows row
/// shade - min(24, kLightReach / depth), between 0 and 31. Fitted to frames of the reference engine.
inline float light_shade(int light) { return 64.0f - static_cast<float>(light + 12) * 0.25f; }
constexpr float kLightReach = 1280.0f;
constexpr float kLightNearest = 24.0f;
/// The row of the light table.
inline int light_row(float shade, float inverse) {
  const float row = shade - (kLightReach * inverse < kLightNearest ? kLightReach * inverse : kLightNearest);
  return row <= 0 ? 0 : row >= 31 ? 31 : static_cast<int>(row);
}

}  // namespace comrad::doom
