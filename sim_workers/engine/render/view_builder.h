// From a world and an eye to a short list of quads: everything that is visible and nearly nothing else.
// Doom's walls are vertical, so visibility is decided once per picture column: the nearest solid wall in each
// column is found on the CPU, and only wall pieces, floor strips and sprites in front of it are emitted.
// Floors need no triangles of their own in the level: a floor's visible part is bounded by the walls seen in
// each column. Stage: render.
#pragma once

#include <cstdint>
#include <deque>
#include <span>
#include <vector>

#include "sim_workers/engine/play/world.h"
#include "sim_workers/engine/render/projection.h"
#include "sim_workers/engine/render/scene.h"

namespace comrad::doom {

/// What one picture shows, apart from the scene's fixed parts.
struct SceneView {
  const Scene* scene = nullptr;
  std::span<const Sector> sectors;
  std::span<const Actor> actors;
  const SpriteTable* sprites = nullptr;
  uint32_t hidden_actor_id = 0;  ///< the viewer's own body
  double eye_x = 0, eye_y = 0, eye_z = 0;
  Angle angle = 0;
};

/// A corner of a quad, as the vertex shader takes it.
struct QuadVertex {
  float x, y, z, w;     ///< clip coordinates
  float u, v;           ///< in repeats of the texture
  float width, height;  ///< of the texture, texels
  float shade;          ///< light row at infinite distance; see light_shade()
  int32_t address;      ///< of the texture in the atlas
};

/// Quads in drawing order; four vertices each. Ranges count quads.
struct DrawList {
  std::vector<QuadVertex> vertices;
  uint32_t painted_end = 0;  ///< [0, painted_end): opaque, in painter's order, no depth test
  uint32_t solid_end = 0;    ///< [painted_end, solid_end): walls, depth tested and written
  uint32_t plane_end = 0;    ///< [solid_end, plane_end): floors and ceilings, depth tested only
  uint32_t masked_end =
      0;  ///< [plane_end, masked_end): sprites and gratings from far to near, transparent texels
  bool needs_depth = false;  ///< false where no wall part can hide another: walls and floors tile the picture

  void clear() { *this = DrawList{.vertices = std::move(vertices)}, vertices.clear(); }
};

/// Light row at infinite distance for a sector light of 0..255; a surface `depth` units away shows row
/// shade - min(24, kLightReach / depth), between 0 and 31. Fitted to frames of the reference engine.
inline float light_shade(int light) { return 64.0f - static_cast<float>(light + 12) * 0.25f; }
constexpr float kLightReach = 1280.0f;
constexpr float kLightNearest = 24.0f;

/// Which of a sprite's eight sides faces an eye that looks along `to_thing` (from the eye to the thing).
inline int sprite_side(Angle to_thing, Angle thing_angle) {
  return static_cast<int>((to_thing - thing_angle + kAngle180 + kAngle45 / 2) >> 29);
}

class ViewBuilder {
 public:
  ViewBuilder(const Projection& projection, ArtAtlas* atlas);
  /// Fills `list` with the quads of `view`.
  void build(const SceneView& view, DrawList* list);

 private:
  /// A line's visible extent in this picture, nearest end to farthest. Along the columns 1/depth and u/depth
  /// are linear.
  struct Span {
    uint32_t line = 0;
    bool back_side = false;  ///< seen from its back
    bool solid = false;
    int column_begin = 0, column_end = 0;
    float x_left = 0, x_right = 0;
    float inverse_left = 0, inverse_slope = 0;  ///< 1/depth at x_left, per pixel
    float u_left = 0, u_slope = 0;              ///< texels along the wall, over depth
    float inverse_at(float x) const { return inverse_left + (x - x_left) * inverse_slope; }
    float u_at(float x) const { return u_left + (x - x_left) * u_slope; }
  };
  struct SectorNow {
    float floor = 0, ceiling = 0, shade = 0;
    const ScenePlane* floor_plane = nullptr;
    const ScenePlane* ceiling_plane = nullptr;
    uint64_t stamp = 0;
  };
  struct Crossing {
    float inverse = 0;
    int32_t span = -1;
  };
  struct VisibleSprite {
    float inverse = 0, x_left = 0, x_right = 0, y_top = 0, y_bottom = 0, shade = 0;
    const SpriteArt* art = nullptr;
    int32_t grating = -1;  ///< a span with a see-through middle texture instead of a sprite
    int column_begin = 0, column_end = 0;
    bool mirrored = false;
  };

  const SectorNow& sector(uint32_t index);
  const SceneSide& near_side(const Span& span) const;
  const SceneSide& far_side(const Span& span) const;
  void emit_painted_run(int column_begin, int column_end, const SectorNow& now, float inverse_min);
  void transform_vertices();
  void collect_spans();
  bool add_span(uint32_t line_index);
  void fill_columns(int32_t span_index);
  void emit_painted_planes();
  void emit_sky();
  void emit_walls(const Span& span, int column_begin, int column_end);
  void emit_wall_part(const Span& span, float x_left, float x_right, float top, float bottom,
                      float texture_top, float offset_y, const AtlasRegion& region, float shade);
  void emit_crossed_planes();
  void emit_plane_run(int column_begin, int column_end, const Crossing* crossings, int count,
                      int32_t solid_span);
  void emit_plane(float x_left, float x_right, float top_left, float top_right, float bottom_left,
                  float bottom_right, float height, const AtlasRegion& region, float shade);
  void collect_sprites();
  void emit_masked();
  void push(float x, float row, float inverse, float u, float v, const AtlasRegion& region, float shade);
  uint32_t quad_count() const { return static_cast<uint32_t>(list_->vertices.size() / 4); }

  Projection projection_;
  ArtAtlas* atlas_;
  const SceneView* view_ = nullptr;
  const Scene* scene_ = nullptr;
  DrawList* list_ = nullptr;
  float cosine_ = 1, sine_ = 0, eye_x_ = 0, eye_y_ = 0, eye_z_ = 0;
  uint64_t stamp_ = 0;
  std::vector<SectorNow> sectors_;
  std::deque<ScenePlane> changed_planes_;  // textures that scripts set, of this picture
  std::vector<float> side_, depth_;        // [vertex] right of and ahead of the eye
  std::vector<Span> spans_;
  std::vector<int32_t> partial_spans_;
  std::vector<float> column_inverse_;  // [column] 1/depth of the nearest solid wall
  std::vector<int32_t> column_span_;
  std::vector<Crossing> crossings_;  // [column, kCrossingsMax]
  std::vector<int32_t> crossing_count_;
  std::vector<VisibleSprite> sprites_;
  bool sky_seen_ = false;
};

}  // namespace comrad::doom
