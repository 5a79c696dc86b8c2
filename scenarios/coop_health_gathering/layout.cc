#include "scenarios/coop_health_gathering/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cmath>

#include "doomgen/layout/map_validation.h"
#include "doomgen/layout/reachability.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/layout_info.h"

namespace comrad::scenarios::coop_health_gathering {
namespace {

using doomgen::Box;
using doomgen::MapData;
using doomgen::Point;
using doomgen::Polygon;
using doomgen::Region;

constexpr int64_t kRadius = 2000, kDamage = 5, kKitCap = 80;  // of the default map
constexpr int32_t kCentreHalfWidth = 256;                     // no pillar begins in the middle
constexpr int32_t kPillarGap = 48;                            // a body of 32 passes between any two pillars
constexpr int kPillarPlacements = 64;   // places tried for one pillar before it is given up
constexpr int32_t kSpotClearance = 24;  // more than the radius of a kit
constexpr int32_t kSpotDistance = 40;   // two kit spots never coincide
constexpr int32_t kStartClearance = 32;
constexpr int32_t kStartDistance = 64;

/// 12..24 corners at equal angles, each at 0.6 R .. R from the centre.
Polygon draw_outline(int32_t radius, Rng rng) {
  const int32_t corner_count = rng.between(12, 24);
  Polygon outline;
  for (int32_t i = 0; i < corner_count; ++i)
    outline.push_back(doomgen::polar_point(rng.between(radius * 6 / 10, radius), i, corner_count));
  return outline;
}

/// One pillar for every 19 600 square units times density. A try whose point lies in the middle places
/// none; one that would come too near to a wall or another pillar is drawn again elsewhere, so that the
/// density holds.
std::vector<Box> draw_pillars(Region region, int64_t radius, int64_t density_thousandths, Rng rng) {
  const int64_t try_count = radius * radius * density_thousandths / 19'600'000;
  std::vector<Box> pillars;
  for (int64_t i = 0; i < try_count; ++i) {
    const int32_t width = rng.between(48, 128), height = rng.between(48, 128);
    for (int placement = 0; placement < kPillarPlacements; ++placement) {
      const auto centre = doomgen::random_point(region, 0, rng);
      if (!centre || (std::abs(centre->x) < kCentreHalfWidth && std::abs(centre->y) < kCentreHalfWidth))
        break;
      const Point low{centre->x - width / 2, centre->y - height / 2};
      const Box pillar{low, {low.x + width, low.y + height}};
      if (!doomgen::clear_inside(region, pillar, kPillarGap)) continue;
      pillars.push_back(pillar);
      region.holes.push_back(pillar.polygon());
      break;
    }
  }
  return pillars;
}

bool far_from(const std::vector<Point>& points, Point p, int32_t distance) {
  for (const Point& other : points)
    if (doomgen::distance_squared(p, other) < int64_t{distance} * distance) return false;
  return true;
}

/// Spots that keep 0.15 R between each other as long as such are found, then any free ones.
std::vector<Point> draw_kit_spots(const Region& region, int32_t radius, Rng rng) {
  std::vector<Point> spots;
  for (int i = 0; i < 4 * kKitSpotCount && spots.size() < kKitSpotCount; ++i) {
    const auto spot = doomgen::random_point(region, kSpotClearance, rng);
    if (spot && far_from(spots, *spot, radius * 15 / 100)) spots.push_back(*spot);
  }
  for (int i = 0; i < 100 * kKitSpotCount && spots.size() < kKitSpotCount; ++i) {
    const auto spot = doomgen::random_point(region, kSpotClearance, rng);
    if (spot && far_from(spots, *spot, kSpotDistance)) spots.push_back(*spot);
  }
  return spots;
}

/// A team's starts: around one point, within half the tether of it and apart from each other. Where a body
/// finds no room it stands 64 units beside the centre, and the checks decide.
std::vector<Point> draw_starts(const Region& region, int player_count, int32_t tether, Rng rng) {
  const auto centre = doomgen::random_point(region, kStartClearance, rng);
  if (!centre) return {};
  const int32_t reach = tether / 2;
  std::vector<Point> starts;
  for (int player = 0; player < player_count; ++player) {
    Point start{centre->x + (player % 2 == 0 ? -64 : 64), centre->y + (player / 2 == 0 ? 0 : 64)};
    for (int i = 0; i < 1000; ++i) {
      const Point p{centre->x + rng.between(-reach, reach), centre->y + rng.between(-reach, reach)};
      if (doomgen::distance_squared(p, *centre) > int64_t{reach} * reach ||
          !far_from(starts, p, kStartDistance) || !doomgen::clear_inside(region, p, kStartClearance))
        continue;
      start = p;
      break;
    }
    starts.push_back(start);
  }
  return starts;
}

Error refused(const std::string& what) {
  return Error{ErrorCode::kBadInput, "coop_health_gathering: " + what};
}

/// One sector, with a wall along each edge of its outline and of the pillars in it, in the order in which they were
/// drawn: it is that of the published maps (a MapPlan would order them by place).
MapData arena(const Region& region) {
  MapData map;
  map.sectors.push_back({.floor_height = 0,
                         .ceiling_height = 384,
                         .floor_texture = "FLAT1",
                         .ceiling_texture = "CEIL1_2",
                         .light = 200,
                         .tag = kArenaTag});
  const auto add_walls = [&map](Polygon outline, bool is_pillar) {
    // The sector lies to the right of its lines: the outline runs clockwise, pillars the other way round.
    if ((doomgen::twice_area(outline) < 0) == is_pillar) std::reverse(outline.begin(), outline.end());
    const auto first = static_cast<uint32_t>(map.vertices.size()),
               count = static_cast<uint32_t>(outline.size());
    map.vertices.insert(map.vertices.end(), outline.begin(), outline.end());
    for (uint32_t i = 0; i < count; ++i) {
      doomgen::LinedefData wall;
      wall.start = first + i, wall.end = first + (i + 1) % count;
      wall.front = static_cast<uint32_t>(map.sidedefs.size());
      wall.blocking = true;
      map.sidedefs.push_back({0, "", is_pillar ? "ASHWALL6" : "BRICK6", ""});
      map.linedefs.push_back(wall);
    }
  };
  add_walls(region.outline, false);
  for (const Polygon& pillar : region.holes) add_walls(pillar, true);
  return map;
}

/// Starts stand free and apart; every spot and every start can be walked to from the first start.
Status check_things(const Region& region, const MapData& map, const std::vector<Point>& starts,
                    const std::vector<Point>& spots) {
  for (std::size_t i = 0; i < starts.size(); ++i) {
    const std::vector<Point> others(starts.begin(), starts.begin() + static_cast<int64_t>(i));
    if (!doomgen::clear_inside(region, starts[i], kStartClearance) ||
        !far_from(others, starts[i], kStartDistance))
      return refused("a player's start has no room");
  }
  const doomgen::Reachability walk(map, std::span(starts.data(), 1));
  for (const Point& p : starts)
    if (!walk.reaches(p)) return refused("a player's start is cut off");
  for (const Point& p : spots)
    if (!walk.reaches(p)) return refused("a kit spot is cut off");
  return {};
}

}  // namespace

std::vector<LayoutParameter> parameters() {
  return {
      {"radius", kRadius, 800, 8000, "outer radius R of the arena, units (axis: 1600, 2000, 2400)"},
      {"tether", 400, 160, 2000, "length of the tether, units (axis: 320, 400, 480)"},
      {"damage", kDamage, 1, 100, "health that the floor takes every 32 tics (axis: 3, 5, 7)"},
      {"kit_cap", kKitCap, 1, 1000, "kits that lie about at most (axis: 60, 80, 100)"},
      {"density", 600, 0, 1000, "pillars per 19 600 square units, thousandths (axis: 450, 600, 750)"},
      {"players", 4, 2, 4, "starts that the map prepares (axis: 2, 3, 4)"},
  };
}

Expected<DrawnLayout> draw(uint64_t seed, const std::map<std::string, int64_t>& values) {
  const RngKey key = RngKey(seed).split("coop_health_gathering");
  const auto radius = static_cast<int32_t>(values.at("radius"));

  Region region;
  region.outline = draw_outline(radius, Rng(key.split("outline")));
  for (const Box& pillar : draw_pillars(region, radius, values.at("density"), Rng(key.split("pillars"))))
    region.holes.push_back(pillar.polygon());
  const std::vector<Point> starts =
      draw_starts(region, static_cast<int>(values.at("players")), static_cast<int32_t>(values.at("tether")),
                  Rng(key.split("starts")));
  const std::vector<Point> spots = draw_kit_spots(region, radius, Rng(key.split("kit_spots")));
  if (starts.empty() || spots.size() < kKitSpotCount)
    return refused("there is no room for every start and kit spot");

  MapData map = arena(region);
  Rng facing(key.split("facing"));
  for (std::size_t i = 0; i < starts.size(); ++i)
    map.things.push_back({.position = starts[i],
                          .angle_degrees = facing.between(0, 359),
                          .editor_number = static_cast<int32_t>(i) + 1});
  COMRAD_TRY(doomgen::validate_map(map));
  COMRAD_TRY(check_things(region, map, starts, spots));
  std::vector<int64_t> spot_x, spot_y;
  for (const Point& spot : spots) spot_x.push_back(spot.x), spot_y.push_back(spot.y);
  return DrawnLayout{.map = std::move(map),
                     .defines = {{"KIT_SPOT_COUNT", kKitSpotCount}},
                     .arrays = {{"spot_x", std::move(spot_x)}, {"spot_y", std::move(spot_y)}}};
}

namespace {

/// What decides how hard a map is to live on.
struct Supply {
  double radius = 0, damage = 0, kit_cap = 0;
};

/// The lowest mean health of a team that loses no time and shares evenly, from the first tic, when no kit lies
/// about: each agent walks from kit to kit on the shortest tour through its share of them.
double lowest_mean_health(const Supply& supply, int num_agents, int32_t limit_tics) {
  // Of script.acs: three kits every 35 tics, 10 health three times of four, else 25; damage every 32 tics.
  constexpr double kKit = (3 * 10 + 25) / 4.0, kKitsAtATime = 3, kKitTics = 35, kDamageTics = 32, kFull = 100;
  constexpr double kWalk = 8.3;  // units a tic, straight ahead
  // The outline's corners lie at 0.6 R to R, uniformly: (0.8^2 + 0.4^2 / 12) pi, less the slivers between them.
  constexpr double kArenaShare = 2.0;
  constexpr double kTourShare = 0.7124;  // a way through n points of an area A: 0.7124 sqrt(n A)
  const double lost = supply.damage / kDamageTics * kKitTics;
  double lying = 0, health = kFull, lowest = kFull;
  for (double tic = 0; tic < limit_tics && lowest > 0; tic += kKitTics) {
    lying = std::min(lying + kKitsAtATime, std::max(lying, supply.kit_cap));
    const double way =
        kTourShare * std::sqrt(kArenaShare * supply.radius * supply.radius * num_agents / lying);
    const double taken = std::min(
        {kKitTics * kWalk / way, lying / num_agents, (kFull - health + lost) / kKit});  // by one agent
    lying = std::max(lying - taken * num_agents, 1e-6);
    health += taken * kKit - lost;
    lowest = std::min(lowest, health);
  }
  return lowest;
}

/// The weakest of a real team is far below the mean, and by how much follows from no rule. What a team can bear is
/// taken from the default map: the mean may not fall much lower than it falls there. How much is measured: three scripted
/// agents live to the limit where it falls as low, and rarely where it falls to 0.91 of that (scenarios/POOLS.md).
Status check_resources(const LayoutTask& task) {
  constexpr double kAsPublished = 0.93;
  const auto of = [&](const char* name) { return static_cast<double>(task.value(name)); };
  const double lowest =
      lowest_mean_health({of("radius"), of("damage"), of("kit_cap")}, task.num_agents, task.limit_tics);
  const double least =
      kAsPublished * lowest_mean_health({kRadius, kDamage, kKitCap}, task.num_agents, task.limit_tics);
  if (lowest >= least) return {};
  const auto whole = [](double health) { return std::to_string(std::max<int64_t>(0, std::lround(health))); };
  return Error{
      ErrorCode::kBadInput,
      fmt::format(
          "the floor takes more than {} agents can fetch: a team that loses no time falls to {} health on "
          "average ({} are needed); lower damage or radius, raise kit_cap, or take fewer agents",
          task.num_agents, whole(lowest), whole(least))};
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = parameters(),
          .draw = [](const LayoutDraw& wanted) { return draw(wanted.seed, wanted.values); },
          .players_parameter = "players",
          .axes = {{"radius", {{{"radius", 1600}}, {{"radius", 2000}}, {{"radius", 2400}}}},
                   {"tether", {{{"tether", 320}}, {{"tether", 400}}, {{"tether", 480}}}},
                   {"damage", {{{"damage", 3}}, {{"damage", 5}}, {{"damage", 7}}}},
                   {"kit_cap", {{{"kit_cap", 60}}, {{"kit_cap", 80}}, {{"kit_cap", 100}}}},
                   {"density", {{{"density", 450}}, {{"density", 600}}, {{"density", 750}}}}},
          .check_resources = check_resources};
}

}  // namespace comrad::scenarios::coop_health_gathering
