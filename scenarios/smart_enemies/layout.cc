#include "scenarios/smart_enemies/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <string>

#include "scenarios/spec/variety.h"

namespace comrad::scenarios::smart_enemies {
namespace {

using doomgen::Box;
using doomgen::MapPlan;
using doomgen::Point;
using doomgen::Polygon;

constexpr int32_t kFieldMargin = 256, kFieldCells = 12'000;  // of organic outlines
constexpr int kArenaCorners = 64, kCircleCorners = 12;
constexpr int32_t kInnerRadius = 200;  // obstacles have their places from here ...
constexpr int32_t kFreeRadius = 128;   // ... and leave this much around the middle free
constexpr int kPlacements = 64;        // tried for one obstacle
constexpr int32_t kStartDistance = 32;
constexpr doomgen::Body kDemon{.radius = 30, .height = 56, .step = 24};
constexpr int32_t kSpotClearance = 32;
constexpr int64_t kRadius = 800, kCap = 4, kInterval = 3;  // of the default map

int32_t root(int64_t value) {
  int32_t low = 0, high = 1 << 15;
  while (low < high) {
    const int32_t middle = (low + high + 1) / 2;
    if (int64_t{middle} * middle <= value) {
      low = middle;
    } else {
      high = middle - 1;
    }
  }
  return low;
}

/// The polygon turned by `degrees` about (0, 0) and moved to `centre`.
Polygon placed(const Polygon& polygon, Point centre, int32_t degrees) {
  const doomgen::SineCosine turn = doomgen::sine_cosine_of_turn(degrees, 360);
  const auto rounded = [](int64_t scaled) {
    return static_cast<int32_t>((scaled + (int64_t{1} << 29)) >> 30);
  };
  Polygon result;
  for (const Point& p : polygon)
    result.push_back({centre.x + rounded(p.x * turn.cosine - p.y * turn.sine),
                      centre.y + rounded(p.x * turn.sine + p.y * turn.cosine)});
  return result;
}

/// One of five is round, two are rectangles, one an L, one a cross.
Polygon draw_shape(Rng& rng) {
  switch (rng.below(5)) {
    case 0: {
      const int32_t radius = rng.between(32, 96);
      Polygon circle;
      for (int i = 0; i < kCircleCorners; ++i)
        circle.push_back(doomgen::polar_point(radius, i, kCircleCorners));
      return circle;
    }
    case 1:
    case 2: {
      const int32_t width = rng.between(64, 256), height = rng.between(64, 256);
      return Box::around({0, 0}, width, height).polygon();
    }
    case 3: {
      const int32_t along = rng.between(96, 192), along_width = rng.between(32, 64);
      const int32_t up = rng.between(96, 192), up_width = rng.between(32, 64);
      return {{0, 0}, {along, 0}, {along, along_width}, {up_width, along_width}, {up_width, up}, {0, up}};
    }
    default: {
      const int32_t arm = rng.between(96, 160), half = rng.between(32, 48);
      return {{half, half},   {half, arm},   {-half, arm}, {-half, half}, {-arm, half}, {-arm, -half},
              {-half, -half}, {-half, -arm}, {half, -arm}, {half, -half}, {arm, -half}, {arm, half}};
    }
  }
}

bool leaves_the_middle_free(const Polygon& shape) {
  if (doomgen::inside(shape, {0, 0})) return false;
  for (std::size_t i = 0; i < shape.size(); ++i)
    if (doomgen::nearer_than({0, 0}, shape[i], shape[(i + 1) % shape.size()], kFreeRadius)) return false;
  return true;
}

/// Uniform over the ring; only its first place counts, as far as the middle stays free.
std::optional<Polygon> draw_obstacle(int32_t radius, Rng& rng) {
  const Polygon shape = draw_shape(rng);
  const int64_t outer = int64_t{radius} * 9 / 10;
  for (int i = 0; i < kPlacements; ++i) {
    const auto squared =
        static_cast<int64_t>(kInnerRadius * kInnerRadius +
                             rng.below(static_cast<uint32_t>(outer * outer - kInnerRadius * kInnerRadius)));
    const Point centre = doomgen::polar_point(root(squared), rng.between(0, 3599), 3600);
    Polygon obstacle = placed(shape, centre, rng.between(0, 359));
    if (leaves_the_middle_free(obstacle)) return obstacle;
  }
  return std::nullopt;
}

}  // namespace

Expected<DrawnLayout> draw_arena(const LayoutDraw& draw) {
  const int32_t radius = draw.value32("radius");
  MapPlan plan;
  use_organic_outlines(
      plan, draw, Box::around({0, 0}, 2 * (radius + kFieldMargin), 2 * (radius + kFieldMargin)), kFieldCells);
  Polygon outline;
  for (int i = 0; i < kArenaCorners; ++i) outline.push_back(doomgen::polar_point(radius, i, kArenaCorners));
  // Obstacles may seal off pockets; nobody starts or comes from there.
  const doomgen::AreaId arena = plan.add_area({.name = "arena",
                                               .ceiling = 384,
                                               .floor_texture = "NUKAGE1",
                                               .ceiling_texture = "CEIL3_5",
                                               .wall_texture = "STONE2",
                                               .light = 255,
                                               .tag = kArenaTag,
                                               .in_pieces = true},
                                              outline);
  Rng obstacles(draw.key.split("obstacles"));
  for (int64_t i = 0; i < draw.value("obstacles"); ++i)
    if (const auto obstacle = draw_obstacle(radius, obstacles)) plan.add_pillar(*obstacle, "BIGBRIK1");

  const std::array<Point, 4> starts = {{{-kStartDistance, kStartDistance},
                                        {kStartDistance, kStartDistance},
                                        {-kStartDistance, -kStartDistance},
                                        {kStartDistance, -kStartDistance}}};
  for (int i = 0; i < 4; ++i) plan.add_start(i + 1, starts[static_cast<std::size_t>(i)], 0);

  // Spots: where a demon has room and from where it can come to the middle.
  COMRAD_TRY_ASSIGN(const doomgen::MapData bare, plan.build());
  const doomgen::Reachability walk(bare, std::span(starts.data(), 1), kDemon);
  Rng spots(draw.key.split("spots"));
  int found = 0;
  for (int i = 0; i < 100 * kSpotCount && found < kSpotCount; ++i) {
    const auto spot = plan.random_point(arena, kSpotClearance, spots);
    if (!spot || !walk.reaches(*spot)) continue;
    plan.add_spot(kFirstSpotId + found++, *spot, 45 * spots.between(0, 7));
  }
  if (found < kSpotCount)
    return Error{ErrorCode::kBadInput,
                 fmt::format("there is room for {} spots of {} that a demon can leave", found, kSpotCount)};
  COMRAD_TRY_ASSIGN(doomgen::MapData map, plan.build());
  COMRAD_TRY(doomgen::check_starts(map, 4));
  return DrawnLayout{.map = std::move(map), .defines = {{"SPOT_COUNT", kSpotCount}}};
}

namespace {

// Numbers of script.acs; the floor hurts at clock 32, 64, ...
constexpr int64_t kHitTics = 32, kHit = 2, kStartHealth = 100, kKillHealth = 7;

int64_t interval_tics(const LayoutTask& task) { return task.value("interval") * 35; }

/// Demons that have come until then, were none of them missing for the cap.
int64_t came(const LayoutTask& task, int64_t tic) { return 1 + tic / interval_tics(task); }

}  // namespace

double most_kills(const LayoutTask& task) {
  int64_t end = task.limit_tics - 1;
  for (int64_t tic = kHitTics; tic <= end; tic += kHitTics)
    if (kStartHealth + kKillHealth * came(task, tic) <= kHit * tic / kHitTics) end = tic;
  return static_cast<double>(came(task, end));
}

double Hunt::tics() const {
  constexpr double kToTheWall = 32 / (9 * std::numbers::pi);       // of a disc of radius 1
  constexpr double kWalk = 11.5;                                   // units a tic, askance
  constexpr double kTurn = 90 / 3.5;                               // tics of a quarter turn
  constexpr double kHealth = 100, kShot = 7 * 10, kShotTics = 37;  // of a demon without armour; of one gun
  return std::max(0.0, kToTheWall * radius - reach) / kWalk + kTurn + kHealth / (kShot * guns) * kShotTics;
}

double Hunt::caught_share() const {
  // Chances of n demons in units of that of none: a^n / n! while a party is free for each, then a / c each.
  const double load = tics() / interval_tics;
  double chance = 1, sum = 1;
  for (int demons = 1; demons <= cap; ++demons) {
    chance *= load / std::min(demons, parties);
    sum += chance;
  }
  return 1 - chance / sum;
}

Status check_hunt(const LayoutTask& task, const Hunt& hunt, const Hunt& published) {
  constexpr double kAsPublished = 0.9;  // of the share that is caught on the default map
  const auto percent = [](double share) { return fmt::format("{} %", std::lround(100 * share)); };
  const int64_t floor = kHit * (task.limit_tics / kHitTics);
  const int64_t needed = (floor - kStartHealth) / kKillHealth + 1, demons = came(task, task.limit_tics - 1);
  const double caught = hunt.caught_share();
  if (caught * static_cast<double>(demons) < static_cast<double>(needed))
    return Error{
        ErrorCode::kBadInput,
        fmt::format("the floor takes {} health in all, so that {} demons must be killed; {} come, and of "
                    "those {} can be caught; lower interval or radius, or raise cap or proximity",
                    floor, needed, demons, percent(caught))};
  if (caught < kAsPublished * published.caught_share())
    return Error{ErrorCode::kBadInput, "of the demons that come " + percent(caught) +
                                           " can be caught, on the default map " +
                                           percent(published.caught_share()) +
                                           "; raise interval, cap or proximity, or lower radius"};
  return {};
}

namespace {

/// Of all places where another hunter may stand, the part that is not within `proximity` of a demon, in the mean
/// of the spots, which lie at random where demons can be.
double share_apart(const std::vector<Point>& spots, int64_t proximity) {
  int64_t pairs = 0, apart = 0;
  for (const Point& demon : spots)
    for (const Point& hunter : spots)
      if (&demon != &hunter)
        ++pairs, apart += doomgen::distance_squared(demon, hunter) >= proximity * proximity;
  return pairs > 0 ? static_cast<double>(apart) / static_cast<double>(pairs) : 0.0;
}

/// The largest team that finds room to hunt apart. Where a team's other hunters stand anywhere, a demon is alone
/// with its own in share_apart()^(N - 1) of all cases, of which there must be kAlone.
int most_hunters(const std::vector<Point>& spots, int64_t proximity) {
  constexpr double kAlone = 0.15;  // measured: ../POOLS.md
  constexpr int kMost = 8;
  const double apart = share_apart(spots, proximity);
  double alone = 1;
  for (int hunters = 1; hunters < kMost; ++hunters)
    if ((alone *= apart) < kAlone) return hunters;
  return kMost;
}

Expected<DrawnLayout> draw_with_room(const LayoutDraw& draw) {
  COMRAD_TRY_ASSIGN(DrawnLayout drawn, draw_arena(draw));
  std::vector<Point> spots;
  for (const doomgen::ThingData& thing : drawn.map.things)
    if (thing.id >= kFirstSpotId && thing.id < kFirstSpotId + kSpotCount) spots.push_back(thing.position);
  drawn.most_agents = most_hunters(spots, draw.value("proximity"));
  return drawn;
}

/// Each hunter is a party.
Hunt hunt_of(int64_t radius, int64_t interval, int64_t cap, int num_agents) {
  return {.radius = static_cast<double>(radius),
          .reach = kPelletReach,
          .interval_tics = static_cast<double>(interval) * 35,
          .cap = static_cast<int>(cap),
          .parties = num_agents};
}

Status check_resources(const LayoutTask& task) {
  return check_hunt(task,
                    hunt_of(task.value("radius"), task.value("interval"), task.value("cap"), task.num_agents),
                    hunt_of(kRadius, kInterval, kCap, task.num_agents));
}

}  // namespace

LayoutRecipe recipe() {
  return {
      .parameters = {{"radius", kRadius, 500, 4000, "radius of the arena, units (axis: 700, 850, 1000)"},
                     {"obstacles", 30, 0, 200, "obstacles (axis: 18, 30, 42)"},
                     {"cap", kCap, 1, 32, "demons that live at a time (axis: 3, 5, 7)"},
                     {"interval", kInterval, 1, 60, "seconds between two demons (axis: 2, 3, 4)"},
                     {"proximity", 512, 64, 2000, "how near a hunter counts, units (axis: 384, 512, 640)"},
                     organic_parameter()},
      .draw = draw_with_room,
      .axes = {{"radius", {{{"radius", 700}}, {{"radius", 850}}, {{"radius", 1000}}}},
               {"obstacles", {{{"obstacles", 18}}, {{"obstacles", 30}}, {{"obstacles", 42}}}},
               {"cap", {{{"cap", 3}}, {{"cap", 5}}, {{"cap", 7}}}},
               {"interval", {{{"interval", 2}}, {{"interval", 3}}, {{"interval", 4}}}},
               {"proximity", {{{"proximity", 384}}, {{"proximity", 512}}, {{"proximity", 640}}}}},
      .ceiling = most_kills,
      .check_resources = check_resources};
}

}  // namespace comrad::scenarios::smart_enemies
