// Our pictures beside ViZDoom's of the same map, tests/golden/render/vizdoom/gallery.udmf, from a dozen
// places: one of each thing that can be drawn wrongly. COMRAD_PICTURES=DIR writes theirs (left) and ours
// (right). gallery.py in that folder made map and pictures.
#include <cstdlib>
#include <sstream>

#include "tests/support/scratch_folder.h"
#include "tests/support/wad_bytes.h"
#include "tests/unit/sim_workers/render/recorded_art.h"
#include "tests/unit/sim_workers/render/vizdoom_pictures.h"

namespace comrad::doom {
namespace gallery_parity_test {

const std::string kFolder = std::string(COMRAD_SOURCE_DIR) + "/tests/golden/render/vizdoom/";

TEST(GalleryParity, EachViewIsViZDoomsButForAFewTexels) {
  const auto art = ArtArchive::open();
  if (!art) GTEST_SKIP() << art.error().message;
  const std::string recorded = kFolder + test::folder_of_art(**art);
  const std::vector<uint8_t> map = test::file_bytes(kFolder + "gallery.udmf");
  ASSERT_FALSE(map.empty());
  const comrad::test::ScratchFolder folder;
  wad::test::WadBytes wad;
  wad.add("MAP01").add("TEXTMAP", std::string(map.begin(), map.end())).add("ENDMAP");
  folder.write("gallery.wad", wad.build());
  const char* pictures = std::getenv("COMRAD_PICTURES");
  std::ifstream poses(kFolder + "poses.csv");
  std::string line;
  std::getline(poses, line);
  test::ReferencePainter::print_header();
  int views = 0;
  double sum = 0;
  test::EdgeCount edges;
  while (std::getline(poses, line)) {
    std::istringstream fields(line);
    std::string name, x, y, angle, tics;
    for (std::string* field : {&name, &x, &y, &angle, &tics}) std::getline(fields, *field, ',');
    std::ofstream(folder / "gallery.cfg")
        << "doom_scenario_path = gallery.wad\ndoom_map = MAP01\nepisode_start_time = " << tics
        << "\nrender_hud = true\nrender_weapon = true\nrender_crosshair = false\nrender_screen_flashes = "
           "false\n"
           "available_buttons = { TURN_LEFT }\n";
    trace::GameOptions options;
    options.target = (folder / "gallery.cfg").string();
    const auto game = trace::open_trace_game(options);
    ASSERT_TRUE(game.has_value()) << game.error().message;
    (*game)->reset(1);
    trace::Pose pose;
    pose.x = to_fixed(std::stoi(x)), pose.y = to_fixed(std::stoi(y));
    pose.angle = degrees_to_angle(std::stoi(angle));
    World& world = (*game)->world();
    pose.z = world.sectors()[world.sector_at(pose.x, pose.y)].floor_height;
    trace::set_pose(world, pose);
    for (Player& player : world.state().players) player.view_z = pose.z + to_fixed(41);
    auto painter = test::ReferencePainter::create(**game, {});
    ASSERT_TRUE(painter.has_value()) << painter.error().message;
    const auto difference = painter->compare(world, recorded + name, pictures == nullptr ? "" : pictures);
    ASSERT_TRUE(difference.has_value()) << difference.error().message;
    test::ReferencePainter::print(name, *difference);
    test::ReferencePainter::expect_alike(name, *difference, 1.5);
    EXPECT_GE(difference->equal_share, 0.96) << name;
    edges.add(*difference);
    sum += difference->mean_absolute, ++views;
  }
  ASSERT_GE(views, 10);
  edges.expect_few();
  std::printf("%-34s %8.2f\n", "mean", sum / views);
}

}  // namespace gallery_parity_test
}  // namespace comrad::doom
