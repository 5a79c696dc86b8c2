#include "sim_workers/engine/map/sector_tree.h"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdlib>
#include <utility>

namespace comrad::doom {

/// Makes the tree: picks a line that cuts few others and halves the rest, splits, and continues with
/// both halves.
class SectorTreeBuilder {
 public:
  explicit SectorTreeBuilder(const Level& level) : level_(level) {}

  SectorTree build() {
    std::vector<Seg> segs;
    for (uint32_t index = 0; index < level_.linedefs.size(); ++index) {
      const Linedef& linedef = level_.linedefs[index];
      if (linedef.in_polyobject) continue;
      const Vertex& start = level_.vertices[linedef.start];
      const Vertex& end = level_.vertices[linedef.end];
      if (start.x == end.x && start.y == end.y)
        continue;  // the loader refuses these; a hand-made level may not
      const double x1 = to_double(start.x), y1 = to_double(start.y), x2 = to_double(end.x),
                   y2 = to_double(end.y);
      segs.push_back({x1, y1, x2, y2, index, true, level_.sidedefs[linedef.front].sector_index});
      if (linedef.back)
        segs.push_back({x2, y2, x1, y1, index, false, level_.sidedefs[*linedef.back].sector_index});
    }
    node_limit_ = 64 * segs.size() + 64;
    if (!segs.empty()) tree_.root_ = grow(std::move(segs), 0, 1);
    return std::move(tree_);
  }

 private:
  struct Seg {
    double x1, y1, x2, y2;
    uint32_t linedef_index;
    bool front;  // runs along its linedef, else against it
    uint32_t sector_index;
  };
  enum class Place { kFront, kBack, kSplit };

  // Pieces shorter than this are rounding and are dropped; map units.
  static constexpr double kSliver = 1.0 / 4096.0;
  static constexpr std::size_t kSampledCandidates = 24;
  static constexpr int kDepthLimit = 400;

  struct Partition {
    double x, y, dx, dy;  // direction of unit length; front to its right
    double distance(double px, double py) const { return dy * (px - x) - dx * (py - y); }
  };

  Partition partition_of(const Seg& seg) const {
    const Linedef& linedef = level_.linedefs[seg.linedef_index];
    const Vertex& start = level_.vertices[seg.front ? linedef.start : linedef.end];
    const Vertex& end = level_.vertices[seg.front ? linedef.end : linedef.start];
    const double dx = to_double(end.x) - to_double(start.x), dy = to_double(end.y) - to_double(start.y);
    const double length = std::sqrt(dx * dx + dy * dy);
    return {to_double(start.x), to_double(start.y), dx / length, dy / length};
  }

  static Place classify(const Partition& partition, const Seg& seg) {
    const double first = partition.distance(seg.x1, seg.y1), second = partition.distance(seg.x2, seg.y2);
    if (std::abs(first) <= kSliver && std::abs(second) <= kSliver)
      return (seg.x2 - seg.x1) * partition.dx + (seg.y2 - seg.y1) * partition.dy > 0 ? Place::kFront
                                                                                     : Place::kBack;
    if (first >= -kSliver && second >= -kSliver) return Place::kFront;
    if (first <= kSliver && second <= kSliver) return Place::kBack;
    return Place::kSplit;
  }

  /// Cost of a partition, or nothing useful (-1) where everything stays in front.
  static int64_t cost_of(const Partition& partition, const std::vector<Seg>& segs) {
    int64_t front = 0, back = 0, split = 0;
    for (const Seg& seg : segs) {
      const Place place = classify(partition, seg);
      ++(place == Place::kFront ? front : place == Place::kBack ? back : split);
    }
    if (back == 0 && split == 0) return -1;
    return 8 * split + std::abs(front - back);
  }

  int32_t leaf(const std::vector<Seg>& segs, uint32_t fallback_sector) const {
    return ~static_cast<int32_t>(segs.empty() ? fallback_sector : segs.front().sector_index);
  }

  int32_t grow(std::vector<Seg> segs, uint32_t fallback_sector, int depth) {
    tree_.depth_ = std::max(tree_.depth_, depth);
    if (segs.empty() || depth >= kDepthLimit || tree_.nodes_.size() >= node_limit_)
      return leaf(segs, fallback_sector);
    // A sample of evenly spread candidates first; all of them only where none of the sample cuts anything.
    int64_t best_cost = -1;
    Partition best{};
    const Seg* best_seg = nullptr;
    const std::size_t stride = std::max<std::size_t>(1, segs.size() / kSampledCandidates);
    for (std::size_t pass_stride = stride;; pass_stride = 1) {
      for (std::size_t i = 0; i < segs.size(); i += pass_stride) {
        const Partition candidate = partition_of(segs[i]);
        const int64_t cost = cost_of(candidate, segs);
        if (cost >= 0 && (best_seg == nullptr || cost < best_cost))
          best_cost = cost, best = candidate, best_seg = &segs[i];
        if (pass_stride == 1 && stride > 1 && best_seg != nullptr) break;
      }
      if (best_seg != nullptr || pass_stride == 1) break;
    }
    if (best_seg == nullptr) return leaf(segs, fallback_sector);  // convex

    const Linedef& linedef = level_.linedefs[best_seg->linedef_index];
    const Vertex& start = level_.vertices[best_seg->front ? linedef.start : linedef.end];
    const Vertex& end = level_.vertices[best_seg->front ? linedef.end : linedef.start];
    const uint32_t sector_index = best_seg->sector_index;
    const bool along_linedef = best_seg->front;
    const std::size_t node_index = tree_.nodes_.size();
    SectorTree::Node node;
    node.x = start.x, node.y = start.y;
    node.dx = int64_t{end.x} - start.x, node.dy = int64_t{end.y} - start.y;
    tree_.nodes_.push_back(node);

    std::vector<Seg> front, back;
    for (const Seg& seg : segs) {
      const Place place = classify(best, seg);
      if (place == Place::kFront) front.push_back(seg);
      if (place == Place::kBack) back.push_back(seg);
      if (place != Place::kSplit) continue;
      const double first = best.distance(seg.x1, seg.y1), second = best.distance(seg.x2, seg.y2);
      const double fraction = first / (first - second);
      Seg head = seg, tail = seg;
      head.x2 = tail.x1 = seg.x1 + fraction * (seg.x2 - seg.x1);
      head.y2 = tail.y1 = seg.y1 + fraction * (seg.y2 - seg.y1);
      for (const Seg& piece : {head, tail}) {
        if (std::hypot(piece.x2 - piece.x1, piece.y2 - piece.y1) <= kSliver) continue;
        const bool is_front = best.distance((piece.x1 + piece.x2) / 2, (piece.y1 + piece.y2) / 2) > 0;
        (is_front ? front : back).push_back(piece);
      }
    }
    segs.clear();
    segs.shrink_to_fit();
    const int32_t front_child = grow(std::move(front), sector_index, depth + 1);
    const int32_t back_child = grow(std::move(back), sector_index, depth + 1);
    SectorTree::Node& made = tree_.nodes_[node_index];
    made.front = front_child, made.back = back_child;
    // A point on a line lies west or south of it where it runs along an axis, else behind it, as in ViZDoom: that side
    // becomes the front.
    const bool front_is_east = made.dx == 0 && made.dy > 0, front_is_north = made.dy == 0 && made.dx < 0;
    const bool is_sloped = made.dx != 0 && made.dy != 0;
    if (front_is_east || front_is_north || (is_sloped && along_linedef)) {
      made.dx = -made.dx, made.dy = -made.dy;
      std::swap(made.front, made.back);
    }
    return static_cast<int32_t>(node_index);
  }

  const Level& level_;
  SectorTree tree_;
  std::size_t node_limit_ = 0;
};

SectorTree SectorTree::build(const Level& level) { return SectorTreeBuilder(level).build(); }

}  // namespace comrad::doom
