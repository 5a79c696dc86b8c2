#include "sim_workers/engine/render/view_builder.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "rollout_buffer/core/rng.h"
#include "tests/support/level_builder.h"
#include "tests/unit/sim_workers/render/open_level.h"
#include "tests/unit/sim_workers/render/tiny_iwad.h"

namespace comrad::doom {
namespace view_builder_test {

using test::LevelBuilder;

/// Builds draw lists of a level from any eye, without a world.
class Camera {
 public:
  explicit Camera(std::shared_ptr<const Level> level)
      : atlas_(test::tiny_archive()),
        scene_(Scene::create(level, &atlas_).value()),
        catalog_(std::make_shared<const ActorCatalog>()),
        sprites_(catalog_, &atlas_),
        projection_(make_projection({})),
        builder_(projection_, &atlas_),
        sectors(level->sectors),
        wall_address_(atlas_.wall("BRICK6").value().address) {}

  const DrawList& look(double x, double y, double z, double degrees) {
    SceneView view;
    view.scene = scene_.get(), view.sprites = &sprites_;
    view.sectors = sectors, view.actors = &actors;
    view.sides = sides, view.polyobjects = polyobjects, view.hand = hand;
    view.eye_x = x, view.eye_y = y, view.eye_z = z;
    view.angle = static_cast<Angle>(static_cast<int64_t>(std::llround(degrees / 360 * 4294967296.0)));
    builder_.build(view, &list_);
    return list_;
  }
  const Projection& projection() const { return projection_; }
  bool is_wall(const Strip& strip) const {
    return strip.kind == Strip::Kind::kWall && strip.region.address == wall_address_;
  }

 private:
  ArtAtlas atlas_;
  std::unique_ptr<Scene> scene_;
  std::shared_ptr<const ActorCatalog> catalog_;
  SpriteTable sprites_;
  Projection projection_;
  ViewBuilder builder_;
  DrawList list_;

 public:
  std::vector<Sector> sectors;
  StableList<Actor> actors;
  std::vector<SideState> sides;
  std::vector<Polyobject> polyobjects;
  std::vector<HandSprite> hand;

  const ActorCatalog& catalog() const { return *catalog_; }
  ArtAtlas& atlas() { return atlas_; }

 private:
  uint32_t wall_address_;
};

bool holds(const Strip& strip, int column, int row) {
  const auto at = static_cast<float>(column);
  return column >= strip.column_begin && column < strip.column_end && row >= row_below(strip.top.at(at)) &&
         row < row_below(strip.bottom.at(at));
}

std::vector<Strip> opaque_strips(const DrawList& list) {
  return {list.strips.begin(), list.strips.begin() + list.opaque_end};
}

TEST(Projection, PutsTheHorizonAndTheFieldOfViewWhereDoomHasThem) {
  const Projection small = make_projection({});
  EXPECT_EQ(small.rows, 60) << "168/200 of 72 rows, rounded down: the bar takes the rest";
  EXPECT_FLOAT_EQ(small.center_x, 64);
  EXPECT_FLOAT_EQ(small.center_y, 30);
  EXPECT_FLOAT_EQ(small.focal_x, 64) << "90 degrees across";
  EXPECT_FLOAT_EQ(small.focal_y, 57.6f)
      << "0.8 of the screen's height: 4:3 and pixels 1.2 times as tall as wide";
  RenderOptions options;
  options.width = 160, options.height = 120, options.status_bar = false;
  const Projection full = make_projection(options);
  EXPECT_EQ(full.rows, 120);
  EXPECT_FLOAT_EQ(full.focal_x, 80);
  EXPECT_FLOAT_EQ(full.focal_y, 96);
}

TEST(ViewBuilder, PutsACornerAtAKnownAngleIntoAKnownColumn) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128);
  builder.room(room, -300, -300, 200, 100);
  Camera camera(builder.build());
  const DrawList& list = camera.look(0, 0, 41, 0);
  // The corner (200, 100) lies 200 ahead and 100 to the left: column 64 - 64 * 100 / 200 = 32. The wall ahead
  // meets the floor at row 30 + 57.6 * 41 / 200.
  int at_corner = 0;
  for (const Strip& strip : opaque_strips(list)) {
    if (!camera.is_wall(strip)) continue;
    if (strip.column_end == 32) {
      ++at_corner;
      EXPECT_NEAR(1 / strip.inverse.at(32.0f), 200, 0.1);
    }
    if (strip.column_begin == 32) {
      ++at_corner;
      EXPECT_NEAR(strip.bottom.at(32.0f), 30 + 57.6 * 41 / 200, 1e-3);
      EXPECT_NEAR(strip.bottom.at(90.0f), 30 + 57.6 * 41 / 200, 1e-3);
      EXPECT_NEAR(strip.top.at(32.0f), 30 - 57.6 * 87 / 200, 1e-3);
    }
  }
  EXPECT_EQ(at_corner, 2) << "two walls meet in the corner";
}

TEST(Projection, EndsOfWallsAreRoundedAwayFromTheMiddle) {
  const Projection projection = make_projection({});
  EXPECT_EQ(projection.first_column(20.3f), 20);
  EXPECT_EQ(projection.first_column(20.9f), 20);
  EXPECT_EQ(projection.first_column(21.0f), 21);
  EXPECT_EQ(projection.first_column(80.3f), 81);
  EXPECT_EQ(projection.first_column(80.9f), 81);
  EXPECT_EQ(projection.first_column(81.0f), 82) << "on a border: to the right";
  EXPECT_EQ(projection.first_column(64.0f), 65);
  for (int column = 0; column < projection.width; ++column)
    EXPECT_EQ(projection.first_column(projection.ray_of(column)), column == 64 ? 63 : column)
        << "both columns beside the middle look at it";
}

TEST(ViewBuilder, PicksTheSideOfASpriteThatFacesTheEye) {
  const Angle east = 0, north = kAngle90, west = kAngle180, south = kAngle90 + kAngle180;
  EXPECT_EQ(sprite_side(west, east), 0) << "it looks at the eye: front";
  EXPECT_EQ(sprite_side(east, east), 4) << "it looks away: back";
  EXPECT_EQ(sprite_side(east, north), 2) << "seen from its left";
  EXPECT_EQ(sprite_side(east, south), 6) << "seen from its right";
  EXPECT_EQ(sprite_side(west + kAngle45 / 2 - 1, east), 0) << "a side holds for 22.5 degrees both ways";
  EXPECT_EQ(sprite_side(west + kAngle45 / 2, east), 1);
  EXPECT_EQ(sprite_side(west - kAngle45 / 2, east), 0);
  EXPECT_EQ(sprite_side(west - kAngle45 / 2 - 1, east), 7);
}

TEST(ViewBuilder, LightFallsOffWithDepthInRowsOfTheColormap) {
  EXPECT_FLOAT_EQ(light_shade(210), 8.5f);
  EXPECT_FLOAT_EQ(light_shade(244), 0.0f);
  EXPECT_GT(light_shade(96), light_shade(160)) << "less light, a darker row";
}

struct Segment {
  double x0, y0, x1, y1;
};

/// A direction by the table of fine angles, as views have it.
struct Eye {
  double x, y, cosine, sine;
  Eye(double at_x, double at_y, double degrees) : x(at_x), y(at_y) {
    const auto angle = static_cast<Angle>(static_cast<int64_t>(std::llround(degrees / 360 * 4294967296.0)));
    cosine = to_double(fine_cosine(angle)), sine = to_double(fine_sine(angle));
  }
};

/// Where a ray meets the line that a wall lies on: the depth along the view axis, and how far along the wall, 0 to 1 within it.
struct Meeting {
  double depth = 0, along = 0;
};
Meeting meet(const Segment& wall, const Eye& eye, double side_per_depth) {
  const double dx = eye.cosine + side_per_depth * eye.sine, dy = eye.sine - side_per_depth * eye.cosine;
  const double ex = wall.x1 - wall.x0, ey = wall.y1 - wall.y0;
  const double denominator = dx * ey - dy * ex;
  if (denominator == 0) return {};
  return {((wall.x0 - eye.x) * ey - (wall.y0 - eye.y) * ex) / denominator,
          ((wall.x0 - eye.x) * dy - (wall.y0 - eye.y) * dx) / denominator};
}

/// The nearest wall that a ray meets; null where none.
const Segment* nearest_wall(const std::vector<Segment>& walls, const Eye& eye, double side_per_depth) {
  const Segment* best = nullptr;
  double best_depth = 0;
  for (const Segment& wall : walls) {
    const Meeting at = meet(wall, eye, side_per_depth);
    if (at.depth <= 0 || at.along < 0 || at.along > 1 || (best != nullptr && at.depth >= best_depth))
      continue;
    best = &wall, best_depth = at.depth;
  }
  return best;
}

TEST(ViewBuilder, CoversEveryPixelOfRandomHallsOnceWithTheNearestSurface) {
  for (uint64_t seed = 1; seed <= 30; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Rng rng{seed};
    LevelBuilder builder;
    const uint32_t hall = builder.sector(0, 200);
    std::vector<Segment> walls;
    const auto ring = [&](const LevelBuilder::Points& points) {
      for (std::size_t i = 0; i < points.size(); ++i) {
        const auto& [x0, y0] = points[i];
        const auto& [x1, y1] = points[(i + 1) % points.size()];
        walls.push_back({double(x0), double(y0), double(x1), double(y1)});
      }
    };
    LevelBuilder::Points star;
    const int corners = rng.between(12, 24);
    for (int i = 0; i < corners; ++i) {
      const double angle = -6.283185307179586 * i / corners, reach = rng.between(1200, 2000);
      star.emplace_back(std::lround(reach * std::cos(angle)), std::lround(reach * std::sin(angle)));
    }
    builder.room(hall, star);
    ring(star);
    for (int i = 0; i < 100; ++i) {
      const int x = rng.between(-800, 800), y = rng.between(-800, 800);
      const int w = rng.between(24, 64), h = rng.between(24, 64);
      if (std::abs(x) < 160 && std::abs(y) < 160) continue;
      builder.pillar(hall, x - w, y - h, x + w, y + h);
      ring({{x - w, y - h}, {x + w, y - h}, {x + w, y + h}, {x - w, y + h}});
    }
    Camera camera(builder.build());
    const Projection& projection = camera.projection();
    const double eye_x = rng.between(-60, 60), eye_y = rng.between(-60, 60),
                 degrees = rng.between(0, 359) + 0.37;
    const Eye eye(eye_x, eye_y, degrees);
    const std::vector<Strip> strips = opaque_strips(camera.look(eye_x, eye_y, 41, degrees));
    int edge_pixels = 0;
    for (int column = 0; column < projection.width; ++column) {
      const auto side_at = [&](double x) { return (x - projection.center_x) / projection.focal_x; };
      const Segment* const wall = nearest_wall(walls, eye, side_at(projection.ray_of(column)));
      ASSERT_NE(wall, nullptr);
      // A wall's borders run from its first whole column to its last, so they may lie up to a column beside the exact ones.
      double foot_low = 1e9, foot_high = -1e9, head_low = 1e9, head_high = -1e9;
      for (const double x : {column - 1.0, column + 0.0, column + 1.0}) {
        const double depth = meet(*wall, eye, side_at(x)).depth;
        if (depth <= 0) continue;
        const double foot = projection.center_y + projection.focal_y * 41 / depth;
        const double head = projection.center_y - projection.focal_y * (200 - 41) / depth;
        foot_low = std::min(foot_low, foot), foot_high = std::max(foot_high, foot);
        head_low = std::min(head_low, head), head_high = std::max(head_high, head);
      }
      for (int row = 0; row < projection.rows; ++row) {
        const double y = row + 1;
        int layers = 0;
        const Strip* shown = nullptr;
        for (const Strip& strip : strips)
          if (holds(strip, column, row)) ++layers, shown = &strip;
        ASSERT_EQ(layers, 1) << "column " << column << " row " << row
                             << ": each pixel belongs to one surface";
        constexpr double kRounding = 0.05;
        if ((y > foot_low - kRounding && y < foot_high + kRounding) ||
            (y > head_low - kRounding && y < head_high + kRounding)) {
          ++edge_pixels;
          continue;
        }
        const bool wall_expected = y > head_high && y < foot_low;
        ASSERT_EQ(camera.is_wall(*shown), wall_expected) << "column " << column << " row " << row;
        if (!wall_expected) continue;
        const float x = std::max(static_cast<float>(column), shown->x_left);
        const double depth = meet(*wall, eye, side_at(x)).depth;
        EXPECT_NEAR(1 / shown->inverse.at(x), depth, 0.01 * depth) << "the nearest wall";
      }
    }
    EXPECT_LT(edge_pixels, projection.width * projection.rows / 10);
  }
}

TEST(ViewBuilder, AShutDoorHidesWhatAnOpenOneShows) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128), door = builder.sector(0, 128);
  builder.sector_at(door).floor_texture = "FLAT1";
  builder.room(room, -256, -256, 512, 256).island(door, room, 128, -256, 160, 256);
  Camera camera(test::with_open_lines(builder.build()));
  Actor kit;
  kit.id = 5, kit.x = to_fixed(300), kit.sector_index = room;
  const State& shown = camera.catalog().state(
      camera.catalog()[camera.catalog().find("Stimpack").value()].state(StateLabel::kSpawn));
  kit.sprite = shown.sprite, kit.frame = shown.frame;
  camera.actors.push_back(kit);
  const auto masked = [](const DrawList& list) { return list.strip_count() - list.opaque_end; };
  EXPECT_EQ(masked(camera.look(0, 0, 41, 0)), 1u) << "open: the kit behind it is drawn";
  camera.sectors[door].ceiling_height = 0;
  const DrawList& shut = camera.look(0, 0, 41, 0);
  EXPECT_EQ(masked(shut), 0u);
  camera.sectors[door].ceiling_height = to_fixed(64);
  EXPECT_EQ(masked(camera.look(0, 0, 41, 0)), 1u) << "half open";
}

TEST(ViewBuilder, LinesWithNothingToSeeCostNothing) {
  LevelBuilder builder, plain;
  const uint32_t room = builder.sector(0, 128), same = builder.sector(0, 128);
  builder.room(room, -256, -256, 512, 256).island(same, room, 128, -64, 160, 64);
  plain.room(plain.sector(0, 128), -256, -256, 512, 256);
  Camera camera(test::with_open_lines(builder.build())), empty(plain.build());
  const auto strips = [&](double degrees) { return camera.look(0, 0, 41, degrees).opaque_end; };
  const uint32_t alike = strips(0);
  EXPECT_EQ(alike, empty.look(0, 0, 41, 0).opaque_end) << "two sectors that look alike need no border";
  const uint32_t behind = strips(180);
  camera.sectors[same].floor_height = to_fixed(16);
  EXPECT_GT(strips(0), alike);
  EXPECT_EQ(strips(180), behind) << "behind the eye";
}

TEST(ViewBuilder, EveryPixelOfSteppedRoomsIsPaintedOnce) {
  for (uint64_t seed = 1; seed <= 20; ++seed) {
    SCOPED_TRACE("seed " + std::to_string(seed));
    Rng rng{seed};
    LevelBuilder builder;
    const uint32_t hall = builder.sector(0, 200);
    builder.room(hall, -900, -900, 900, 900);
    for (int row = -3; row < 3; ++row)
      for (int column = -3; column < 3; ++column) {
        const uint32_t block = builder.sector(rng.between(-64, 64), rng.between(100, 240));
        const int x = 280 * column + rng.between(20, 80), y = 280 * row + rng.between(20, 80);
        builder.island(block, hall, x, y, x + rng.between(40, 180), y + rng.between(40, 180));
      }
    Camera camera(test::with_open_lines(builder.build()));
    const Projection& projection = camera.projection();
    const std::vector<Strip> strips =
        opaque_strips(camera.look(-880, rng.between(-800, 800), 41, rng.between(-30, 30)));
    int twice = 0;
    for (int column = 0; column < projection.width; ++column)
      for (int row = 0; row < projection.rows; ++row) {
        const auto layers =
            std::ranges::count_if(strips, [&](const Strip& strip) { return holds(strip, column, row); });
        ASSERT_GE(layers, 1) << "column " << column << " row " << row << " is bare";
        twice += layers > 1;
      }
    EXPECT_EQ(twice, 0) << "pixels that belong to two surfaces";
  }
}

TEST(ViewBuilder, AnEyeOutsideTheMapSeesNothingAndSurvives) {
  LevelBuilder builder;
  builder.room(builder.sector(0, 128), -256, -256, 256, 256);
  Camera camera(builder.build());
  for (int degrees = 0; degrees < 360; degrees += 15) {
    const DrawList& list = camera.look(4000, 4000, 41, degrees);
    for (const Strip& strip : list.strips)
      EXPECT_TRUE(std::isfinite(strip.inverse.at_zero) && std::isfinite(strip.top.at_zero) &&
                  std::isfinite(strip.bottom.slope));
  }
}

}  // namespace view_builder_test
}  // namespace comrad::doom
