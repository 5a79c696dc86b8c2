// Walls, floors, ceilings and the sky of a view as strips. Floors need no separate triangles in the level: a
// floor's visible part is bounded by the walls seen in each column. Stage: render.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <vector>

#include "sim_workers/engine/render/view_frame.h"
#include "sim_workers/engine/render/visibility.h"

namespace comrad::doom {

/// The upper or lower end of what shows of a surface: an end of the picture, or a height along a span. "Far" is
/// what shows of the sector behind the span.
struct Edge {
  enum Kind : uint8_t { kPictureTop, kPictureBottom, kNearFloor, kNearCeiling, kFarFloor, kFarCeiling };
  Kind kind = kPictureTop;
  uint32_t span = 0;
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
  /// Adds the strips of what the eye sees.
  void emit();

  // After emit(), for what stands among the surfaces.
  /// What is left between the edges that are nearer than 1 / inverse and hide sprites; of a grating, those
  /// nearer than its own span.
  Clip clip_at(int column, float inverse, std::optional<uint32_t> own_span) const;
  ColumnLine line_of(Edge edge) const;
  /// Where a height runs along a span.
  ColumnLine line_at(const WallSpan& span, float height) const;
  /// A strip of a wall with its texture, which begins at the height `texture_top`; columns and edges are the caller's.
  Strip textured(const WallSpan& span, float texture_top, const ScenePart& part, const SceneSide& side) const;

 private:
  struct Crossing {
    float inverse = 0;
    uint32_t span = 0;
  };
  /// What a span does to the columns that it covers.
  struct Border {
    const SectorNow* now = nullptr;
    const SceneSide* side = nullptr;              ///< that the eye sees
    std::array<ColumnLine, 4> lines{};            ///< where it runs, by Edge::Kind from kNearFloor on
    bool floor_ends = true, ceiling_ends = true;  ///< they look otherwise behind it
    bool draws_floor = false, draws_ceiling = false;
    uint32_t floor_plane = 0, ceiling_plane = 0;  ///< into DrawList::planes, where they are drawn
    bool sky_goes_on = false;  ///< its ceiling is open sky, and so is the one behind it, no lower
    bool upper = false, lower = false, middle = false;    ///< the parts of the wall that are drawn
    bool closes_top = false, closes_bottom = false;       ///< nothing behind shows beyond the opening
    std::optional<Edge::Kind> sprite_top, sprite_bottom;  ///< what hides sprites behind it
    const ColumnLine& line(Edge::Kind kind) const {
      return lines[static_cast<std::size_t>(kind - Edge::kNearFloor)];
    }
  };
  /// A part of a surface between two edges, in a run of columns.
  struct Piece {
    enum class Kind : uint8_t { kFloor, kCeiling, kMiddle, kUpper, kLower } kind = Kind::kFloor;
    uint32_t span = 0;  ///< the wall's, or the one that ends the floor
    Edge top, bottom;
    int column_begin = 0, column_end = 0;
    bool is_plane() const { return kind == Kind::kFloor || kind == Kind::kCeiling; }
    bool same_surface(const Piece& other) const {
      return kind == other.kind && span == other.span && top == other.top && bottom == other.bottom;
    }
  };
  /// One end of what is still open in a column.
  struct End {
    Edge edge;
    float row = 0;
  };
  /// What a column shows, from near to far.
  struct Look {
    std::vector<Piece> pieces;
    bool meets_sky = false;
    float sky_bottom = 0;  ///< the lowest row that the sky may show in
  };

  Border measure_border(const WallSpan& span);
  void collect_crossings();
  void collect_pieces();
  void collect_run(int begin, int end);
  bool same_run(int column, int other) const;
  void look_through(int column, Look* look) const;
  bool goes_on(const Piece& before, const Piece& now) const;
  void add_pieces(const Look& look, int begin, int end);
  void emit_sky();
  void emit_piece(const Piece& piece);
  void emit_wall_part(const Piece& piece);
  uint32_t plane(uint32_t sector, bool floor);
  uint32_t plane_of(const Piece& piece) const {
    const Border& border = borders_[piece.span];
    return piece.kind == Piece::Kind::kFloor ? border.floor_plane : border.ceiling_plane;
  }

  ViewFrame& frame_;
  const Visibility& visibility_;
  std::vector<Crossing> crossings_;  // [column, kCrossingsMax]
  std::vector<int> crossing_counts_;
  std::vector<Border> borders_;                         // [span]
  std::vector<Piece> pieces_;                           // of the picture
  std::vector<uint32_t> run_pieces_, next_run_pieces_;  // of a run, near to far: into pieces_
  Look first_, last_, between_;
  float sky_bottom_ = 0;
  /// Planes of this picture: whose they are, by place in DrawList::planes.
  struct PlaneOwner {
    uint32_t sector = 0;
    bool floor = false;
  };
  std::vector<PlaneOwner> plane_owners_;
  std::vector<std::array<std::pair<uint64_t, uint32_t>, 2>>
      planes_of_sectors_;  // [sector][floor] stamp, plane
};

}  // namespace comrad::doom
