#include "scenarios/foraging_commons/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>

#include "doomgen/layout/picture.h"

namespace comrad::scenarios::foraging_commons {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kStationTag = 200, kFirstBonusSpot = 100;
constexpr int32_t kShortestCorridor = 64, kSpotClearance = 32, kSpotSpacing = 96;
constexpr int kBarSegments = 20, kSegmentPitch = 6, kSegmentHeight = 6;  // of a screen of 320x240

/// The bar of the spawn rate as a picture for each number of green segments.
std::vector<NamedBytes> bar_pictures() {
  constexpr Colour kGreen{48, 224, 48}, kRed{224, 32, 32}, kNone{0, 0, 0, 0};
  std::vector<NamedBytes> pictures;
  for (int filled = 0; filled <= kBarSegments; ++filled) {
    Picture bar(kBarSegments * kSegmentPitch, kSegmentHeight, kNone);
    for (int y = 0; y < bar.height; ++y)
      for (int x = 0; x < bar.width; ++x)
        if (x % kSegmentPitch != kSegmentPitch - 1) bar.at(x, y) = x / kSegmentPitch < filled ? kGreen : kRed;
    char name[9];
    std::snprintf(name, sizeof(name), "FCBAR%02d", filled);
    pictures.push_back({name, encode_png(bar)});
  }
  return pictures;
}

/// A large field and a near station would overlap: the station then moves off until a corridor fits between.
int64_t station_distance(int64_t distance, int64_t field, int64_t station) {
  return std::max(distance, (field + station) / 2 + kShortestCorridor);
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t field = wanted.value32("field"), station = wanted.value32("station"),
                corridor = wanted.value32("corridor");
  const auto distance = static_cast<int32_t>(station_distance(wanted.value32("distance"), field, station));
  const Box field_box = Box::around({0, 0}, field, field),
            station_box = Box::around({0, -distance}, station, station);
  MapPlan plan;
  const AreaId commons = plan.add_area({.name = "field",
                                        .ceiling = 256,
                                        .floor_texture = "CEIL5_2",
                                        .wall_texture = "BROWN96",
                                        .light = 180,
                                        .tag = 100},
                                       field_box);
  const AreaId cleanup = plan.add_area({.name = "station",
                                        .ceiling = 256,
                                        .floor_texture = "NUKAGE1",
                                        .ceiling_texture = "TLITE6_4",
                                        .wall_texture = "PIPE4",
                                        .light = 255,
                                        .tag = kStationTag},
                                       station_box);
  const int32_t half = corridor / 2;
  plan.add_area({.name = "corridor",
                 .ceiling = 200,
                 .floor_texture = "CEIL5_2",
                 .wall_texture = "BROWN96",
                 .light = 160,
                 .tag = 300},
                Box{{-half, station_box.high.y}, {corridor - half, field_box.low.y}});
  for (int player = 1; player <= 4; ++player)
    plan.add_start(player, {player % 2 == 1 ? -48 : 48, player <= 2 ? 0 : 48}, 0);
  Rng rng(wanted.key.split("bonus_spots"));
  const auto count = static_cast<int>(wanted.value("spots"));
  const std::vector<Point> spots =
      plan.random_points(commons, count, {.clearance = kSpotClearance, .spacing = kSpotSpacing}, rng);
  for (std::size_t i = 0; i < spots.size(); ++i)
    plan.add_spot(kFirstBonusSpot + static_cast<int32_t>(i), spots[i]);
  if (static_cast<int>(spots.size()) < count) plan.fail("there is no room for every bonus spot");

  COMRAD_TRY_ASSIGN(MapData map, plan.build());
  COMRAD_TRY(check_starts(map, 4));
  COMRAD_TRY(check_reaches(map, start_points(map), spots, "a bonus spot"));
  const Point middle = plan.centroid(cleanup);
  COMRAD_TRY(check_reaches(map, start_points(map), std::span(&middle, 1), "the station"));
  return DrawnLayout{.map = std::move(map),
                     .defines = {{"BONUS_SPOT_FIRST", kFirstBonusSpot},
                                 {"BONUS_SPOT_COUNT", count},
                                 {"STATION_TAG", kStationTag},
                                 {"STATION_LEFT", station_box.low.x},
                                 {"STATION_RIGHT", station_box.high.x},
                                 {"STATION_BOTTOM", station_box.low.y},
                                 {"STATION_TOP", station_box.high.y}},
                     .textures = bar_pictures()};
}

/// Has the team the time to eat as much as hunger takes, and to give the field back what that and the decay
/// cost it? In the long run the two must not need more of its time than there is, nor for more bonuses than
/// grow. The numbers of script.acs, and some that were measured with the scripted team.
Status check_resources(const LayoutTask& task) {
  constexpr double kDrainTics = 35, kDecayTics = 45, kSpawnTics = 15, kHeal = 2, kRates = 101;
  constexpr double kWalk = 8.3;             // units a tic
  constexpr double kStepOut = 20;           // tics from a cleanup's end to the next one's beginning
  constexpr double kCleanupsOfAVisit = 10;  // before the cleaner is too hungry
  constexpr double kKeptRate = 75;          // that a good team holds on average
  constexpr double kTicsPerUnit = 0.006;    // of the field's side: from one bonus to the next
  constexpr double kMostCleaning = 0.68;    // of a team's time: who cleans must eat before and after
  constexpr double kShared = 0.8;           // of what grows: more than two get into each other's way
  const auto value = [&](const char* name) { return static_cast<double>(task.value(name)); };
  const double eaten = task.num_agents * value("drain") / kHeal / kDrainTics;  // bonuses a tic
  const double grown =
      task.num_agents / kSpawnTics * kKeptRate / kRates * (task.num_agents > 2 ? kShared : 1.0);
  const double lost = value("decay") / kDecayTics + eaten * value("harvest_cost");  // rate a tic
  const double cleanups = lost > 0 ? lost / std::max(value("boost"), 1e-6) : 0.0;
  const int64_t way =
      2 * station_distance(task.value("distance"), task.value("field"), task.value("station"));
  const double eating = eaten * value("field") * kTicsPerUnit;
  const double cleaning =
      cleanups * (value("cleanup_tics") + kStepOut + static_cast<double>(way) / kWalk / kCleanupsOfAVisit);
  const auto percent = [](double part, double whole) {
    return fmt::format("{} %", static_cast<int64_t>(std::min(100.0 * part / whole, 1e6)));
  };
  if (eaten > grown)
    return Error{
        ErrorCode::kBadInput,
        fmt::format("they need {} of the bonuses that they can get while the rate is {}; lower drain",
                    percent(eaten, grown), static_cast<int>(kKeptRate))};
  if (eating + cleaning <= task.num_agents && cleaning <= kMostCleaning * task.num_agents) return {};
  return Error{ErrorCode::kBadInput, "eating takes " + percent(eating, task.num_agents) +
                                         " of their time and cleaning " + percent(cleaning, task.num_agents) +
                                         " (of which 68 % can be); lower drain, harvest_cost, decay, "
                                         "cleanup_tics, field or distance, or raise boost"};
}

}  // namespace

LayoutRecipe recipe() {
  return {
      .parameters = {{"field", 1600, 512, 4096, "side of the field, units (axis: 1400, 1600, 1800)"},
                     {"station", 384, 128, 1024, "side of the cleanup station, units (axis: 320, 384, 448)"},
                     {"corridor", 200, 64, 320, "width of the corridor, units (axis: 120, 200, 280)"},
                     {"distance", 1200, 400, 8000,
                      "from the field's centre to the station's (axis: 900, 1200, 1500)"},
                     {"start_rate", 80, 5, 100, "spawn rate at the start (axis: 90, 80, 70)"},
                     {"harvest_cost", 2, 0, 100, "rate that a harvest costs (axis: 1, 2, 3)"},
                     {"decay", 1, 0, 100, "rate lost every 45 tics (axis: 1, 1, 2)"},
                     {"boost", 15, 0, 100, "rate that a cleanup restores (axis: 18, 15, 12)"},
                     {"cleanup_tics", 72, 4, 2000, "tics that a cleanup takes (axis: 56, 72, 88)"},
                     {"drain", 2, 0, 100, "health lost every 35 tics (axis: 1, 2, 3)"},
                     {"spots", 16, 1, 64, "bonus spots (axis: 12, 16, 20)"}},
      .draw = draw,
      .axes =
          {{"size",
            {{{"field", 1400}, {"station", 320}, {"corridor", 120}},
             {{"field", 1600}, {"station", 384}, {"corridor", 200}},
             {{"field", 1800}, {"station", 448}, {"corridor", 280}}}},
           {"distance", {{{"distance", 900}}, {{"distance", 1200}}, {{"distance", 1500}}}},
           {"rate",
            {{{"start_rate", 90}, {"harvest_cost", 1}, {"decay", 1}, {"boost", 18}, {"cleanup_tics", 56}},
             {{"start_rate", 80}, {"harvest_cost", 2}, {"decay", 1}, {"boost", 15}, {"cleanup_tics", 72}},
             {{"start_rate", 70}, {"harvest_cost", 3}, {"decay", 2}, {"boost", 12}, {"cleanup_tics", 88}}}},
           {"drain", {{{"drain", 1}}, {{"drain", 2}}, {{"drain", 3}}}},
           {"spots", {{{"spots", 12}}, {{"spots", 16}}, {{"spots", 20}}}}},
      .check_resources = check_resources};
}

}  // namespace comrad::scenarios::foraging_commons
