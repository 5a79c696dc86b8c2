#include "scenarios/armory_siege/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <numbers>
#include <vector>

#include "scenarios/spec/variety.h"

namespace comrad::scenarios::armory_siege {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kHall = 512, kRoom = 384, kDoorThickness = 32, kFirstDoorTag = 10, kFirstRoomTag = 20,
                  kFirstCorridorTag = 30, kHallTag = 40;
constexpr int32_t kBodies = 32;  // the radii of a player and the core
constexpr int kCoreSpots = 5, kAgentSpots = 10, kItemSpots = 5,
              kEnemySpots = 5;  // items, enemies: of each room, corridor
constexpr int64_t kDistance = 600, kWindow = 300, kCoreHealth = 1000,
                  kDifficulty = 500;  // of the default map
/// Nearer rooms would touch the hall beside their doors.
constexpr int32_t kNearestRoom = 592;
constexpr int32_t kCorridorReserve = 24;  ///< further off where rooms and corridors vary

/// What the seed varies where `variety` is 1; as published otherwise.
struct Variety {
  Point centre[3];   ///< of rooms A, B, C
  Point towards[3];  ///< from the hall's middle, at 2^30 = 1 unit: where their corridors lead
  int32_t side[3] = {kRoom, kRoom, kRoom}, corridor[3] = {};
  const char* floor[3] = {"CEIL5_2", "FLAT5_4", "MFLR8_1"};
  const char* walls[3] = {"STONE2", "BROWN1", "STARGR1"};
  const char* hall_floor = "FLOOR4_8";
  const char* hall_ceiling = "TLITE6_4";
  const char* hall_walls = "STARTAN3";
  const char* corridor_floor = "RROCK19";
  int32_t light[5] = {160, 160, 160, 160, 160};  ///< of the rooms, the hall, the corridors
  Polygon hall = Box::around({0, 0}, kHall, kHall).polygon();
};

Variety draw_variety(const LayoutDraw& wanted) {
  Variety drawn;
  const int32_t distance = std::max(wanted.value32("distance"), kNearestRoom),
                width = wanted.value32("corridor");
  constexpr int32_t kEast[] = {0, 866, -866};  // thousandths of the distance
  const bool varies = wanted.value("variety") != 0;
  Rng shape(wanted.key.split("shape")), look(wanted.key.split("look"));
  int order[] = {0, 1, 2};
  int32_t north = 1;
  if (varies) {  // which room lies where; two of them north or south of the hall
    for (int i = 2; i > 0; --i) std::swap(order[i], order[shape.below(static_cast<uint32_t>(i) + 1)]);
    north = shape.below(2) == 0 ? 1 : -1;
  }
  for (int i = 0; i < 3; ++i) {
    const int place = order[i];
    if (varies) drawn.side[i] = stepped(352, 416, 16, shape);
    // A wide room stands further off, so that its corridor keeps room for all spots.
    const int32_t nearest = kNearestRoom + std::max(0, drawn.side[i] - kRoom) + kCorridorReserve;
    const int32_t far = varies ? std::max(nearest, distance + stepped(-64, 96, 8, shape)) : distance;
    drawn.corridor[i] = varies ? std::clamp(width + stepped(-16, 24, 8, shape), 128, 320) : width;
    drawn.centre[i] = {far * kEast[place] / 1000, place == 0 ? north * far : -north * (far / 2)};
    const SineCosine turn = sine_cosine_of_turn(north * (3 - 4 * place), 12);
    drawn.towards[i] = {static_cast<int32_t>(turn.cosine), static_cast<int32_t>(turn.sine)};
  }
  if (!varies) return drawn;
  drawn.hall = bent_box(Box::around({0, 0}, kHall, kHall), 3, 40, 0, shape);
  constexpr const char* kFloors[] = {"CEIL5_2", "FLAT5_4", "MFLR8_1", "FLOOR5_1",
                                     "FLAT1",   "RROCK10", "FLAT19"};
  constexpr const char* kWalls[] = {"STONE2", "BROWN1", "STARGR1", "STARTAN3", "METAL1", "GRAY5", "BRICK7"};
  constexpr const char* kCeilings[] = {"TLITE6_4", "CEIL3_5", "CEIL5_2", "FLAT10"};
  for (int i = 0; i < 3; ++i) drawn.floor[i] = one_of(kFloors, look), drawn.walls[i] = one_of(kWalls, look);
  drawn.hall_floor = one_of(kFloors, look);
  drawn.hall_ceiling = one_of(kCeilings, look);
  drawn.hall_walls = one_of(kWalls, look);
  drawn.corridor_floor = one_of(kFloors, look);
  for (int32_t& light : drawn.light) light = stepped(136, 208, 8, look);
  return drawn;
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const Variety variety = draw_variety(wanted);
  const char* const letter[] = {"A", "B", "C"};
  MapPlan plan;
  const AreaId hall = plan.add_area({.name = "hall",
                                     .ceiling = 192,
                                     .floor_texture = variety.hall_floor,
                                     .ceiling_texture = variety.hall_ceiling,
                                     .wall_texture = variety.hall_walls,
                                     .light = variety.light[3],
                                     .tag = kHallTag},
                                    variety.hall);
  std::vector<AreaId> rooms, corridors;
  for (int i = 0; i < 3; ++i)
    rooms.push_back(plan.add_area({.name = std::string("room ") + letter[i],
                                   .ceiling = 160,
                                   .floor_texture = variety.floor[i],
                                   .wall_texture = variety.walls[i],
                                   .light = variety.light[i],
                                   .tag = kFirstRoomTag + i},
                                  Box::around(variety.centre[i], variety.side[i], variety.side[i])));
  for (int i = 0; i < 3; ++i) {
    // A strip from the hall's middle to the room's, of which only the rock between them becomes corridor.
    const int64_t half = variety.corridor[i] / 2;
    const Point side{static_cast<int32_t>(-variety.towards[i].y * half / (int64_t{1} << 30)),
                     static_cast<int32_t>(variety.towards[i].x * half / (int64_t{1} << 30))};
    const Point end = variety.centre[i];
    corridors.push_back(plan.add_area(
        {.name = std::string("corridor ") + letter[i],
         .floor_texture = variety.corridor_floor,
         .wall_texture = variety.hall_walls,
         .light = variety.light[4],
         .tag = kFirstCorridorTag + i},
        Polygon{side, {-side.x, -side.y}, {end.x - side.x, end.y - side.y}, {end.x + side.x, end.y + side.y}},
        Claim::kOnlyRock));
  }
  std::vector<int32_t> door_tags;
  for (int i = 0; i < 3; ++i) {
    plan.add_door({.name = std::string("door ") + letter[i],
                   .floor_texture = variety.floor[i],
                   .ceiling_texture = "GATE1",
                   .wall_texture = "BIGDOOR2",
                   .tag = kFirstDoorTag + i},
                  rooms[i], corridors[i], kDoorThickness);
    door_tags.push_back(kFirstDoorTag + i);
  }
  Rng rng(wanted.key.split("spots"));
  const auto spots = [&](std::vector<Point>& into, AreaId area, int count, int32_t clearance,
                         int32_t spacing) {
    const std::vector<Point> points =
        plan.random_points(area, count, {.clearance = clearance, .spacing = spacing}, rng);
    if (static_cast<int>(points.size()) < count)
      plan.fail("there is no room for every spot in " + plan.spec(area).name);
    into.insert(into.end(), points.begin(), points.end());
  };
  std::vector<Point> core, agents, items, enemies, pistols, clips;
  spots(core, hall, kCoreSpots, 64, 48);
  spots(agents, hall, kAgentSpots, 32, 64);
  for (int i = 0; i < 3; ++i) {
    spots(items, rooms[i], kItemSpots, 64, 64);
    spots(enemies, corridors[i], kEnemySpots, 32, 32);
    spots(pistols, corridors[i], kItemSpots, 24, 16);
    spots(clips, corridors[i], kItemSpots, 24, 16);
  }
  const Point starts[] = {{-64, -64}, {64, -64},    {0, 64},     {-128, 64},
                          {128, 64},  {-128, -160}, {128, -160}, {0, 160}};
  for (int player = 1; player <= 8; ++player) plan.add_start(player, starts[player - 1], 90);

  COMRAD_TRY_ASSIGN(MapData map, plan.build());
  COMRAD_TRY(check_starts(map, 8));
  const std::vector<Point> from = start_points(map);
  // The core is put down while everybody still stands at a start, and is as wide as they are.
  if (!std::any_of(core.begin(), core.end(), [&](Point spot) {
        return std::none_of(from.begin(), from.end(), [&](Point start) {
          return std::abs(spot.x - start.x) < kBodies && std::abs(spot.y - start.y) < kBodies;
        });
      }))
    return Error{ErrorCode::kBadInput, "armory_siege: every spot of the core lies on a start"};
  const auto first = std::span(from.data(), 1);
  COMRAD_TRY(check_reaches(with_open_sectors(map, door_tags), first, items, "an item spot"));
  COMRAD_TRY(check_separated(map, first, items, "an item spot"));
  DrawnLayout layout{.map = std::move(map)};
  layout.defines = {{"DOOR_TAG", kFirstDoorTag},
                    {"CORE_SPOTS", kCoreSpots},
                    {"AGENT_SPOTS", kAgentSpots},
                    {"ITEM_SPOTS", kItemSpots},
                    {"ENEMY_SPOTS", kEnemySpots}};
  const auto add = [&](const std::string& name, const std::vector<Point>& points) {
    std::vector<int64_t> x, y;
    for (const Point& p : points) x.push_back(p.x), y.push_back(p.y);
    layout.arrays.emplace_back(name + "_x", std::move(x));
    layout.arrays.emplace_back(name + "_y", std::move(y));
  };
  for (const std::vector<Point>* points : {&core, &agents, &enemies, &pistols, &clips})
    COMRAD_TRY(check_reaches(layout.map, first, *points, "a spot"));
  add("core", core), add("agent", agents), add("item", items), add("enemy", enemies);
  add("pistol", pistols), add("clip", clips);
  return layout;
}

// What script.acs and scenario.toml pay, in points of the own return.
constexpr double kKill = 3.0, kHit = 0.2, kRound = 0.012, kHealth = 0.01, kAtLimit = 10.0;
constexpr double kWeapons =
    1.0 + 0.3;  // the first one and the other slot; a death costs 2 and earns them again
constexpr int kPistolRounds = 20, kShotgunShells = 8, kClipRounds = 10, kBoxShells = 20, kMedikit = 25;

int64_t wave_tics(int64_t window) { return window * 4 - 50; }

/// What a door's timetable puts down, tic by tic, as script.acs does it.
class Timetable {
 public:
  Timetable(int64_t door, int64_t window) : door_(door), window_(window) {}

  /// To be called for each tic from 0 on: whether it brings an item.
  bool brings(int64_t tic) {
    const bool due = is_due(tic % (window_ * 4)), opens = due && !open_;
    open_ = due;
    if (opens) age_ = 0;
    return opens || (due && window_ > 300 && ++age_ % 300 == 0);
  }

 private:
  bool is_due(int64_t time) const {
    const int64_t first = window_ * 2 / 3 * door_, second = first + window_ * 5 / 3;
    return (time >= first && time < first + window_) || (time >= second && time < second + window_) ||
           (door_ == 0 && time >= window_ * 10 / 3);
  }

  int64_t door_, window_, age_ = 0;
  bool open_ = false;
};

int64_t items_of_door(int64_t door, int64_t window, int64_t limit) {
  Timetable timetable(door, window);
  int64_t items = 0;
  for (int64_t tic = 0; tic < limit; ++tic) items += timetable.brings(tic);
  return items;
}

int64_t spawn_tics(int64_t wave) { return wave < 8 ? 200 - 20 * wave : 40; }

struct Kind {
  int64_t health;
  double radius;
  bool drops_clip;
};
struct Roll {
  double chance;
  Kind kind;
};

/// What a wave's monsters are; script.acs rolls 0..10.
std::array<Roll, 2> rolls_of(int64_t wave) {
  constexpr Kind kZombie{20, 20, true}, kImp{60, 20, false}, kDemon{150, 30, false},
      kLostSoul{100, 16, false};
  if (wave == 0) return {{{1.0, kZombie}, {0.0, kImp}}};
  if (wave == 1) return {{{6.0 / 11, kZombie}, {5.0 / 11, kImp}}};
  if (wave == 2) return {{{4.0 / 11, kImp}, {7.0 / 11, kDemon}}};
  return {{{5.0 / 11, kDemon}, {6.0 / 11, kLostSoul}}};
}

int64_t health_of(const Kind& kind, int64_t difficulty) {
  return difficulty < 1000 ? std::max<int64_t>(1, kind.health * difficulty / 1000) : kind.health;
}

/// Of a random number.
struct Moments {
  double mean = 0, square = 0;
};

/// Pellets that hurt a monster until it is dead; each takes 5, 10 or 15.
Moments pellets_for(int64_t health) {
  constexpr std::array<int64_t, 3> kDamages = {5, 10, 15};
  std::vector<Moments> left(static_cast<std::size_t>(health) + 1);  // [health]
  for (int64_t h = 1; h <= health; ++h) {
    Moments next;
    for (const int64_t damage : kDamages) {
      const Moments& after = left[static_cast<std::size_t>(std::max<int64_t>(0, h - damage))];
      next.mean += after.mean / 3, next.square += after.square / 3;
    }
    left[static_cast<std::size_t>(h)] = {1 + next.mean, 1 + 2 * next.mean + next.square};
  }
  return left.back();
}

/// What a monster of a wave pays the team that kills it: each agent for the kill, one for pellets and clip.
Moments pay_of(int64_t wave, int64_t difficulty, int num_agents) {
  Moments pay;
  for (const Roll& roll : rolls_of(wave)) {
    const Moments pellets = pellets_for(health_of(roll.kind, difficulty));
    const double sure = kKill * num_agents + (roll.kind.drops_clip ? kRound * kClipRounds : 0);
    pay.mean += roll.chance * (sure + kHit * pellets.mean);
    pay.square += roll.chance * (sure * sure + 2 * sure * kHit * pellets.mean + kHit * kHit * pellets.square);
  }
  return pay;
}

/// The own return, averaged over agents, of a team that takes everything, kills every monster that can come as it comes,
/// and loses nothing. The dice decide what comes and how many pellets it takes: their sum's mean and six standard
/// deviations, which one episode in 10^9 exceeds.
double most_return(const LayoutTask& task) {
  constexpr double kDeviations = 6;
  const int64_t window = task.value("window"), difficulty = task.value("difficulty"), limit = task.limit_tics;
  std::array<Moments, 4> pays;  // of waves 0, 1, 2 and all later ones
  for (std::size_t wave = 0; wave < pays.size(); ++wave)
    pays[wave] = pay_of(static_cast<int64_t>(wave), difficulty, task.num_agents);
  double team = 0, variance = 0;
  for (int64_t tic = 1; tic < limit; ++tic) {
    const int64_t wave = tic / wave_tics(window);
    if (tic % spawn_tics(wave) != 0) continue;
    const Moments& pay = pays[static_cast<std::size_t>(std::min<int64_t>(wave, 3))];
    team += pay.mean, variance += pay.square - pay.mean * pay.mean;
  }
  team += kDeviations * std::sqrt(variance);
  team += kRound * static_cast<double>(3 * (kPistolRounds + kClipRounds) +
                                       kShotgunShells * items_of_door(0, window, limit) +
                                       kBoxShells * items_of_door(1, window, limit));
  team += kHealth * static_cast<double>(kMedikit * items_of_door(2, window, limit));
  // Weapons that lie about in a game of several can be taken once by everybody.
  const double most =
      team / task.num_agents + kWeapons + kRound * (kPistolRounds + kShotgunShells) + kAtLimit;
  return std::ceil(most * 1000) / 1000;  // scenario.toml contains it for the default map
}

/// What decides how hard a siege is to hold.
struct Siege {
  int64_t distance = 0, window = 0, core_health = 0, difficulty = 0;
};

/// Shots of the shotgun that a monster of a wave takes on average. The last one is half wasted.
double shots_for(int64_t wave, int64_t difficulty) {
  constexpr double kPellets = 20, kPelletDamage = 10, kAcross = 11.2, kUp = 7.1;  // of actors.decorate
  constexpr double kRange = 300;                                                  // units at which it fires
  constexpr double kHalfHeight = 28, kDegrees = 180 / std::numbers::pi;
  // A pellet's angle is the difference of two even draws: the chance to lie within `half` of `spread`.
  const auto within = [](double half, double spread) {
    const double outside = std::max(0.0, 1 - half * kDegrees / spread);
    return 1 - outside * outside;
  };
  double shots = 0;
  for (const Roll& roll : rolls_of(wave)) {
    const double hits =
        within(std::atan(roll.kind.radius / kRange), kAcross) * within(std::atan(kHalfHeight / kRange), kUp);
    const auto health = static_cast<double>(health_of(roll.kind, difficulty));
    shots += roll.chance * std::max(1.0, health / (kPellets * kPelletDamage * hits) + 0.5);
  }
  return shots;
}

/// The share of all monsters that a team kills before the core falls, if it loses no time: monsters come, live until
/// an agent has had the time and the shells for them, and bite the core meanwhile. All in means: nothing is random.
double killed_share(const Siege& siege, int num_agents, int64_t limit_tics) {
  constexpr double kTurn = 90 / 3.5, kShot = 57;  // tics of a quarter turn and of a shot
  constexpr double kWalk = 8.3;                   // units a tic
  constexpr double kCarried = 50;                 // shells at most
  // A demon takes 22 every 24 tics, a lost soul 13.5 about every 40.
  constexpr double kBite = (5 * 22.0 / 24 + 6 * 13.5 / 40) / 11;
  const double trip = 2.0 * static_cast<double>(std::max<int64_t>(siege.distance, kNearestRoom)) / kWalk;
  Timetable guns(0, siege.window), boxes(1, siege.window);
  double came = 0, killed = 0, alive = 0, core = static_cast<double>(siege.core_health);
  double lying = 0, carried = 0;  // shells
  for (int64_t tic = 0; tic < limit_tics; ++tic) {
    const int64_t wave = tic / wave_tics(siege.window);
    const double spawned = 1.0 / static_cast<double>(spawn_tics(wave));
    const double cap = static_cast<double>((20 + 5 * wave) * siege.difficulty / 1000);
    came += spawned;
    if (core <= 0) continue;
    // A room's item is put down unless it still lies there.
    lying = std::min<double>(
        lying + (guns.brings(tic) ? kShotgunShells : 0) + (boxes.brings(tic) ? kBoxShells : 0),
        kShotgunShells + kBoxShells);
    const double taken = std::min(lying, kCarried * num_agents - carried);
    lying -= taken, carried += taken;
    if (alive < cap) alive += spawned;
    const double shells = 2 * shots_for(wave, siege.difficulty);
    double kills = std::min(alive, num_agents / (kTurn + shells / 2 * kShot + shells / kBoxShells * trip));
    if (wave >= 2) kills = std::min(kills, carried / shells), carried -= kills * shells;  // pistols do before
    alive -= kills, killed += kills;
    core -= kBite * alive;
  }
  return killed / came;
}

/// Not every team can hold every siege to the end, on the default map neither; it must be able to do there at least
/// nine tenths of what it can do on the default map.
Status check_resources(const LayoutTask& task) {
  constexpr double kAsPublished = 0.9;
  const Siege siege{task.value("distance"), task.value("window"), task.value("core_health"),
                    task.value("difficulty")};
  if (wave_tics(siege.window) <= 0)
    return Error{ErrorCode::kBadInput,
                 fmt::format("with window {} a wave (4 windows less 50 tics) has no time; give 13 at least",
                             siege.window)};
  const double killed = killed_share(siege, task.num_agents, task.limit_tics);
  const double published =
      killed_share({kDistance, kWindow, kCoreHealth, kDifficulty}, task.num_agents, task.limit_tics);
  if (killed >= kAsPublished * published) return {};
  const auto percent = [](double share) { return fmt::format("{} %", std::lround(100 * share)); };
  return Error{
      ErrorCode::kBadInput,
      fmt::format("the shots and shells of {} agents suffice for {} of the monsters before the core falls, "
                  "on the default map for {}; lower difficulty, change window, or take more agents",
                  task.num_agents, percent(killed), percent(published))};
}

}  // namespace

LayoutRecipe recipe() {
  return {
      .parameters = {{"distance", kDistance, 400, 4000,
                      "from the hall to the rooms, units; 592 at least is drawn (axis: 500, 700, 900)"},
                     {"corridor", 225, 128, 320, "width of the corridors, units (axis: 135, 225, 315)"},
                     {"window", kWindow, 10, 3000, "tics that a door stays open (axis: 150, 300, 450)"},
                     {"core_health", kCoreHealth, 1, 100000, "of the defence core (axis: 600, 1000, 1400)"},
                     {"difficulty", kDifficulty, 100, 3000,
                      "of the enemies, thousandths (axis: 500, 1000, 1500)"},
                     variety_parameter("1: which room lies where, distances, sizes, corridors, the hall's "
                                       "walls, textures and light come from the seed (pools set it)")},
      .draw = draw,
      .axes = {{"distance", {{{"distance", 500}}, {{"distance", 700}}, {{"distance", 900}}}},
               {"corridor", {{{"corridor", 135}}, {{"corridor", 225}}, {{"corridor", 315}}}},
               {"window", {{{"window", 150}}, {{"window", 300}}, {{"window", 450}}}},
               {"core", {{{"core_health", 600}}, {{"core_health", 1000}}, {{"core_health", 1400}}}},
               {"difficulty", {{{"difficulty", 500}}, {{"difficulty", 1000}}, {{"difficulty", 1500}}}}},
      .pool_values = {{"variety", 1}},
      .ceiling = most_return,
      .check_resources = check_resources};
}

}  // namespace comrad::scenarios::armory_siege
