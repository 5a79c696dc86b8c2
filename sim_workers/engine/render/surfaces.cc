#include "sim_workers/engine/render/surfaces.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace comrad::doom {
namespace {

constexpr int kCrossingsMax = 32;  // floor or ceiling changes seen in one column; farther ones are left out
// Coordinates that are whole texels in exact arithmetic (walls and eyes on round numbers are common) must not fall to either side
// by rounding: as in ViZDoom a wall's belong to the texel that begins there, a plane's to the one that ends.
constexpr float kWallTexelHair = 1.0f / 512.0f;
constexpr double kPlaneTexelHair = 1.0 / 1024.0;
// As much is taken from the distance of a wall's edge to the horizon, so that one that lies on a border of two pixels belongs
// to the pixel towards the horizon.
constexpr float kEdgeShare = 1.0f - 1.0f / 32768.0f;
constexpr std::size_t kPiecesLookedAt = 8;
constexpr uint32_t kGoesOn = UINT32_MAX;  // in the place of a piece that is not over

}  // namespace

Surfaces::Surfaces(ViewFrame* frame, const Visibility* visibility)
    : frame_(*frame), visibility_(*visibility) {
  const auto columns = static_cast<std::size_t>(frame->projection.width);
  crossings_.resize(columns * kCrossingsMax);
  crossing_counts_.resize(columns);
}

void Surfaces::emit() {
  sky_bottom_ = 0;
  plane_owners_.clear();
  borders_.clear();
  for (const WallSpan& span : visibility_.spans()) borders_.push_back(measure_border(span));
  collect_crossings();
  collect_pieces();
  if (sky_bottom_ > 0) emit_sky();
  for (const Piece& piece : pieces_) emit_piece(piece);
}

Surfaces::Border Surfaces::measure_border(const WallSpan& span) {
  Border border;
  const SceneSide& side = *(border.side = &visibility_.near_side(span));
  const SectorNow& now = *(border.now = &frame_.sector(span.near_sector));
  const SectorNow& beyond = frame_.sector(span.far_sector);
  border.lines = {line_at(span, now.floor), line_at(span, now.ceiling),
                  line_at(span, std::min(beyond.floor, now.ceiling)),
                  line_at(span, std::max(beyond.ceiling, now.floor))};
  border.draws_floor = now.floor < frame_.eye_z && !now.floor_plane->sky;
  border.draws_ceiling = now.ceiling > frame_.eye_z && !now.ceiling_plane->sky;
  if (border.draws_floor) border.floor_plane = plane(span.near_sector, /*floor=*/true);
  if (border.draws_ceiling) border.ceiling_plane = plane(span.near_sector, /*floor=*/false);
  // From below a floor hides nothing (an eye may be there while a lift rises past it).
  border.floor_ends = now.floor < frame_.eye_z;
  border.ceiling_ends = now.ceiling > frame_.eye_z;
  if (!frame_.scene->shapes[span.line].two_sided) {
    border.middle = side.middle.present;
    return border;
  }
  const bool both_sky = now.ceiling_plane->sky && beyond.ceiling_plane->sky;
  const bool ceiling_drops = beyond.ceiling < now.ceiling, floor_rises = now.floor < beyond.floor;
  border.upper = ceiling_drops && !both_sky && side.top.present;
  border.lower = floor_rises && side.bottom.present;
  if (span.solid) return border;
  border.floor_ends &= !frame_.same_plane_look(span.near_sector, span.far_sector, /*floor=*/true);
  border.ceiling_ends &= !frame_.same_plane_look(span.near_sector, span.far_sector, /*floor=*/false);
  border.sky_goes_on = both_sky && !ceiling_drops;
  // Where a texture is missing the floor or ceiling behind it runs on in its place, as in Doom.
  border.closes_top = border.upper || (both_sky && ceiling_drops);
  border.closes_bottom = border.lower;
  if (border.closes_top)
    border.sprite_top = Edge::kFarCeiling;
  else if (!ceiling_drops && !border.sky_goes_on && (beyond.ceiling > now.ceiling || now.ceiling_plane->sky))
    border.sprite_top = Edge::kNearCeiling;
  if (border.closes_bottom)
    border.sprite_bottom = Edge::kFarFloor;
  else if (beyond.floor < now.floor)
    border.sprite_bottom = Edge::kNearFloor;
  return border;
}

ColumnLine Surfaces::line_at(const WallSpan& span, float height) const {
  const float factor = frame_.row_factor(height) * kEdgeShare;
  return {.at_zero = frame_.center_y + factor * span.edge.at_zero, .slope = factor * span.edge.slope};
}

ColumnLine Surfaces::line_of(Edge edge) const {
  if (edge.kind == Edge::kPictureTop) return {};
  if (edge.kind == Edge::kPictureBottom) return {.at_zero = frame_.rows()};
  return borders_[edge.span].line(edge.kind);
}

/// The partial spans of every column, near to far.
void Surfaces::collect_crossings() {
  std::fill(crossing_counts_.begin(), crossing_counts_.end(), 0);
  for (const uint32_t index : visibility_.partial_spans()) {
    const WallSpan& span = visibility_.spans()[index];
    if (span.near_sector == span.far_sector) continue;
    for (int column = span.column_begin; column < span.column_end; ++column) {
      const float inverse = span.inverse.at(visibility_.ray(column));
      if (inverse <= visibility_.column(column).inverse) continue;
      const auto at = static_cast<std::size_t>(column);
      Crossing* list = &crossings_[at * kCrossingsMax];
      int& count = crossing_counts_[at];
      if (count == kCrossingsMax && list[count - 1].inverse >= inverse) continue;
      int place = std::min(count, kCrossingsMax - 1);
      while (place > 0 && list[place - 1].inverse < inverse) list[place] = list[place - 1], --place;
      list[place] = {.inverse = inverse, .span = index};
      count = std::min(count + 1, kCrossingsMax);
    }
  }
}

// ---------------------------------------------------------------- what each column shows

/// Whether two columns meet the same borders in the same order.
bool Surfaces::same_run(int column, int other) const {
  const auto a = static_cast<std::size_t>(column), b = static_cast<std::size_t>(other);
  if (crossing_counts_[a] != crossing_counts_[b]) return false;
  if (visibility_.column(column).span != visibility_.column(other).span) return false;
  const Crossing *const of_a = &crossings_[a * kCrossingsMax], *const of_b = &crossings_[b * kCrossingsMax];
  return std::equal(of_a, of_a + crossing_counts_[a], of_b,
                    [](const Crossing& one, const Crossing& two) { return one.span == two.span; });
}

void Surfaces::collect_pieces() {
  pieces_.clear(), run_pieces_.clear();
  const int width = frame_.projection.width;
  for (int begin = 0; begin < width;) {
    int end = begin + 1;
    while (end < width && same_run(begin, end)) ++end;
    collect_run(begin, end);
    begin = end;
  }
}

/// Columns with the same borders. Which edge bounds a piece is decided by comparing straight lines, so columns that agree
/// about it lie side by side: their end is searched by halving.
void Surfaces::collect_run(int begin, int end) {
  const auto agree = [](const Look& a, const Look& b) {
    return a.meets_sky == b.meets_sky &&
           std::ranges::equal(a.pieces, b.pieces,
                              [](const Piece& one, const Piece& two) { return one.same_surface(two); });
  };
  while (begin < end) {
    look_through(begin, &first_);
    int next = begin + 1;
    if (next < end) {
      look_through(end - 1, &last_);
      if (agree(first_, last_)) {
        next = end;
      } else {
        int other = end - 1;
        while (other - next > 0) {
          const int middle = next + (other - next) / 2;
          look_through(middle, &between_);
          if (agree(first_, between_))
            next = middle + 1;
          else
            other = middle;
        }
      }
    }
    if (first_.meets_sky) {
      look_through(next - 1, &between_);
      sky_bottom_ = std::max({sky_bottom_, first_.sky_bottom, between_.sky_bottom});
    }
    add_pieces(first_, begin, next);
    begin = next;
  }
}

/// A column from near to far: what lies between the lowest upper and the highest lower edge so far still shows.
void Surfaces::look_through(int column, Look* look) const {
  look->pieces.clear(), look->meets_sky = false, look->sky_bottom = 0;
  const auto at = static_cast<std::size_t>(column);
  const auto x = static_cast<float>(column);
  const Crossing* crossings = &crossings_[at * kCrossingsMax];
  const ViewColumn& wall = visibility_.column(column);
  End top{{Edge::kPictureTop}, 0}, bottom{{Edge::kPictureBottom}, frame_.rows()};
  const auto add = [&](Piece::Kind kind, uint32_t span, const End& from, const End& to) {
    look->pieces.push_back({.kind = kind, .span = span, .top = from.edge, .bottom = to.edge});
  };
  const auto show_sky = [&](float below) {
    look->meets_sky = true;
    look->sky_bottom = std::max(look->sky_bottom, below);
  };
  for (int i = 0; i <= crossing_counts_[at]; ++i) {
    const bool last = i == crossing_counts_[at];
    if (last && !wall.span) {  // the map is open here: nothing ends this floor
      if (frame_.scene->has_sky) show_sky(bottom.row);
      break;
    }
    const uint32_t index = last ? *wall.span : crossings[i].span;
    const Border& border = borders_[index];
    const auto end_at = [&](Edge::Kind kind) { return End{{kind, index}, border.line(kind).at(x)}; };
    if (const End floor = end_at(Edge::kNearFloor); border.floor_ends && floor.row < bottom.row) {
      if (border.draws_floor) add(Piece::Kind::kFloor, index, floor.row >= top.row ? floor : top, bottom);
      if (border.now->floor_plane->sky) show_sky(bottom.row);
      bottom = floor;
      if (bottom.row <= top.row) break;
    }
    if (border.now->ceiling_plane->sky) show_sky(bottom.row);
    if (const End ceiling = end_at(Edge::kNearCeiling);
        border.ceiling_ends && !border.sky_goes_on && ceiling.row > top.row) {
      if (border.draws_ceiling)
        add(Piece::Kind::kCeiling, index, top, ceiling.row <= bottom.row ? ceiling : bottom);
      top = ceiling;
      if (bottom.row <= top.row) break;
    }
    if (border.middle) add(Piece::Kind::kMiddle, index, top, bottom);
    const End opening_top = end_at(Edge::kFarCeiling), opening_bottom = end_at(Edge::kFarFloor);
    if (border.upper && opening_top.row > top.row)
      add(Piece::Kind::kUpper, index, top, opening_top.row <= bottom.row ? opening_top : bottom);
    if (border.lower && opening_bottom.row < bottom.row)
      add(Piece::Kind::kLower, index, opening_bottom.row >= top.row ? opening_bottom : top, bottom);
    if (border.closes_top && opening_top.row > top.row) top = opening_top;
    if (border.closes_bottom && opening_bottom.row < bottom.row) bottom = opening_bottom;
    if (bottom.row <= top.row) break;
  }
}

/// The same surface between the same edges, in the next columns.
bool Surfaces::goes_on(const Piece& before, const Piece& now) const {
  if (before.kind != now.kind || before.top != now.top || before.bottom != now.bottom) return false;
  return before.span == now.span || (now.is_plane() && plane_of(before) == plane_of(now));
}

/// Adds the pieces of a run, as continuations of those of the run before where they are that. Both are in the same order: the
/// search continues behind the last that was found, and not far; a piece that is missed is drawn in two.
void Surfaces::add_pieces(const Look& look, int begin, int end) {
  next_run_pieces_.clear();
  std::size_t older = 0;
  for (const Piece& shown : look.pieces) {
    const std::size_t looked_at = std::min(run_pieces_.size(), older + kPiecesLookedAt);
    std::size_t found = older;
    while (found < looked_at &&
           (run_pieces_[found] == kGoesOn || !goes_on(pieces_[run_pieces_[found]], shown)))
      ++found;
    if (found < looked_at) {
      pieces_[run_pieces_[found]].column_end = end;
      next_run_pieces_.push_back(std::exchange(run_pieces_[found], kGoesOn));
      older = found + 1;
      continue;
    }
    next_run_pieces_.push_back(static_cast<uint32_t>(pieces_.size()));
    pieces_.push_back(shown);
    pieces_.back().column_begin = begin, pieces_.back().column_end = end;
  }
  std::swap(run_pieces_, next_run_pieces_);
}

Surfaces::Clip Surfaces::clip_at(int column, float inverse, std::optional<uint32_t> own_span) const {
  Clip clip;
  const auto at = static_cast<std::size_t>(column);
  const auto x = static_cast<float>(column);
  float top_row = 0, bottom_row = frame_.rows();
  for (int i = 0; i < crossing_counts_[at]; ++i) {
    const Crossing& crossing = crossings_[at * kCrossingsMax + static_cast<std::size_t>(i)];
    if (crossing.inverse <= inverse || crossing.span == own_span) break;
    const Border& border = borders_[crossing.span];
    const auto row = [&](Edge::Kind kind) { return border.line(kind).at(x); };
    if (border.sprite_top && row(*border.sprite_top) > top_row)
      top_row = row(*border.sprite_top), clip.top = {*border.sprite_top, crossing.span};
    if (border.sprite_bottom && row(*border.sprite_bottom) < bottom_row)
      bottom_row = row(*border.sprite_bottom), clip.bottom = {*border.sprite_bottom, crossing.span};
  }
  return clip;
}

// ---------------------------------------------------------------- strips

void Surfaces::emit_sky() {
  Strip strip;
  strip.kind = Strip::Kind::kSky;
  strip.column_end = frame_.projection.width;
  strip.bottom.at_zero = sky_bottom_ + 1;
  strip.region = frame_.scene->sky;
  strip.subject = kWallSubject;  // as ViZDoom labels it
  frame_.list->strips.push_back(strip);
}

void Surfaces::emit_piece(const Piece& piece) {
  if (!piece.is_plane()) return emit_wall_part(piece);
  Strip strip;
  strip.kind = Strip::Kind::kPlane;
  strip.column_begin = piece.column_begin, strip.column_end = piece.column_end;
  strip.top = line_of(piece.top), strip.bottom = line_of(piece.bottom);
  strip.subject = kPlaneSubject;
  strip.plane = plane_of(piece);
  frame_.list->strips.push_back(strip);
}

void Surfaces::emit_wall_part(const Piece& piece) {
  const WallSpan& span = visibility_.spans()[piece.span];
  const SceneLine& line = frame_.scene->lines[span.line];
  const SceneSide& near = *borders_[piece.span].side;
  const ScenePart& part = piece.kind == Piece::Kind::kMiddle  ? near.middle
                          : piece.kind == Piece::Kind::kUpper ? near.top
                                                              : near.bottom;
  const SectorNow& now = frame_.sector(span.near_sector);
  const SectorNow& beyond = frame_.sector(span.far_sector);
  const float part_height = static_cast<float>(part.region.height) / part.scale_y;
  float texture_top = now.ceiling;
  if (piece.kind == Piece::Kind::kMiddle) {
    if (line.lower_unpegged) texture_top = now.floor + part_height;
  } else if (piece.kind == Piece::Kind::kUpper) {
    if (!line.upper_unpegged) texture_top = beyond.ceiling + part_height;
  } else {
    // Unpegged, the texture lines up with the ceiling, or with the upper edge of the opening under open sky.
    const bool both_sky = now.ceiling_plane->sky && beyond.ceiling_plane->sky;
    texture_top = !line.lower_unpegged ? beyond.floor
                  : both_sky           ? std::min(now.ceiling, beyond.ceiling)
                                       : now.ceiling;
  }
  Strip strip = textured(span, texture_top, part, near);
  strip.column_begin = piece.column_begin, strip.column_end = piece.column_end;
  strip.top = line_of(piece.top), strip.bottom = line_of(piece.bottom);
  strip.paint.tint = now.tint;
  frame_.list->strips.push_back(strip);
}

Strip Surfaces::textured(const WallSpan& span, float texture_top, const ScenePart& part,
                         const SceneSide& side) const {
  Strip strip;
  strip.kind = Strip::Kind::kWall;
  strip.region = part.region;
  strip.shade = frame_.wall_shade(frame_.sector(span.near_sector), side);
  strip.subject = kWallSubject;
  float offset_x = part.offset_x, offset_y = part.offset_y;
  if (side.sidedef < frame_.view->sides.size()) {
    offset_x += to_float(frame_.view->sides[side.sidedef].scroll_x);
    offset_y += to_float(frame_.view->sides[side.sidedef].scroll_y);
  }
  strip.x_left = span.x_left;
  strip.inverse = span.inverse, strip.light = span.edge;
  strip.u_offset = offset_x + kWallTexelHair;
  strip.u_over_depth = {.at_zero = span.u.at_zero * part.scale_x, .slope = span.u.slope * part.scale_x};
  strip.v_horizon = (texture_top - frame_.eye_z) * part.scale_y + offset_y;
  strip.v_step = part.scale_y / frame_.projection.focal_y;
  return strip;
}

/// The plane of a sector's floor or ceiling; sectors whose planes look alike share one.
uint32_t Surfaces::plane(uint32_t sector_index, bool floor) {
  planes_of_sectors_.resize(std::max(planes_of_sectors_.size(), frame_.view->sectors.size()));
  auto& [stamp, known] = planes_of_sectors_[sector_index][floor ? 1 : 0];
  if (stamp == frame_.stamp) return known;
  stamp = frame_.stamp;
  const auto same = std::ranges::find_if(plane_owners_, [&](const PlaneOwner& owner) {
    return owner.floor == floor && frame_.same_plane_look(owner.sector, sector_index, floor);
  });
  known = static_cast<uint32_t>(same - plane_owners_.begin());
  if (same != plane_owners_.end()) return known;
  plane_owners_.push_back({sector_index, floor});

  const SectorNow& now = frame_.sector(sector_index);
  const Sector& sector = frame_.view->sectors[sector_index];
  const FlatPlacement& placement = floor ? sector.floor_placement : sector.ceiling_placement;
  // Texels per unit of the map along both axes, and where they begin.
  double along_x = 1, across = 0, scale_x = 1, scale_y = 1, offset_x = 0, offset_y = 0;
  static const FlatPlacement plain;
  if (!same_placement(placement, plain)) {
    const double radians = placement.rotation_degrees * (6.283185307179586 / 360.0);
    // Rounded from double, so that every C library gives the same.
    along_x = static_cast<float>(std::cos(radians)), across = static_cast<float>(std::sin(radians));
    const auto usable = [](float scale) { return scale > 1e-3f && scale < 1e3f ? scale : 1.0f; };
    scale_x = usable(placement.scale_x), scale_y = usable(placement.scale_y);
    offset_x = to_double(placement.offset_x), offset_y = to_double(placement.offset_y);
  }
  const auto u_of = [&](double x, double y) { return (x * along_x - y * across) * scale_x; };
  const auto v_of = [&](double x, double y) { return -(x * across + y * along_x) * scale_y; };
  const double cosine = frame_.cosine, sine = frame_.sine, focal = frame_.projection.focal_x;
  frame_.list->planes.push_back({.region = (floor ? now.floor_plane : now.ceiling_plane)->region,
                                 .row_factor = frame_.row_factor(floor ? now.floor : now.ceiling),
                                 .shade = floor ? now.floor_shade : now.ceiling_shade,
                                 .tint = now.tint,
                                 .u_eye = u_of(frame_.eye_x, frame_.eye_y) + offset_x - kPlaneTexelHair,
                                 .v_eye = v_of(frame_.eye_x, frame_.eye_y) + offset_y - kPlaneTexelHair,
                                 .u_ahead = u_of(cosine, sine),
                                 .v_ahead = v_of(cosine, sine),
                                 .u_right = u_of(sine, -cosine) / focal,
                                 .v_right = v_of(sine, -cosine) / focal});
  return known;
}

}  // namespace comrad::doom
