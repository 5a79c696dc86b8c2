#include "scenarios/platform_chain/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <cstdio>

#include "doomgen/layout/picture.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::platform_chain {
namespace {

using namespace doomgen;  // NOLINT: a recipe is written in its words

constexpr int32_t kColumns = 12, kSize = 112, kCeiling = 2048, kLavaFloor = -96, kBasinHalf = 1750;
constexpr int32_t kFirstPlatformTag = 8000, kFirstBridgeTag = 8200, kLavaTag = 900;
constexpr int32_t kBridgeWidth = 36, kBridgeRise = 4, kFirstBridge = 6, kBridgePeriod = 4;
constexpr int32_t kSpacingMin = 140, kSpacingMax = 188;  // of the parameter; of the published curriculum
constexpr int32_t kPanelLength = 56, kPanelDepth = 20, kPanelGap = 10;
constexpr int kBarSegments = 20, kSegmentPitch = 5, kSegmentHeight = 6;  // of a screen of 320x240

/// The tether's bar as a picture for each colour and number of lit segments.
std::vector<NamedBytes> bar_pictures() {
  constexpr Colour kUnlit{40, 40, 40}, kNone{0, 0, 0, 0};
  constexpr std::pair<const char*, Colour> kStates[] = {
      {"PCCALM", {48, 224, 48}}, {"PCWARN", {255, 208, 48}}, {"PCHOT", {255, 32, 32}}};
  std::vector<NamedBytes> pictures;
  for (const auto& [state, colour] : kStates)
    for (int filled = 0; filled <= kBarSegments; ++filled) {
      Picture bar(kBarSegments * kSegmentPitch, kSegmentHeight, kNone);
      for (int y = 0; y < bar.height; ++y)
        for (int x = 0; x < bar.width; ++x)
          if (x % kSegmentPitch != kSegmentPitch - 1)
            bar.at(x, y) = x / kSegmentPitch < filled ? colour : kUnlit;
      char name[9];
      std::snprintf(name, sizeof(name), "%s%02d", state, filled);
      pictures.push_back({name, encode_png(bar)});
    }
  return pictures;
}

/// What the seed varies where `variety` is 1; as published otherwise.
struct Variety {
  int32_t columns = kColumns;
  std::vector<int32_t> column_x, row_y;  ///< of the platforms' centres
  int32_t first_bridge = kFirstBridge, bridge_period = kBridgePeriod;
  Polygon basin = Box::around({0, 0}, 2 * kBasinHalf, 2 * kBasinHalf).polygon();
  int32_t lava_floor = kLavaFloor, platform_light = 208, lava_light = 196;
  const char* floor = "FLOOR4_8";
  const char* sides = "METAL2";
  const char* ceiling = "RROCK16";
};

/// Columns are as far apart in every row, and rows in every column, so that panels swing through gaps alone.
Variety draw_variety(const LayoutDraw& wanted) {
  Variety drawn;
  const int32_t levels = wanted.value32("levels"), spacing = wanted.value32("spacing");
  const bool varies = wanted.value("variety") != 0;
  Rng shape(wanted.key.split("shape")), look(wanted.key.split("look"));
  if (varies) drawn.columns = shape.between(10, 14);
  const int32_t rows = (levels + drawn.columns - 1) / drawn.columns;
  const auto places = [&](int32_t count) {
    std::vector<int32_t> place{0};
    for (int32_t i = 1; i < count; ++i) {
      const int32_t gap = varies ? std::clamp(spacing + stepped(-12, 8, 2, shape), kSpacingMin,
                                              std::max(spacing, kSpacingMax))
                                 : spacing;
      place.push_back(place.back() + gap);
    }
    const int32_t middle = place.back() / 2;
    for (int32_t& one : place) one -= middle;
    return place;
  };
  drawn.column_x = places(drawn.columns);
  drawn.row_y = places(rows);
  if (!varies) return drawn;
  drawn.first_bridge = shape.between(5, 8);
  drawn.bridge_period = shape.between(3, 5);
  drawn.basin = bent_box(Box::around({0, 0}, 2 * kBasinHalf, 2 * kBasinHalf), 5, 200, 64, shape);
  drawn.lava_floor = stepped(-128, -80, 8, shape);
  drawn.platform_light = stepped(176, 240, 8, look);
  drawn.lava_light = stepped(176, 224, 8, look);
  // Not the ones of lifts, crushers, bridges and lava.
  constexpr const char* kFloors[] = {"FLOOR4_8", "FLOOR5_1", "FLAT5_4", "MFLR8_1",
                                     "FLAT1",    "FLAT19",   "RROCK10"};
  constexpr const char* kSides[] = {"METAL2", "METAL1", "STONE2", "BROWN96", "GRAY5", "BSTONE1", "ROCK2"};
  constexpr const char* kCeilings[] = {"RROCK16", "CEIL5_2", "CEIL3_5", "FLAT10"};
  drawn.floor = one_of(kFloors, look);
  drawn.sides = one_of(kSides, look);
  drawn.ceiling = one_of(kCeilings, look);
  return drawn;
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int32_t levels = wanted.value32("levels"), rise = wanted.value32("step"),
                panels = wanted.value32("panels");
  const Variety variety = draw_variety(wanted);
  const int32_t columns = variety.columns;
  const auto is_turn = [&](int32_t i) { return i % columns == columns - 1; };
  std::vector<Point> centre;
  for (int32_t i = 0; i < levels; ++i) {
    const int32_t row = i / columns, column = row % 2 == 0 ? i % columns : columns - 1 - i % columns;
    centre.push_back({variety.column_x[column], variety.row_y[row]});
  }
  MapPlan plan;
  plan.add_area({.name = "lava",
                 .floor = variety.lava_floor,
                 .ceiling = kCeiling,
                 .floor_texture = "LAVA1",
                 .ceiling_texture = variety.ceiling,
                 .wall_texture = variety.sides,
                 .light = variety.lava_light,
                 .tag = kLavaTag},
                variety.basin);
  for (int32_t i = 0; i < levels; ++i)
    plan.add_area({.name = fmt::format("platform {}", i),
                   .floor = rise * i,
                   .ceiling = kCeiling,
                   .floor_texture = variety.floor,
                   .ceiling_texture = variety.ceiling,
                   .wall_texture = variety.sides,
                   .light = variety.platform_light,
                   .tag = kFirstPlatformTag + i},
                  Box::around(centre[i], kSize, kSize));
  std::vector<int64_t> bridges;
  for (int32_t i = variety.first_bridge; i + 1 < levels; i += variety.bridge_period) {
    if (wanted.value("variety") != 0 && is_turn(i)) continue;
    // From edge to edge; where the way turns the strip runs north.
    const Point a = centre[i], b = centre[i + 1];
    const Box strip = a.y == b.y ? Box{{std::min(a.x, b.x) + kSize / 2, a.y - kBridgeWidth / 2},
                                       {std::max(a.x, b.x) - kSize / 2, a.y + kBridgeWidth / 2}}
                                 : Box{{a.x - kBridgeWidth / 2, a.y + kSize / 2},
                                       {a.x + kBridgeWidth / 2, b.y - kSize / 2}};
    plan.add_area({.name = fmt::format("bridge {}", i),
                   .floor = rise * i + kBridgeRise,
                   .ceiling = kCeiling,
                   .floor_texture = "STEP1",
                   .ceiling_texture = variety.ceiling,
                   .wall_texture = variety.sides,
                   .light = 220,
                   .tag = kFirstBridgeTag + static_cast<int32_t>(bridges.size())},
                  strip);
    bridges.push_back(i);
  }
  std::vector<int64_t> panel_pairs;
  for (int32_t k = 1; k <= panels; ++k) {
    int32_t i = (levels - 1) * k / (panels + 1);
    if (is_turn(i)) --i;  // panels stand between platforms that lie east and west
    const Point a = centre[i], b = centre[i + 1];
    plan.add_polyobject({.number = k,
                         .outline = Box::around({0, 0}, kPanelLength, kPanelDepth).polygon(),
                         .spot = {(a.x + b.x) / 2, a.y + kPanelDepth / 2 + kPanelGap},
                         .wall_texture = "METAL",
                         .floor = variety.lava_floor,
                         .ceiling = kCeiling});
    panel_pairs.push_back(i);
  }
  for (int32_t i = 14; i < levels; i += 7) {
    if (wanted.value("variety") != 0 && (is_turn(i) || is_turn(i - 1))) continue;
    plan.add_thing(
        {.position = {centre[i].x + 18, centre[i].y - 14}, .editor_number = i / 7 % 2 == 0 ? 30 : 31});
  }
  for (int player = 1; player <= 4; ++player) plan.add_start(player, centre[player - 1], 0);

  COMRAD_TRY_ASSIGN(MapData map, plan.build());
  COMRAD_TRY(check_starts(map, 4));
  // Nobody climbs out of the lava, and no gap is a step: every other platform takes a jump.
  const std::vector<Point> starts = start_points(map);
  COMRAD_TRY(check_separated(map, std::span(&starts[0], 1), std::span(&centre[1], 1), "platform 1"));
  std::vector<int64_t> x, y;
  for (const Point& p : centre) x.push_back(p.x), y.push_back(p.y);
  return DrawnLayout{
      .map = std::move(map),
      .defines = {{"PLATFORM_TAG_FIRST", kFirstPlatformTag},
                  {"BRIDGE_TAG_FIRST", kFirstBridgeTag},
                  {"BRIDGES", static_cast<int64_t>(bridges.size())},
                  {"LAVA_TAG", kLavaTag},
                  {"PANELS", panels},
                  {"ROW_LENGTH", columns},
                  {"PLATFORM_HALF", kSize / 2}},
      .arrays = {{"platform_x", x}, {"platform_y", y}, {"bridge_from", bridges}, {"panel_pair", panel_pairs}},
      .textures = bar_pictures()};
}

/// The published twelve stages. The first four are made by their own generator there, whose numbers of
/// platforms and safe platforms are not known; here they are short chains with a long safe beginning.
CurriculumRecipe curriculum() {
  return {.parameters = {"levels", "step", "spacing", "panels", "safe_min", "safe_max", "tether", "lava"},
          .stages = {{"easy_intro", 42, {24, 10, 168, 2, 8, 8, 300, 20}},
                     {"easy_movers", 43, {24, 10, 176, 4, 8, 8, 285, 30}},
                     {"easy_spacing", 44, {24, 11, 180, 6, 8, 8, 270, 40}},
                     {"easy_mastery", 45, {24, 12, 184, 8, 8, 8, 250, 50}},
                     {"bridge_intro", 42, {24, 10, 172, 4, 6, 6, 290, 25}},
                     {"bridge_progress", 43, {28, 11, 176, 6, 5, 5, 275, 35}},
                     {"bridge_mastery", 44, {32, 12, 180, 6, 4, 4, 260, 45}},
                     {"hard_intro", 42, {40, 11, 176, 6, 4, 4, 265, 35}},
                     {"hard_default", 42, {}},
                     {"hard_tighter", 43, {48, 12, 182, 8, 2, 2, 240, 50}},
                     {"hard_extended", 44, {56, 12, 184, 10, 2, 2, 230, 60}},
                     {"hard_endgame", 45, {60, 13, 188, 12, 1, 1, 220, 70}}}};
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = {{"levels", 48, 6, 96, "platforms (axis: 36, 48, 60)"},
                         {"spacing", 180, 140, 240,
                          "units from one platform's centre to the next one's (168 to 188)"},
                         {"step", 12, 0, 20, "units that each platform rises (10 to 13)"},
                         {"tether", 250, 150, 1000, "length of the tether, units (axis: 220, 250, 280)"},
                         {"lava", 50, 1, 1000, "damage of the lava; every tic from 50 on (axis: 35, 50, 70)"},
                         {"panels", 8, 0, 16, "moving panels (axis: 4, 12)"},
                         {"safe_min", 1, 0, 96, "static platforms at the beginning, at least (axis: 1, 4)"},
                         {"safe_max", 3, 0, 96, "and at most (axis: 1, 4)"},
                         variety_parameter("1: length of rows, distances, bridges, outline of the lava, "
                                           "textures and light come from the seed (pools set it)")},
          .draw = draw,
          .axes = {{"levels", {{{"levels", 36}}, {{"levels", 48}}, {{"levels", 60}}}},
                   {"safe", {{{"safe_min", 1}, {"safe_max", 1}}, {{"safe_min", 4}, {"safe_max", 4}}}},
                   {"tether", {{{"tether", 220}}, {{"tether", 250}}, {{"tether", 280}}}},
                   {"lava", {{{"lava", 35}}, {{"lava", 50}}, {{"lava", 70}}}},
                   {"panels", {{{"panels", 4}}, {{"panels", 12}}}}},
          .pool_values = {{"variety", 1}},
          .curriculum = curriculum(),
          .ceiling = [](const LayoutTask& task) { return static_cast<double>(task.value("levels") - 1); }};
}

}  // namespace comrad::scenarios::platform_chain
