// Pictures of a small hall with the installed IWAD, compared with the ones in tests/golden/render, a folder for each release of
// Freedoom and in it a picture for each renderer: the painter's are the same to the byte on every machine. After a deliberate change, or for another release, whose folder must be there: COMRAD_REGENERATE_GOLDEN=1 ./comrad test -R
// picture_golden_test, then look at the new pictures.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <opencv2/core.hpp>
#include <opencv2/imgcodecs.hpp>

#include "sim_workers/engine/play/damage.h"
#include "sim_workers/engine/play/spawning.h"
#include "sim_workers/engine/render/art_archive.h"
#include "sim_workers/engine/render/renderer.h"
#include "sim_workers/engine/tic/tic.h"
#include "tests/unit/sim_workers/render/open_level.h"
#include "tests/unit/sim_workers/render/recorded_art.h"

namespace comrad::doom {
namespace picture_golden_test {

std::shared_ptr<const Level> hall() {
  test::LevelBuilder builder;
  const uint32_t hall = builder.sector(0, 160), platform = builder.sector(16, 160),
                 yard = builder.sector(-24, 160);
  builder.sector_at(hall).light = 200;
  builder.sector_at(platform).floor_texture = "FLAT1";
  builder.sector_at(yard).floor_texture = "NUKAGE1", builder.sector_at(yard).ceiling_texture = "F_SKY1";
  builder.sector_at(yard).light = 255;
  builder.room(hall, -384, -512, 768, 512);
  builder.island(platform, hall, 192, -224, 320, -64);
  builder.island(yard, hall, 256, 64, 512, 320);
  builder.pillar(hall, 416, -64, 480, 0);
  builder.thing(1, 0, 0).thing(2, 160, 48, 225);
  return test::with_open_lines(builder.build());
}

/// A world with kits on the floor and the platform; player 1 is in player 0's view.
World scene() {
  auto catalog = std::make_shared<const ActorCatalog>();
  World world(hall(), catalog);
  reset_world(world, {.player_count = 2, .seed = 5});
  const uint32_t stimpack = catalog->find("Stimpack").value(), medikit = catalog->find("Medikit").value();
  spawn_actor(world, medikit, to_fixed(128), to_fixed(-48), 0, 0, 0, true);
  spawn_actor(world, stimpack, to_fixed(256), to_fixed(-128), to_fixed(16), 0, 0, true);
  spawn_actor(world, stimpack, to_fixed(520), to_fixed(-40), 0, 0, 0, true);
  return world;
}

cv::Mat to_bgr(const std::vector<uint8_t>& planar, int width, int height) {
  cv::Mat picture(height, width, CV_8UC3);
  const std::size_t plane = static_cast<std::size_t>(width) * height;
  for (int y = 0; y < height; ++y)
    for (int x = 0; x < width; ++x) {
      const std::size_t at = static_cast<std::size_t>(y) * width + x;
      picture.at<cv::Vec3b>(y, x) = {planar[2 * plane + at], planar[plane + at], planar[at]};
    }
  return picture;
}

class PictureGolden : public ::testing::Test {
 protected:
  void SetUp() override {
    auto archive = ArtArchive::open();
    if (!archive) GTEST_SKIP() << archive.error().message;
    archive_ = *archive;
  }

  void compare(const std::string& name, const World& world, RenderOptions options) {
    for (const RendererKind kind : {RendererKind::kPainter, RendererKind::kOsmesa}) {
      options.renderer = kind;
      compare_one(name + "_" + word_of(kind), world, options);
    }
  }

  void compare_one(const std::string& name, const World& world, const RenderOptions& options) {
    auto renderer = Renderer::create(archive_, options);
    ASSERT_TRUE(renderer.has_value()) << renderer.error().message;
    const Status prepared = (*renderer)->prepare(world.shared_level(), world.shared_catalog());
    ASSERT_TRUE(prepared.has_value()) << prepared.error().message;
    std::vector<uint8_t> planar(std::size_t{3} * options.width * options.height);
    const ViewRequest request{.world = &world, .player = 0, .destination = planar.data()};
    (*renderer)->draw({&request, 1});
    const cv::Mat picture = to_bgr(planar, options.width, options.height);
    const std::string path = std::string(COMRAD_SOURCE_DIR) + "/tests/golden/render/" +
                             test::folder_of_art(*archive_) + name + ".png";
    if (std::getenv("COMRAD_REGENERATE_GOLDEN") != nullptr) {
      ASSERT_TRUE(cv::imwrite(path, picture)) << path;
      std::printf("wrote %s\n", path.c_str());
      return;
    }
    const cv::Mat golden = cv::imread(path, cv::IMREAD_COLOR);
    ASSERT_FALSE(golden.empty()) << path << " is missing: see the head of this file";
    ASSERT_EQ(golden.size(), picture.size());
    int different = 0;
    for (int y = 0; y < picture.rows; ++y)
      for (int x = 0; x < picture.cols; ++x)
        different += picture.at<cv::Vec3b>(y, x) != golden.at<cv::Vec3b>(y, x);
    // OpenGL rounds a texture coordinate differently here and there on another processor.
    const int allowed =
        options.renderer == RendererKind::kPainter ? 0 : picture.rows * picture.cols / 100 - 1;
    EXPECT_LE(different, allowed) << different << " pixels differ from " << path;
  }

  std::shared_ptr<const ArtArchive> archive_;
};

TEST_F(PictureGolden, AnAgentsView) { compare("hall_128x72", scene(), {}); }

TEST_F(PictureGolden, AnAgentsViewInPain) {
  World world = scene();
  damage_player(world, 0, 40);
  compare("hall_pain_128x72", world, {});
}

TEST_F(PictureGolden, ALargeViewWithoutStatusBar) {
  RenderOptions options;
  options.width = 320, options.height = 240;
  options.status_bar = options.crosshair = false;
  compare("hall_320x240", scene(), options);
}

}  // namespace picture_golden_test
}  // namespace comrad::doom
