// Plays the recorded button scripts and compares every tic with the recorded state, bit for bit.
#include <gtest/gtest.h>

#include <cmath>
#include <fstream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "sim_workers/engine/play/player_thinker.h"
#include "sim_workers/engine/tic/tic.h"
#include "sim_workers/engine/world/world.h"
#include "tests/support/level_builder.h"

namespace comrad::doom {
namespace movement_golden_test {

using Row = std::map<std::string, std::string>;

std::vector<Row> load_trace(const std::string& name) {
  std::ifstream file(std::string(COMRAD_SOURCE_DIR) + "/tests/golden/movement/" + name + ".csv");
  const auto split = [](const std::string& line) {
    std::vector<std::string> cells;
    std::stringstream stream(line);
    for (std::string cell; std::getline(stream, cell, ',');) cells.push_back(cell);
    return cells;
  };
  std::string line;
  std::getline(file, line);
  const std::vector<std::string> header = split(line);
  std::vector<Row> rows;
  while (std::getline(file, line)) {
    const std::vector<std::string> cells = split(line);
    Row row;
    for (std::size_t i = 0; i < header.size() && i < cells.size(); ++i) row[header[i]] = cells[i];
    rows.push_back(std::move(row));
  }
  return rows;
}

Fixed fixed_of(const Row& row, const char* column) {
  return static_cast<Fixed>(std::lround(std::stod(row.at(column)) * kFracUnit));
}
Angle angle_of(const Row& row) {
  return static_cast<Angle>(std::llround(std::stod(row.at("angle")) / 360.0 * 4294967295.0));
}
bool pressed(const Row& row, const char* column) { return row.at(column) != "0"; }

/// The room of the traces, one player, one tic old.
World room_of_the_traces() {
  test::LevelBuilder builder;
  const uint32_t sector = builder.sector(0, 256);
  builder.sector_at(sector).damage_amount = 8;
  builder.room(sector, 0, 0, 1216, 1216).thing(1, 608, 608);
  World world(builder.build(), std::make_shared<const ActorCatalog>());
  reset_world(world, {.player_count = 1});
  const Buttons nothing;
  run_tic(world, {&nothing, 1});
  return world;
}

/// Plays a trace's buttons and compares every row exactly.
void follow(World& world, const std::vector<Row>& rows) {
  ASSERT_GT(rows.size(), 50u) << "the trace is not there";
  for (std::size_t t = 0; t < rows.size(); ++t) {
    const Row& row = rows[t];
    if (t > 0) {
      Buttons buttons;
      buttons.forward = pressed(row, "a_fwd"), buttons.backward = pressed(row, "a_back");
      buttons.left = pressed(row, "a_left"), buttons.right = pressed(row, "a_right");
      buttons.turn_left = pressed(row, "a_turnl"), buttons.turn_right = pressed(row, "a_turnr");
      buttons.speed = pressed(row, "a_speed"), buttons.jump = pressed(row, "a_jump");
      // Turning by a given angle is no button of ours yet: take the angle as recorded.
      if (pressed(row, "a_dyaw")) world.set_angle(world.player(0).actor_id, angle_of(row));
      run_tic(world, {&buttons, 1});
    }
    const Actor& body = world.body(0);
    SCOPED_TRACE("t = " + std::to_string(t));
    ASSERT_EQ(world.tic_count(), std::stoull(row.at("map_tic")));
    ASSERT_EQ(body.x, fixed_of(row, "position_x"));
    ASSERT_EQ(body.y, fixed_of(row, "position_y"));
    ASSERT_EQ(body.z, fixed_of(row, "position_z"));
    ASSERT_EQ(body.angle, angle_of(row));
    ASSERT_EQ(body.velocity_x, fixed_of(row, "velocity_x"));
    ASSERT_EQ(body.velocity_y, fixed_of(row, "velocity_y"));
    ASSERT_EQ(body.velocity_z, fixed_of(row, "velocity_z"));
    ASSERT_EQ(world.player(0).view_z - body.z, fixed_of(row, "view_height"));
    ASSERT_EQ(world.player(0).damage_taken, std::stoi(row.at("damage_taken")));
  }
}

class MovementGolden : public ::testing::TestWithParam<const char*> {};

TEST_P(MovementGolden, FollowsTheTraceBitForBit) {
  World world = room_of_the_traces();
  follow(world, load_trace(GetParam()));
}

INSTANTIATE_TEST_SUITE_P(OpenFloor, MovementGolden,
                         ::testing::Values("walk_forward", "diagonal_walk", "strafe_left_walk", "run_forward",
                                           "turn_left_key", "turn_taps", "turn_while_running", "jump",
                                           "wall_head_on_run", "wall_slide_run", "mixed_script"),
                         [](const auto& trace) { return std::string(trace.param); });

}  // namespace movement_golden_test
}  // namespace comrad::doom
