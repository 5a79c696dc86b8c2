#include "scenarios/stealth_labyrinth/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <string>

#include "doomgen/layout/map_plan.h"
#include "doomgen/layout/reachability.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::stealth_labyrinth {
namespace {

using doomgen::Box;
using doomgen::MapPlan;
using doomgen::Point;

constexpr int32_t kCeiling = 192;
constexpr int32_t kStartSide = 320, kHubSide = 448;
constexpr Point kStartCentre{0, -560};
constexpr int32_t kStartsApart = 80;  // torch and gunner
constexpr int32_t kFirstRoomDistance = 980, kRoomGap = 128;
constexpr int32_t kCellUnits = 54;  // the published generator's; a corridor of w cells is 2w - 1 across
constexpr int32_t kFieldMargin = 512, kFieldCells = 16'000;  // of organic outlines
constexpr int32_t kRoomMargin = 64;  // the torch lights a room or corridor from this far outside it
constexpr int32_t kHallMargin = 72;  // start room and hub
constexpr int32_t kStartLight = 224, kHubLight = 160, kStartCorridorLight = 160, kRoomLight = 224,
                  kCorridorLight = 176;
constexpr int32_t kLampJitter = 24;       // lamps stand this far from their published places at most
constexpr int32_t kTurretClearance = 26;  // the radius of a turret and a little
constexpr int kBullets = 240;             // of the gunner, for good
constexpr int32_t kTechLamp = 85, kTallRedPillar = 32, kFloorLamp = 2028;

/// A branch goes north, west or east; `forward` along it, `left` to the left of that.
Point along(int branch, int32_t forward, int32_t left) {
  switch (branch) {
    case 0:
      return {-left, forward};
    case 1:
      return {-forward, -left};
    default:
      return {forward, left};
  }
}
int32_t heading(int branch) { return branch == 0 ? 90 : branch == 1 ? 180 : 0; }

Box box_between(Point a, Point b) {
  return {{std::min(a.x, b.x), std::min(a.y, b.y)}, {std::max(a.x, b.x), std::max(a.y, b.y)}};
}

}  // namespace

Plan plan(const LayoutDraw& draw) {
  Plan plan;
  plan.start = Box::around(kStartCentre, kStartSide, kStartSide);
  plan.hub = Box::around({0, 0}, kHubSide, kHubSide);
  const int32_t width = draw.value32("room_width"), length = draw.value32("room_length");
  // Wide corridors must leave a corner of wall in the rooms and the start room.
  const int32_t across = (2 * draw.value32("corridor") - 1) * kCellUnits;
  const int32_t start_across = std::min(across, kStartSide - 64), room_across = std::min(across, width - 64);
  plan.start_corridor = {{-start_across / 2, plan.start.high.y}, {start_across / 2, plan.hub.low.y}};
  Rng turrets(draw.key.split("turrets")), lamps(draw.key.split("lamps"));
  const int room_count = draw.value32("rooms");
  for (int branch = 0; branch < draw.value32("branches"); ++branch) {
    for (int index = 0; index < room_count; ++index) {
      Room room;
      room.branch = branch, room.index = index;
      const int32_t middle = kFirstRoomDistance + (length + kRoomGap) * index;
      const int32_t near = middle - length / 2, far = middle + length / 2;
      const int32_t before = index == 0 ? kHubSide / 2 : near - kRoomGap;
      room.centre = along(branch, middle, 0);
      room.box = box_between(along(branch, near, -width / 2), along(branch, far, width / 2));
      room.corridor =
          box_between(along(branch, before, -room_across / 2), along(branch, near, room_across / 2));
      room.turret_health = draw.value32(index == 0 ? "first_health" : "health");

      const int32_t margin = index == 0 ? draw.value32("first_margin") : 144;
      const int count =
          room_count == 1
              ? 1
              : turrets.between(draw.value32("turrets_low"),
                                std::max(draw.value32("turrets_low"), draw.value32("turrets_high")));
      room.turrets.push_back(along(branch, middle + length / 2 - margin, 0));
      if (count > 1) room.turrets.push_back(along(branch, middle + length / 2 - margin - 96, width / 4));

      const auto lamp = [&](int32_t forward, int32_t left) {
        left += lamps.between(-kLampJitter, kLampJitter);
        forward += lamps.between(-kLampJitter, kLampJitter);
        return along(branch, forward, left);
      };
      const int32_t side = std::min(120, width / 4);
      const int32_t back = std::min(220, length / 4), front = std::min(60, length / 6);
      room.lamps.push_back(lamp(middle - back, side));
      room.lamps.push_back(lamp(middle + front, -side));
      plan.rooms.push_back(std::move(room));
    }
  }
  return plan;
}

namespace {

/// The gunner's bullets against the turrets. A bullet takes 5, 10 or 15, so that a turret of `health` takes
/// (health + 10 / 3) / 10 of them on average; and some miss.
Status check_bullets(int64_t health, int64_t turrets) {
  constexpr int64_t kHits = 85;  // of 100 bullets
  const int64_t hits = (3 * health + 10 * turrets) / 30;
  if (100 * hits <= kHits * kBullets) return {};
  return Error{ErrorCode::kBadInput,
               fmt::format("{} turrets of {} health in all take {} hits, and of the gunner's {} bullets {} % "
                           "hit; lower health, first_health, turrets_low, turrets_high, rooms or branches",
                           turrets, health, hits, kBullets, kHits)};
}

/// With as few turrets as may be drawn; draw_layout() looks at those that were.
Status check_resources(const LayoutTask& task) {
  const int64_t rooms = task.value("rooms"), each = rooms == 1 ? 1 : task.value("turrets_low"),
                branches = task.value("branches");
  return check_bullets(branches * each * (task.value("first_health") + (rooms - 1) * task.value("health")),
                       branches * rooms * each);
}

LayoutParameter start_at_parameter() {
  return {"start_at",
          0,
          0,
          4,
          "where agents start: 0 the start room, 1 its corridor, 2 the hub, 3 its far edge, 4 the corridor "
          "after it",
          /*hide_default=*/true};
}

/// Between the two agents, who look north.
Point start_of(const LayoutDraw& draw, const Plan& where) {
  const Box& corridor = where.rooms.front().corridor;
  switch (draw.value("start_at")) {
    case 0:
      return {0, kStartCentre.y - 32};
    case 1:
      return {0, (where.start_corridor.low.y + where.start_corridor.high.y) / 2};
    case 2:
      return {0, where.hub.low.y + kHubSide / 4};  // before the pillar
    case 3:
      return {0, where.hub.high.y - kRoomMargin / 2};  // whence the torch lights the corridor already
    default:
      return {0, (corridor.low.y + corridor.high.y) / 2};
  }
}

struct Areas {
  std::vector<int64_t> tag, light, left, right, bottom, top;
  void add(int32_t area_tag, int32_t level, const Box& box, int32_t margin) {
    const Box lit = box.grown(margin);
    tag.push_back(area_tag), light.push_back(level);
    left.push_back(lit.low.x), right.push_back(lit.high.x), bottom.push_back(lit.low.y),
        top.push_back(lit.high.y);
  }
};

Status check(const Plan& plan, const doomgen::MapData& map, Point start) {
  const doomgen::Reachability walk(map, std::span(&start, 1));
  for (const Room& room : plan.rooms) {
    const std::string name = fmt::format("room {} of branch {}", room.index, room.branch);
    if (!walk.reaches(room.centre))
      return Error{ErrorCode::kBadInput, "stealth_labyrinth: " + name + " is cut off"};
    const doomgen::Region inside{room.box.polygon(), {}};
    for (const Point& turret : room.turrets)
      if (!doomgen::clear_inside(inside, turret, kTurretClearance))
        return Error{ErrorCode::kBadInput, "stealth_labyrinth: a turret of " + name + " has no room"};
  }
  return {};
}

Expected<DrawnLayout> draw_layout(const LayoutDraw& draw) {
  const Plan where = plan(draw);
  int64_t turret_health = 0, turrets = 0;
  for (const Room& room : where.rooms) {
    turrets += static_cast<int64_t>(room.turrets.size());
    turret_health += static_cast<int64_t>(room.turrets.size()) * room.turret_health;
  }
  if (const Status enough = check_bullets(turret_health, turrets); !enough)
    return Error{enough.error().code, "stealth_labyrinth: " + enough.error().message};
  MapPlan map;
  std::vector<Point> corners{where.start.low, where.start.high, where.hub.low, where.hub.high};
  for (const Room& room : where.rooms) corners.push_back(room.box.low), corners.push_back(room.box.high);
  use_organic_outlines(map, draw, doomgen::bounds_of(corners).grown(kFieldMargin), kFieldCells);
  Areas areas;
  const auto area = [&](std::string name, int32_t tag, const Box& box, const char* floor, const char* wall) {
    map.add_area({.name = std::move(name),
                  .ceiling = kCeiling,
                  .floor_texture = floor,
                  .ceiling_texture = "CEIL3_5",
                  .wall_texture = wall,
                  .light = 0,
                  .tag = tag},
                 box);
  };
  area("start", kStartTag, where.start, "FLOOR4_8", "STONE2");
  area("hub", kHubTag, where.hub, "FLOOR4_8", "STONE2");
  area("start corridor", kStartCorridorTag, where.start_corridor, "FLOOR4_8", "METAL1");
  areas.add(kStartTag, kStartLight, where.start, kHallMargin);
  areas.add(kHubTag, kHubLight, where.hub, kHallMargin);
  areas.add(kStartCorridorTag, kStartCorridorLight, where.start_corridor, kRoomMargin);

  std::vector<int64_t> room_x, room_y, room_branch, first_turret, end_turret, health;
  for (std::size_t i = 0; i < where.rooms.size(); ++i) {
    const Room& room = where.rooms[i];
    const auto number = static_cast<int32_t>(i);
    area(fmt::format("room {}", i), kFirstRoomTag + number, room.box, "FLOOR5_2", "METAL1");
    area(fmt::format("corridor {}", i), kFirstCorridorTag + number, room.corridor, "FLOOR4_8", "METAL1");
    areas.add(kFirstRoomTag + number, kRoomLight, room.box, kRoomMargin);
    areas.add(kFirstCorridorTag + number, kCorridorLight, room.corridor, kRoomMargin);
    room_x.push_back(room.centre.x), room_y.push_back(room.centre.y), room_branch.push_back(room.branch);
    first_turret.push_back(static_cast<int64_t>(health.size()));
    for (const Point& turret : room.turrets) {
      map.add_spot(kFirstSpotId + static_cast<int32_t>(health.size()), turret,
                   (heading(room.branch) + 180) % 360);
      health.push_back(room.turret_health);
    }
    end_turret.push_back(static_cast<int64_t>(health.size()));
    for (const Point& lamp : room.lamps) map.add_thing({.position = lamp, .editor_number = kFloorLamp});
  }

  const Point start = start_of(draw, where);
  const Point torch{start.x - kStartsApart / 2, start.y}, gunner{start.x + kStartsApart / 2, start.y};
  map.add_start(1, torch, 90);
  map.add_start(2, gunner, 90);
  map.add_thing({.position = {-96, -592}, .editor_number = kTechLamp});
  map.add_thing({.position = {96, -592}, .editor_number = kTechLamp});
  map.add_thing({.position = {0, 0}, .editor_number = kTallRedPillar});

  COMRAD_TRY_ASSIGN(doomgen::MapData data, map.build());
  COMRAD_TRY(check(where, data, torch));
  return DrawnLayout{.map = std::move(data),
                     .defines = {{"BULLETS", kBullets},
                                 {"AREA_COUNT", static_cast<int64_t>(areas.tag.size())},
                                 {"ROOM_COUNT", static_cast<int64_t>(where.rooms.size())},
                                 {"TURRET_COUNT", static_cast<int64_t>(health.size())}},
                     .arrays = {{"area_tag", areas.tag},
                                {"area_light", areas.light},
                                {"area_left", areas.left},
                                {"area_right", areas.right},
                                {"area_bottom", areas.bottom},
                                {"area_top", areas.top},
                                {"room_x", room_x},
                                {"room_y", room_y},
                                {"room_branch", room_branch},
                                {"room_first_turret", first_turret},
                                {"room_end_turret", end_turret},
                                {"turret_health", health}}};
}

/// Stages of our own towards the default map, on which nobody ever hits a turret by chance, so that a pair learns to
/// hide. They start where the turret is (a reverse curriculum: Florensa et al. 2017, arXiv:1707.05300), which is weak
/// and falls at a bullet; then the turret takes more bullets, hits harder and stands further away, and last the pair
/// has to come to it.
CurriculumRecipe curriculum() {
  return {.parameters = {"start_at", "rooms", "strength", "first_health", "first_margin", "room_length"},
          .stages = {{"one_bullet", 42, {4, 1, 0, 10, 640, 768}},
                     {"three_bullets", 42, {4, 1, 0, 30, 560, 768}},
                     {"it_hurts", 42, {4, 1, 1, 60, 480, 832}},
                     {"far_away", 42, {4, 1, 1, 90, 320, 896}},
                     {"hubs_far_edge", 42, {3, 1, 1, 90, 320, 896}},
                     {"from_the_hub", 42, {2, 1, 1, 90, 320, 896}},
                     {"start_corridor", 42, {1, 1, 1, 90, 320, 896}},
                     {"first_room", 42, {0, 1, 1, 90, 320, 896}},
                     {"both_rooms", 42, {0, 2, 1, 90, 320, 896}}}};
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = {{"branches", 1, 1, 3, "branches from the hub: north, west, east (axis: 1, 2, 3)"},
                         {"rooms", 2, 1, 3, "rooms of each branch (axis: 1, 2, 3)"},
                         {"room_width", 416, 256, 1024, "units across a branch (axis: 384, 416, 512)"},
                         {"room_length", 896, 768, 1536, "units along a branch (axis: 768, 896, 1024)"},
                         {"corridor", 4, 2, 8,
                          "width of corridors w: (2w - 1) x 54 units, less than a room's (axis: 5, 4, 3)"},
                         {"turrets_low", 1, 1, 2, "turrets of a room at least (axis: 1, 1, 2)"},
                         {"turrets_high", 1, 1, 2, "turrets of a room at most, drawn (axis: 1, 2, 2)"},
                         {"strength", 1, 0, 2, "bolts: 0 slow and weak, 1, 2 fast, strong, three to a burst"},
                         {"health", 140, 1, 10'000, "health of a turret (axis: 120, 140, 180)"},
                         {"first_health", 90, 1, 10'000,
                          "the same in the first room of a branch (axis: 70, 110)"},
                         {"first_margin", 320, 32, 640,
                          "units from a first room's turret to the far wall (axis: 360, 280)"},
                         start_at_parameter(),
                         organic_parameter()},
          .draw = draw_layout,
          .axes = {{"branches", {{{"branches", 1}}, {{"branches", 2}}, {{"branches", 3}}}},
                   {"rooms", {{{"rooms", 1}}, {{"rooms", 2}}, {{"rooms", 3}}}},
                   {"geometry",
                    {{{"room_width", 384}, {"room_length", 768}, {"corridor", 5}},
                     {{"room_width", 416}, {"room_length", 896}, {"corridor", 4}},
                     {{"room_width", 512}, {"room_length", 1024}, {"corridor", 3}}}},
                   {"group",
                    {{{"turrets_low", 1}, {"turrets_high", 1}},
                     {{"turrets_low", 1}, {"turrets_high", 2}},
                     {{"turrets_low", 2}, {"turrets_high", 2}}}},
                   {"turret",
                    {{{"strength", 0}, {"health", 120}},
                     {{"strength", 1}, {"health", 140}},
                     {{"strength", 2}, {"health", 180}}}},
                   {"first_room",
                    {{{"first_health", 70}, {"first_margin", 360}},
                     {{"first_health", 110}, {"first_margin", 280}}}}},
          .curriculum = curriculum(),
          .check_resources = check_resources};
}

}  // namespace comrad::scenarios::stealth_labyrinth
