// The painter beside plain loops that ask every pixel for itself, as the comments of draw_list.h say it.
#include "sim_workers/engine/render/painter.h"

#include <gtest/gtest.h>

#include <cmath>

#include "rollout_buffer/core/rng.h"
#include "sim_workers/engine/render/picture.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/support/allocation_count.h"
#include "tests/unit/sim_workers/render/open_level.h"
#include "tests/unit/sim_workers/render/tiny_iwad.h"

namespace comrad::doom {
namespace painter_test {

/// Archive of textures whose texels tell their places; sizes that are powers of two and others.
class PainterBesideLoops : public ::testing::Test {
 protected:
  PainterBesideLoops() {
    wad::test::WadBytes wad = test::tiny_iwad();
    wad.add("TX_START");
    for (const auto& [name, size] : std::vector<std::pair<const char*, std::pair<int, int>>>{
             {"SQUARE", {64, 64}}, {"ODD", {40, 72}}, {"TALL", {16, 128}}, {"HOLES", {24, 56}}}) {
      const auto [width, height] = size;
      std::vector<uint8_t> texels;
      for (int i = 0; i < width * height; ++i) {
        const bool hole = std::string(name) == "HOLES" && (i * 7 / 3) % 5 == 0;
        texels.push_back(hole ? uint8_t{255} : static_cast<uint8_t>(1 + (i * 31 + i / width * 17) % 250));
      }
      wad.add(name, test::picture_lump(width, height, 0, 0, texels));
    }
    wad.add("TX_END");
    archive_ = ArtArchive::from_bytes({wad.build()}).value();
    atlas_ = std::make_unique<ArtAtlas>(archive_);
    RenderOptions options;
    options.width = 96, options.height = 80, options.status_bar = false;
    projection_ = make_projection(options);
    list_.center_y = projection_.center_y;
    for (int row = 0; row < 32; ++row)
      for (int index = 0; index < 256; ++index)
        light_table_.push_back(static_cast<uint8_t>((index * 5 + row * 11) % 256));
    for (const uint8_t*& rows : light_.rows) rows = light_table_.data();
  }

  uint8_t texel(const AtlasRegion& region, int64_t u, int64_t v) const {
    const auto wrap = [](int64_t at, int64_t size) { return (at % size + size) % size; };
    return atlas_->texels()[region.address + static_cast<std::size_t>(wrap(v, region.height)) * kAtlasWidth +
                            static_cast<std::size_t>(wrap(u, region.width))];
  }
  uint8_t lit(float shade, float inverse, uint8_t index) const {
    return light_table_[static_cast<std::size_t>(light_row(shade, inverse)) * 256 + index];
  }
  ColumnLine random_line(double low, double high) {
    const double first = low + (high - low) * rng_.uniform(), last = low + (high - low) * rng_.uniform();
    return {static_cast<float>(first), static_cast<float>((last - first) / projection_.width)};
  }
  Strip random_strip(Strip::Kind kind, const char* texture) {
    Strip strip;
    strip.kind = kind;
    strip.column_begin = rng_.between(0, 60), strip.column_end = strip.column_begin + rng_.between(1, 36);
    strip.top = random_line(-30, 50), strip.bottom = random_line(30, 120);
    strip.region = atlas_->wall(texture).value();
    strip.shade = static_cast<float>(rng_.between(0, 40));
    strip.subject = rng_.between(0, 9);
    strip.inverse = random_line(0.001, 0.02), strip.light = random_line(0.001, 0.02);
    strip.v_horizon = static_cast<float>(rng_.between(-4000, 4000)) / 16;
    strip.v_step = static_cast<float>(rng_.between(1, 400)) / 8192;
    strip.u_offset = static_cast<float>(rng_.between(-4000, 4000)) / 16;
    strip.u_over_depth = random_line(-3, 3);
    strip.x_left = static_cast<float>(strip.column_begin) + 0.5f;
    return strip;
  }
  bool holds(const Strip& strip, int column, int row) const {
    const auto x = static_cast<float>(column);
    return column >= strip.column_begin && column < strip.column_end && row >= std::floor(strip.top.at(x)) &&
           row < std::floor(strip.bottom.at(x));
  }

  std::shared_ptr<const ArtArchive> archive_;
  std::unique_ptr<ArtAtlas> atlas_;
  Projection projection_;
  DrawList list_;
  std::vector<uint8_t> light_table_;
  LightRows light_;
  Rng rng_{uint64_t{11}};
};

TEST_F(PainterBesideLoops, WallsAndPictures) {
  Painter painter(projection_, atlas_.get());
  std::vector<uint8_t> picture(static_cast<std::size_t>(projection_.width * projection_.rows));
  int painted = 0;
  for (int round = 0; round < 200; ++round) {
    const Strip::Kind kind = round % 2 == 0 ? Strip::Kind::kWall : Strip::Kind::kPicture;
    Strip strip = random_strip(kind, std::array{"SQUARE", "ODD", "TALL", "HOLES"}[round / 2 % 4]);
    strip.masked = round / 2 % 4 == 3;
    if (kind == Strip::Kind::kPicture) {
      strip.inverse.slope = strip.light.slope = 0,
      strip.v_horizon = static_cast<float>(strip.region.height) / 2;
      strip.u_step = rng_.between(-60000, 60000);
      strip.u_begin = strip.u_step < 0 ? (strip.region.width << 16) - 1 : 0;
    }
    list_.strips = {strip};
    list_.opaque_end = strip.masked ? 0 : 1;
    painter.paint(list_, light_, nullptr, picture.data());
    for (int column = 0; column < projection_.width; ++column)
      for (int row = 0; row < projection_.rows; ++row) {
        const uint8_t shown = picture[static_cast<std::size_t>(row * projection_.width + column)];
        if (!holds(strip, column, row)) {
          ASSERT_EQ(shown, 0) << "column " << column << " row " << row;
          continue;
        }
        const auto x = static_cast<float>(column);
        const float texel_x = kind == Strip::Kind::kWall ? std::max(x, strip.x_left) : x;
        const double depth = 1.0 / strip.inverse.at(texel_x);
        const double step = std::floor(strip.v_step * depth * 65536 + 0.5);
        double v = std::floor(strip.v_horizon * 65536.0 + 0.5) + (row + 1 - projection_.center_y) * step;
        double u = std::floor((strip.u_offset + strip.u_over_depth.at(texel_x) * depth) * 65536);
        if (kind == Strip::Kind::kPicture) {
          u = std::clamp<double>(strip.u_begin + strip.u_step * (column - strip.column_begin), 0,
                                 strip.region.width * 65536.0 - 1);
          v = std::clamp(v, 0.0, strip.region.height * 65536.0 - 1);
        }
        const uint8_t wanted = texel(strip.region, static_cast<int64_t>(std::floor(u / 65536)),
                                     static_cast<int64_t>(std::floor(v / 65536)));
        if (strip.masked && wanted == kTransparentIndex) {
          ASSERT_EQ(shown, 0);
        } else {
          ASSERT_EQ(shown, lit(strip.shade, strip.light.at(x), wanted))
              << "column " << column << " row " << row << " of round " << round;
          ++painted;
        }
      }
  }
  EXPECT_GT(painted, 50000);
}

TEST_F(PainterBesideLoops, PlanesOfSeveralStrips) {
  Painter painter(projection_, atlas_.get());
  std::vector<uint8_t> picture(static_cast<std::size_t>(projection_.width * projection_.rows));
  int painted = 0, beside = 0;
  for (int round = 0; round < 100; ++round) {
    Plane plane;
    plane.region = atlas_->wall(std::array{"SQUARE", "ODD", "TALL"}[round % 3]).value();
    plane.row_factor = static_cast<float>(rng_.between(500, 9000));
    plane.shade = static_cast<float>(rng_.between(0, 40));
    plane.u_eye = rng_.between(-40000, 40000) / 8.0, plane.v_eye = rng_.between(-40000, 40000) / 8.0;
    plane.u_ahead = rng_.uniform() * 2 - 1, plane.v_ahead = rng_.uniform() * 2 - 1;
    plane.u_right = (rng_.uniform() * 2 - 1) / 48, plane.v_right = (rng_.uniform() * 2 - 1) / 48;
    list_.planes = {plane};
    list_.strips.clear();
    int column = 0;  // side by side, with a gap here and there, so that rows run through several
    for (int part = 0; part < 5 && column < 90; ++part) {
      Strip strip = random_strip(Strip::Kind::kPlane, "SQUARE");
      column += part == 3 ? 4 : 0;
      strip.column_begin = column, strip.column_end = column = std::min(96, column + rng_.between(1, 30));
      list_.strips.push_back(strip);
    }
    list_.opaque_end = list_.strip_count();
    painter.paint(list_, light_, nullptr, picture.data());
    for (int at = 0; at < projection_.width; ++at)
      for (int row = 0; row < projection_.rows; ++row) {
        const uint8_t shown = picture[static_cast<std::size_t>(row * projection_.width + at)];
        const bool held =
            std::ranges::any_of(list_.strips, [&](const Strip& strip) { return holds(strip, at, row); });
        if (!held) {
          ASSERT_EQ(shown, 0) << "column " << at << " row " << row;
          continue;
        }
        const double depth = plane.row_factor / std::abs(row + 0.5 - list_.center_y);
        const double right = at + 1 - static_cast<double>(projection_.center_x);
        const double u = plane.u_eye + depth * (plane.u_ahead + plane.u_right * right),
                     v = plane.v_eye + depth * (plane.v_ahead + plane.v_right * right);
        const float inverse = static_cast<float>(std::abs(row - list_.center_y) / plane.row_factor);
        ++painted;
        // A step of 16.16 is cut off: after a hundred columns a texel's border may lie 1/600 of a texel elsewhere.
        constexpr double kRounding = 1.0 / 400;
        bool near = false;
        for (const double du : {-kRounding, kRounding})
          for (const double dv : {-kRounding, kRounding})
            near |= shown == lit(plane.shade, inverse,
                                 texel(plane.region, static_cast<int64_t>(std::floor(u + du)),
                                       static_cast<int64_t>(std::floor(v + dv))));
        ASSERT_TRUE(near) << "column " << at << " row " << row << " of round " << round;
        beside += shown != lit(plane.shade, inverse,
                               texel(plane.region, static_cast<int64_t>(std::floor(u)),
                                     static_cast<int64_t>(std::floor(v))));
      }
  }
  EXPECT_GT(painted, 100000);
  EXPECT_LT(beside, painted / 200) << "texels that lie on a border";
}

TEST_F(PainterBesideLoops, DepthsAndSubjectsAreOfThePixelsThatColoursShow) {
  Painter painter(projection_, atlas_.get());
  Strip wall = random_strip(Strip::Kind::kWall, "ODD"), sprite = random_strip(Strip::Kind::kPicture, "HOLES");
  wall.subject = kWallSubject, sprite.subject = kFirstActor + 3;
  sprite.masked = true, sprite.inverse = {0.01f, 0}, sprite.v_horizon = 20, sprite.u_step = 30000;
  list_.strips = {wall, sprite};
  list_.opaque_end = 1;
  const auto pixels = static_cast<std::size_t>(projection_.width * projection_.rows);
  std::vector<float> depth(pixels);
  std::vector<uint32_t> subjects(pixels);
  painter.paint_depth(list_, depth.data());
  painter.paint_subjects(list_, 999, subjects.data());
  std::vector<uint8_t> wall_alone(pixels), both(pixels);
  painter.paint(list_, light_, nullptr, both.data());
  list_.strips.pop_back();
  painter.paint(list_, light_, nullptr, wall_alone.data());
  int of_sprite = 0, of_wall = 0;
  for (std::size_t at = 0; at < pixels; ++at) {
    const auto column = static_cast<int>(at) % projection_.width,
               row = static_cast<int>(at) / projection_.width;
    if (subjects[at] == kFirstActor + 3) {
      ++of_sprite;
      EXPECT_FLOAT_EQ(depth[at], 100);
      EXPECT_TRUE(holds(sprite, column, row));
    } else {
      EXPECT_EQ(both[at], wall_alone[at]) << "no sprite here";
      EXPECT_EQ(subjects[at] == kWallSubject, holds(wall, column, row));
      if (subjects[at] == 999) {
        EXPECT_EQ(depth[at], 0) << "nothing";
      } else {
        ++of_wall;
        EXPECT_FLOAT_EQ(depth[at], 1 / wall.inverse.at(std::max(static_cast<float>(column), wall.x_left)));
      }
    }
  }
  EXPECT_GT(of_sprite, 50);
  EXPECT_GT(of_wall, 50);
}

TEST_F(PainterBesideLoops, WhatIsSeenThroughIsMixedInThePalette) {
  Painter painter(projection_, atlas_.get());
  PaletteMixer mixer;
  mixer.make(*archive_);
  Strip behind = random_strip(Strip::Kind::kPicture, "SQUARE");
  behind.column_begin = 10, behind.column_end = 40, behind.top = {10, 0}, behind.bottom = {60, 0};
  behind.inverse = behind.light = {0.005f, 0}, behind.v_horizon = 30, behind.v_step = 0.001f,
  behind.u_step = 1000;
  Strip glass = behind;
  glass.column_begin = 30, glass.column_end = 50, glass.v_horizon = 20;
  glass.paint = {.tint = 0, .blended = true, .blend = 2};
  list_.blends[2] = {.kind = Blend::Kind::kMix, .front = 25, .behind = 38};  // an alpha of 0.4
  const auto pixels = static_cast<std::size_t>(projection_.width * projection_.rows);
  std::vector<uint8_t> both(pixels), alone(pixels), opaque(pixels);
  list_.strips = {behind, glass}, list_.opaque_end = 0, list_.has_blended = true;
  painter.paint(list_, light_, &mixer, both.data());
  list_.strips = {behind};
  painter.paint(list_, light_, nullptr, alone.data());
  glass.paint = {};
  list_.strips = {glass};
  painter.paint(list_, light_, nullptr, opaque.data());
  int mixed = 0;
  for (std::size_t at = 0; at < pixels; ++at) {
    const auto column = static_cast<int>(at) % projection_.width;
    if (column < 30 || column >= 50 || opaque[at] == 0) {
      EXPECT_EQ(both[at], alone[at]);
      continue;
    }
    ArtArchive::Color wanted{};
    for (std::size_t channel = 0; channel < 3; ++channel) {
      const int five = (archive_->palette(0)[opaque[at]][channel] * 25 / 16 +
                        archive_->palette(0)[alone[at]][channel] * 38 / 16) /
                       32;
      wanted[channel] = static_cast<uint8_t>(five * 8 + five / 4);
    }
    EXPECT_EQ(both[at], archive_->nearest(wanted));
    ++mixed;
  }
  EXPECT_GT(mixed, 500);
}

TEST(Painter, AViewAllocatesNothing) {
  test::LevelBuilder builder;
  const uint32_t hall = builder.sector(0, 192), pit = builder.sector(-48, 192);
  builder.room(hall, -640, -640, 640, 640).island(pit, hall, 96, 64, 480, 400).thing(1, 0, 0);
  World world(test::with_open_lines(builder.build()), std::make_shared<const ActorCatalog>());
  reset_world(world, {.player_count = 1, .seed = 1});
  world.spawn_unchecked(world.catalog().find("Stimpack").value(), to_fixed(64), 0, 0);
  RenderOptions options;
  options.status_bar = options.crosshair = false;
  const auto renderer = Renderer::create(test::tiny_archive(), options).value();
  std::vector<uint8_t> picture(3 * 72 * 128);
  const ViewRequest request{.world = &world, .player = 0, .destination = picture.data()};
  const auto look_round = [&] {
    for (int degrees = 0; degrees < 360; degrees += 5) {
      world.set_angle(world.body(0).id, degrees_to_angle(degrees));
      renderer->draw({&request, 1});
    }
  };
  look_round();
  const uint64_t before = comrad::test::allocations_of_this_thread();
  look_round();
  EXPECT_EQ(comrad::test::allocations_of_this_thread() - before, 0u);
}

TEST(Painter, DrawsEverySizeFromOnePixelOn) {
  test::LevelBuilder builder;
  builder.room(builder.sector(0, 128), -256, -256, 256, 256).thing(1, 0, 0);
  World world(builder.build(), std::make_shared<const ActorCatalog>());
  reset_world(world, {.player_count = 1, .seed = 1});
  for (const auto& [width, height] :
       {std::pair{1, 1}, {1, 200}, {200, 1}, {3, 2}, {17, 5}, {127, 71}, {1920, 1080}}) {
    RenderOptions options;
    options.width = width, options.height = height, options.status_bar = options.crosshair = false;
    const auto renderer = Renderer::create(test::tiny_archive(), options).value();
    std::vector<uint8_t> picture(std::size_t{3} * width * height, 7);
    const ViewRequest request{.world = &world, .player = 0, .destination = picture.data()};
    for (int degrees = 0; degrees < 360; degrees += 30) {
      world.set_angle(world.body(0).id, degrees_to_angle(degrees));
      renderer->draw({&request, 1});
      EXPECT_EQ(renderer->undrawn_pixels(), 0) << width << "x" << height << " at " << degrees;
    }
  }
}

TEST(ShowIndices, GivesEachPixelItsColourAndTouchesNoOther) {
  Rng rng{uint64_t{7}};
  std::vector<uint32_t> colors(256);
  for (uint32_t& color : colors) color = static_cast<uint32_t>(rng.next()) & 0xFFFFFFu;
  for (const std::size_t size : {0u, 1u, 15u, 16u, 63u, 64u, 65u, 1000u, 7808u}) {
    std::vector<uint8_t> indices(size);
    for (uint8_t& index : indices) index = static_cast<uint8_t>(rng.below(256));
    const std::size_t plane = size + 37;  // rows of a status bar follow
    std::vector<uint8_t> shown(3 * plane, 7), wanted = shown;
    for (std::size_t i = 0; i < size; ++i)
      for (std::size_t channel = 0; channel < 3; ++channel)
        wanted[channel * plane + i] = static_cast<uint8_t>(colors[indices[i]] >> (8 * channel));
    show_indices(indices, colors.data(), plane, shown.data());
    EXPECT_EQ(shown, wanted) << size << " pixels";
  }
}

}  // namespace painter_test
}  // namespace comrad::doom
