// Draws a list of strips on the CPU: walls and sprites column by column, floors and ceilings row by row, in 16.16 steps
// through the textures. One loop for colours, depths and subjects, so that they cannot disagree. Integers, and floating-point
// operations that IEEE 754 defines to the bit: the same picture by any compiler on any machine. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "sim_workers/engine/render/art_atlas.h"
#include "sim_workers/engine/render/draw_list.h"
#include "sim_workers/engine/render/palette_mixer.h"
#include "sim_workers/engine/render/projection.h"

namespace comrad::doom {

/// What every palette index becomes under the light rows of each tint: rows[tint][row * row_stride + index].
struct LightRows {
  std::array<const uint8_t*, kTintsMax> rows{};
  std::size_t row_stride = 256;  ///< 0 where light makes no difference
};

class Painter {
 public:
  Painter(const Projection& projection, const ArtAtlas* atlas);
  /// Colours: `indices` [rows, width], of the palette and after light; 0, Doom's black, where nothing is. `mixer` may be null
  /// where the list has nothing blended.
  void paint(const DrawList& list, const LightRows& light, const PaletteMixer* mixer, uint8_t* indices);
  /// How far away what is seen is: `depth` [rows, width], map units; 0 where nothing but sky is.
  void paint_depth(const DrawList& list, float* depth);
  /// What each pixel is of: `subjects` [rows, width], as Subject counts; `nothing` where nothing is.
  void paint_subjects(const DrawList& list, uint32_t nothing, uint32_t* subjects);

 private:
  template <typename Brushes>
  void paint_all(const DrawList& list, const Brushes& brushes);
  template <typename Brushes>
  void paint_columns(const DrawList& list, const Strip& strip, const Brushes& brushes);
  template <typename Brush>
  void paint_wall(const DrawList& list, const Strip& strip, Brush brush);
  template <typename Brush>
  void paint_picture(const DrawList& list, const Strip& strip, Brush brush);
  template <typename Brushes>
  void paint_sky(const DrawList& list, const Strip& strip, const Brushes& brushes);
  template <typename Brushes>
  void paint_planes(const DrawList& list, const Brushes& brushes);
  template <typename Brush>
  void paint_plane(const DrawList& list, const Plane& plane, uint32_t first_strip, Brush brush);
  template <typename Brush>
  void paint_row(const DrawList& list, const Plane& plane, int row, int begin, int end, Brush* brush);

  std::size_t at(int row, int column) const {
    return static_cast<std::size_t>(row) * static_cast<std::size_t>(projection_.width) +
           static_cast<std::size_t>(column);
  }

  const Projection projection_;
  const ArtAtlas& atlas_;
  std::vector<int> row_begins_;  // [row] where the open stretch of a plane's row began
  struct PlaneStrips {
    uint32_t first = 0, last = 0;
  };
  std::vector<PlaneStrips> plane_strips_;  // [plane]
  std::vector<uint32_t> next_strips_;      // [strip] the next one of its plane
};

}  // namespace comrad::doom
