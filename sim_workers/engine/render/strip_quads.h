// The strips of a view as textured quads, as OpenGL takes them. Stage: render.
#pragma once

#include <cstdint>
#include <vector>

#include "sim_workers/engine/render/draw_list.h"
#include "sim_workers/engine/render/projection.h"

namespace comrad::doom {

/// A corner of a quad, as the vertex shader takes it.
struct QuadVertex {
  float x, y, z, w;     ///< clip coordinates
  float u, v;           ///< in repeats of the texture
  float width, height;  ///< of the texture, texels
  float shade;          ///< light row at infinite distance
  int32_t address;      ///< of the texture in the sheet; above it the tint, or the blend
  int32_t picture = 0;  ///< what it is of (Subject), until the rasterizer writes which picture it is in
};

/// Quads in drawing order, four vertices each, clockwise from the upper left one. Ranges count quads.
struct QuadList {
  std::vector<QuadVertex> vertices;
  uint32_t opaque_end = 0;
  /// The rest in stretches that are all opaque or all blended.
  struct Run {
    uint32_t end = 0;
    bool blended = false;
  };
  std::vector<Run> masked_runs;
  bool has_blended = false;
  PixelBox blended_box;  ///< pixels that blended quads may cover

  uint32_t quad_count() const { return static_cast<uint32_t>(vertices.size() / 4); }
  void clear() {
    vertices.clear(), masked_runs.clear();
    opaque_end = 0;
    has_blended = false, blended_box = {};
  }
};

/// Replaces `quads` by those of `list`. OpenGL samples at a pixel's centre, the painter at the places that Projection names: the
/// quads lie that much beside the strips.
void make_quads(const DrawList& list, const Projection& projection, QuadList* quads);

}  // namespace comrad::doom
