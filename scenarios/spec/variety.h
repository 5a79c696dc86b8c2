// What several recipes share: what they draw where their parameter `variety` is 1 (looks and bent outlines) and
// the jagged outlines of `organic`. Published maps have 0 of both; pools set `variety`
// (LayoutRecipe::pool_values), so every map can be drawn again from its parameters and its seed.
#pragma once

#include <algorithm>
#include <span>

#include "doomgen/layout/geometry.h"
#include "doomgen/layout/map_plan.h"
#include "rollout_buffer/core/rng.h"
#include "scenarios/spec/layout_recipe.h"

namespace comrad::scenarios {

/// The parameter; `what` describes what the seed varies.
constexpr LayoutParameter variety_parameter(const char* what) { return {"variety", 0, 0, 1, what, true}; }

/// The parameter of recipes that were published with walls along the cells of a random field.
constexpr LayoutParameter organic_parameter() {
  return {"organic", 0, 0, 1, "1: walls follow random cells, jagged, instead of straight lines", true};
}

/// Gives the plan jagged outlines where `organic` is 1; before its first question.
inline void use_organic_outlines(doomgen::MapPlan& plan, const LayoutDraw& draw, const doomgen::Box& bounds,
                                 int cell_count) {
  if (draw.value("organic") != 0) plan.use_organic_outlines(bounds, cell_count, draw.key.split("outlines"));
}

/// A uniform one of several names.
inline const char* one_of(std::span<const char* const> names, Rng& rng) {
  return names[rng.below(static_cast<uint32_t>(names.size()))];
}

/// A uniform multiple of `step` in [low, high]; low must be one.
inline int32_t stepped(int32_t low, int32_t high, int32_t step, Rng& rng) {
  return low + step * rng.between(0, (high - low) / step);
}

/// A box whose sides are bent: every side has `bends` corners, each moved across it by up to `in`
/// units inwards or `out` outwards; the box's corners stay. Bends must lie further apart than `in`.
inline doomgen::Polygon bent_box(const doomgen::Box& box, int bends, int32_t in, int32_t out, Rng& rng) {
  const doomgen::Polygon corners = box.polygon();
  doomgen::Polygon outline;
  for (std::size_t side = 0; side < corners.size(); ++side) {
    const doomgen::Point a = corners[side], b = corners[(side + 1) % corners.size()];
    outline.push_back(a);
    for (int i = 1; i <= bends; ++i) {
      const int32_t inwards = rng.between(-out, in);
      // Counter-clockwise: inwards is to the left.
      const int32_t dx = (b.x > a.x) - (b.x < a.x), dy = (b.y > a.y) - (b.y < a.y);
      outline.push_back({a.x + (b.x - a.x) / (bends + 1) * i - dy * inwards,
                         a.y + (b.y - a.y) / (bends + 1) * i + dx * inwards});
    }
  }
  return outline;
}

}  // namespace comrad::scenarios
