// Which walls the eye sees: from its sector through every opening that shows another one. Doom's walls are
// vertical, so visibility is decided once per picture column: the nearest solid wall in each column is found
// here, and only what lies in front of it is drawn. Stage: render.
#pragma once

#include <cstdint>
#include <optional>
#include <vector>

#include "sim_workers/engine/render/view_frame.h"

namespace comrad::doom {

/// A line's visible extent in this picture, from its left end. 1/depth and u/depth are linear in x.
struct WallSpan {
  uint32_t line = 0;
  uint32_t near_sector = 0, far_sector = 0;
  bool back_side = false;  ///< seen from its back
  bool solid = false;
  int column_begin = 0, column_end = 0;
  float x_left = 0;    ///< where it begins; its first column may look for texels left of it
  ColumnLine inverse;  ///< 1/depth
  ColumnLine u;        ///< map units along the wall, over depth
  ColumnLine
      edge;  ///< 1/depth for its upper and lower borders, which run from its first whole column to its last
};

/// The nearest solid wall of a picture column.
struct ViewColumn {
  float inverse = 0;             ///< 1/depth of it at the column's ray; 0 where the map is open
  std::optional<uint32_t> span;  ///< into Visibility::spans()
};

class Visibility {
 public:
  explicit Visibility(ViewFrame* frame);
  /// Looks from the frame's eye.
  void look();

  const std::vector<WallSpan>& spans() const { return spans_; }
  /// Those that the eye sees past and that are not wholly hidden, into spans().
  const std::vector<uint32_t>& partial_spans() const { return partial_spans_; }
  const std::vector<ViewColumn>& columns() const { return columns_; }
  const ViewColumn& column(int at) const { return columns_[static_cast<std::size_t>(at)]; }
  /// Projection::ray_of(), from a table.
  float ray(int column) const { return rays_[static_cast<std::size_t>(column)]; }
  uint32_t eye_sector() const { return eye_sector_; }
  /// Whether the eye reaches that sector.
  bool reaches(uint32_t sector) const { return windows_[sector].stamp == frame_.stamp; }
  /// The side of a span that the eye sees, as it is now.
  const SceneSide& near_side(const WallSpan& span) const;

 private:
  /// This picture's record of a line: the columns it covers, and whether it is among the spans yet.
  struct LineView {
    uint64_t stamp = 0;
    enum class Kind : uint8_t { kUnseen, kPlain, kShown } kind = Kind::kUnseen;
    bool added = false;
    bool open = false;        ///< the eye may pass it
    bool any_facing = false;  ///< so near that either side may be the eye's
    int column_begin = 0, column_end = 0;
    WallSpan span;
  };
  /// A vertex as the eye sees it: how far to the right and ahead, and beyond which border of the picture it lies.
  struct VertexView {
    uint64_t stamp = 0;
    float side = 0, depth = 0;
    bool beyond_left = false, beyond_right = false;
  };
  /// Columns through which the eye reaches a sector.
  struct Window {
    uint64_t stamp = 0;
    int begin = 0, end = 0;
    bool queued = false;
  };

  void reach(uint32_t sector, int begin, int end);
  LineView& look_at(uint32_t line);
  void measure_line(uint32_t line, LineView* seen);
  void add_span(const WallSpan& span);
  void collect_polyobjects();
  const VertexView& transform(uint32_t vertex) {
    if (vertices_[vertex].stamp != frame_.stamp)
      place_vertex(vertex, frame_.scene->vertex_x[vertex], frame_.scene->vertex_y[vertex]);
    return vertices_[vertex];
  }
  void place_vertex(uint32_t vertex, float x, float y);
  bool is_hidden(const WallSpan& span) const;

  ViewFrame& frame_;
  uint32_t eye_sector_ = 0;
  std::vector<VertexView> vertices_;
  std::vector<LineView> line_views_;
  std::vector<Window> windows_;  // [sector]
  std::vector<uint32_t> queue_;
  std::vector<WallSpan> spans_;
  std::vector<uint32_t> partial_spans_;
  std::vector<ViewColumn> columns_;
  std::vector<float> rays_;  // [column]
};

}  // namespace comrad::doom
