#include "scenarios/rhythm_sync/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>

#include "doomgen/layout/picture.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::rhythm_sync {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kDoorThickness = 32, kFirstDoorTagA = 1100, kFirstDoorTagB = 2100;
constexpr int32_t kWidthMin = 256, kNicheMargin = 48;
constexpr int32_t kFirstRoomTagA = 1000, kFirstRoomTagB = 2000;

/// What the seed varies of a room where `variety` is 1; as published otherwise.
struct Room {
  int32_t west = 0, east = 0;
  const char* floor = "FLAT19";
  const char* ceiling = "PLANET1";
  const char* walls = "SILVER1";
  int32_t light = 160;
  struct Niche {
    int32_t west = 0, east = 0, depth = 0;  ///< in the outer wall; depth 0: none
  };
  Niche niche[2] = {};  ///< of lane A and B
};

/// Rooms 0 (start), 1..stages, stages + 1 (exit), the first one's centre at x = 0.
std::vector<Room> draw_rooms(const LayoutDraw& wanted) {
  const int32_t width = wanted.value32("room_width");
  const bool varies = wanted.value("variety") != 0;
  Rng shape(wanted.key.split("shape")), look(wanted.key.split("look"));
  std::vector<Room> rooms;
  for (int32_t i = 0; i <= wanted.value32("stages") + 1; ++i) {
    Room room;
    room.west = rooms.empty() ? -width / 2 : rooms.back().east;
    room.east = room.west + width;
    if (varies) {
      if (i > 0) room.east = room.west + std::max(kWidthMin, width + stepped(-64, 64, 16, shape));
      for (Room::Niche& niche : room.niche) {
        niche.depth = stepped(0, 48, 16, shape);
        niche.west = room.west + kNicheMargin + 8 * shape.between(0, 6);
        niche.east = niche.west + stepped(48, 80, 8, shape);
      }
      constexpr const char* kFloors[] = {"FLAT19", "FLOOR4_8", "FLAT5_4", "FLOOR0_1", "FLAT1", "MFLR8_1"};
      constexpr const char* kCeilings[] = {"PLANET1", "CEIL3_5", "CEIL5_2", "FLAT10"};
      constexpr const char* kWalls[] = {"SILVER1", "SILVER2", "METAL1", "GRAY7", "STARTAN3", "BROWN96"};
      room.floor = one_of(kFloors, look);
      room.ceiling = one_of(kCeilings, look);
      room.walls = one_of(kWalls, look);
      room.light = stepped(128, 208, 8, look);
    }
    rooms.push_back(room);
  }
  return rooms;
}

AreaSpec room_spec(std::string name, int32_t tag, const Room& room) {
  return {.name = std::move(name),
          .floor_texture = room.floor,
          .ceiling_texture = room.ceiling,
          .wall_texture = room.walls,
          .light = room.light,
          .tag = tag};
}

/// What the script shows: the beat, a border of 9 on a screen of 160 x 120, and whole screens of one colour.
std::vector<NamedBytes> pictures() {
  constexpr int kWidth = 160, kHeight = 120, kBorder = 9;
  constexpr Colour kRed{200, 0, 0, 255}, kGreen{0, 160, 0, 255}, kClear{0, 0, 0, 0};
  Picture frame(kWidth, kHeight, kRed);
  for (int y = kBorder; y < kHeight - kBorder; ++y)
    for (int x = kBorder; x < kWidth - kBorder; ++x) frame.at(x, y) = kClear;
  return {{"RSFRAME", encode_png(frame)},
          {"RSRED", encode_png(Picture(8, 6, kRed))},
          {"RSGREEN", encode_png(Picture(8, 6, kGreen))}};
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t stages = wanted.value32("stages"), height = wanted.value32("room_height");
  std::vector<Room> rooms = draw_rooms(wanted);
  // Room 0 stands at x = 0 unless the lanes are too long for that: then all of it moves west.
  const int32_t origin = std::min(0, kMaxCoordinate - 64 - rooms.back().east);
  for (Room& room : rooms) {
    room.west += origin, room.east += origin;
    for (Room::Niche& niche : room.niche) niche.west += origin, niche.east += origin;
  }
  MapPlan plan;
  // Rooms 0 (start), 1..stages, stages + 1 (exit) of lane A (north) and B; rooms reach to the doors at
  // their east.
  std::vector<AreaId> lane_a, lane_b;
  for (int32_t i = 0; i <= stages + 1; ++i) {
    const Room& room = rooms[i];
    const std::string number = std::to_string(i);
    lane_a.push_back(plan.add_area(room_spec("A" + number, kFirstRoomTagA + i, room),
                                   Box{{room.west, 0}, {room.east, height}}));
    lane_b.push_back(plan.add_area(room_spec("B" + number, kFirstRoomTagB + i, room),
                                   Box{{room.west, -height}, {room.east, 0}}));
    if (const Room::Niche& niche = room.niche[0]; niche.depth > 0)
      plan.extend_area(lane_a.back(), Box{{niche.west, height}, {niche.east, height + niche.depth}});
    if (const Room::Niche& niche = room.niche[1]; niche.depth > 0)
      plan.extend_area(lane_b.back(), Box{{niche.west, -height - niche.depth}, {niche.east, -height}});
    const bool is_stage = i >= 1 && i <= stages;
    plan.connect(lane_a.back(), lane_b.back(), is_stage ? Passage::window() : Passage::solid());
  }
  std::vector<int32_t> door_tags;
  for (int32_t i = 1; i <= stages; ++i) {
    const int32_t east = rooms[i].east;
    AreaSpec door{.floor_texture = "GATE1",
                  .ceiling_texture = "GATE1",
                  .wall_texture = "DOORTRAK",
                  .upper_texture = "BIGDOOR2",
                  .lines = {.lower_unpegged = true}};
    door.name = fmt::format("door A{}", i), door.tag = kFirstDoorTagA + i;
    const AreaId a = plan.add_door(door, Box{{east - kDoorThickness, 0}, {east, height}});
    door.name = fmt::format("door B{}", i), door.tag = kFirstDoorTagB + i;
    const AreaId b = plan.add_door(door, Box{{east - kDoorThickness, -height}, {east, 0}});
    plan.connect(a, b, Passage::solid());
    door_tags.push_back(kFirstDoorTagA + i), door_tags.push_back(kFirstDoorTagB + i);
  }
  plan.add_start(1, {origin - 80, height / 2}, 0);
  plan.add_start(2, {origin - 80, -height / 2}, 0);

  COMRAD_TRY_ASSIGN(MapData map, plan.build());
  COMRAD_TRY(check_starts(map, 2));
  const std::vector<Point> starts = start_points(map);
  const MapData open = with_open_sectors(map, door_tags);
  const Point end_a = plan.centroid(lane_a.back()), end_b = plan.centroid(lane_b.back());
  COMRAD_TRY(check_reaches(open, std::span(&starts[0], 1), std::span(&end_a, 1), "the exit of lane A"));
  COMRAD_TRY(check_reaches(open, std::span(&starts[1], 1), std::span(&end_b, 1), "the exit of lane B"));
  COMRAD_TRY(check_separated(open, std::span(&starts[0], 1), std::span(&end_b, 1), "the exit of lane B"));
  const auto middle_of = [&](int32_t i) { return (rooms[i].west + rooms[i].east) / 2; };
  const Point second{middle_of(2), height / 2};
  COMRAD_TRY(check_separated(map, std::span(&starts[0], 1), std::span(&second, 1), "stage 2"));
  std::vector<int64_t> room_x, room_width;
  for (int32_t i = 0; i <= stages + 1; ++i) {
    room_x.push_back(middle_of(i));
    room_width.push_back(rooms[i].east - rooms[i].west);
  }
  return DrawnLayout{.map = std::move(map),
                     .defines = {{"DOOR_A_FIRST", kFirstDoorTagA}, {"DOOR_B_FIRST", kFirstDoorTagB}},
                     .arrays = {{"room_x", room_x}, {"room_width", room_width}},
                     .textures = pictures()};
}

}  // namespace

LayoutRecipe recipe() {
  return {
      .parameters =
          {{"stages", 20, 1, 28, "stages (axis: 20, 24, 28)"},
           {"regular", 8, 0, 28, "stages with a regular beat (axis: 6, 8, 10)"},
           {"jittered", 6, 0, 28, "stages with a jittered beat after them (axis: 3, 5, 7)"},
           {"beat", 72, 1, 1000, "tics between beats (axis: 84, 72, 60)"},
           {"beat_jitter", 24, 0, 500, "tics that a jittered beat is off at most (axis: 12, 24, 36)"},
           {"window_start", 16, 1, 500, "tics between the two presses, first stage (axis: 20, 16, 12)"},
           {"window_floor", 8, 1, 500, "tics that the window never falls below (axis: 10, 8, 6)"},
           {"window_decay", 1, 0, 100, "tics that it shrinks with a stage (axis: 1, 1, 2)"},
           {"room_width", 512, 256, 576, "length of a room, units (axis: 448, 512, 576)"},
           {"room_height", 256, 160, 512, "width of a lane, units (axis: 224, 256, 288)"},
           {"use_range", 64, 16, 128, "units to a switch along each axis (axis: 56, 64, 72)"},
           {"wall_margin", 32, 0, 64, "units that switches keep from walls (axis: 48, 32, 20)"},
           {"intro_stages", 8, 0, 28, "stages whose switches stay near the base (axis: 10, 8, 6)"},
           {"intro_jitter", 125, 0, 1000, "thousandths of the limits they move (axis: 50, 125, 250)"},
           {"extra_draws", 0, 0, 1000, "random draws before the positions (axis: 0, 37, 73)"},
           variety_parameter("1: lengths of rooms, niches in their outer walls, textures and light come from "
                             "the seed (pools set it)")},
      .draw = draw,
      .axes = {{"stages", {{{"stages", 20}}, {{"stages", 24}}, {{"stages", 28}}}},
               {"types",
                {{{"regular", 6}, {"jittered", 3}},
                 {{"regular", 8}, {"jittered", 5}},
                 {{"regular", 10}, {"jittered", 7}}}},
               {"timing",
                {{{"beat", 84},
                  {"beat_jitter", 12},
                  {"window_start", 20},
                  {"window_floor", 10},
                  {"window_decay", 1}},
                 {{"beat", 72},
                  {"beat_jitter", 24},
                  {"window_start", 16},
                  {"window_floor", 8},
                  {"window_decay", 1}},
                 {{"beat", 60},
                  {"beat_jitter", 36},
                  {"window_start", 12},
                  {"window_floor", 6},
                  {"window_decay", 2}}}},
               {"size",
                {{{"room_width", 448}, {"room_height", 224}, {"use_range", 56}},
                 {{"room_width", 512}, {"room_height", 256}, {"use_range", 64}},
                 {{"room_width", 576}, {"room_height", 288}, {"use_range", 72}}}},
               {"positions",
                {{{"wall_margin", 48}, {"intro_stages", 10}, {"intro_jitter", 50}, {"extra_draws", 0}},
                 {{"wall_margin", 32}, {"intro_stages", 8}, {"intro_jitter", 125}, {"extra_draws", 37}},
                 {{"wall_margin", 20}, {"intro_stages", 6}, {"intro_jitter", 250}, {"extra_draws", 73}}}}},
      .pool_values = {{"variety", 1}}};
}

}  // namespace comrad::scenarios::rhythm_sync
