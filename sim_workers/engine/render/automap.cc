#include "sim_workers/engine/render/automap.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "rollout_buffer/core/text.h"

namespace comrad::doom {
namespace {

using Color = std::array<uint8_t, 3>;
using Point = std::array<double, 2>;

// As ViZDoom draws them with Freedoom's palette.
constexpr Color kBackground{111, 87, 67}, kWall{47, 27, 11}, kFloorStep{139, 115, 91},
    kCeilingStep{75, 55, 27}, kSameHeights{139, 139, 139}, kOwnArrow{255, 235, 223},
    kOtherArrow{119, 255, 111}, kThing{255, 255, 255};

constexpr double kFillsPicture = 0.7;  // of the whole map this part is on the picture, along its longer way
constexpr double kRowsAboveBar = 13.0 / 15.0;  // that the map is fitted to, with or without a status bar
constexpr double kArrowLength = 8.0 * 16.0 / 7.0, kTriangleLength = 16.0;

constexpr std::array<std::array<Point, 2>, 7> kArrow{{
    {{{-0.875, 0}, {1, 0}}},
    {{{1, 0}, {0.5, 0.25}}},
    {{{1, 0}, {0.5, -0.25}}},
    {{{-0.875, 0}, {-1.125, 0.25}}},
    {{{-0.875, 0}, {-1.125, -0.25}}},
    {{{-0.625, 0}, {-0.875, 0.25}}},
    {{{-0.625, 0}, {-0.875, -0.25}}},
}};
constexpr std::array<std::array<Point, 2>, 3> kTriangle{{
    {{{-0.5, -0.7}, {1, 0}}},
    {{{1, 0}, {-0.5, 0.7}}},
    {{{-0.5, 0.7}, {-0.5, -0.7}}},
}};

class Sheet {
 public:
  Sheet(const AutomapOptions& options, uint8_t* picture) : options_(options), picture_(picture) {
    for (int pixel = 0; pixel < options.width * options.height; ++pixel)
      std::ranges::copy(kBackground, picture + 3 * pixel);
  }

  /// `center` comes to lie in the middle; a map unit is `scale` pixels; `turn` radians left of north is up.
  void place(Point center, double scale, double turn) {
    center_ = center, scale_ = scale, cosine_ = std::cos(turn), sine_ = std::sin(turn);
  }

  void line(Point from, Point to, const Color& color) {
    Point a = pixel_of(from), b = pixel_of(to);
    if (!cut(&a, &b)) return;
    const int steps = std::max({1, static_cast<int>(std::ceil(std::abs(b[0] - a[0]))),
                                static_cast<int>(std::ceil(std::abs(b[1] - a[1])))});
    for (int step = 0; step <= steps; ++step) {
      const double share = static_cast<double>(step) / steps;
      const int x = static_cast<int>(std::floor(a[0] + (b[0] - a[0]) * share)),
                y = static_cast<int>(std::floor(a[1] + (b[1] - a[1]) * share));
      if (x < 0 || y < 0 || x >= options_.width || y >= options_.height) continue;
      std::ranges::copy(color, picture_ + 3 * (y * options_.width + x));
    }
  }

  /// A figure `length` map units long, at a place and turned to `angle`.
  template <typename Figure>
  void figure(const Figure& lines, Point at, double angle, double length, const Color& color) {
    const double cosine = std::cos(angle) * length, sine = std::sin(angle) * length;
    const auto corner = [&](const Point& point) -> Point {
      return {at[0] + point[0] * cosine - point[1] * sine, at[1] + point[0] * sine + point[1] * cosine};
    };
    for (const auto& [from, to] : lines) line(corner(from), corner(to), color);
  }

 private:
  Point pixel_of(Point at) const {
    const double x = (at[0] - center_[0]) * scale_, y = (at[1] - center_[1]) * scale_;
    // The row below the middle, as ViZDoom's lines lie.
    return {options_.width / 2.0 + x * cosine_ + y * sine_,
            options_.height / 2.0 + 1 + x * sine_ - y * cosine_};
  }
  /// What of a line lies on the picture (Liang and Barsky 1984); false where nothing does.
  bool cut(Point* a, Point* b) const {
    double begin = 0, end = 1;
    const std::array<double, 2> size{static_cast<double>(options_.width),
                                     static_cast<double>(options_.height)};
    const Point start = *a, way{(*b)[0] - (*a)[0], (*b)[1] - (*a)[1]};
    for (std::size_t axis = 0; axis < 2; ++axis) {
      if (way[axis] == 0) {
        if (start[axis] < 0 || start[axis] >= size[axis]) return false;
        continue;
      }
      double enters = -start[axis] / way[axis], leaves = (size[axis] - start[axis]) / way[axis];
      if (enters > leaves) std::swap(enters, leaves);
      begin = std::max(begin, enters), end = std::min(end, leaves);
    }
    if (begin > end) return false;
    for (std::size_t axis = 0; axis < 2; ++axis) {
      (*a)[axis] = start[axis] + way[axis] * begin;
      (*b)[axis] = start[axis] + way[axis] * end;
    }
    return true;
  }

  const AutomapOptions& options_;
  uint8_t* picture_;
  Point center_{};
  double scale_ = 1, cosine_ = 1, sine_ = 0;
};

/// Where vertices are now: those of polyobjects move.
std::vector<Point> places_of(const World& world) {
  std::vector<Point> places;
  for (const Vertex& vertex : world.level().vertices)
    places.push_back({to_double(vertex.x), to_double(vertex.y)});
  for (const Polyobject& polyobject : world.state().movers.polyobjects)
    for (std::size_t i = 0; i < polyobject.vertices.size() && i < polyobject.position.size(); ++i)
      if (polyobject.vertices[i] < places.size())
        places[polyobject.vertices[i]] = {to_double(polyobject.position[i][0]),
                                          to_double(polyobject.position[i][1])};
  return places;
}

double scale_of(const std::vector<Point>& places, const AutomapOptions& options) {
  double scale = std::numeric_limits<double>::infinity();
  const Point room{static_cast<double>(options.width), options.height * kRowsAboveBar};
  for (std::size_t axis = 0; axis < 2; ++axis) {
    const auto [least, most] =
        std::ranges::minmax(places, {}, [axis](const Point& place) { return place[axis]; });
    if (most[axis] > least[axis]) scale = std::min(scale, room[axis] / (most[axis] - least[axis]));
  }
  return std::isfinite(scale) ? scale / kFillsPicture : 1.0;
}

/// Nothing where the line is not drawn.
std::optional<Color> color_of(const World& world, const Linedef& line, bool whole) {
  if (!line.back || (line.flags & kLineSecret) != 0) return kWall;
  const Level& level = world.level();
  const Sector& front = world.sectors()[level.sidedefs[line.front].sector_index];
  const Sector& back = world.sectors()[level.sidedefs[*line.back].sector_index];
  if (front.floor_height != back.floor_height) return kFloorStep;
  if (front.ceiling_height != back.ceiling_height) return kCeilingStep;
  return whole ? std::optional(kSameHeights) : std::nullopt;
}

}  // namespace

std::optional<AutomapMode> find_automap_mode(std::string_view name) {
  const std::string wanted = upper_case(name);
  if (wanted == "NORMAL") return AutomapMode::kNormal;
  if (wanted == "WHOLE") return AutomapMode::kWhole;
  if (wanted == "OBJECTS") return AutomapMode::kObjects;
  if (wanted == "OBJECTS_WITH_SIZE") return AutomapMode::kObjectsWithSize;
  return std::nullopt;
}

void draw_automap(const World& world, int player, const AutomapOptions& options,
                  std::span<const uint8_t> seen, uint8_t* picture) {
  Sheet sheet(options, picture);
  const std::vector<Point> places = places_of(world);
  if (places.empty()) return;
  const auto place_of = [](const Actor& actor) -> Point { return {to_double(actor.x), to_double(actor.y)}; };
  const Actor& own = world.body(player);
  const double own_angle = angle_to_radians(own.angle);
  sheet.place(place_of(own), scale_of(places, options),
              options.rotates ? own_angle - angle_to_radians(kAngle90) : 0.0);
  const bool whole = options.mode != AutomapMode::kNormal;
  const std::vector<Linedef>& lines = world.level().linedefs;
  for (std::size_t index = 0; index < lines.size(); ++index) {
    if (!whole && (index >= seen.size() || seen[index] == 0)) continue;
    if (const std::optional<Color> color = color_of(world, lines[index], whole))
      sheet.line(places[lines[index].start], places[lines[index].end], *color);
  }
  if (options.mode == AutomapMode::kObjects || options.mode == AutomapMode::kObjectsWithSize)
    for (const Actor& actor : world.actors()) {
      if (actor.removed || actor.sprite == 0 || actor.has(ActorFlag::kInvisible)) continue;
      const Point at = place_of(actor);
      sheet.figure(kTriangle, at, angle_to_radians(actor.angle), kTriangleLength, kThing);
      if (options.mode != AutomapMode::kObjectsWithSize) continue;
      const double radius = to_double(actor.radius);
      const std::array<Point, 4> corners{{{at[0] - radius, at[1] - radius},
                                          {at[0] - radius, at[1] + radius},
                                          {at[0] + radius, at[1] + radius},
                                          {at[0] + radius, at[1] - radius}}};
      for (std::size_t i = 0; i < 4; ++i) sheet.line(corners[i], corners[(i + 1) % 4], kThing);
    }
  for (int other = 0; other < world.player_count(); ++other)
    if (other != player)
      sheet.figure(kArrow, place_of(world.body(other)), angle_to_radians(world.body(other).angle),
                   kArrowLength, kOtherArrow);
  sheet.figure(kArrow, place_of(own), own_angle, kArrowLength, kOwnArrow);
}

}  // namespace comrad::doom
