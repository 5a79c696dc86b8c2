// Walls, floors, ceilings and the sky of a view as quads. Floors need no triangles of their own in the level: a
// floor's visible part is bounded by the walls seen in each column. Stage: render.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "sim_workers/engine/render/picture_area.h"
#include "sim_workers/engine/render/view_frame.h"
#include "sim_workers/engine/render/visibility.h"

namespace comrad::doom {

/// The upper or lower end of what shows of a surface: an end of the picture, or a height along a span. "Far" is
/// what shows of the sector behind the span.
struct Edge {
  enum Kind : uint8_t { kPictureTop, kPictureBottom, kNearFloor, kNearCeiling, kFarFloor, kFarCeiling };
  Kind kind = kPictureTop;
  uint32_t span = 0;
  bool is_of_picture() const { return kind < kNearFloor; }
  bool operator==(const Edge&) const = default;
};

class Surfaces {
 public:
  /// Edges between which a sprite, or a grating, shows in a column.
  struct Clip {
    Edge top{Edge::kPictureTop}, bottom{Edge::kPictureBottom};
    bool operator==(const Clip&) const = default;
  };

  Surfaces(ViewFrame* frame, const Visibility* visibility);
  /// Adds the quads of what the eye sees, from far to near.
  void emit();

  // After emit(), for what stands among the surfaces.
  /// What is left between the edges that are nearer than 1 / inverse and hide sprites; of a grating, those
  /// nearer than its own span.
  Clip clip_at(int column, float inverse, std::optional<uint32_t> own_span) const;
  float row_of(Edge at, float x) const;
  /// The row of a height where `span` stands in column x.
  float row_at(const WallSpan& span, float x, float height) const {
    return frame_.center_y - frame_.projection.focal_y * (height - frame_.eye_z) * span.inverse_at(x);
  }
  /// A part of a wall with its texture, which begins at the height `texture_top`.
  void emit_textured(const WallSpan& span, const PictureArea& area, float texture_top, const ScenePart& part,
                     const SceneSide& side, float shade, int32_t mark);

 private:
  struct Crossing {
    float inverse = 0;
    uint32_t span = 0;
  };
  /// What a partial or solid span does to the columns that it covers.
  struct Border {
    const SectorNow* now = nullptr;
    const SectorNow* beyond = nullptr;
    std::array<float, 4> factors{};               ///< ViewFrame::row_factor() by Edge::Kind, of the opening
    bool floor_ends = true, ceiling_ends = true;  ///< they look otherwise behind it
    bool draws_floor = false, draws_ceiling = false;
    bool sky_goes_on = false;  ///< its ceiling is open sky, and so is the one behind it, no lower
    bool upper = false, lower = false, middle = false;    ///< the parts of the wall that are drawn
    bool closes_top = false, closes_bottom = false;       ///< nothing behind shows beyond the opening
    std::optional<Edge::Kind> sprite_top, sprite_bottom;  ///< what hides sprites behind it
    float factor(Edge::Kind kind) const { return factors[static_cast<std::size_t>(kind - Edge::kNearFloor)]; }
  };
  /// A part of a surface between two edges, in a run of columns.
  struct Piece {
    enum class Kind : uint8_t { kFloor, kCeiling, kMiddle, kUpper, kLower } kind = Kind::kFloor;
    uint32_t span = 0;  ///< the wall's, or the one that ends the floor
    Edge top, bottom;
    int column_begin = 0, column_end = 0;
  };

  void emit_painted_planes();
  void emit_painted_run(int column_begin, int column_end, uint32_t sector_index, float inverse_min);
  void emit_all_walls();
  void emit_walls(const WallSpan& span, int column_begin, int column_end);
  void emit_sky();
  float sky_u(float x) const;
  float sky_v(float row) const;
  Border measure_border(const WallSpan& span);
  void collect_crossings();
  void collect_pieces();
  void look_through(int column);
  /// One end of a piece in a column.
  struct End {
    Edge edge;
    float row = 0;
  };
  void add_piece(Piece::Kind kind, uint32_t span, const End& from, const End& to, int column,
                 std::size_t* older);
  bool goes_on(const Piece& before, const Piece& now);
  void emit_piece(const Piece& piece);
  void emit_wall_part(const WallSpan& span, Piece::Kind kind, const PictureArea& area);
  void emit_plane(const PictureArea& area, uint32_t sector_index, bool floor);

  ViewFrame& frame_;
  const Visibility& visibility_;
  std::vector<Crossing> crossings_;  // [column, kCrossingsMax]
  std::vector<int> crossing_counts_;
  std::vector<Border> borders_;                               // [span]
  std::vector<Piece> pieces_;                                 // of the picture
  std::vector<uint32_t> column_pieces_, next_column_pieces_;  // of a column, near to far: into pieces_
  /// What decides about the order of pieces.
  struct Drawn {
    float inverse;
    Piece::Kind kind;
    uint32_t piece;
  };
  std::vector<Drawn> drawn_;  // every piece, as they ended; then far to near
  bool sky_seen_ = false;
};

}  // namespace comrad::doom
