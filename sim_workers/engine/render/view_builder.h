// From a world and an eye to a short list of strips: everything that is visible and nearly nothing else. The
// lines that are looked at at all are those of sectors that the eye reaches through openings, window by window,
// so a view costs what is visible. Stage: render.
#pragma once

#include "sim_workers/engine/render/sprites.h"
#include "sim_workers/engine/render/surfaces.h"
#include "sim_workers/engine/render/view_frame.h"
#include "sim_workers/engine/render/visibility.h"

namespace comrad::doom {

class ViewBuilder {
 public:
  ViewBuilder(const Projection& projection, ArtAtlas* atlas) : frame_(projection, atlas) {}
  ViewBuilder(const ViewBuilder&) = delete;  // its parts refer to each other
  ViewBuilder& operator=(const ViewBuilder&) = delete;

  /// Fills `list` with the strips of `view`.
  void build(const SceneView& view, DrawList* list) {
    look(view, list);
    surfaces_.emit();
    list->opaque_end = list->strip_count();
    sprites_.emit();
  }
  /// Only finds out what `view` sees of the map; visibility() returns it.
  void look(const SceneView& view, DrawList* list) {
    frame_.begin(view, list);
    visibility_.look();
  }
  const Visibility& visibility() const { return visibility_; }

 private:
  ViewFrame frame_;
  Visibility visibility_{&frame_};
  Surfaces surfaces_{&frame_, &visibility_};
  Sprites sprites_{&frame_, &visibility_, &surfaces_};
};

}  // namespace comrad::doom
