#include "sim_workers/engine/render/renderer.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numeric>

#include "sim_workers/engine/play/placement.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/render/projection.h"
#include "sim_workers/engine/render/scene.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/unit/sim_workers/render/open_level.h"
#include "tests/unit/sim_workers/render/tiny_iwad.h"

namespace comrad::doom {
namespace renderer_test {

using test::LevelBuilder;

// Palette indices of the tiny IWAD, which are the red channel of what is drawn.
constexpr int kWall = 10, kStep = 20, kFloor = 50, kCeiling = 60, kPitFloor = 70, kKit = 40, kSky = 30;

RenderOptions bare_options() {
  RenderOptions options;
  options.status_bar = options.crosshair = false;
  return options;
}

std::unique_ptr<Renderer> make_renderer() {
  return Renderer::create(test::tiny_archive(), bare_options()).value();
}

std::vector<uint8_t> draw(Renderer& renderer, const World& world, int player = 0) {
  std::vector<uint8_t> picture(3 * 72 * 128);
  const ViewRequest request{.world = &world, .player = player, .destination = picture.data()};
  renderer.draw({&request, 1});
  return picture;
}

World make_world(std::shared_ptr<const Level> level, int players = 1) {
  World world(std::move(level), std::make_shared<const ActorCatalog>());
  reset_world(world, {.player_count = players, .seed = 1});
  return world;
}

/// A hall with a platform, a pit, a pit inside the pit, a lowered ceiling and pillars.
std::shared_ptr<const Level> stepped_hall() {
  LevelBuilder builder;
  const uint32_t hall = builder.sector(0, 192);
  const uint32_t platform = builder.sector(24, 192), pit = builder.sector(-48, 192),
                 deep = builder.sector(-96, 192);
  const uint32_t beam = builder.sector(0, 96);
  builder.sector_at(pit).floor_texture = builder.sector_at(deep).floor_texture = "FLAT1";
  builder.room(hall, -640, -640, 640, 640);
  builder.island(platform, hall, 160, -320, 320, -64);
  builder.island(pit, hall, 96, 64, 480, 400);
  builder.island(deep, pit, 200, 160, 360, 300);
  builder.island(beam, hall, -400, -200, -160, 200);
  builder.pillar(hall, 380, -40, 440, 20).pillar(hall, -100, 300, -40, 380);
  builder.thing(1, 0, 0);
  return test::with_open_lines(builder.build());
}

/// What a ray meets, found the slow way: line after line in order of depth.
int trace(const Level& level, double x, double y, double z, double radians, double side, double up) {
  struct Crossing {
    double depth;
    const Linedef* line;
    bool from_back;
  };
  const double dx = std::cos(radians) + side * std::sin(radians),
               dy = std::sin(radians) - side * std::cos(radians);
  std::vector<Crossing> crossings;
  for (const Linedef& line : level.linedefs) {
    const double x0 = to_double(level.vertices[line.start].x), y0 = to_double(level.vertices[line.start].y);
    const double ex = to_double(level.vertices[line.end].x) - x0,
                 ey = to_double(level.vertices[line.end].y) - y0;
    const double denominator = dx * ey - dy * ex;
    if (denominator == 0) continue;
    const double depth = ((x0 - x) * ey - (y0 - y) * ex) / denominator;
    const double along = ((x0 - x) * dy - (y0 - y) * dx) / denominator;
    if (depth > 0 && along >= 0 && along <= 1) crossings.push_back({depth, &line, denominator > 0});
  }
  std::sort(crossings.begin(), crossings.end(),
            [](const auto& a, const auto& b) { return a.depth < b.depth; });
  const auto index_of = [](const std::string& texture) {
    return texture == "FLOOR4_8" ? kFloor
           : texture == "FLAT1"  ? kPitFloor
           : texture == kSkyFlat ? kSky
                                 : kCeiling;
  };
  for (const auto& [depth, line, from_back] : crossings) {
    if (from_back && !line->back) continue;  // a ray through a corner may slip past its walls
    const Sidedef& near = level.sidedefs[from_back ? *line->back : line->front];
    const Sector& now = level.sectors[near.sector_index];
    const double height = z + up * depth;
    if (height < to_double(now.floor_height)) return index_of(now.floor_texture);
    if (height > to_double(now.ceiling_height)) return index_of(now.ceiling_texture);
    if (!line->back) return kWall;
    const Sector& beyond = level.sectors[level.sidedefs[from_back ? line->front : *line->back].sector_index];
    if (height < to_double(beyond.floor_height) || height > to_double(beyond.ceiling_height)) return kStep;
  }
  return -1;
}

TEST(Renderer, ShowsInEveryPixelWhatARayThroughItMeets) {
  const auto level = stepped_hall();
  World world = make_world(level);
  const auto renderer = make_renderer();
  const RenderOptions options = bare_options();
  const Projection projection = make_projection(options);
  const std::pair<int, int> places[] = {{0, 0},     {40, -200}, {-500, 100}, {240, -190},
                                        {280, 120}, {-280, 0},  {560, 560}};
  int pixels = 0, wrong = 0;
  for (const auto& [x, y] : places) {
    for (int degrees = 0; degrees < 360; degrees += 30) {
      set_position(world, world.body(0).id, to_fixed(x), to_fixed(y), 0);
      world.set_angle(world.body(0).id, degrees_to_angle(degrees));
      const double eye_z = to_double(world.player(0).view_z);
      const std::vector<uint8_t> picture = draw(*renderer, world);
      int wrong_here = 0;
      for (int row = 0; row < options.height; ++row)
        for (int column = 0; column < options.width; ++column) {
          // Which wall it is is asked at a column's ray, where its borders run at whole columns: an edge may lie a column
          // beside the exact one.
          const auto sees = [&](double at) {
            const double side = (at - projection.center_x) / projection.focal_x;
            const double up = (projection.center_y - row - 1) / projection.focal_y;
            return trace(*level, x, y, eye_z, degrees * 3.14159265358979 / 180, side, up);
          };
          const int shown = picture[static_cast<std::size_t>(row * options.width + column)];
          const bool right = shown == sees(projection.ray_of(column)) || shown == sees(column) ||
                             shown == sees(column - 1) || shown == sees(column + 1);
          wrong_here += right ? 0 : 1;
          ++pixels;
        }
      // Pixels whose lower border lies within rounding of an edge may fall to either side.
      EXPECT_LT(wrong_here, 30) << "at (" << x << ", " << y << ") looking to " << degrees << " degrees";
      wrong += wrong_here;
    }
  }
  EXPECT_LT(wrong, pixels / 1000) << wrong << " of " << pixels << " pixels show something else";
}

TEST(Renderer, ShowsTheSkyWhereTheCeilingIsOpen) {
  LevelBuilder builder;
  const uint32_t yard = builder.sector(0, 128), hut = builder.sector(0, 96);
  builder.sector_at(yard).ceiling_texture = kSkyFlat;
  builder.room(yard, -512, -512, 512, 512).island(hut, yard, 128, -128, 384, 128).thing(1, 0, 0);
  const auto level = test::with_open_lines(builder.build());
  World world = make_world(level);
  const auto renderer = make_renderer();
  world.set_angle(world.body(0).id, kAngle180);
  std::vector<uint8_t> picture = draw(*renderer, world);
  EXPECT_EQ(picture[2], kSky) << "above the yard";
  EXPECT_EQ(picture[29 * 128 + 64], kWall);
  EXPECT_EQ(picture[71 * 128 + 64], kFloor);
  set_position(world, world.body(0).id, to_fixed(256), 0, 0);
  picture = draw(*renderer, world);
  EXPECT_EQ(picture[64], kCeiling) << "under the hut's roof";
}

TEST(Renderer, DrawsItemsWhereTheyStandAndNotBehindWalls) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128);
  builder.room(room, -512, -512, 512, 512).pillar(room, 200, -32, 232, 32).thing(1, 0, 0);
  World world = make_world(builder.build());
  const auto renderer = make_renderer();
  const uint32_t kit = world.catalog().find("Stimpack").value();
  const auto count = [&] {
    const std::vector<uint8_t> picture = draw(*renderer, world);
    return std::count(picture.begin(), picture.begin() + 72 * 128, kKit);
  };
  EXPECT_EQ(count(), 0);
  ASSERT_TRUE(spawn_actor(world, kit, to_fixed(300), 0, 0, 0, 0, true).has_value());
  EXPECT_EQ(count(), 0) << "hidden by the pillar";
  ASSERT_TRUE(spawn_actor(world, kit, to_fixed(128), to_fixed(64), 0, 0, 0, true).has_value());
  const std::vector<uint8_t> picture = draw(*renderer, world);
  // 8x8 texels at depth 128, 64 to the left: 4 columns round column 32, feet at row 36 + 57.6 * 41 / 128.
  const int feet = static_cast<int>(36 + 57.6 * to_double(world.player(0).view_z) / 128) - 1;
  for (int column = 30; column < 34; ++column)
    EXPECT_EQ(picture[static_cast<std::size_t>(feet * 128 + column)], kKit);
  EXPECT_NE(picture[static_cast<std::size_t>(feet * 128 + 29)], kKit);
  EXPECT_NE(picture[static_cast<std::size_t>(feet * 128 + 34)], kKit);
  EXPECT_NEAR(static_cast<double>(count()), 8 * 0.5 * 8 * 0.45, 4);
}

TEST(Renderer, ViewsDrawnTogetherEqualViewsDrawnAlone) {
  const auto level = stepped_hall();
  LevelBuilder other;
  other.room(other.sector(0, 128), -256, -256, 256, 256).thing(1, 0, 0);
  std::vector<World> worlds;
  for (int i = 0; i < 6; ++i) {
    worlds.push_back(make_world(i % 3 == 2 ? other.build() : level));
    World& world = worlds.back();
    world.set_angle(world.body(0).id, static_cast<Angle>(i) * 0x2A3B4C5Du);
    spawn_actor(world, world.catalog().find("Stimpack").value(), to_fixed(64 + 8 * i), to_fixed(-32), 0, 0, 0,
                true);
  }
  const auto renderer = make_renderer();
  std::vector<std::vector<uint8_t>> alone;
  const auto fresh = make_renderer();
  for (const World& world : worlds) alone.push_back(draw(*fresh, world));
  std::vector<std::size_t> order(worlds.size());
  std::iota(order.begin(), order.end(), 0u);
  for (int round = 0; round < 3; ++round) {
    std::vector<std::vector<uint8_t>> together(worlds.size(), std::vector<uint8_t>(3 * 72 * 128, 0xEE));
    std::vector<ViewRequest> requests;
    for (const std::size_t i : order)
      requests.push_back({.world = &worlds[i], .player = 0, .destination = together[i].data()});
    renderer->draw(requests);
    for (std::size_t i = 0; i < worlds.size(); ++i)
      EXPECT_EQ(together[i], alone[i]) << "view " << i << ", round " << round;
    std::rotate(order.begin(), order.begin() + 2, order.end());
  }
}

TEST(Renderer, TwoRenderersInOneThreadDoNotMixUp) {
  const World world = make_world(stepped_hall());
  const auto first = make_renderer(), second = make_renderer();
  const std::vector<uint8_t> picture = draw(*first, world);
  EXPECT_EQ(draw(*second, world), picture);
  EXPECT_EQ(draw(*first, world), picture);
}

TEST(Renderer, AnUnknownSpriteIsLeftOut) {
  auto catalog = std::make_shared<ActorCatalog>();
  ActorType ghost;
  ghost.name = "TetherGhost";
  catalog->add_simple(ghost, "ZZZZ", "A", -1);
  const auto renderer = make_renderer();
  LevelBuilder builder;
  builder.room(builder.sector(0, 128), -256, -256, 256, 256).thing(1, 0, 0);
  const auto level = builder.build();
  ASSERT_TRUE(renderer->prepare(level, catalog).has_value());
  World world(level, catalog);
  reset_world(world, {.player_count = 1, .seed = 1});
  const std::vector<uint8_t> before = draw(*renderer, world);
  spawn_actor(world, catalog->find("TetherGhost").value(), to_fixed(100), 0, 0, 0, 0, true);
  EXPECT_EQ(draw(*renderer, world), before);
}

TEST(Renderer, UnknownTexturesBecomeACheckerboard) {
  LevelBuilder builder;
  const uint32_t room = builder.sector(0, 128);
  builder.sector_at(room).floor_texture = "NOSUCH";
  builder.room(room, -256, -256, 256, 256).thing(1, 0, 0);
  const std::vector<uint8_t> picture = draw(*make_renderer(), make_world(builder.build()));
  const auto checks = std::count_if(picture.begin() + 60 * 128, picture.begin() + 72 * 128,
                                    [](uint8_t red) { return red == 4 || red == 176; });
  EXPECT_EQ(checks, 12 * 128);
}

TEST(Renderer, RefusesWhatItCannotDo) {
  RenderOptions options = bare_options();
  options.width = 0;
  EXPECT_EQ(Renderer::create(test::tiny_archive(), options).error().code, ErrorCode::kBadInput);
  options = bare_options();
  options.renderer = RendererKind::kOsmesa, options.width = 1, options.height = 1;
  EXPECT_TRUE(Renderer::create(test::tiny_archive(), options).has_value());
  options = {};  // the status bar's graphics are missing from the tiny IWAD
  const auto created = Renderer::create(test::tiny_archive(), options);
  ASSERT_FALSE(created.has_value());
  EXPECT_EQ(created.error().code, ErrorCode::kNotFound);
  EXPECT_NE(created.error().message.find("STBAR"), std::string::npos);
}

}  // namespace renderer_test
}  // namespace comrad::doom
