// From a world and an eye to a short list of quads: everything that is visible and nearly nothing else.
// Doom's walls are vertical, so visibility is decided once per picture column: the nearest solid wall in each
// column is found on the CPU, and only wall pieces, floor strips and sprites in front of it are emitted.
// Floors need no triangles of their own in the level: a floor's visible part is bounded by the walls seen in
// each column. The lines that are looked at at all are those of sectors that the eye reaches through
// openings, window by window, so a view costs what is visible. Stage: render.
#pragma once

#include <array>
#include <cstdint>
#include <deque>
#include <span>
#include <utility>
#include <vector>

#include "sim_workers/engine/play/world.h"
#include "sim_workers/engine/render/projection.h"
#include "sim_workers/engine/render/scene.h"

namespace comrad::doom {

/// A picture held before the eye: the weapon in hand or its flash.
struct HandSprite {
  uint32_t sprite = 0;
  uint8_t frame = 0;
  bool bright = false;
  float x = 0, y = 0;  ///< Doom's place of a weapon on a screen of 320x200; y = 32 is raised
};

/// What one picture shows, apart from the scene's fixed parts.
struct SceneView {
  const Scene* scene = nullptr;
  std::span<const Sector> sectors;
  std::span<const SideState> sides;  ///< empty: as the level has them
  std::span<const LineState> lines;  ///< the same
  const StableList<Actor>* actors = nullptr;
  std::span<const Polyobject> polyobjects;
  SpriteTable* sprites = nullptr;
  uint32_t hidden_actor_id = 0;  ///< the viewer's own body
  double eye_x = 0, eye_y = 0, eye_z = 0;
  Angle angle = 0, pitch = 0;  ///< pitch: positive down
  int extra_light = 0;         ///< of a weapon's flash, 0..2
  std::span<const HandSprite> hand;
  RenderStyle hand_style = RenderStyle::kNormal;
  float hand_alpha = 1;
};

/// A corner of a quad, as the vertex shader takes it.
struct QuadVertex {
  float x, y, z, w;     ///< clip coordinates
  float u, v;           ///< in repeats of the texture
  float width, height;  ///< of the texture, texels
  float shade;          ///< light row at infinite distance; see light_shade()
  int32_t address;      ///< of the texture in the atlas; above it the tint, or the blend
  int32_t picture = 0;  ///< which of the pictures of a pass; the rasterizer sets it
};

/// Pixels [left, right) x [top, bottom).
struct PixelBox {
  int left = 0, top = 0, right = 0, bottom = 0;
};

constexpr int kTintsMax = 8, kBlendsMax = 8;

/// How the texels of a see-through surface join the picture behind it.
struct Blend {
  enum class Kind : uint8_t { kMix, kAdd, kSubtract, kDarken } kind = Kind::kMix;
  uint8_t alpha = 255;
  bool operator==(const Blend&) const = default;
};

/// Quads in drawing order; four vertices each. Ranges count quads.
struct DrawList {
  std::vector<QuadVertex> vertices;
  uint32_t opaque_end = 0;  ///< [0, opaque_end): sky, walls, floors, ceilings, in painter's order
  /// [opaque_end, masked_end): sprites and gratings from far to near, then the weapon; transparent texels
  uint32_t masked_end = 0;
  /// The masked range in stretches that are all opaque or all blended. A blended texel goes to a layer of its
  /// own, an opaque one takes the layer away: the nearest see-through surface of a pixel counts.
  struct Run {
    uint32_t end = 0;
    bool blended = false;
  };
  std::vector<Run> masked_runs;
  bool has_blended = false;
  PixelBox blended_box;                             ///< pixels that blended quads may cover
  int32_t picture = 0;                              ///< which of the pictures of one pass this is
  std::array<uint32_t, kTintsMax> tints{0xFFFFFF};  ///< 0xRRGGBB by number; 0 is white
  uint32_t tint_count = 1;
  std::array<Blend, kBlendsMax> blends{};
  uint32_t blend_count = 0;

  void clear() {
    vertices.clear(), masked_runs.clear();
    opaque_end = masked_end = 0;
    has_blended = false;
    blended_box = {};
    tint_count = 1, blend_count = 0;
  }
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
    uint32_t near_sector = 0, far_sector = 0;
    bool back_side = false;  ///< seen from its back
    bool solid = false;
    int column_begin = 0, column_end = 0;
    float x_left = 0, x_right = 0;
    float inverse_left = 0, inverse_slope = 0;  ///< 1/depth at x_left, per pixel
    float u_left = 0, u_slope = 0;              ///< map units along the wall, over depth
    float inverse_at(float x) const { return inverse_left + (x - x_left) * inverse_slope; }
    float u_at(float x) const { return u_left + (x - x_left) * u_slope; }
  };
  /// What this picture knows of a line: the columns it covers, and whether it is among the spans yet.
  struct LineView {
    uint64_t stamp = 0;
    enum class Kind : uint8_t { kUnseen, kPlain, kShown } kind = Kind::kUnseen;
    bool added = false;
    bool open = false;        ///< the eye may pass it
    bool any_facing = false;  ///< so near that either side may be the eye's
    int column_begin = 0, column_end = 0;
    Span span;
  };
  /// Columns through which the eye reaches a sector.
  struct Window {
    uint64_t stamp = 0;
    int begin = 0, end = 0;
    bool queued = false;
  };
  struct SectorNow {
    float floor = 0, ceiling = 0;
    float shade = 0, floor_shade = 0, ceiling_shade = 0;
    int32_t tint = 0;  ///< shifted to its place above an address
    const ScenePlane* floor_plane = nullptr;
    const ScenePlane* ceiling_plane = nullptr;
    uint64_t stamp = 0;
  };
  struct Crossing {
    float inverse = 0;
    int32_t span = -1;
  };
  /// The upper or lower end of what shows of a surface: a height along a span (4 * span + which), or an end
  /// of the picture.
  using Edge = int32_t;
  static constexpr Edge kPictureTop = -1, kPictureBottom = -2;
  enum EdgeHeight : int32_t { kNearFloor, kNearCeiling, kFarFloor, kFarCeiling };
  static Edge edge(int32_t span, EdgeHeight which) { return 4 * span + which; }
  /// What a partial or solid span does to the columns that it covers. A row is center_y_ + factor / depth.
  struct Border {
    const SectorNow* now = nullptr;
    const SectorNow* beyond = nullptr;
    std::array<float, 4> factor{};                ///< by EdgeHeight, of the opening
    bool floor_ends = true, ceiling_ends = true;  ///< they look otherwise behind it
    bool draws_floor = false, draws_ceiling = false;
    bool sky_goes_on = false;  ///< its ceiling is open sky, and so is the one behind it, no lower
    bool upper = false, lower = false, middle = false;  ///< the parts of the wall that are drawn
    bool closes_top = false, closes_bottom = false;     ///< nothing behind shows beyond the opening
    Edge sprite_top = kPictureTop, sprite_bottom = kPictureBottom;  ///< what hides sprites behind it
  };
  /// A part of a surface between two edges, in a run of columns.
  struct Piece {
    enum class Kind : uint8_t { kFloor, kCeiling, kMiddle, kUpper, kLower } kind = Kind::kFloor;
    int32_t span = -1;  ///< the wall's, or the one that ends the floor
    Edge top = kPictureTop, bottom = kPictureBottom;
    int column_begin = 0, column_end = 0;
    float inverse = 0;  ///< in the middle of the span
  };
  struct VisibleSprite {
    float inverse = 0, x_left = 0, x_right = 0, y_top = 0, y_bottom = 0, shade = 0;
    AtlasRegion region;
    int32_t grating = -1;  ///< a span with a see-through middle texture instead of a sprite
    int32_t blend = -1;    ///< -1 opaque
    int32_t tint = 0;
    int column_begin = 0, column_end = 0;
    bool mirrored = false;
  };

  const SectorNow& sector(uint32_t index);
  const SceneSide& side_now(const SceneSide& side);
  const SceneSide& near_side(const Span& span);
  float wall_shade(const SectorNow& now, const SceneSide& side) const;
  int32_t tint(uint32_t color);
  int32_t blend(RenderStyle style, float alpha);
  bool same_look(const SectorNow& a, const SectorNow& b, uint32_t a_index, uint32_t b_index) const;
  void emit_painted_run(int column_begin, int column_end, uint32_t sector_index, float inverse_min);
  void transform(uint32_t vertex);
  void place_vertex(uint32_t vertex, float x, float y);
  void collect_spans();
  void reach(uint32_t sector, int begin, int end);
  LineView& look_at(uint32_t line);
  void measure_line(uint32_t line, LineView* seen);
  void add_span(const Span& span);
  void collect_polyobjects();
  void fill_columns(int32_t span_index);
  void emit_painted_planes();
  void emit_sky();
  float sky_u(float x) const;
  float sky_v(float row) const;
  void emit_all_walls();
  void emit_walls(const Span& span, int column_begin, int column_end);
  void measure_border(int32_t span_index);
  bool same_plane_look(const SectorNow& a, const SectorNow& b, uint32_t a_index, uint32_t b_index,
                       bool floor) const;
  /// The row of a height where `span` stands in column x.
  float row_at(const Span& span, float x, float height) const;
  float row_of(Edge at, float x) const;
  void collect_crossings();
  void collect_pieces();
  void add_piece(const Piece& piece, bool holds_pixel, std::size_t* older);
  bool goes_on(const Piece& before, const Piece& now) const;
  void emit_piece(const Piece& piece);
  void emit_wall_part(const Span& span, Piece::Kind kind, float x_left, float x_right, float top_left,
                      float top_right, float bottom_left, float bottom_right);
  void emit_textured(const Span& span, float x_left, float x_right, float top_left, float top_right,
                     float bottom_left, float bottom_right, float texture_top, const ScenePart& part,
                     const SceneSide& side, float shade, int32_t tint);
  void emit_plane(float x_left, float x_right, float top_left, float top_right, float bottom_left,
                  float bottom_right, float height, const AtlasRegion& region, const FlatPlacement& placement,
                  float shade, int32_t tint);
  struct Clip {
    Edge top = kPictureTop, bottom = kPictureBottom;
    bool operator==(const Clip&) const = default;
  };
  Clip clip_at(int column, float inverse, int32_t own_span) const;
  void collect_sprites();
  void collect_gratings();
  void emit_masked();
  void emit_grating(const Span& span, int32_t tint_or_blend, float run_left, float run_right,
                    const Clip& clip);
  void emit_sprite(const VisibleSprite& sprite, int32_t mark, float run_left, float run_right,
                   const Clip& clip);
  void emit_hand();
  void begin_masked(bool blended);
  void cover_blended(float left, float top, float right, float bottom);
  void push(float x, float row, float inverse, float u, float v, const AtlasRegion& region, float shade,
            int32_t tint);
  uint32_t quad_count() const { return static_cast<uint32_t>(list_->vertices.size() / 4); }

  Projection projection_;
  ArtAtlas* atlas_;
  const SceneView* view_ = nullptr;
  const Scene* scene_ = nullptr;
  DrawList* list_ = nullptr;
  float cosine_ = 1, sine_ = 0, eye_x_ = 0, eye_y_ = 0, eye_z_ = 0;
  float center_y_ = 0;  // of the projection, moved by the pitch
  uint32_t eye_sector_ = 0;
  uint64_t stamp_ = 0;
  std::vector<SectorNow> sectors_;
  std::deque<ScenePlane> changed_planes_;  // textures that scripts set, of this picture
  std::deque<SceneSide> changed_sides_;
  std::vector<std::pair<uint64_t, const SceneSide*>> side_changes_;  // [sidedef] stamp and what it is now
  std::vector<float> side_, depth_;                                  // [vertex] right of and ahead of the eye
  std::vector<uint64_t> vertex_stamps_;
  std::vector<LineView> line_views_;
  std::vector<Window> windows_;  // [sector]
  std::vector<uint32_t> queue_;
  std::vector<Span> spans_;
  std::vector<int32_t> partial_spans_;
  std::vector<float> column_inverse_;  // [column] 1/depth of the nearest solid wall
  std::vector<int32_t> column_span_;
  std::vector<Crossing> crossings_;  // [column, kCrossingsMax]
  std::vector<int32_t> crossing_count_;
  std::vector<Border> borders_;                            // [span]
  std::vector<Piece> pieces_;                              // of the picture
  std::vector<Piece> column_pieces_, next_column_pieces_;  // of a column, near to far
  std::vector<VisibleSprite> sprites_;
  bool sky_seen_ = false;
};

}  // namespace comrad::doom
