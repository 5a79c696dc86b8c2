#include "sim_workers/engine/render/painter_drawer.h"

#include <algorithm>

namespace comrad::doom {

PainterDrawer::PainterDrawer(const RenderOptions& options, const Projection& projection,
                             const ArtAtlas* atlas, ColorTables* colors)
    : painter_(projection, atlas),
      colors_(*colors),
      plane_(static_cast<std::size_t>(options.width) * static_cast<std::size_t>(options.height)),
      indices_(static_cast<std::size_t>(projection.width) * static_cast<std::size_t>(projection.rows)),
      subjects_(indices_.size()) {}

void PainterDrawer::finish(std::size_t, int palette, Sight sight, uint8_t* destination) {
  const DrawList& list = *drawn_;
  painter_.paint(list, colors_.light_rows(sight, std::span(list.tints).first(list.tint_count)),
                 list.has_blended ? &colors_.mixer() : nullptr, indices_.data());
  show_indices(indices_, colors_.lit(palette), plane_, destination);
}

int PainterDrawer::undrawn_pixels() {
  constexpr uint32_t kNothing = UINT32_MAX;
  painter_.paint_subjects(*drawn_, kNothing, subjects_.data());
  return static_cast<int>(std::ranges::count(subjects_, kNothing));
}

}  // namespace comrad::doom
