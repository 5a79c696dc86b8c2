// What turns lists of strips into pictures: the painter, or OpenGL. Stage: render.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "rollout_buffer/core/expected.h"
#include "sim_workers/engine/render/art_atlas.h"
#include "sim_workers/engine/render/draw_list.h"
#include "sim_workers/engine/render/picture.h"
#include "sim_workers/engine/render/projection.h"

namespace comrad::doom {

class ViewDrawer {
 public:
  /// The one that options.renderer names. `atlas` and `colors` are the renderer's. Errors: kUnsupported where OpenGL lacks what
  /// is needed or the program was built without it.
  static Expected<std::unique_ptr<ViewDrawer>> create(const RenderOptions& options,
                                                      const Projection& projection, ArtAtlas* atlas,
                                                      ColorTables* colors);
  virtual ~ViewDrawer() = default;
  /// How many views are best drawn at once.
  virtual std::size_t capacity() const { return 1; }
  /// Draws views, at most capacity(), all with blended strips or all without. The lists live until their finish().
  virtual void draw(std::span<const DrawList* const> lists) = 0;
  /// The colours of a view of the last draw(), by its place there: `destination` [3, height, width] u8, of which the rows above
  /// the status bar are written.
  virtual void finish(std::size_t place, int palette, Sight sight, uint8_t* destination) = 0;
  /// How far away what a view shows is: `depth` [rows, width], map units; 0 where nothing but sky is.
  virtual void draw_depth(const DrawList& list, float* depth) = 0;
  /// What each pixel of a view is of: `subjects` [rows, width], as Subject counts; walls where nothing is.
  virtual void draw_subjects(const DrawList& list, uint32_t* subjects) = 0;
  /// Pixels of the view finished last that nothing covered.
  virtual int undrawn_pixels() = 0;
  /// What OpenGL complained of since the last call.
  virtual unsigned driver_error() { return 0; }
};

}  // namespace comrad::doom
