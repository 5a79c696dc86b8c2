#include "scenarios/lava_pit/layout.h"

#include <spdlog/fmt/fmt.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <string>

#include "doomgen/layout/map_checks.h"
#include "doomgen/layout/map_plan.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/variety.h"

namespace comrad::scenarios::lava_pit {
namespace {

using doomgen::AreaId;
using doomgen::Box;
using doomgen::MapPlan;
using doomgen::Point;

constexpr int32_t kSea = 560, kDepth = -80, kCeiling = 512;
constexpr int32_t kFirstJitter = 24;          // of platforms reached by bootstrap bridges
constexpr int32_t kBridgeMargin = 4;          // between a plate and the bridge's end on the platform
constexpr int32_t kDropToCentre = 64;         // from a plate's centre to any drop
constexpr int32_t kWayMin = 64;               // common width of a bridge and its platforms
constexpr int kFieldCellsPerPlatform = 1000;  // of organic outlines
constexpr int64_t kLengthMax = 44'000;

std::vector<LayoutParameter> parameters() {
  return {
      {"platforms", 12, 2, 60, "platforms of the chain; bridges are one fewer (axis: 10, 12, 14)"},
      {"width_min", 360, 256, 1024, "length of a platform along the chain, units"},
      {"width_max", 460, 256, 1024, "the same, at most"},
      {"depth_min", 240, 208, 1024, "width of a platform across the chain, units"},
      {"depth_max", 320, 208, 1024, "the same, at most"},
      {"gap_min", 260, kGapMin, 800, "edge to edge, units"},
      {"gap_max", 360, kGapMin, 800, "the same, at most"},
      {"jitter", 48, 0, 200, "sideways step from platform to platform, at most, units"},
      {"lateral", 360, 0, 2000, "how far the chain strays to either side, units"},
      {"amplitude", 220, 0, 1000, "of the wave that the chain follows, units"},
      {"waves", 1, 0, 8, "how many waves"},
      {"bootstrap", 3, 1, 8, "easy first bridges: one plate each, at its outer end"},
      {"first_width", 560, 256, 1024, "the first two platforms are at least so long, units"},
      {"first_depth", 360, 208, 1024, "and so wide"},
      {"first_gap", 240, kGapMin, 800, "the first gap is so wide at most, units"},
      {"plate_scale", 190, 100, 300, "size of the first bridge's plates, hundredths"},
      {"latch", 105, 0, 3500, "tics that the first bridge stays up after its plates are left"},
      {"damage", 100, 1, 1000, "of the lava, every tic where 50 or more (axis: 60, 100, 140)"},
      {"script_jitter", 0, 0, 70,
       "extra tics between the script's looks at the plates, at most (axis: 0, 20)"},
      organic_parameter(),
  };
}

Error refused(const std::string& what) { return Error{ErrorCode::kBadInput, "lava_pit: " + what}; }

struct Platform {
  Point centre;
  int32_t width = 0, depth = 0;
  Box box() const { return Box::around(centre, width, depth); }
};

/// sin(2 pi numerator / denominator) times amplitude, from whole numbers: the same on every machine.
int32_t wave(int32_t amplitude, int64_t numerator, int64_t denominator) {
  return doomgen::polar_point(amplitude, numerator, denominator).y;
}

/// value x s^exponent for s = numerator / denominator, kept within low..1. Long chains only.
int32_t shrunk(int32_t value, int64_t numerator, int64_t denominator, double exponent, double low) {
  if (numerator >= denominator) return value;
  const double scale = std::pow(static_cast<double>(numerator) / static_cast<double>(denominator), exponent);
  return static_cast<int32_t>(std::floor(value * std::clamp(scale, low, 1.0) + 1e-9));
}

/// Where a plate of that side may lie on a platform, as offsets from its centre; those of red plates
/// are mirrored.
std::vector<Point> candidates(const Platform& platform, int32_t side, bool bootstrap) {
  const int32_t inner = side / 2 + 8;
  const int32_t outer = platform.width / 2 - std::max(side / 2 + kBridgeBite + kBridgeMargin, kDropToCentre);
  std::vector<int32_t> columns;
  if (bootstrap)
    columns = {outer};
  else if (outer - inner >= side)
    columns = {inner, outer};
  else
    columns = {(inner + outer) / 2};
  const int32_t row_max = platform.depth / 2 - std::max(side / 2 + 12, kDropToCentre);
  const int32_t row = std::min(row_max, std::max(side / 2 + 4, platform.depth * 18 / 100));
  std::vector<int32_t> rows{0};
  if (!bootstrap && row >= side / 2 + 4) rows = {-row, row};
  std::vector<Point> places;
  for (const int32_t x : columns)
    for (const int32_t y : rows) places.push_back({x, y});
  return places;
}

std::vector<Platform> draw_chain(const LayoutDraw& wanted, std::vector<int32_t>* gaps) {
  const int count = wanted.value32("platforms"), bootstrap = wanted.value32("bootstrap");
  const int64_t longest = int64_t{count} * (wanted.value("width_max") + wanted.value("gap_max"));
  const auto size = [&](const char* name) {
    return shrunk(wanted.value32(name), kLengthMax, longest, 0.55, 0.78);
  };
  const auto lateral = [&](const char* name) {
    return shrunk(wanted.value32(name), kLengthMax, longest, 1.1, 0.45);
  };
  const int32_t gap_low = wanted.value32("gap_min");
  const int32_t gap_high = std::max(gap_low, wanted.value32("gap_max"));

  Rng gap_rng(wanted.key.split("gaps"));
  for (int i = 0; i + 1 < count; ++i)
    gaps->push_back(i < bootstrap ? gap_rng.between(gap_low, std::min(gap_low + 48, gap_high))
                                  : gap_rng.between(gap_low, gap_high));
  if (!gaps->empty()) gaps->front() = std::min(gaps->front(), wanted.value32("first_gap"));
  for (int32_t& gap : *gaps) gap = std::max(kGapMin, shrunk(gap, kLengthMax, longest, 1.6, 0.28));

  Rng size_rng(wanted.key.split("sizes")), side_rng(wanted.key.split("sideways"));
  const int32_t width_low = size("width_min"), width_high = std::max(width_low, size("width_max"));
  const int32_t depth_low = size("depth_min"), depth_high = std::max(depth_low, size("depth_max"));
  std::vector<Platform> chain;
  for (int i = 0; i < count; ++i) {
    Platform p{{0, 0}, size_rng.between(width_low, width_high), size_rng.between(depth_low, depth_high)};
    if (i < 2) {
      p.width = std::max(p.width, wanted.value32("first_width"));
      p.depth = std::max(p.depth, wanted.value32("first_depth"));
    }
    p.width -= p.width % 2, p.depth -= p.depth % 2;  // outlines around a centre of whole units
    if (i > 0) {
      const Platform& before = chain.back();
      const int32_t jitter = i <= bootstrap ? kFirstJitter : lateral("jitter");
      const int32_t curve =
          i <= bootstrap || count < 2 ? 0 : wave(lateral("amplitude"), wanted.value("waves") * i, count - 1);
      p.centre.x = before.centre.x + before.width / 2 + (*gaps)[i - 1] + p.width / 2;
      p.centre.y = (2 * (before.centre.y + side_rng.between(-jitter, jitter)) + curve) / 3;
      p.centre.y = std::clamp(p.centre.y, -lateral("lateral"), lateral("lateral"));
    }
    chain.push_back(p);
  }
  // The chain's box around (0, 0).
  Box box = chain.front().box();
  for (const Platform& p : chain) {
    box.low = {std::min(box.low.x, p.box().low.x), std::min(box.low.y, p.box().low.y)};
    box.high = {std::max(box.high.x, p.box().high.x), std::max(box.high.y, p.box().high.y)};
  }
  for (Platform& p : chain) {
    p.centre.x -= (box.low.x + box.high.x) / 2;
    p.centre.y -= (box.low.y + box.high.y) / 2;
  }
  return chain;
}

Expected<DrawnLayout> draw(const LayoutDraw& wanted) {
  const int count = wanted.value32("platforms"), bootstrap = wanted.value32("bootstrap");
  std::vector<int32_t> gaps;
  const std::vector<Platform> chain = draw_chain(wanted, &gaps);
  Box sea = chain.front().box();
  for (const Platform& p : chain) {
    sea.low = {std::min(sea.low.x, p.box().low.x), std::min(sea.low.y, p.box().low.y)};
    sea.high = {std::max(sea.high.x, p.box().high.x), std::max(sea.high.y, p.box().high.y)};
  }
  if (sea.high.x - sea.low.x > 2 * 15'000) return refused("the chain is too long for a map");

  MapPlan plan;
  const bool organic = wanted.value("organic") != 0;
  use_organic_outlines(plan, wanted, sea.grown(kSea),
                       std::clamp(kFieldCellsPerPlatform * std::min(count, 28), 9'000, 30'000));
  plan.add_area({.name = "lava",
                 .floor = kDepth,
                 .ceiling = kCeiling,
                 .floor_texture = "LAVA1",
                 .ceiling_texture = "CEIL5_2",
                 .wall_texture = "ASHWALL2",
                 .light = 200,
                 .tag = kLavaTag},
                sea.grown(kSea));
  for (int i = 0; i < count; ++i) {
    const bool goal = i + 1 == count;
    plan.add_area({.name = fmt::format("platform {}", i + 1),
                   .ceiling = kCeiling,
                   .floor_texture = goal ? "CEIL5_2" : "FLOOR5_1",
                   .ceiling_texture = "CEIL5_2",
                   .wall_texture = "STARTAN3",
                   .light = goal ? 252 : 232,
                   .tag = kPlatformTag + i,
                   .in_pieces = organic},  // plates may cut off single cells
                  chain[i].box());
  }
  std::vector<Box> bridges;
  for (int i = 0; i + 1 < count; ++i) {
    const Platform &a = chain[i], &b = chain[i + 1];
    const int32_t left = a.box().high.x - kBridgeBite, right = b.box().low.x + kBridgeBite;
    const int32_t middle = (a.centre.y + b.centre.y) / 2;
    const int32_t height = std::max(108, std::abs(a.centre.y - b.centre.y) + 88);
    bridges.push_back({{left, middle - height / 2}, {right, middle - height / 2 + height}});
    // Both ends must be wide enough for a body, and no body may leap over the gap.
    for (const Platform* end : {&a, &b}) {
      const int32_t way = std::min(bridges.back().high.y, end->box().high.y) -
                          std::max(bridges.back().low.y, end->box().low.y);
      if (way < kWayMin) return refused(fmt::format("bridge {} hardly touches its platform", i + 1));
    }
    if (b.box().low.x - a.box().high.x < kGapMin)
      return refused(fmt::format("gap {} could be leapt over", i + 1));
    plan.add_area({.name = fmt::format("bridge {}", i + 1),
                   .floor = kDepth,
                   .ceiling = kCeiling,
                   .floor_texture = "LAVA1",
                   .ceiling_texture = "CEIL5_2",
                   .wall_texture = "STARTAN3",
                   .light = 176,
                   .tag = kBridgeTag + i},
                  bridges.back());
  }

  // Plates: green ones on the near platform's far half, red ones on the far platform's near half.
  DrawnLayout layout;
  std::vector<Point> plates;
  std::vector<int64_t> green_count, red_count, green_x, green_y, red_x, red_y, plate_half;
  for (int i = 0; i + 1 < count; ++i) {
    const Platform &near = chain[i], &far = chain[i + 1];
    int32_t side = count >= 60 ? 72 : 80;
    for (const Platform* p : {&near, &far}) {
      side = std::min({side, p->width / 2 - 8, p->depth - 24});
      if (i == 0)
        side = std::max(side, std::min({80 * wanted.value32("plate_scale") / 100,
                                        std::max(80, std::min(near.width / 2 - 20, near.depth - 24)),
                                        std::max(80, std::min(far.width / 2 - 20, far.depth - 24))}));
    }
    side -= side % 2;
    plate_half.push_back(side / 2);
    for (const bool green : {true, false}) {
      const Platform& p = green ? near : far;
      const std::vector<Point> places = candidates(p, side, i < bootstrap);
      (green ? green_count : red_count).push_back(static_cast<int64_t>(places.size()));
      for (int v = 0; v < kCandidatesMax; ++v) {
        const bool used = v < static_cast<int>(places.size());
        const Point offset = used ? places[v] : Point{0, 0};
        const Point centre{p.centre.x + (green ? offset.x : -offset.x), p.centre.y + offset.y};
        (green ? green_x : red_x).push_back(centre.x);
        (green ? green_y : red_y).push_back(centre.y);
        if (!used) continue;
        plates.push_back(centre);
        const Box plate = Box::around(centre, side, side);
        const Box field = p.box().grown(-8);
        if (plate.low.x < field.low.x || plate.low.y < field.low.y || plate.high.x > field.high.x ||
            plate.high.y > field.high.y || (green ? plate.low.x < p.centre.x : plate.high.x > p.centre.x))
          return refused(fmt::format("a plate does not lie on its half of platform {}", i + 1));
        const std::string name = fmt::format("{}{}.{}", green ? "green " : "red ", i + 1, v + 1);
        plan.add_area({.name = name,
                       .ceiling = kCeiling,
                       .floor_texture = !green && i + 2 == count ? "CEIL5_2" : "FLOOR5_1",
                       .ceiling_texture = "CEIL5_2",
                       .wall_texture = "STARTAN3",
                       .light = !green && i + 2 == count ? 252 : 232,
                       .tag = (green ? kGreenTag : kRedTag) + kCandidatesMax * i + v},
                      plate);
      }
    }
  }

  const Point home = chain[0].centre;
  const Point starts[] = {{-28, -18}, {28, 18}, {-28, 18}, {28, -18}};
  for (int player = 0; player < 4; ++player) {
    const Point at{home.x + starts[player].x, home.y + starts[player].y};
    const int32_t angle = count > 1 ? doomgen::degrees_towards(at, chain[1].centre) : 0;
    plan.add_start(player + 1, at, angle);
    plan.add_spot(100 + player, at, angle);
  }
  COMRAD_TRY_ASSIGN(layout.map, plan.build());
  COMRAD_TRY(doomgen::check_starts(layout.map, 4));
  // With all bridges up everything can be walked to, with all of them down nothing but the first platform.
  std::vector<int32_t> bridge_tags;
  for (int i = 0; i + 1 < count; ++i) bridge_tags.push_back(kBridgeTag + i);
  std::vector<Point> centres;
  for (const Platform& p : chain) centres.push_back(p.centre);
  const std::vector<Point> from = doomgen::start_points(layout.map);
  const doomgen::MapData crossed = doomgen::with_floors_at(layout.map, bridge_tags, 0);
  COMRAD_TRY(doomgen::check_reaches(crossed, std::span(from.data(), 1), centres, "a platform"));
  COMRAD_TRY(doomgen::check_reaches(crossed, std::span(from.data(), 1), plates, "a plate"));
  COMRAD_TRY(doomgen::check_separated(layout.map, from, std::span(centres).subspan(1), "a platform"));

  std::vector<int64_t> x0, x1, y0, y1, bridge_y0, bridge_y1;
  for (const Platform& p : chain) {
    x0.push_back(p.box().low.x), x1.push_back(p.box().high.x);
    y0.push_back(p.box().low.y), y1.push_back(p.box().high.y);
  }
  for (const Box& bridge : bridges) bridge_y0.push_back(bridge.low.y), bridge_y1.push_back(bridge.high.y);
  layout.defines = {{"PLATFORMS", count},     {"BRIDGES", count - 1},         {"BITE", kBridgeBite},
                    {"LAVA_TAG", kLavaTag},   {"PLATFORM_TAG", kPlatformTag}, {"BRIDGE_TAG", kBridgeTag},
                    {"GREEN_TAG", kGreenTag}, {"RED_TAG", kRedTag},           {"CANDIDATES", kCandidatesMax},
                    {"LAVA_HEIGHT", kDepth}};
  layout.arrays = {{"platform_x0", x0},          {"platform_x1", x1},      {"platform_y0", y0},
                   {"platform_y1", y1},          {"bridge_y0", bridge_y0}, {"bridge_y1", bridge_y1},
                   {"green_count", green_count}, {"red_count", red_count}, {"green_x", green_x},
                   {"green_y", green_y},         {"red_x", red_x},         {"red_y", red_y},
                   {"plate_half", plate_half}};
  return layout;
}

}  // namespace

LayoutRecipe recipe() {
  return {.parameters = parameters(),
          .draw = draw,
          .axes = {{"platforms", {{{"platforms", 10}}, {{"platforms", 12}}, {{"platforms", 14}}}},
                   {"profile",
                    {{{"width_min", 400},
                      {"width_max", 520},
                      {"depth_min", 260},
                      {"depth_max", 340},
                      {"gap_min", 240},
                      {"gap_max", 300}},
                     {{"width_min", 360},
                      {"width_max", 460},
                      {"depth_min", 240},
                      {"depth_max", 320},
                      {"gap_min", 260},
                      {"gap_max", 360}},
                     {{"width_min", 320},
                      {"width_max", 420},
                      {"depth_min", 220},
                      {"depth_max", 300},
                      {"gap_min", 300},
                      {"gap_max", 420}}}},
                   {"curvature",
                    {{{"jitter", 24}, {"lateral", 280}, {"amplitude", 120}, {"waves", 1}},
                     {{"jitter", 48}, {"lateral", 360}, {"amplitude", 220}, {"waves", 1}},
                     {{"jitter", 72}, {"lateral", 440}, {"amplitude", 320}, {"waves", 2}}}},
                   {"bootstrap",
                    {{{"bootstrap", 4},
                      {"first_width", 640},
                      {"first_depth", 400},
                      {"plate_scale", 220},
                      {"latch", 140}},
                     {{"bootstrap", 3},
                      {"first_width", 560},
                      {"first_depth", 360},
                      {"plate_scale", 190},
                      {"latch", 105}},
                     {{"bootstrap", 2},
                      {"first_width", 480},
                      {"first_depth", 320},
                      {"plate_scale", 160},
                      {"latch", 70}}}},
                   {"damage", {{{"damage", 60}}, {{"damage", 100}}, {{"damage", 140}}}},
                   {"script_jitter", {{{"script_jitter", 0}}, {{"script_jitter", 20}}}}},
          .ceiling = [](const LayoutTask& task) { return static_cast<double>(task.value("platforms") - 1); }};
}

}  // namespace comrad::scenarios::lava_pit
