#include "sim_workers/engine/render/surfaces.h"

#include <algorithm>
#include <cmath>
#include <utility>

namespace comrad::doom {
namespace {

constexpr int kCrossingsMax = 32;  // floor or ceiling changes seen in one column; farther ones are left out
constexpr int kSkyStripColumns = 16;
constexpr float kSkyColumnsPerTurn = 1024.0f;
constexpr int kTallSkyRows = 200;
constexpr float kSkyHorizonRow = 108.5f;
// Coordinates that are whole texels in exact arithmetic (walls and eyes on round numbers are common) must not
// fall to either side by rounding.
constexpr float kTexelEpsilon = 1.0f / 256.0f;
constexpr float kTuck = 1.0f / 16.0f;  // rows that a surface goes on below a nearer one
constexpr std::size_t kPiecesLookedAt = 8;
constexpr uint32_t kGoesOn = UINT32_MAX;  // in the place of a piece that is not over

/// 1/depth of corners, none of them farther than anything is drawn.
FourCorners not_beyond(const FourCorners& inverse) {
  return inverse < kFarInverse ? FourCorners{} + kFarInverse : inverse;
}

}  // namespace

Surfaces::Surfaces(ViewFrame* frame, const Visibility* visibility)
    : frame_(*frame), visibility_(*visibility) {
  const auto columns = static_cast<std::size_t>(frame->projection.width);
  crossings_.resize(columns * kCrossingsMax);
  crossing_counts_.resize(columns);
}

void Surfaces::emit() {
  sky_seen_ = false;
  if (visibility_.partial_spans().empty()) {
    emit_painted_planes();
    emit_all_walls();
    return;
  }
  collect_crossings();
  collect_pieces();
  if (sky_seen_) emit_sky();
  for (const Drawn& drawn : drawn_) emit_piece(pieces_[drawn.piece]);
}

// ---------------------------------------------------------------- the sky

float Surfaces::sky_u(float x) const {
  const Projection& projection = frame_.projection;
  // 1.5 times the walls' shift: the reference engine looks skies up a little more to the left still.
  const float offset = (x + 1.5f * projection.wall_shift_x - projection.center_x) / projection.focal_x;
  return (static_cast<float>(angle_to_radians(frame_.view->angle)) - std::atan(offset)) * kSkyColumnsPerTurn /
         kTwoPi / static_cast<float>(frame_.scene->sky.width);
}

float Surfaces::sky_v(float row) const {
  // Skies of 128 rows are stretched to twice their height and stand on the horizon's row 108.5; taller ones
  // were drawn for a screen of 200 rows.
  const int height = frame_.scene->sky.height;
  const bool stretched = height < kTallSkyRows;
  const float texels_per_row = (stretched ? 100.0f : 200.0f) / (frame_.projection.focal_y / 0.8f);
  return ((stretched ? kSkyHorizonRow : 100.0f) + (row - frame_.center_y) * texels_per_row) /
         static_cast<float>(height);
}

void Surfaces::emit_sky() {
  frame_.list->subject = kWallSubject;  // as ViZDoom labels it
  const auto corner = [&](float x, float row) {
    frame_.push(x, row, 1, sky_u(x), sky_v(row), frame_.scene->sky, 0, 0);
  };
  const int width = frame_.projection.width;
  for (int begin = 0; begin < width; begin += kSkyStripColumns) {
    const auto left = static_cast<float>(begin),
               right = static_cast<float>(std::min(begin + kSkyStripColumns, width));
    corner(left, 0), corner(right, 0), corner(right, frame_.rows()), corner(left, frame_.rows());
  }
}

// ---------------------------------------------------------------- where only solid walls are seen

/// Each stretch of columns that ends at the same kind of floor gets one rectangle down from the farthest wall's
/// foot; nearer walls are painted over it.
void Surfaces::emit_painted_planes() {
  const std::vector<WallSpan>& spans = visibility_.spans();
  const int width = frame_.projection.width;
  std::optional<uint32_t> last;
  for (const ViewColumn& column : visibility_.columns()) {
    if (sky_seen_) break;
    if (column.span && column.span != last) {
      const SectorNow& now = frame_.sector(spans[*column.span].near_sector);
      sky_seen_ = now.ceiling_plane->sky || now.floor_plane->sky;
    }
    last = column.span;
  }
  if (sky_seen_) emit_sky();
  for (int begin = 0; begin < width;) {
    last = visibility_.column(begin).span;
    if (!last) {
      ++begin;
      continue;
    }
    const uint32_t here = spans[*last].near_sector;
    float inverse_min = visibility_.column(begin).inverse;
    int end = begin + 1;
    for (; end < width; ++end) {
      const ViewColumn& column = visibility_.column(end);
      if (!column.span) break;
      if (column.span != last) {
        const uint32_t there = spans[*column.span].near_sector;
        if (there != here && !frame_.same_look(here, there)) break;
        last = column.span;
      }
      inverse_min = std::min(inverse_min, column.inverse);
    }
    emit_painted_run(begin, end, here, inverse_min);
    begin = end;
  }
}

void Surfaces::emit_painted_run(int column_begin, int column_end, uint32_t sector_index, float inverse_min) {
  const SectorNow& now = frame_.sector(sector_index);
  const auto left = static_cast<float>(column_begin), right = static_cast<float>(column_end);
  const float rows = frame_.rows();
  inverse_min = std::max(inverse_min, kFarInverse);
  if (now.floor < frame_.eye_z && !now.floor_plane->sky) {
    const float foot = frame_.center_y + frame_.row_factor(now.floor) * inverse_min;
    if (foot < rows) emit_plane({left, right, foot, foot, rows, rows}, sector_index, /*floor=*/true);
  }
  if (now.ceiling > frame_.eye_z && !now.ceiling_plane->sky) {
    const float head = frame_.center_y + frame_.row_factor(now.ceiling) * inverse_min;
    if (head > 0) emit_plane({left, right, 0, 0, head, head}, sector_index, /*floor=*/false);
  }
}

/// The nearest solid walls of all columns.
void Surfaces::emit_all_walls() {
  const int width = frame_.projection.width;
  for (int begin = 0; begin < width;) {
    const std::optional<uint32_t> span = visibility_.column(begin).span;
    int end = begin + 1;
    while (end < width && visibility_.column(end).span == span) ++end;
    if (span) emit_walls(visibility_.spans()[*span], begin, end);
    begin = end;
  }
}

/// One wall of the nearest, from its ceiling to its floor.
void Surfaces::emit_walls(const WallSpan& span, int column_begin, int column_end) {
  const SectorNow& now = frame_.sector(span.near_sector);
  const SectorNow& beyond = frame_.sector(span.far_sector);
  const float left = std::max(span.x_left, static_cast<float>(column_begin));
  const float right = std::min(span.x_right, static_cast<float>(column_end));
  if (right <= left) return;
  const auto part = [&](Piece::Kind kind, float top, float bottom) {
    emit_wall_part(span, kind,
                   {left, right, row_at(span, left, top), row_at(span, right, top),
                    row_at(span, left, bottom), row_at(span, right, bottom)});
  };
  if (!frame_.scene->lines[span.line].two_sided) {
    part(Piece::Kind::kMiddle, now.ceiling, now.floor);
    return;
  }
  if (beyond.ceiling < now.ceiling)
    part(Piece::Kind::kUpper, now.ceiling, std::max(beyond.ceiling, now.floor));
  if (beyond.floor > now.floor) part(Piece::Kind::kLower, std::min(beyond.floor, now.ceiling), now.floor);
}

// ---------------------------------------------------------------- where the eye sees past walls

Surfaces::Border Surfaces::measure_border(const WallSpan& span) {
  const SceneLine& line = frame_.scene->lines[span.line];
  const SceneSide& side = visibility_.near_side(span);
  Border border;
  const SectorNow& now = *(border.now = &frame_.sector(span.near_sector));
  const SectorNow& beyond = *(border.beyond = &frame_.sector(span.far_sector));
  border.factors = {frame_.row_factor(now.floor), frame_.row_factor(now.ceiling),
                    frame_.row_factor(std::min(beyond.floor, now.ceiling)),
                    frame_.row_factor(std::max(beyond.ceiling, now.floor))};
  border.draws_floor = now.floor < frame_.eye_z && !now.floor_plane->sky;
  border.draws_ceiling = now.ceiling > frame_.eye_z && !now.ceiling_plane->sky;
  // From below a floor hides nothing (an eye may be there while a lift rises past it).
  border.floor_ends = now.floor < frame_.eye_z;
  border.ceiling_ends = now.ceiling > frame_.eye_z;
  if (!line.two_sided) {
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

float Surfaces::row_of(Edge at, float x) const {
  if (at.is_of_picture()) return at.kind == Edge::kPictureTop ? 0.0f : frame_.rows();
  return frame_.center_y + borders_[at.span].factor(at.kind) * visibility_.spans()[at.span].inverse_at(x);
}

/// The partial spans of every column, near to far.
void Surfaces::collect_crossings() {
  std::fill(crossing_counts_.begin(), crossing_counts_.end(), 0);
  for (const uint32_t index : visibility_.partial_spans()) {
    const WallSpan& span = visibility_.spans()[index];
    if (span.near_sector == span.far_sector) continue;
    for (int column = span.column_begin; column < span.column_end; ++column) {
      const float inverse = span.inverse_at(centre_of(column));
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

/// The same surface between the same edges, in the next column.
bool Surfaces::goes_on(const Piece& before, const Piece& now) {
  if (before.kind != now.kind || before.top != now.top || before.bottom != now.bottom) return false;
  if (before.span == now.span) return true;
  if (now.kind != Piece::Kind::kFloor && now.kind != Piece::Kind::kCeiling) return false;
  return frame_.same_plane_look(visibility_.spans()[before.span].near_sector,
                                visibility_.spans()[now.span].near_sector, now.kind == Piece::Kind::kFloor);
}

/// Adds a piece of one column, as the continuation of one of the column before it where it is that, or else
/// if it holds a pixel. Pieces of a column are in the same order as those of the one before; the search goes
/// on behind the last that was found, and not far: a piece that is missed is drawn in two.
void Surfaces::add_piece(Piece::Kind kind, uint32_t span, const End& from, const End& to, int column,
                         std::size_t* older) {
  const Piece piece{.kind = kind,
                    .span = span,
                    .top = from.edge,
                    .bottom = to.edge,
                    .column_begin = column,
                    .column_end = column + 1};
  const std::size_t end = std::min(column_pieces_.size(), *older + kPiecesLookedAt);
  for (std::size_t i = *older; i < end; ++i) {
    Piece& before = pieces_[column_pieces_[i]];
    if (!goes_on(before, piece)) continue;
    before.column_end = piece.column_end;
    next_column_pieces_.push_back(std::exchange(column_pieces_[i], kGoesOn));
    *older = i + 1;
    return;
  }
  const bool holds_pixel = std::ceil(from.row - kTuck - 0.5f) < to.row + kTuck - 0.5f;
  if (!holds_pixel) return;
  next_column_pieces_.push_back(static_cast<uint32_t>(pieces_.size()));
  pieces_.push_back(piece);
}

/// Each pixel belongs to one piece; nothing is painted twice but a sliver below edges.
void Surfaces::collect_pieces() {
  borders_.clear();
  for (const WallSpan& span : visibility_.spans()) borders_.push_back(measure_border(span));
  pieces_.clear(), column_pieces_.clear(), drawn_.clear();
  const auto end_pieces = [&] {
    for (const uint32_t index : column_pieces_) {
      if (index == kGoesOn) continue;
      const WallSpan& of = visibility_.spans()[pieces_[index].span];
      const float inverse = of.inverse_at(0.5f * static_cast<float>(of.column_begin + of.column_end));
      drawn_.push_back({inverse, pieces_[index].kind, index});
    }
  };
  for (int column = 0; column < frame_.projection.width; ++column) {
    next_column_pieces_.clear();
    look_through(column);
    end_pieces();
    std::swap(column_pieces_, next_column_pieces_);
  }
  end_pieces();
  // Far to near, and at the same border its wall before the floor in front of it.
  const auto farther = [](const Drawn& a, const Drawn& b) {
    return a.inverse != b.inverse ? a.inverse < b.inverse : a.kind > b.kind;
  };
  std::stable_sort(drawn_.begin(), drawn_.end(), farther);
}

/// A column from near to far: what lies between the lowest upper and the highest lower edge so far still shows.
void Surfaces::look_through(int column) {
  const auto at = static_cast<std::size_t>(column);
  const Crossing* crossings = &crossings_[at * kCrossingsMax];
  std::size_t older = 0;
  const auto add = [&](Piece::Kind kind, uint32_t span, const End& from, const End& to) {
    add_piece(kind, span, from, to, column, &older);
  };
  End top{{Edge::kPictureTop}, 0}, bottom{{Edge::kPictureBottom}, frame_.rows()};
  const ViewColumn& wall = visibility_.column(column);
  for (int i = 0; i <= crossing_counts_[at]; ++i) {
    const bool last = i == crossing_counts_[at];
    if (last && !wall.span) {  // the map is open here: nothing ends this floor
      sky_seen_ = frame_.scene->has_sky;
      break;
    }
    const uint32_t index = last ? *wall.span : crossings[i].span;
    const float inverse = last ? wall.inverse : crossings[i].inverse;
    const Border& border = borders_[index];
    const auto end_at = [&](Edge::Kind kind) {
      return End{{kind, index}, frame_.center_y + border.factor(kind) * inverse};
    };
    sky_seen_ |= border.now->ceiling_plane->sky || border.now->floor_plane->sky;
    if (const End floor = end_at(Edge::kNearFloor); border.floor_ends && floor.row < bottom.row) {
      if (border.draws_floor) add(Piece::Kind::kFloor, index, floor.row >= top.row ? floor : top, bottom);
      bottom = floor;
      if (bottom.row <= top.row) break;
    }
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

void Surfaces::emit_piece(const Piece& piece) {
  const WallSpan& span = visibility_.spans()[piece.span];
  auto left = static_cast<float>(piece.column_begin), right = static_cast<float>(piece.column_end);
  const bool wall = piece.kind != Piece::Kind::kFloor && piece.kind != Piece::Kind::kCeiling;
  if (wall) left = std::max(left, span.x_left), right = std::min(right, span.x_right);
  if (right <= left) return;
  // Under what is nearer, and so painted later, it goes on a little: edges that are cut in different places
  // are not rounded alike.
  const Edge own_top = piece.kind == Piece::Kind::kFloor   ? Edge{Edge::kNearFloor, piece.span}
                       : piece.kind == Piece::Kind::kLower ? Edge{Edge::kFarFloor, piece.span}
                                                           : Edge{Edge::kPictureTop};
  const Edge own_bottom = piece.kind == Piece::Kind::kCeiling ? Edge{Edge::kNearCeiling, piece.span}
                          : piece.kind == Piece::Kind::kUpper ? Edge{Edge::kFarCeiling, piece.span}
                                                              : Edge{Edge::kPictureBottom};
  const float above = piece.top == own_top ? 0.0f : kTuck, below = piece.bottom == own_bottom ? 0.0f : kTuck;
  PictureArea area{left,
                   right,
                   row_of(piece.top, left) - above,
                   row_of(piece.top, right) - above,
                   row_of(piece.bottom, left) + below,
                   row_of(piece.bottom, right) + below};
  if (wall) return emit_wall_part(span, piece.kind, area);
  const SectorNow& now = *borders_[piece.span].now;
  const bool floor = piece.kind == Piece::Kind::kFloor;
  const float horizon = frame_.center_y + frame_.row_factor(floor ? now.floor : now.ceiling) * kFarInverse;
  if (floor)
    area.top_left = std::max(area.top_left, horizon), area.top_right = std::max(area.top_right, horizon);
  else
    area.bottom_left = std::min(area.bottom_left, horizon),
    area.bottom_right = std::min(area.bottom_right, horizon);
  emit_plane(area, span.near_sector, floor);
}

Surfaces::Clip Surfaces::clip_at(int column, float inverse, std::optional<uint32_t> own_span) const {
  Clip clip;
  if (visibility_.partial_spans().empty()) return clip;
  const auto at = static_cast<std::size_t>(column);
  float top_row = 0, bottom_row = frame_.rows();
  for (int i = 0; i < crossing_counts_[at]; ++i) {
    const Crossing& crossing = crossings_[at * kCrossingsMax + static_cast<std::size_t>(i)];
    if (crossing.inverse <= inverse || crossing.span == own_span) break;
    const Border& border = borders_[crossing.span];
    const auto row = [&](Edge::Kind kind) {
      return frame_.center_y + border.factor(kind) * crossing.inverse;
    };
    if (border.sprite_top && row(*border.sprite_top) > top_row)
      top_row = row(*border.sprite_top), clip.top = {*border.sprite_top, crossing.span};
    if (border.sprite_bottom && row(*border.sprite_bottom) < bottom_row)
      bottom_row = row(*border.sprite_bottom), clip.bottom = {*border.sprite_bottom, crossing.span};
  }
  return clip;
}

// ---------------------------------------------------------------- textures

void Surfaces::emit_wall_part(const WallSpan& span, Piece::Kind kind, const PictureArea& area) {
  const SceneLine& line = frame_.scene->lines[span.line];
  const SceneSide& near = visibility_.near_side(span);
  const ScenePart& part = kind == Piece::Kind::kMiddle  ? near.middle
                          : kind == Piece::Kind::kUpper ? near.top
                                                        : near.bottom;
  if (!part.present) return;
  const SectorNow& now = frame_.sector(span.near_sector);
  const SectorNow& beyond = frame_.sector(span.far_sector);
  const float part_height = static_cast<float>(part.region.height) / part.scale_y;
  float texture_top = now.ceiling;
  if (kind == Piece::Kind::kMiddle) {
    if (line.lower_unpegged) texture_top = now.floor + part_height;
  } else if (kind == Piece::Kind::kUpper) {
    if (!line.upper_unpegged) texture_top = beyond.ceiling + part_height;
  } else {
    // Unpegged, the texture lines up with the ceiling, or with the upper edge of the opening under open sky.
    const bool both_sky = now.ceiling_plane->sky && beyond.ceiling_plane->sky;
    texture_top = !line.lower_unpegged ? beyond.floor
                  : both_sky           ? std::min(now.ceiling, beyond.ceiling)
                                       : now.ceiling;
  }
  emit_textured(span, area, texture_top, part, near, frame_.wall_shade(now, near), now.tint);
}

void Surfaces::emit_textured(const WallSpan& span, const PictureArea& area, float texture_top,
                             const ScenePart& part, const SceneSide& side, float shade, int32_t mark) {
  frame_.list->subject = kWallSubject;
  const Projection& projection = frame_.projection;
  const auto texture_width = static_cast<float>(part.region.width),
             texture_height = static_cast<float>(part.region.height);
  float offset_x = part.offset_x, offset_y = part.offset_y;
  if (side.sidedef < frame_.view->sides.size()) {
    offset_x += to_float(frame_.view->sides[side.sidedef].scroll_x);
    offset_y += to_float(frame_.view->sides[side.sidedef].scroll_y);
  }
  quads_in_picture(area, frame_.rows(), [&](const FourCorners& x, const FourCorners& row) {
    const FourCorners sample_x = x + projection.wall_shift_x, sample_row = row + projection.wall_shift_y;
    const FourCorners inverse = not_beyond(span.inverse_at(sample_x));
    const FourCorners height = frame_.eye_z + (frame_.center_y - sample_row) / (projection.focal_y * inverse);
    frame_.push_quad(
        x, row, inverse,
        (span.u_at(sample_x) / inverse * part.scale_x + offset_x + kTexelEpsilon) / texture_width,
        ((texture_top - height) * part.scale_y + offset_y + kTexelEpsilon) / texture_height, part.region,
        shade, mark);
  });
}

void Surfaces::emit_plane(const PictureArea& area, uint32_t sector_index, bool floor) {
  frame_.list->subject = kPlaneSubject;
  const Projection& projection = frame_.projection;
  const SectorNow& now = frame_.sector(sector_index);
  const Sector& sector = frame_.view->sectors[sector_index];
  const AtlasRegion& region = (floor ? now.floor_plane : now.ceiling_plane)->region;
  const FlatPlacement& placement = floor ? sector.floor_placement : sector.ceiling_placement;
  const float shade = floor ? now.floor_shade : now.ceiling_shade;
  const float inverse_per_row = 1.0f / frame_.row_factor(floor ? now.floor : now.ceiling);
  // Texels per unit of the map along both axes, and where they begin.
  float along_x = 1, across = 0, scale_x = 1, scale_y = 1, offset_x = 0, offset_y = 0;
  static const FlatPlacement plain;
  if (!same_placement(placement, plain)) {
    const float radians = placement.rotation_degrees * (kTwoPi / 360.0f);
    along_x = std::cos(radians), across = std::sin(radians);
    const auto usable = [](float scale) { return scale > 1e-3f && scale < 1e3f ? scale : 1.0f; };
    scale_x = usable(placement.scale_x), scale_y = usable(placement.scale_y);
    offset_x = to_float(placement.offset_x), offset_y = to_float(placement.offset_y);
  }
  quads_in_picture(area, frame_.rows(), [&](const FourCorners& x, const FourCorners& row) {
    const FourCorners inverse = not_beyond((row - frame_.center_y) * inverse_per_row);
    const FourCorners depth = 1.0f / inverse, side = (x + projection.plane_shift_x - projection.center_x) /
                                                     projection.focal_x * depth;
    const FourCorners map_x = frame_.eye_x + frame_.cosine * depth + frame_.sine * side,
                      map_y = frame_.eye_y + frame_.sine * depth - frame_.cosine * side;
    const FourCorners texel_x = (map_x * along_x - map_y * across) * scale_x + offset_x;
    const FourCorners texel_y = -(map_x * across + map_y * along_x) * scale_y + offset_y;
    frame_.push_quad(x, row, inverse, (texel_x - kTexelEpsilon) / static_cast<float>(region.width),
                     (texel_y - kTexelEpsilon) / static_cast<float>(region.height), region, shade, now.tint);
  });
}

}  // namespace comrad::doom
