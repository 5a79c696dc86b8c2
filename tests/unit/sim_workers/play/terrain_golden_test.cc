// Plays the recorded scripts on steps, under low ceilings, along slanted walls and over lines that push, and
// compares every tic with ViZDoom's, bit for bit.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <iterator>
#include <sstream>
#include <string>
#include <vector>

#include "doomgen/wad/wad_reader.h"
#include "sim_workers/engine/map/level_loader.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/wad_bytes.h"

namespace comrad::doom {
namespace terrain_golden_test {

constexpr uint64_t kIdleTics = 14;   // before the first row
constexpr double kTurnsMax = 65536;  // what a turn is counted in

std::string folder() { return std::string(COMRAD_SOURCE_DIR) + "/tests/golden/terrain/"; }

struct Row {
  uint64_t map_tic = 0;
  Buttons buttons;
  int64_t x = 0, y = 0, z = 0, velocity_x = 0, velocity_y = 0, velocity_z = 0;
  Angle angle = 0;
};

std::vector<Row> load_trace(const std::string& name) {
  std::ifstream file(folder() + name + ".csv");
  std::string line;
  std::getline(file, line);
  std::vector<Row> rows;
  while (std::getline(file, line)) {
    std::vector<double> cells;
    std::stringstream stream(line);
    for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(std::stod(cell));
    if (cells.size() != 15) return {};
    Row row;
    row.map_tic = static_cast<uint64_t>(cells[0]);
    Buttons& pressed = row.buttons;
    pressed.forward = cells[1] != 0, pressed.backward = cells[2] != 0;
    pressed.left = cells[3] != 0, pressed.right = cells[4] != 0;
    pressed.jump = cells[5] != 0, pressed.crouch = cells[6] != 0, pressed.speed = cells[7] != 0;
    int64_t* const numbers[] = {&row.x, &row.y, &row.z, &row.velocity_x, &row.velocity_y, &row.velocity_z};
    for (std::size_t i = 0; i < std::size(numbers); ++i) *numbers[i] = std::llround(cells[8 + i]);
    row.angle = static_cast<Angle>(std::llround(cells[14] / 360.0 * kTurnsMax)) << 16;
    rows.push_back(row);
  }
  return rows;
}

class TerrainGolden : public ::testing::TestWithParam<const char*> {};

TEST_P(TerrainGolden, FollowsTheTraceBitForBit) {
  const std::string name = GetParam();
  std::ifstream text(folder() + name + ".textmap");
  const std::string textmap((std::istreambuf_iterator<char>(text)), {});
  const auto wad = wad::WadFile::from_bytes(
      wad::test::WadBytes().add("MAP01").add("TEXTMAP", textmap).add("ENDMAP").build(), name + ".wad");
  ASSERT_TRUE(wad) << wad.error().message;
  const auto level = load_level(*wad);
  ASSERT_TRUE(level) << level.error().message;
  const std::vector<Row> rows = load_trace(name);
  ASSERT_GT(rows.size(), 500u) << "the trace is not there";

  World world(*level, std::make_shared<const ActorCatalog>());
  reset_world(world, {.player_count = 1, .allow_crouch = true});
  const Buttons nothing;
  for (uint64_t tic = 0; tic < kIdleTics; ++tic) run_tic(world, {&nothing, 1});
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& row = rows[i];
    SCOPED_TRACE("map tic " + std::to_string(row.map_tic));
    if (i > 0) {
      world.set_angle(world.player(0).actor_id, row.angle);  // turns are part of the recording
      run_tic(world, {&row.buttons, 1});
    }
    const Actor& body = world.body(0);
    ASSERT_EQ(world.tic_count(), row.map_tic);
    ASSERT_EQ(body.x, row.x);
    ASSERT_EQ(body.y, row.y);
    ASSERT_EQ(body.z, row.z);
    ASSERT_EQ(body.velocity_x, row.velocity_x);
    ASSERT_EQ(body.velocity_y, row.velocity_y);
    ASSERT_EQ(body.velocity_z, row.velocity_z);
  }
}

INSTANTIATE_TEST_SUITE_P(Strips, TerrainGolden, ::testing::Values("1", "2", "3", "5", "7", "9"));
INSTANTIATE_TEST_SUITE_P(SlantedWalls, TerrainGolden,
                         ::testing::Values("slanted_4", "slanted_34", "slanted_41"));
INSTANTIATE_TEST_SUITE_P(LinesThatPush, TerrainGolden, ::testing::Values("pushed_1"));

}  // namespace terrain_golden_test
}  // namespace comrad::doom
