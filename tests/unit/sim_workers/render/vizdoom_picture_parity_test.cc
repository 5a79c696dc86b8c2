// Our pictures beside those that ViZDoom's pip package draws now, on its own maps along a script of moves,
// with and without monsters. Play is not what is compared: every frame takes pose and actors from ViZDoom.
// COMRAD_PICTURES=DIR writes theirs (left) and ours (right).

#include <cmath>
#include <cstdlib>
#include <map>
#include <sstream>

#include "scenarios/spec/registry.h"
#include "tests/support/scratch_folder.h"
#include "tests/support/vizdoom_python.h"
#include "tests/unit/sim_workers/render/vizdoom_pictures.h"

namespace comrad::doom {
namespace vizdoom_picture_parity_test {

/// A CSV by column name.
std::vector<std::map<std::string, std::string>> read_csv(const std::string& path) {
  std::vector<std::map<std::string, std::string>> rows;
  std::ifstream file(path);
  std::string line, field;
  std::vector<std::string> names;
  while (std::getline(file, line)) {
    if (line.empty() || line[0] == '#') continue;
    std::istringstream fields(line);
    std::map<std::string, std::string> row;
    for (std::size_t column = 0; std::getline(fields, field, ','); ++column) {
      if (names.size() == column && rows.empty() && row.empty())
        names.push_back(field);
      else if (column < names.size())
        row[names[column]] = field;
    }
    if (!row.empty()) rows.push_back(std::move(row));
  }
  return rows;
}

Fixed fixed_of(const std::string& text) {
  return static_cast<Fixed>(std::llround(std::stod(text) * 65536.0));
}

Angle angle_of(const std::string& text) {
  return static_cast<Angle>(static_cast<int64_t>(std::llround(std::stod(text) / 360.0 * 4294967296.0)));
}

/// Everything but the player's body goes; what ViZDoom saw comes, bodies that players left behind as well.
void place_things(const std::vector<std::map<std::string, std::string>>& things, const std::string& t,
                  World& world) {
  for (std::size_t i = 0; i < world.actors().size(); ++i)
    if (world.actors()[i].player_index < 0) world.state().actors[i].removed = true;
  for (const auto& thing : things) {
    if (thing.at("t") != t) continue;
    const std::optional<uint32_t> type = world.catalog().find(thing.at("name"));
    if (!type) continue;  // what shows nothing: fog, markers of the engine's own
    const Fixed x = fixed_of(thing.at("x")), y = fixed_of(thing.at("y"));
    const Actor& own = world.body(0);
    if (thing.at("name") == "DoomPlayer" && std::abs(x - own.x) + std::abs(y - own.y) < to_fixed(2)) continue;
    world.spawn_unchecked(*type, x, y, fixed_of(thing.at("z")), angle_of(thing.at("angle")));
  }
}

class VizdoomPictureParity : public ::testing::Test {
 protected:
  void SetUp() override {
    const Expected<std::string> python = test_python();
    if (!python) GTEST_SKIP() << python.error().message;
    if (const auto art = ArtArchive::open(); !art) GTEST_SKIP() << art.error().message;
    python_ = *python;
    scenarios_ =
        shell("'" + python_ + "' -c 'import os, vizdoom; print(os.path.dirname(vizdoom.__file__))'") +
        "/scenarios/";
    iwad_ = wad::find_iwad("").value();
  }
  void TearDown() override { edges_.expect_few(); }

  static Expected<std::string> test_python() {
    static const Expected<std::string> python = comrad::test::vizdoom_python();
    return python;
  }

  static std::string shell(const std::string& command) {
    std::string text;
    if (FILE* const pipe = ::popen(command.c_str(), "r")) {
      char part[256];
      while (std::fgets(part, sizeof part, pipe) != nullptr) text += part;
      ::pclose(pipe);
    }
    while (!text.empty() && text.back() == '\n') text.pop_back();
    return text;
  }

  struct Case {
    std::string scenario;
    bool monsters = true;
    std::string at;
    bool hud = false;
    std::string map;  ///< empty: the cfg's
    double limit = 12.0;
    double equal = 0.99;      ///< share of pixels that are ViZDoom's, over all views
    std::string folder = {};  ///< of the cfg and its WAD; empty: the package's
  };

  void compare(const Case& wanted) {
    const std::string label = wanted.scenario + wanted.map + (wanted.monsters ? "" : "_nomonsters");
    const std::string out = folder_ / label;
    const std::string source = std::string(COMRAD_SOURCE_DIR) + "/tests/golden/render/vizdoom/";
    const std::string games = wanted.folder.empty() ? scenarios_ : wanted.folder + "/";
    const std::string config = games + wanted.scenario + ".cfg";
    std::string command = "timeout 100 '" + python_ + "' -B '" + source + "record.py' '" + config + "' '" +
                          out + "' --at " + wanted.at + " --script '" + source + "walk.csv' --iwad '" +
                          iwad_ + "'";
    if (!wanted.monsters) command += " --no_monsters";
    if (wanted.hud) command += " --hud";
    if (!wanted.map.empty()) command += " --map " + wanted.map;
    ASSERT_TRUE(comrad::test::runs_well(command)) << command;

    trace::GameOptions options;
    // The same cfg, with what the recorder changed.
    const std::vector<uint8_t> text = test::file_bytes(config);
    const std::string changed = folder_ / (wanted.scenario + ".cfg");
    std::ofstream(changed) << std::string(text.begin(), text.end())
                           << "\nrender_hud = " << (wanted.hud ? "true" : "false")
                           << "\nrender_crosshair = false\nrender_screen_flashes = false\n"
                           << (wanted.map.empty() ? "" : "doom_map = " + wanted.map + "\n");
    for (const auto& entry : std::filesystem::directory_iterator(games))
      if (entry.path().extension() == ".wad" && !std::filesystem::exists(folder_ / entry.path().filename()))
        std::filesystem::create_symlink(entry.path(), folder_ / entry.path().filename());
    options.target = changed;
    options.no_monsters = !wanted.monsters;
    const auto game = trace::open_trace_game(options);
    ASSERT_TRUE(game.has_value()) << game.error().message;
    (*game)->iwad_path = iwad_;
    auto painter = test::ReferencePainter::create(**game, iwad_);
    ASSERT_TRUE(painter.has_value()) << painter.error().message;
    (*game)->reset(1);
    World& world = (*game)->world();
    const auto rows = read_csv(out + "/trace.csv"), things = read_csv(out + "/things.csv");
    const char* pictures = std::getenv("COMRAD_PICTURES");
    int views = 0;
    double equal = 0;
    for (const auto& row : rows) {
      const int t = std::stoi(row.at("t"));
      if ((*game)->finished()) break;
      if (t > 0) (*game)->step({});  // the weapon rises and swings by the clock
      char stem[32];
      std::snprintf(stem, sizeof stem, "/frame_t%03d", t);
      if (!std::filesystem::exists(out + stem + ".png")) continue;
      trace::Pose pose;
      pose.x = fixed_of(row.at("POSITION_X")), pose.y = fixed_of(row.at("POSITION_Y"));
      pose.z = fixed_of(row.at("POSITION_Z"));
      pose.angle = angle_of(row.at("ANGLE")), pose.pitch = angle_of(row.at("PITCH"));
      trace::set_pose(world, pose);
      world.state().players[0].view_z = pose.z + fixed_of(row.at("VIEW_HEIGHT"));
      place_things(things, row.at("t"), world);
      const std::string folder = pictures == nullptr ? "" : std::string(pictures) + "/" + label;
      const auto difference = painter->compare(world, out + stem, folder);
      ASSERT_TRUE(difference.has_value()) << difference.error().message;
      const std::string name = label + " t" + std::to_string(t);
      test::ReferencePainter::print(name, *difference);
      test::ReferencePainter::expect_alike(name, *difference, wanted.limit);
      edges_.add(*difference);
      equal += difference->equal_share;
      ++views;
    }
    ASSERT_GT(views, 0);
    EXPECT_GE(equal / views, wanted.equal) << label;
  }

  std::string python_, scenarios_, iwad_;
  const comrad::test::ScratchFolder folder_;
  test::EdgeCount edges_;
};

const char* const kRecorded = "0,1,35,175";

TEST_F(VizdoomPictureParity, OnTheRecordedPosesWithoutMonsters) {
  test::ReferencePainter::print_header();
  for (const char* scenario : {"basic", "health_gathering", "my_way_home"})
    compare({.scenario = scenario, .monsters = false, .at = kRecorded, .map = ""});
}

TEST_F(VizdoomPictureParity, OnTheRecordedPosesWithMonsters) {
  test::ReferencePainter::print_header();
  for (const char* scenario : {"basic", "health_gathering", "my_way_home"})
    compare({.scenario = scenario, .at = kRecorded, .map = ""});
}

TEST_F(VizdoomPictureParity, OnLargerMapsWithStatusBar) {
  test::ReferencePainter::print_header();
  for (const char* scenario : {"deadly_corridor", "health_gathering_supreme", "deathmatch", "take_cover"})
    compare({.scenario = scenario, .monsters = false, .at = "0,35,105,175,240,300", .hud = true, .map = ""});
}

TEST_F(VizdoomPictureParity, OnOurScenarios) {
  test::ReferencePainter::print_header();
  const comrad::test::ScratchFolder games;
  for (const std::string& name : scenarios::layout_recipes()) {
    if (name == "lava_maze") continue;  // over at once where one plays alone
    scenarios::LayoutRequest request;
    if (name == "platform_chain")
      request.parameters = {{"safe_min", "96"}, {"safe_max", "96"}};  // no lifts by chance
    const auto layout = scenarios::generate_layout(name, request);
    ASSERT_TRUE(layout.has_value()) << layout.error().message;
    games.write(name + ".wad", layout->wad);
    games.write(name + ".cfg", "doom_scenario_path = " + name +
                                   ".wad\ndoom_map = MAP01\navailable_buttons = { ATTACK }\nmode = PLAYER\n");
    // Until the scripts of both engines draw different lots; Co-op Puzzle's plates are drawn at once.
    compare({.scenario = name,
             .at = "3,20",
             .hud = true,
             .map = "",
             .equal = name == "coop_puzzle" || name == "platform_chain" ? 0.97 : 0.985,
             .folder = games / ""});
  }
}

TEST_F(VizdoomPictureParity, OnMapsOfTheIwad) {
  test::ReferencePainter::print_header();
  // MAP07 shows a message, MAP29 torches whose flames ViZDoom starts by chance.
  for (const auto& [map, equal] :
       {std::pair{"MAP01", 0.98}, {"MAP02", 0.98}, {"MAP07", 0.92}, {"MAP15", 0.975}, {"MAP29", 0.9}})
    compare({.scenario = "freedoom2",
             .monsters = false,
             .at = "1,35,105,200,240,300",
             .hud = true,
             .map = map,
             .equal = equal});
}

}  // namespace vizdoom_picture_parity_test
}  // namespace comrad::doom
