#include "sim_workers/engine/render/view_builder.h"

#include <gtest/gtest.h>

#include <cmath>

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
        wall_address_(static_cast<int32_t>(atlas_.wall("BRICK6").value().address)) {}

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
  bool is_wall(const QuadVertex& vertex) const { return vertex.address == wall_address_; }

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
  int32_t wall_address_;
};

/// A quad in pixels: all quads have upright left and right sides.
struct PixelQuad {
  double left, right, top_left, top_right, bottom_left, bottom_right, inverse_left, inverse_right;
  const QuadVertex* corner;

  bool holds(double x, double y) const {
    if (x < left || x >= right) return false;
    const double t = (x - left) / (right - left);
    return y >= top_left + t * (top_right - top_left) && y < bottom_left + t * (bottom_right - bottom_left);
  }
  double depth_at(double x) const {
    return 1 / (inverse_left + (x - left) / (right - left) * (inverse_right - inverse_left));
  }
};

PixelQuad quad_at(const DrawList& list, const Projection& projection, uint32_t index) {
  const QuadVertex* corner = &list.vertices[std::size_t{4} * index];
  const auto x = [&](int i) { return (corner[i].x / corner[i].w + 1.0) * projection.width / 2; };
  const auto y = [&](int i) { return (corner[i].y / corner[i].w + 1.0) * projection.rows / 2; };
  return {x(0), x(1), y(0), y(1), y(3), y(2), 1.0 / corner[0].w, 1.0 / corner[1].w, corner};
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
  for (uint32_t i = 0; i < list.opaque_end; ++i) {
    const PixelQuad quad = quad_at(list, camera.projection(), i);
    if (!camera.is_wall(*quad.corner)) continue;
    if (std::abs(quad.right - 32) < 1e-3) {
      ++at_corner;
      EXPECT_NEAR(quad.depth_at(32 - camera.projection().wall_shift_x), 200, 0.1);
    }
    if (std::abs(quad.left - 32) < 1e-3) {
      ++at_corner;
      EXPECT_NEAR(quad.bottom_left, 30 + 57.6 * 41 / 200, 1e-3);
      EXPECT_NEAR(quad.bottom_right, 30 + 57.6 * 41 / 200, 1e-3);
      EXPECT_NEAR(quad.top_left, 30 - 57.6 * 87 / 200, 1e-3);
    }
  }
  EXPECT_EQ(at_corner, 2) << "two walls meet in the corner";
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

/// Depth (along the view axis) of the nearest wall that the centre of `column` meets; 0 where none.
double nearest_depth(const std::vector<Segment>& walls, double x, double y, double radians,
                     double side_per_depth) {
  const double dx = std::cos(radians) + side_per_depth * std::sin(radians);
  const double dy = std::sin(radians) - side_per_depth * std::cos(radians);
  double best = 0;
  for (const Segment& wall : walls) {
    const double ex = wall.x1 - wall.x0, ey = wall.y1 - wall.y0;
    const double denominator = dx * ey - dy * ex;
    if (denominator == 0) continue;
    const double depth = ((wall.x0 - x) * ey - (wall.y0 - y) * ex) / denominator;
    const double along = ((wall.x0 - x) * dy - (wall.y0 - y) * dx) / denominator;
    if (depth <= 0 || along < 0 || along > 1) continue;
    if (best == 0 || depth < best) best = depth;
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
    const DrawList& list = camera.look(eye_x, eye_y, 41, degrees);
    std::vector<PixelQuad> quads;
    for (uint32_t i = 0; i < list.opaque_end; ++i) quads.push_back(quad_at(list, projection, i));
    int edge_pixels = 0;
    for (int column = 0; column < projection.width; ++column) {
      const double x = column + 0.5;
      const double depth = nearest_depth(walls, eye_x, eye_y, degrees * 3.14159265358979 / 180,
                                         (x - projection.center_x) / projection.focal_x);
      ASSERT_GT(depth, 0);
      const double foot = projection.center_y + projection.focal_y * 41 / depth;
      const double head = projection.center_y - projection.focal_y * (200 - 41) / depth;
      for (int row = 0; row < projection.rows; ++row) {
        const double y = row + 0.5;
        int wall_layers = 0, plane_layers = 0;
        const PixelQuad* top = nullptr;
        for (const PixelQuad& quad : quads) {
          if (!quad.holds(x, y)) continue;
          (camera.is_wall(*quad.corner) ? wall_layers : plane_layers) += 1;
          top = &quad;
        }
        ASSERT_LE(wall_layers, 1) << "walls never overlap";
        ASSERT_LE(plane_layers, 1) << "floors and ceilings never overlap";
        ASSERT_NE(top, nullptr) << "column " << column << " row " << row << " is bare";
        if (std::abs(y - foot) < 0.05 || std::abs(y - head) < 0.05) {
          ++edge_pixels;
          continue;
        }
        const bool wall_expected = y > head && y < foot;
        ASSERT_EQ(camera.is_wall(*top->corner), wall_expected) << "column " << column << " row " << row;
        if (wall_expected) {
          // Quads carry the depth of where textures are looked up, a little beside the pixel's centre.
          EXPECT_NEAR(top->depth_at(x - projection.wall_shift_x), depth, 0.01 * depth) << "the nearest wall";
        }
      }
    }
    EXPECT_LT(edge_pixels, projection.width * 4);
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
  const auto masked = [](const DrawList& list) { return list.masked_end - list.opaque_end; };
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
  const auto quads = [&](double degrees) { return camera.look(0, 0, 41, degrees).opaque_end; };
  const uint32_t alike = quads(0);
  EXPECT_EQ(alike, empty.look(0, 0, 41, 0).opaque_end) << "two sectors that look alike need no border";
  const uint32_t behind = quads(180);
  camera.sectors[same].floor_height = to_fixed(16);
  EXPECT_GT(quads(0), alike);
  EXPECT_EQ(quads(180), behind) << "behind the eye";
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
    const DrawList& list = camera.look(-880, rng.between(-800, 800), 41, rng.between(-30, 30));
    std::vector<PixelQuad> quads;
    for (uint32_t i = 0; i < list.opaque_end; ++i) quads.push_back(quad_at(list, projection, i));
    // Corners lie on a grid of 1/256 pixel; an edge through a pixel's centre has the pixel on its right.
    constexpr double kCenter = 0.5 + 1.0 / 1024;
    int twice = 0;
    for (int column = 0; column < projection.width; ++column)
      for (int row = 0; row < projection.rows; ++row) {
        const auto layers = std::count_if(quads.begin(), quads.end(), [&](const PixelQuad& quad) {
          return quad.holds(column + kCenter, row + kCenter);
        });
        ASSERT_GE(layers, 1) << "column " << column << " row " << row << " is bare";
        twice += layers > 1;
      }
    // A surface goes on for a sixteenth of a row below a nearer one.
    EXPECT_LT(twice, projection.width * projection.rows / 20);
  }
}

TEST(ViewBuilder, AnEyeOutsideTheMapSeesNothingAndSurvives) {
  LevelBuilder builder;
  builder.room(builder.sector(0, 128), -256, -256, 256, 256);
  Camera camera(builder.build());
  for (int degrees = 0; degrees < 360; degrees += 15) {
    const DrawList& list = camera.look(4000, 4000, 41, degrees);
    for (const QuadVertex& vertex : list.vertices)
      EXPECT_TRUE(std::isfinite(vertex.x) && std::isfinite(vertex.y) && vertex.w > 0);
  }
}

}  // namespace view_builder_test
}  // namespace comrad::doom
