// Views by the painter. Stage: render.
#pragma once

#include <vector>

#include "sim_workers/engine/render/painter.h"
#include "sim_workers/engine/render/view_drawer.h"

namespace comrad::doom {

class PainterDrawer : public ViewDrawer {
 public:
  PainterDrawer(const RenderOptions& options, const Projection& projection, const ArtAtlas* atlas,
                ColorTables* colors);
  void draw(std::span<const DrawList* const> lists) override { drawn_ = lists.front(); }
  void finish(std::size_t place, int palette, Sight sight, uint8_t* destination) override;
  void draw_depth(const DrawList& list, float* depth) override { painter_.paint_depth(list, depth); }
  void draw_subjects(const DrawList& list, uint32_t* subjects) override {
    painter_.paint_subjects(list, kWallSubject, subjects);
  }
  int undrawn_pixels() override;

 private:
  Painter painter_;
  ColorTables& colors_;
  const std::size_t plane_;  // pixels of a whole picture
  const DrawList* drawn_ = nullptr;
  std::vector<uint8_t> indices_;
  std::vector<uint32_t> subjects_;
};

}  // namespace comrad::doom
